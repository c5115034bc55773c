# SPDX-License-Identifier: Apache-2.0
"""Who moves the rim: unattended visitors, and commanded velocities of visitors elsewhere.

A pose of the rim is (x, y, yaw) in metres and radians; a velocity is its rate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eol_ros.core.geometry import PLATFORM_SIDE_M, RIM_SIDE_M

YAW_LIMIT_RAD = 0.25
EASE_S = 0.06  # the rim is heavy: a commanded velocity is reached with this time constant
MAX_SPEED_MPS = 0.35
MAX_YAW_RATE_RADPS = 0.9
MAX_HOLD_S = 1.0
YIELD_S = 20.0  # after the last touch of a person the visitors come back
# Of the visitors: share of push, jerk, circle, rotation and two people; mean speeds, least and most
SHARES = (0.4, 0.2, 0.12, 0.1, 0.18)
PUSH_MPS, JERK_MPS, CIRCLE_MPS = (0.03, 0.065), (0.08, 0.14), (0.05, 0.09)
SHORTEST_S = 0.8
LEFT_S = 0.5  # hands that let go give nothing any more
PAUSE_S = (1.5, 4.5)  # between gestures


def reach_m(yaw: float) -> float:
    """Return how far (m) the rim may stand off centre along x or y and stay on the platform.

    A square of side s rotated by phi spans s (|cos phi| + |sin phi|); at yaw 0 this is RIM_REACH_M.
    """
    span = RIM_SIDE_M * (abs(np.cos(yaw)) + abs(np.sin(yaw)))
    return max(0.0, (PLATFORM_SIDE_M - span) / 2)


def within_reach(pose: np.ndarray) -> np.ndarray:
    """Return the nearest pose that keeps the rim on the platform, shape (3,)."""
    yaw = float(np.clip(pose[2], -YAW_LIMIT_RAD, YAW_LIMIT_RAD))
    reach = reach_m(yaw)
    return np.array([np.clip(pose[0], -reach, reach), np.clip(pose[1], -reach, reach), yaw])


class _Reach(NamedTuple):
    """One hand's way: from `begin_s` to `stop_s` by `move` (3,), and about a circle of `radius`."""

    begin_s: float
    stop_s: float
    move: np.ndarray
    radius: float = 0.0  # m
    heading: float = 0.0  # rad, where on the circle it begins

    def velocity(self, time_s: float) -> np.ndarray:
        """Return the velocity (3,) that this hand gives the rim at `time_s`.

        It has the minimum-jerk speed of a human reach (Flash and Hogan, J. Neurosci. 5, 1985):
        s = 10 r^3 - 15 r^4 + 6 r^5.
        """
        if not self.begin_s < time_s < self.stop_s:
            return np.zeros(3)
        duration = self.stop_s - self.begin_s
        r = (time_s - self.begin_s) / duration
        rate = 30 * r * r * (1 - r) ** 2 / duration
        velocity = self.move * rate
        if self.radius:
            s = r**3 * (10 - 15 * r + 6 * r * r)
            angle = self.heading + 2 * np.pi * s
            speed = 2 * np.pi * rate * self.radius
            velocity[:2] += speed * np.array([-np.sin(angle), np.cos(angle)])
        return velocity


class Visitors:
    """Hands of nobody, gentle and varied: they play while no person does, the same for a seed.

    Gestures with pauses between: a push (slow and far), a jerk (short and quick), a circle, a
    rotation, and two people who begin one after the other and do not quite agree.
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 0x68616E64])
        self._reaches: list[_Reach] = []
        self._next_s: float | None = None  # when the next gesture begins; None: now
        self._gone = np.zeros(3)  # what they had given the rim when they let go,
        self._gone_s = self._back_s = -np.inf  # when that was, and until when they stay away

    def let_go(self, time_s: float, away_s: float) -> None:
        """Take the hands off the rim at `time_s`, until `away_s` later at least."""
        if time_s >= self._back_s:
            self._gone, self._gone_s = self._led(time_s), time_s
            self._reaches, self._next_s = [], None
        self._back_s = max(self._back_s, time_s + away_s)

    def away(self, time_s: float) -> bool:
        """Whether they have let go and are not back yet."""
        return time_s < self._back_s

    def velocity(self, time_s: float, pose: np.ndarray) -> np.ndarray:
        """Return the rim velocity (3,) at `time_s`; `pose` is where the rim stands now.

        Times must not fall; the gestures are drawn as they pass.
        """
        if self.away(time_s):
            gone_s = time_s - self._gone_s
            return self._gone * np.exp(-gone_s / EASE_S) if gone_s < LEFT_S else np.zeros(3)
        if self._next_s is None or time_s >= self._next_s:
            self._begin(time_s if self._next_s is None else self._next_s, pose)
        return self._led(time_s)

    def _led(self, time_s: float) -> np.ndarray:
        return sum((reach.velocity(time_s) for reach in self._reaches), np.zeros(3))

    def _begin(self, begin_s: float, pose: np.ndarray) -> None:
        random = self._random
        kinds = (self._push, self._jerk, self._circle, self._rotate, self._two)
        kind = kinds[random.choice(len(kinds), p=SHARES)] if self._next_s else self._push
        self._reaches = kind(begin_s, pose)
        self._next_s = max(r.stop_s for r in self._reaches) + random.uniform(*PAUSE_S)

    def _push(self, begin_s: float, pose: np.ndarray) -> list[_Reach]:
        target = self._across(pose, 0.10, 0.20, pose[2] * self._random.uniform(0.0, 1.0))
        return [self._reach(begin_s, target - pose, PUSH_MPS)]

    def _jerk(self, begin_s: float, pose: np.ndarray) -> list[_Reach]:
        way = self._way(pose) * self._random.uniform(0.04, 0.09)
        target = within_reach(pose + np.array([*way, 0.0]))
        return [self._reach(begin_s, target - pose, JERK_MPS)]

    def _circle(self, begin_s: float, pose: np.ndarray) -> list[_Reach]:
        target = within_reach(pose * (0.6, 0.6, 0.5))
        heading = np.arctan2(pose[1], pose[0])  # it leads back over the middle
        radius = self._random.uniform(0.04, 0.08)
        return [self._reach(begin_s, target - pose, CIRCLE_MPS, radius, heading)]

    def _rotate(self, begin_s: float, pose: np.ndarray) -> list[_Reach]:
        yaw = -np.sign(pose[2] or 1.0) * self._random.uniform(0.12, 0.24)
        target = within_reach(np.array([pose[0] * 0.5, pose[1] * 0.5, yaw]))
        return [self._reach(begin_s, target - pose, PUSH_MPS)]

    def _two(self, begin_s: float, pose: np.ndarray) -> list[_Reach]:
        """One pushes; the other, at another side, soon pulls another way and rotates the rim."""
        first = self._across(pose, 0.10, 0.18, pose[2]) - pose
        off = self._random.choice((-1.0, 1.0)) * self._random.uniform(np.pi / 3, np.pi)
        way = np.arctan2(first[1], first[0]) + off
        far = self._random.uniform(0.05, 0.12)
        yaw = np.sign(off) * self._random.uniform(0.05, 0.15)
        end = pose + first + np.array([far * np.cos(way), far * np.sin(way), yaw])
        pushed = self._reach(begin_s, first, PUSH_MPS)
        late_s = begin_s + self._random.uniform(0.2, 0.6) * (pushed.stop_s - begin_s)
        return [pushed, self._reach(late_s, within_reach(end) - pose - first, PUSH_MPS)]

    def _reach(
        self,
        begin_s: float,
        move: np.ndarray,
        speed: tuple[float, float],
        radius: float = 0.0,
        heading: float = 0.0,
    ) -> _Reach:
        length = np.hypot(move[0], move[1]) + 0.4 * abs(move[2]) + 2 * np.pi * radius
        duration = max(SHORTEST_S, float(length) / self._random.uniform(*speed))
        return _Reach(begin_s, begin_s + duration, move, radius, heading)

    def _way(self, pose: np.ndarray) -> np.ndarray:
        """Return a direction (2,), back over the middle where the rim stands off it."""
        off = np.hypot(pose[0], pose[1]) > 0.03
        back = np.arctan2(-pose[1], -pose[0]) if off else 0.0
        angle = back + self._random.uniform(-1, 1) * (np.pi / 3 if off else np.pi)
        return np.array([np.cos(angle), np.sin(angle)])

    def _across(self, pose: np.ndarray, near: float, far: float, yaw: float) -> np.ndarray:
        """Return a target across the middle, `near`..`far` from it."""
        x, y = self._way(pose) * self._random.uniform(near, far)
        return within_reach(np.array([x, y, yaw]))


class Commands:
    """Commanded rim velocities: the newest of each source counts, all sources add up."""

    def __init__(self) -> None:
        self.touched_s = -np.inf  # when a hand last moved, or held against, the rim
        self._newest: dict[str, tuple[float, np.ndarray]] = {}

    def take(self, stamp_s: float, source: str, velocity: Sequence[float], hold_s: float) -> None:
        """Hold `velocity` (vx, vy, yaw_rate) of `source` from `stamp_s` for `hold_s`, at most 1 s.

        A command with a value that is not finite is no command and is dropped.
        """
        wanted = np.asarray(velocity, float)
        if np.all(np.isfinite(wanted)) and np.isfinite(hold_s):
            until = stamp_s + min(max(hold_s, 0.0), MAX_HOLD_S)
            self._newest[source] = (until, wanted)
            if wanted.any():
                self.touched_s = stamp_s

    def velocity(self, time_s: float) -> np.ndarray:
        """Return the sum (3,) of what is held at `time_s`, and forget what has expired."""
        self._newest = {k: held for k, held in self._newest.items() if held[0] > time_s}
        return sum((held[1] for held in self._newest.values()), np.zeros(3))


class Rim:
    """The rim's pose under all hands: eased, bounded in speed, kept on the platform."""

    def __init__(self) -> None:
        self.pose = np.zeros(3)
        self.velocity = np.zeros(3)
        self._commanded = np.zeros(3)

    def advance(self, step_s: float, hands: np.ndarray, commanded: np.ndarray) -> None:
        """Move by one step: `hands` and `commanded` are velocities (3,) at its end.

        Afterwards `pose` and `velocity` are the ends of a cubic path through the step.
        """
        self._commanded += (commanded - self._commanded) * -np.expm1(-step_s / EASE_S)
        wanted = hands + self._commanded
        speed = np.hypot(wanted[0], wanted[1])
        if speed > MAX_SPEED_MPS:
            wanted[:2] *= MAX_SPEED_MPS / speed
        wanted[2] = np.clip(wanted[2], -MAX_YAW_RATE_RADPS, MAX_YAW_RATE_RADPS)
        free = self.pose + 0.5 * step_s * (self.velocity + wanted)
        held = within_reach(free)
        self.velocity = np.where(np.abs(held - free) > 1e-12, 0.0, wanted)
        self.pose = held
