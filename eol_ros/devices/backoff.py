# SPDX-License-Identifier: Apache-2.0
"""Waiting longer after each failure: 1, 2, 4 ... 30 s."""

FIRST_S = 1.0
LONGEST_S = 30.0


class Backoff:
    """The pause before the next try; `succeeded` starts it again."""

    def __init__(self, first_s: float = FIRST_S, longest_s: float = LONGEST_S):
        self._first_s, self._longest_s = first_s, longest_s
        self._next_s = first_s

    def failed(self) -> float:
        """Return how long to wait now, in seconds; twice as long the next time."""
        pause_s = self._next_s
        self._next_s = min(2 * pause_s, self._longest_s)
        return pause_s

    def succeeded(self) -> None:
        """The device works: the next failure is a first one again."""
        self._next_s = self._first_s
