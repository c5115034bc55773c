# SPDX-License-Identifier: Apache-2.0
"""Recorded time against wall time, from what a replay tells on /clock.

A replay runs at some rate, stands still, jumps back when it loops, and its messages on /clock come
a little late, some more and some less. Between two changes of its pace recorded time is a straight
line over wall time. The slope is that of least squares over the last messages, and of the newest of
them the one that came soonest gives the offset: messages come late, and never early.
"""

from collections import deque

import numpy as np

WINDOW = 64  # messages that the slope rests on, 0.64 s at 100 a second
NEWEST = 5  # messages that the offset rests on: a replay that was held up is followed soon
LINE_NS = 80_000_000  # over a shorter time the lateness of one message would bend the slope
CHANGE_NS = 25_000_000  # so far off the line is another pace, not a late message
AHEAD_NS = 20_000_000  # without a message recorded time is taken to run on for so long, not longer


class PlayedClock:
    """Feed each message on /clock to `take`; all times are whole nanoseconds."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, int]] = deque(maxlen=WINDOW)  # recorded, wall
        self._before: list[tuple[int, int]] = []  # of the stretch before the last change of pace
        self._slope = 1.0  # wall ns for a recorded one
        self._offset_ns = 0.0  # wall time of the newest recorded time, less that of its message
        self._sure = False  # of the slope
        self._known = 1.0  # the slope that was last sure
        self._stands_since_ns: int | None = None  # wall time

    def take(self, recorded_ns: int, wall_ns: int) -> bool:
        """Take note that the replay was at `recorded_ns` at the latest at `wall_ns`.

        Returns whether it has jumped back.
        """
        points = self._points
        last_ns = points[-1][0] if points else recorded_ns
        stands = bool(points) and recorded_ns == last_ns
        if not stands:
            self._stands_since_ns = None
        elif self._stands_since_ns is None:
            self._stands_since_ns = points[-1][1]
        if recorded_ns < last_ns:  # it has begun again: nothing before it holds
            points.clear()
            self._before = []
        elif stands or (len(points) > 1 and abs(wall_ns - self._line(recorded_ns)) > CHANGE_NS):
            self._before = list(points) if len(points) > 1 else self._before
            points.clear()
        points.append((recorded_ns, wall_ns))
        self._fit()
        return recorded_ns < last_ns

    @property
    def stretch(self) -> float:
        """How many times longer a wait is behind a replay that is slower than the run was.

        Whatever took a moment in the run takes so much longer in its replay. 1 where the replay is
        as fast or faster, and before its pace is known. A late message does not change it.
        """
        return max(self._known, 1.0)

    def _fit(self) -> None:
        recorded, wall = self._relative()
        self._sure = bool(wall[-1] - wall[0] >= LINE_NS)
        if self._sure:
            x = recorded - recorded.mean()
            slope = float(x @ (wall - wall.mean()) / (x @ x))
            self._slope = self._known = max(slope, 1e-6)
        elif len(wall) > 1 and recorded[-1] > recorded[0]:
            self._slope = max(float((wall[-1] - wall[0]) / (recorded[-1] - recorded[0])), 1e-6)
        self._offset_ns = float((wall - self._slope * recorded)[-NEWEST:].min())

    def _relative(self) -> tuple[np.ndarray, np.ndarray]:
        """Return recorded and wall times less those of the newest message."""
        points = np.array(self._points, np.int64)
        recorded, wall = (points - points[-1]).astype(float).T
        return recorded, wall

    def _line(self, recorded_ns: int) -> int:
        newest, wall_ns = self._points[-1]
        return wall_ns + round(self._slope * (recorded_ns - newest) + self._offset_ns)

    def wall_ns(self, recorded_ns: int) -> int | None:
        """Return when `recorded_ns` was played, or will be; None where that is not known."""
        if not self._points:
            return None
        if recorded_ns > self._points[0][0] or not self._before:
            return self._line(recorded_ns)
        recorded, wall = np.array(self._before, np.int64).T
        if recorded_ns > recorded[-1]:  # in the moment of the change
            return self._line(recorded_ns)
        at = int(np.searchsorted(recorded, recorded_ns))
        if at == 0:
            return int(wall[0])
        share = (recorded_ns - recorded[at - 1]) / (recorded[at] - recorded[at - 1])
        return int(wall[at - 1]) + round(share * int(wall[at] - wall[at - 1]))

    def recorded_ns(self, wall_ns: int) -> int | None:
        """Return what was being played at `wall_ns`, of now or some moments ago, or None."""
        if not self._points:
            return None
        newest, heard_ns = self._points[-1]
        since_ns = self._stands_since_ns
        if since_ns is not None:
            return newest + round(min(wall_ns - since_ns, 0) / self._slope)
        after_ns = min(wall_ns - heard_ns, AHEAD_NS) - self._offset_ns
        if not self._sure:  # a slope from two messages that came together may be anything
            after_ns = min(after_ns, 0)
        return newest + round(after_ns / self._slope)
