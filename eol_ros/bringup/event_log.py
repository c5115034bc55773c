# SPDX-License-Identifier: Apache-2.0
"""What is kept of a run in words: a rotated log of every line, and a events for people."""

import datetime
import logging
import logging.handlers
from pathlib import Path

_SIZE = 5_000_000
_FILES = 10


class EventLog:
    """`eol.log`: all that nodes print, 10 files of 5 MB; `events.log`: starts, faults, stops.

    A context manager, which closes both.
    """

    def __init__(self, where: Path):
        self._log = logging.Logger('eol')
        lines = logging.handlers.RotatingFileHandler(
            where / 'eol.log', maxBytes=_SIZE, backupCount=_FILES - 1
        )
        lines.setFormatter(logging.Formatter('%(asctime)s %(message)s'))
        self._log.addHandler(lines)
        self._events = logging.handlers.RotatingFileHandler(
            where / 'events.log', maxBytes=_SIZE, backupCount=1
        )

    def __enter__(self) -> 'EventLog':
        return self

    def __exit__(self, *_: object) -> None:
        for handler in (*self._log.handlers, self._events):
            handler.close()

    def line(self, text: str) -> None:
        """Keep a line that a node printed."""
        self._log.info(text)

    def entry(self, text: str) -> None:
        """Keep what a person would want to read later."""
        now = datetime.datetime.now().strftime('%Y-%m-%d %H:%M:%S')
        self._events.emit(logging.makeLogRecord({'msg': f'{now}  {text}'}))
        self._log.info(text)
