# SPDX-License-Identifier: Apache-2.0
"""The latency with which triggers that come late would be in time."""

import math
from collections import deque

import numpy as np

WINDOW = 200  # triggers
RECENT_S = 60.0  # older triggers say nothing about the network as it is now
LATE_SHARE = 0.01  # of triggers that may be late
MARGIN_S = 0.002  # above the latency that sufficed


class Arrivals:
    """The last WINDOW triggers of one kind within RECENT_S; times are s of a steady clock."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    def add(self, now_s: float, needed_s: float) -> None:
        """Note a trigger that was in time with a latency of `needed_s` or more."""
        self._rows.append((now_s, needed_s))

    def remedy_s(self, now_s: float, latency_s: float) -> float | None:
        """Return the latency, whole milliseconds, that would do; None where `latency_s` does.

        It does where at most LATE_SHARE of a full window is late.
        """
        while self._rows and now_s - self._rows[0][0] > RECENT_S:
            self._rows.popleft()
        needed = np.sort([needed_s for _, needed_s in self._rows])
        if len(needed) < WINDOW or np.mean(needed > latency_s) <= LATE_SHARE:
            return None
        enough_s = needed[math.ceil((1 - LATE_SHARE) * WINDOW) - 1] + MARGIN_S
        return math.ceil(1e3 * enough_s) / 1e3
