# SPDX-License-Identifier: Apache-2.0
"""What is kept of a run in words: a rotated log of every line, and a events for people."""

import datetime
import logging
import logging.handlers
from pathlib import Path

from eol_ros.errors import ConfigError

_SIZE = 5_000_000
_FILES = 10


class EventLog:
    """`eol.log`: all that nodes print, 10 files of 5 MB; `events.log`: starts, faults, stops.

    A context manager, which closes both. Raises ConfigError where they cannot be written.
    """

    def __init__(self, where: Path):
        self._log = logging.Logger('eol')
        lines = _opened(where / 'eol.log', _FILES - 1)
        lines.setFormatter(logging.Formatter('%(asctime)s %(message)s'))
        self._log.addHandler(lines)
        self._events = _opened(where / 'events.log', 1)

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


def _opened(path: Path, older: int) -> logging.handlers.RotatingFileHandler:
    try:
        return logging.handlers.RotatingFileHandler(path, maxBytes=_SIZE, backupCount=older)
    except OSError as error:
        raise ConfigError(
            f'{path}: {error.strerror}; set EOL_STATE to a folder that can be written'
        ) from None
