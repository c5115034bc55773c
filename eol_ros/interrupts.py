# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM in a command: one ends it in a word and with exit code 0, wherever it is.

Python raises KeyboardInterrupt between any two steps of the main thread, once. While a module is
imported, C code makes an ImportError of it (SciPy); in llvmlite, what two owners share is freed
twice, and the process crashes. So it waits until these are left. Other C code drops it, such as
NumPy while it asks an operand for an attribute, or it comes in a `__del__`, where exceptions are
ignored. So it is raised again until it is on its way.
"""

import _thread
import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

AGAIN_S = 0.02
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_OF_PYTHON = (signal.default_int_handler, signal.SIG_DFL)
# Files of the frames through which Python imports, and of what is not ready for an exception.
_NOT_WITHIN = ('<frozen importlib._bootstrap', f'{os.sep}llvmlite{os.sep}')
_asked = False  # and not caught
_done = False


def install() -> None:
    """End at once from here on; what is ignored, as Ctrl-C of a script's `eol VERB &`, stays so."""
    for number in _SIGNALS:
        if signal.getsignal(number) in _OF_PYTHON:
            signal.signal(number, _end)


def begin() -> None:
    """From here on raise KeyboardInterrupt, as there may be something to put away."""
    _change(_end, interrupt)


def caught() -> None:
    """Tell that KeyboardInterrupt was caught, by who goes on; another Ctrl-C raises it again."""
    global _asked
    _asked = False


def finish() -> None:
    """Let the process come to its end, which is near, with the exit code that it has."""
    global _done
    _done = True
    _change(interrupt, signal.SIG_IGN)  # Python gives up its handlers before it ends


@contextlib.contextmanager
def until_stopped(seconds: float | None = None) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns False after Ctrl-C, SIGTERM or `seconds`."""
    stopping: list[int] = []
    before = {n: signal.signal(n, lambda number, _: stopping.append(number)) for n in _SIGNALS}
    end_s = time.monotonic() + seconds if seconds else float('inf')
    try:
        yield lambda: not stopping and time.monotonic() < end_s
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, if none is on its way; where it would do harm ask for it again."""
    global _asked
    if _done or isinstance(sys.exc_info()[1], KeyboardInterrupt):
        return  # or in a `finally`, whose work shall be done
    _asked = True
    # not a Timer: a handler may interrupt who holds a lock of `threading`
    _thread.start_new_thread(_again, (number,))
    while frame is not None:
        if any(name in frame.f_code.co_filename for name in _NOT_WITHIN):
            return
        frame = frame.f_back
    sys.unraisablehook = _nothing
    raise KeyboardInterrupt


def _again(number: int) -> None:
    time.sleep(AGAIN_S)
    if _asked:
        os.kill(os.getpid(), number)


def _nothing(_what: Any) -> None:
    """Do not print what objects raise in `__del__` that were half made at the interrupt."""


def _change(before: Any, after: Any) -> None:
    for number in _SIGNALS:
        if signal.getsignal(number) is before:
            signal.signal(number, after)


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b'eol: stopped\n')
    os._exit(0)
