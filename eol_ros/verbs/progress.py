# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: a bar on a terminal, a line every tenth elsewhere; always on stderr."""

import sys
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

T = TypeVar('T')


def track(items: Iterable[T], words: str, total: float | None = None) -> Iterator[T]:
    """Yield `items` and show how far it has come; `total` where `items` has no length."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import track as bar

        yield from bar(items, words, total=total, console=Console(stderr=True), transient=True)
        return
    tenth = 0
    for count, item in enumerate(items, 1):
        yield item
        if total and int(10 * count / total) > tenth:
            tenth = int(10 * count / total)
            print(f'{words}: {10 * tenth} %', file=sys.stderr, flush=True)
