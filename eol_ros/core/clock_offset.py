# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of two machines that send each other messages.

The arithmetic of NTP (RFC 5905, section 8), on messages that are sent anyway: a message leaves by
the sender's clock and arrives by the receiver's. That difference is delay plus offset one way, and
delay minus offset the other way.
"""

from collections import deque
from typing import NamedTuple

WINDOW = 8  # messages of which the quickest counts
LIMIT_S = 0.002  # a larger offset is an error of the set-up: NTP on a LAN keeps a tenth of it


class OneWay:
    """Smallest difference between arrival and departure of the last messages, in seconds."""

    def __init__(self) -> None:
        self._last: deque[float] = deque(maxlen=WINDOW)

    def add(self, sent_ns: int, received_ns: int) -> float:
        """Take a message in; return the smallest difference."""
        self._last.append((received_ns - sent_ns) * 1e-9)
        return min(self._last)


class Offset(NamedTuple):
    """How far a clock is ahead of another, and the most by which that may be wrong, in seconds."""

    offset_s: float
    error_s: float

    @property
    def matters(self) -> bool:
        """Whether the clocks surely differ by more than LIMIT_S."""
        return abs(self.offset_s) > LIMIT_S + self.error_s


def offset(here_s: float, there_s: float) -> Offset | None:
    """Return how far the clock here is ahead; None if a clock was set within the messages.

    here_s, there_s: differences of messages that arrived here, and there, as `OneWay` has them. The
    offset is wrong by at most half the round trip, as if all delay were in one direction.
    """
    half_trip_s = (here_s + there_s) / 2
    return Offset((here_s - there_s) / 2, half_trip_s) if half_trip_s >= 0 else None
