# SPDX-License-Identifier: Apache-2.0
"""A thread that ends by an exception ends its process, with one line and an exit code.

Python itself would print the traceback and continue without the thread.
"""

import sys
import textwrap
import threading
import traceback
from collections.abc import Callable
from pathlib import Path

from eol_ros.errors import EolError

_first: EolError | None = None


def install(log: str = 'above', end: Callable[[], object] = lambda: None) -> None:
    """From now on keep the first exception that ends a thread, for `check`.

    `log` is the part of the line that says where the traceback is. That thread calls `end`, which
    can end the process even if the main thread waits for the failed one.
    """

    def hook(what: threading.ExceptHookArgs) -> None:
        global _first
        error, name = what.exc_value, what.thread.name if what.thread else 'a thread'
        if error is None or isinstance(error, SystemExit) or sys.is_finalizing():
            return
        words = ''.join(traceback.format_exception(error))
        print(f'[ERROR] thread {name}:\n{textwrap.indent(words, "  ")}', file=sys.stderr, end='')
        if _first is None:
            _first = _line(name, error, log)
            end()

    global _first
    _first = None
    threading.excepthook = hook


def check() -> None:
    """Raise the exception that ended a thread; the main thread calls it several times a second."""
    if _first is not None:
        raise _first


def _line(name: str, error: BaseException, log: str) -> EolError:
    if isinstance(error, EolError):  # has its own message and exit code
        return error
    last = traceback.extract_tb(error.__traceback__)[-1:]
    place = f' ({Path(last[0].filename).name}:{last[0].lineno})' if last else ''
    what = ' '.join(f'{type(error).__name__}: {error}'.split())
    return EolError(f'thread {name} failed with {what}{place}; its traceback is {log}')
