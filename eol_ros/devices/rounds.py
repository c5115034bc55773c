# SPDX-License-Identifier: Apache-2.0
"""Count of completed rounds, by which a worker thread shows that it works."""

import contextlib
from collections.abc import Iterator


class Rounds:
    """Counts rounds of a worker; calling it returns the count, or None while no work is due.

    No work is due before the first round, while the worker waits for work, and after it has ended
    on request.
    """

    def __init__(self) -> None:
        self.count = 0
        self._due = False

    def __call__(self) -> int | None:
        """Return the count, or None while no work is due."""
        return self.count if self._due else None

    def done(self) -> None:
        """End a round and begin the next."""
        self.count += 1
        self._due = True

    def rest(self) -> None:
        """Mark that no work is due until `done` is called again."""
        self._due = False

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Mark that no work is due while the body waits; a round begins after it."""
        self._due = False
        try:
            yield
        finally:
            self.done()
