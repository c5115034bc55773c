# SPDX-License-Identifier: Apache-2.0
"""Median and 99th percentile of what has taken time in the last minute."""

from collections import deque

SPAN_S = 60.0
FOREIGN_S = 10.0  # a stamp further from now is that of another clock


class Latency:
    """Latencies of the last minute."""

    def __init__(self) -> None:
        self._taken: deque[tuple[float, float]] = deque()

    def add(self, now_s: float, latency_s: float) -> None:
        """Take in one latency at `now_s` of the steady clock; that of a foreign stamp is none."""
        if abs(latency_s) < FOREIGN_S:
            self._taken.append((now_s, latency_s))
        while self._taken and now_s - self._taken[0][0] > SPAN_S:
            self._taken.popleft()

    def values(self, now_s: float) -> tuple[float, float] | None:
        """Return p50 and p99 in ms; None where the last minute had none."""
        found = sorted(latency_s for at_s, latency_s in self._taken if now_s - at_s <= SPAN_S)
        if not found:
            return None
        p50, p99 = (found[round(share * (len(found) - 1))] for share in (0.5, 0.99))
        return round(1e3 * p50, 1), round(1e3 * p99, 1)
