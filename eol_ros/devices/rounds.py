# SPDX-License-Identifier: Apache-2.0
"""The count by which a worker thread shows that it works."""

import contextlib
from collections.abc import Iterator


class Rounds:
    """Counts rounds of a worker; calling it returns the count, or None while nothing is due.

    Nothing is due before the first round begins, while the worker waits for something to do, and
    after it has ended as it was told to.
    """

    def __init__(self) -> None:
        self.count = 0
        self._due = False

    def __call__(self) -> int | None:
        """Return the count, or None while nothing is due."""
        return self.count if self._due else None

    def done(self) -> None:
        """A round is completed, and the next one begins."""
        self.count += 1
        self._due = True

    def rest(self) -> None:
        """Nothing is due until `done` is called again."""
        self._due = False

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Nothing is due while the body waits; a round begins after it."""
        self._due = False
        try:
            yield
        finally:
            self.done()
