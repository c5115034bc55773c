# SPDX-License-Identifier: Apache-2.0
"""Two clocks that exchange pings: what the host's clock showed when the board's showed something.

The arithmetic of NTP (RFC 5905, section 8) with one answer stamp: a ping leaves the host at t0, the
board reads it at b, the answer is back at t1. The offset b - (t0 + t1) / 2 is wrong by at most
(t1 - t0) / 2. Quick exchanges say most, so only those near the quickest count; a line through them
takes up the difference in rate between the two crystals.
"""

import math
from collections import deque
from dataclasses import dataclass

WRAP_US = 1 << 32
MAX_RATE = 1e-3  # crystals differ by 1e-4 at the very worst; ten times that is a broken exchange
LINE_SPAN_S = 4.0  # a slope from a shorter time is noise


@dataclass(frozen=True)
class HostTime:
    """A moment on the host's clock and how far it may be off, in seconds."""

    time_s: float
    sigma_s: float


class ClockSync:
    """Turn a board's 32-bit microsecond clock into the host's seconds.

    Feed each answered ping to `add`; `window` of them are kept. A board that restarts (its clock
    jumps by more than any crystal drifts) is noticed, and the past forgotten.
    """

    def __init__(self, window: int = 64):
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=window)
        self._last_us = 0  # unwrapped
        self._origin_s = 0.0  # host time of the first sample: keeps the numbers small
        self._line = (0.0, 0.0, 0.0, 0.0)  # centre, offset there, slope, sigma
        self.restarts = 0

    @property
    def ready(self) -> bool:
        """True as soon as one ping came back."""
        return bool(self._samples)

    @property
    def rate(self) -> float:
        """Return the board's seconds a host's second, less one."""
        return self._line[2]

    def add(self, sent_s: float, board_us: int, received_s: float) -> None:
        """Take in one exchange; one that came back before it was sent is ignored."""
        round_trip = received_s - sent_s
        if round_trip < 0:
            return
        middle = (sent_s + received_s) / 2
        if self._samples:
            unwrapped = self._unwrap(board_us)
            error = unwrapped * 1e-6 - self._board_at(middle)
            since = middle - self._origin_s - self._samples[-1][0]
            if abs(error) > round_trip + 0.05 + MAX_RATE * abs(since):
                self._samples.clear()
                self.restarts += 1
        if not self._samples:
            self._origin_s = middle
            unwrapped = board_us
        self._last_us = unwrapped
        self._samples.append((middle - self._origin_s, unwrapped * 1e-6, round_trip))
        self._fit()

    def to_host(self, board_us: int) -> HostTime:
        """Return the host's time at `board_us`; ValueError before the first exchange.

        `board_us` may lie up to 35 minutes before or after the last exchange.
        """
        if not self.ready:
            raise ValueError('no ping has come back yet: the clocks cannot be compared')
        centre, offset, slope, sigma = self._line
        board_s = self._unwrap(board_us) * 1e-6
        # board = host + offset + slope (host - centre)
        host = (board_s - offset + slope * centre) / (1 + slope)
        return HostTime(self._origin_s + host, sigma)

    def _board_at(self, host_s: float) -> float:
        centre, offset, slope, _ = self._line
        host = host_s - self._origin_s
        return host + offset + slope * (host - centre)

    def _unwrap(self, board_us: int) -> int:
        step = (board_us - self._last_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        return self._last_us + step

    def _fit(self) -> None:
        best = min(trip for _, _, trip in self._samples)
        chosen = [s for s in self._samples if s[2] <= 1.5 * best + 50e-6]
        centre = math.fsum(s[0] for s in chosen) / len(chosen)
        offset = math.fsum(s[1] - s[0] for s in chosen) / len(chosen)
        slope = 0.0
        if chosen[-1][0] - chosen[0][0] >= LINE_SPAN_S:
            spread = math.fsum((s[0] - centre) ** 2 for s in chosen)
            slope = math.fsum((s[0] - centre) * (s[1] - s[0] - offset) for s in chosen) / spread
            slope = min(max(slope, -MAX_RATE), MAX_RATE)
        else:  # too short for a slope: the newest of the good ones stands nearest to now
            centre, offset = chosen[-1][0], chosen[-1][1] - chosen[-1][0]
        self._line = (centre, offset, slope, best / 2)
