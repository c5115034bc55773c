# SPDX-License-Identifier: Apache-2.0
"""What is kept of a run in words: a rotated log of every line, and a events for people."""

import contextlib
import datetime
import logging
import logging.handlers
from collections.abc import Callable
from pathlib import Path

_SIZE = 5_000_000
_FILES = 10


class EventLog:
    """`eol.log`: all that nodes print, 10 files of 5 MB; `events.log`: starts, faults, stops.

    A context manager, which closes both. If they cannot be opened, `trouble` says why, and lines go
    to `say`.
    """

    def __init__(self, where: Path, say: Callable[[str], None] = lambda line: None):
        self.trouble, self._say = '', say
        self._log = logging.Logger('eol')
        self._events: logging.Handler = logging.NullHandler()
        try:
            where.mkdir(parents=True, exist_ok=True)
            lines = _File(where / 'eol.log', _FILES - 1)
            lines.setFormatter(logging.Formatter('%(asctime)s %(message)s'))
            self._log.addHandler(lines)
            self._events = _File(where / 'events.log', 1)
        except OSError as error:
            self.trouble = (
                f'{where}: {error.strerror}: no log is written and nothing is remembered; set '
                'EOL_STATE to a folder that can be written'
            )

    def __enter__(self) -> 'EventLog':
        return self

    def __exit__(self, *_: object) -> None:
        for handler in (*self._log.handlers, self._events):
            with contextlib.suppress(OSError):  # a full disk
                handler.close()

    def line(self, text: str, shown: bool = False) -> None:
        """Log a line that a node printed; `shown`: the user has already seen it."""
        self._log.info(text)
        if not self._log.handlers and not shown:
            self._say(text)

    def entry(self, text: str) -> None:
        """Keep what a person would want to read later."""
        now = datetime.datetime.now().strftime('%Y-%m-%d %H:%M:%S')
        self._events.emit(logging.makeLogRecord({'msg': f'{now}  {text}'}))
        self._log.info(text)


class _File(logging.handlers.RotatingFileHandler):
    """A log that a full disk does not stop.

    It counts the lines that are not written, and writes the count when there is room again.
    """

    def __init__(self, path: Path, older: int):
        super().__init__(path, maxBytes=_SIZE, backupCount=older)
        self.lost = 0

    def emit(self, record: logging.LogRecord) -> None:
        before = self.lost
        super().emit(record)
        if before and self.lost == before:
            self.lost = 0
            super().emit(logging.makeLogRecord({'msg': f'({before} lines could not be written)'}))

    def handleError(self, _record: logging.LogRecord) -> None:  # noqa: N802 (of logging)
        """Count a lost line and reopen the file for the next; logging would print a traceback."""
        self.lost += 1
        stream, self.stream = self.stream, None  # its buffer holds the lost line
        if stream:
            with contextlib.suppress(OSError):
                stream.close()
