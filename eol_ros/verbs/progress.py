# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: a bar on a terminal, a line every tenth elsewhere; always on stderr."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from typing import Any, TypeVar

T = TypeVar('T')
SILENT_S = 5.0  # long work says by then what it is


class Progress:
    """Shows the share done, 0 to 1, with which it is called; silent for `quiet_s`.

    After `SILENT_S` without a word it says what goes on. Close it, or leave its `with`, at the end.
    Within another one, the inner one speaks.
    """

    _active: list['Progress'] = []

    def __init__(self, words: str, quiet_s: float = 1.0):
        self._words, self._tenth = words, 0
        self._begin_s = time.monotonic() + quiet_s
        self._bar: Any = None
        for outer in self._active:
            outer._timer.cancel()
        self._active.append(self)
        self._wait()

    def __enter__(self) -> 'Progress':
        return self

    def __exit__(self, *exc) -> None:
        self.close()

    def _wait(self) -> None:
        self._timer = threading.Timer(SILENT_S, self._still)
        self._timer.daemon = True
        self._timer.start()

    def _still(self) -> None:
        if self._bar is None:
            print(f'{self._words} ...', file=sys.stderr, flush=True)

    def __call__(self, share: float) -> None:
        if share >= 1.0:
            self._timer.cancel()
        if time.monotonic() < self._begin_s:
            return
        if sys.stderr.isatty():
            if self._bar is None:
                from rich.console import Console
                from rich.progress import Progress as Bar

                self._bar = Bar(console=Console(stderr=True), transient=True)
                self._task = self._bar.add_task(self._words, total=1.0)
                self._bar.start()
            self._bar.update(self._task, completed=share)
            if share >= 1.0:
                self.close()
        elif int(10 * share) > self._tenth:
            self._timer.cancel()
            self._tenth = int(10 * share)
            print(f'{self._words}: {10 * self._tenth} %', file=sys.stderr, flush=True)

    def close(self) -> None:
        """Remove the progress bar, say no more."""
        self._timer.cancel()
        if self in self._active:
            self._active.remove(self)
            for outer in self._active[-1:]:
                outer._wait()
        if self._bar is not None:
            self._bar.stop()


def track(items: Iterable[T], words: str, total: float | None = None) -> Iterator[T]:
    """Yield `items` and show how far it has come; `total` where `items` has no length."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with Progress(words, quiet_s=0.0) as progress:
        for count, item in enumerate(items, 1):
            yield item
            if total:
                progress(count / total)
