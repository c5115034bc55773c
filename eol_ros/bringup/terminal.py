# SPDX-License-Identifier: Apache-2.0
"""Lines for the person at the terminal, written by a thread that may be stuck for ever."""

import contextlib
import os
import select
import threading
from collections import deque

LINES = 1000  # kept for a terminal that does not take them
FLUSH_S = 1.0  # at the end, for those that are still to be written


class Terminal:
    """`say` never waits: not for Ctrl-S, not for a pipe that is not read, not for a log service.

    Of more than LINES that wait, the oldest are dropped and counted. A context manager, which gives
    the last lines FLUSH_S; the thread does not keep the process alive.
    """

    def __init__(self, fd: int = 2):
        self._fd = fd
        self._lines: deque[str] = deque(maxlen=LINES)
        self._lost = 0
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name='terminal', daemon=True)

    def __enter__(self) -> 'Terminal':
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(FLUSH_S)

    def say(self, text: str) -> None:
        """Hand a line to the thread."""
        with self._changed:
            self._lost += len(self._lines) == LINES
            self._lines.append(text)
            self._changed.notify()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines or self._ended)
                if not self._lines:
                    return
                text, lost, self._lost = self._lines.popleft(), self._lost, 0
            if lost:
                self._write(f'({lost} lines are not shown here; eol.log has them)')
            self._write(text)

    def _write(self, text: str) -> None:
        """Write by the descriptor: a stuck `sys.stderr` would hold a lock that the exit needs."""
        data = (text + '\n').encode(errors='replace')
        with contextlib.suppress(OSError):  # the terminal has gone; the show goes on
            while data:
                try:
                    data = data[os.write(self._fd, data) :]
                except BlockingIOError:  # somebody has made it non-blocking
                    select.select([], [self._fd], [])
