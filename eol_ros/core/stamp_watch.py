# SPDX-License-Identifier: Apache-2.0
"""Has the clock been set? The stamps of a stream against steady time.

Stamps are of the system clock, which NTP or a person may set by any amount. A stream that falls
silent, comes late or comes in a burst is no jump: its stamps never fall back by much, nor run
ahead of the steady time that has passed.
"""

from collections import deque

BACK_S = 0.2  # stamps fall back by less where messages overtake each other
AHEAD_S = 2.0  # a message may have waited so long for a busy reader before the newest did not
LATEST = 700  # stamps: more than a queue keeps (qos.STREAM), which a stall makes late
NS = 1e9
# What is asked between two images counts from this long after the first: less than any camera's
# period, more than a step of seconds since the epoch in double precision.
SOON_NS = 1_000_000


class StampWatch:
    """Feed each stamp of one stream to `take`; all times are whole nanoseconds."""

    def __init__(self, back_s: float = BACK_S, ahead_s: float = AHEAD_S):
        self._back_ns, self._ahead_ns = round(back_s * NS), round(ahead_s * NS)
        self._newest_ns = 0  # stamp
        # Of the last stamps from steady time; the greatest, of the least late, is the offset.
        self._ahead: deque[int] = deque(maxlen=LATEST)

    def take(self, stamp_ns: int, steady_ns: int) -> int:
        """Return by how much time has jumped before `stamp_ns`, heard at `steady_ns`; 0: not."""
        step_ns, ahead_ns = stamp_ns - self._newest_ns, stamp_ns - steady_ns
        jump_ns = ahead_ns - max(self._ahead, default=ahead_ns)
        jumped = bool(self._ahead) and (step_ns < -self._back_ns or jump_ns > self._ahead_ns)
        if jumped:
            self._ahead.clear()
        if jumped or step_ns > 0:
            self._newest_ns = stamp_ns
            self._ahead.append(ahead_ns)
        return jump_ns if jumped else 0
