# SPDX-License-Identifier: Apache-2.0
"""The rate at which a soak's exhibition is played, and counts of what it lost."""

import time
from collections.abc import Callable


class Totals:
    """Counts that begin again, with each bag or with each life of their node, as totals."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._total: dict[str, int] = {}

    def add(self, counts: dict[str, int]) -> dict[str, int]:
        """Take what stands there now; return the totals."""
        for name, now in counts.items():
            last = self._last.get(name, 0)
            self._total[name] = self._total.get(name, 0) + (now - last if now >= last else now)
            self._last[name] = now
        return dict(self._total)


class Rate:
    """The highest rate that the readers keep up with.

    As TCP finds its own (Chiu and Jain 1989): a bit higher as long as nothing is lost, much lower
    when something is; not much higher than what was reached, where the replay waits for its readers
    and the machine is the bound.
    """

    WINDOW_S = 30.0  # what a decision rests on
    MORE, LESS, ABOVE = 1.15, 0.7, 1.25
    LEAST, MOST = 1.0, 100.0

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic):
        self.rate = max(rate, self.LEAST)
        self._clock = clock
        self._since: tuple[float, float, int] | None = None

    def look(self, played_s: float, lost: int) -> float | None:
        """Return the rate to change to, None: none."""
        now_s = self._clock()
        if self._since is None:
            self._since = now_s, played_s, lost
        span_s = now_s - self._since[0]
        if span_s < self.WINDOW_S:
            return None
        reached, more_lost = (played_s - self._since[1]) / span_s, lost > self._since[2]
        self._since = now_s, played_s, lost
        wanted = self.rate * self.LESS if more_lost else self.rate * self.MORE
        wanted = min(max(min(wanted, reached * self.ABOVE), self.LEAST), self.MOST)
        if abs(wanted / self.rate - 1) < 0.05:
            return None
        self.rate = round(wanted, 2)
        return self.rate
