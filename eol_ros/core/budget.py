# SPDX-License-Identifier: Apache-2.0
"""A limit on actions a second: a token bucket of one second."""

import math


class Budget:
    """Allows `per_s` actions a second, and after a second without any that many at once.

    >>> budget = Budget(2.0)
    >>> [budget.take(now_s) for now_s in (0.0, 0.0, 0.0, 0.5)]
    [True, True, False, True]
    """

    def __init__(self, per_s: float):
        self._per_s = self._left = per_s
        self._then_s = -math.inf

    def left(self, now_s: float) -> int:
        """Return how many actions are allowed now."""
        self._left = min(self._left + (now_s - self._then_s) * self._per_s, self._per_s)
        self._then_s = now_s
        return int(self._left)

    def spend(self, count: int) -> None:
        """Count actions against what is left."""
        self._left -= count

    def take(self, now_s: float) -> bool:
        """Return whether one more action is allowed, and count it."""
        allowed = self.left(now_s) >= 1
        self.spend(allowed)
        return allowed
