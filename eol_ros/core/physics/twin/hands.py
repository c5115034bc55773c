# SPDX-License-Identifier: Apache-2.0
"""Who moves the rim: unattended visitors, and commanded velocities of visitors elsewhere.

A pose of the rim is (x, y, yaw) in metres and radians; a velocity is its rate.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.geometry import PLATFORM_SIDE_M, RIM_BAR_M, RIM_SIDE_M
from eol_ros.core.physics.series import entry

VISITORS_YAW_RAD = 0.25  # people may rotate the rim at will: on the platform it fits at any yaw
RIM_KG = 8.0  # a frame of steel tube on four casters; a guess
ROLLING_N = 0.05 * RIM_KG * 9.81  # small casters on grit; a guess
HAND_N = 60.0  # what one hand pulls with at most; 55 N hold all 25 blocks at mu_s 0.9
HAND_NSPM = 1000.0  # how firmly it wants its velocity, N s/m
GYRATION_M = RIM_SIDE_M / math.sqrt(6)  # radius, of a thin square frame
ALIKE = (1.0, 1.0, GYRATION_M)  # m, m, rad into m: the mass is the same in all three
# By how many springs the table resists: ten lie along the way and ten across, where the pre-tension
# leaves a third; in rotation the same forces at the lever arms of the 20 ends.
RESISTS = (40 / 3, 40 / 3, 16.0)
MAX_SPEED_MPS = 0.35
MAX_YAW_RATE_RADPS = 0.9
MAX_HOLD_S = 1.0
YIELD_S = 20.0  # after the last touch of a person the visitors come back
# Of the visitors: share of push, jerk, circle, rotation and two people; mean speeds, least and most
SHARES = (0.4, 0.2, 0.12, 0.1, 0.18)
PUSH_MPS, JERK_MPS, CIRCLE_MPS = (0.03, 0.065), (0.08, 0.14), (0.05, 0.09)
SHORTEST_S = 0.8
HOLD_S = 0.3  # at the end of a gesture
# How fast a hand wants to make up for what the rim stays behind, and what that is at most
FOLLOW_PER_S, FOLLOW_MPS = 6.0, 0.05
PAUSE_S = (1.5, 4.5)  # between gestures

Springs = Callable[[np.ndarray], np.ndarray]


@entry
def reach_m(yaw):
    """Return how far (m) the rim may stand off centre along x or y and stay on the platform.

    A square of side s rotated by phi spans s (|cos phi| + |sin phi|); at yaw 0 this is RIM_REACH_M.
    """
    span = (RIM_SIDE_M + 2 * RIM_BAR_M) * (abs(cos(yaw)) + abs(sin(yaw)))
    return max(0.0, (PLATFORM_SIDE_M - span) / 2)


@entry
def keep_within(pose):
    """Move `pose` (3,) along x and y to the nearest that keeps the rim on the platform."""
    reach = reach_m(pose[2])
    for p in range(2):
        pose[p] = min(max(pose[p], -reach), reach)


@entry
def led(time_s, begin_s, stop_s, move, circle, grip, place, rate):
    """Write the pose (3,) at `time_s` of a hand's way, and its rate; see `Reach`."""
    duration = stop_s - begin_s
    r = min((time_s - begin_s) / duration, 1.0)
    s, fast = r**3 * (10 - 15 * r + 6 * r * r), 30 * r * r * (1 - r) ** 2 / duration
    for p in range(3):
        place[p], rate[p] = grip[p] + s * move[p], fast * move[p]
    radius, heading = circle
    if radius != 0.0:
        angle = heading + 2 * math.pi * s
        x, y = radius * cos(angle), radius * sin(angle)
        place[0] += x - radius * cos(heading)
        place[1] += y - radius * sin(heading)
        rate[0] -= 2 * math.pi * fast * y
        rate[1] += 2 * math.pi * fast * x


@entry
def follow(time_s, pose, begin_s, stop_s, move, circle, grip, place, wanted):
    """Write the velocity (3,) that a hand on its way wants of a rim at `pose`."""
    led(time_s, begin_s, stop_s, move, circle, grip, place, wanted)
    square = 0.0
    for p in range(3):
        place[p] = FOLLOW_PER_S * (place[p] - pose[p])
        square += (ALIKE[p] * place[p]) ** 2
    slack = min(1.0, (stop_s + HOLD_S - time_s) / HOLD_S)
    for p in range(3):
        wanted[p] += place[p] * slack / max(1.0, math.sqrt(square) / FOLLOW_MPS)


@dataclass
class Reach:
    """One hand's way from `begin_s` to `stop_s`: by `move` (3,), and about a circle of `radius`.

    It has the minimum-jerk speed of a human reach (Flash and Hogan, J. Neurosci. 5, 1985),
    s = 10 r^3 - 15 r^4 + 6 r^5. At its end it holds on for HOLD_S and slackens.
    """

    begin_s: float
    stop_s: float
    move: np.ndarray
    radius: float = 0.0  # m
    heading: float = 0.0  # rad, where on the circle it begins
    grip: np.ndarray | None = None  # pose at which it took hold

    def velocity(self, time_s: float, pose: np.ndarray) -> np.ndarray | None:
        """Return the velocity (3,) that this hand wants of a rim at `pose`; None: it is off."""
        if not self.begin_s < time_s < self.stop_s + HOLD_S:
            return None
        if self.grip is None:
            self.grip = pose.copy()
        place, wanted = np.empty(3), np.empty(3)
        follow(time_s, pose, *self._way(), place, wanted)
        return wanted

    def place(self, time_s: float) -> np.ndarray | None:
        """Return the pose (3,) at which this hand wants the rim; None: it is off."""
        if self.grip is None or time_s >= self.stop_s + HOLD_S:
            return None
        place = np.empty(3)
        led(time_s, *self._way(), place, np.empty(3))
        return place

    def _way(self) -> tuple[Any, ...]:
        circle = float(self.radius), float(self.heading)
        return self.begin_s, self.stop_s, self.move, circle, self.grip


def _gently(pose: np.ndarray) -> np.ndarray:
    """Return the nearest pose (3,) to which unattended hands would lead the rim."""
    pose = np.array(pose, float)
    pose[2] = min(max(pose[2], -VISITORS_YAW_RAD), VISITORS_YAW_RAD)
    keep_within(pose)
    return pose


class Visitors:
    """Hands of nobody, gentle and varied: they play while no person does, the same for a seed.

    Gestures with pauses between: a push (slow and far), a jerk (short and quick), a circle, a
    rotation, and two people who begin one after the other and do not quite agree.
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 0x68616E64])
        self.reaches: list[Reach] = []
        self._next_s: float | None = None  # when the next gesture begins; None: now
        self._back_s = -np.inf  # until when they stay away
        # compiles or loads what moves them before the clock runs
        Reach(0.0, 1.0, np.zeros(3)).velocity(0.5, _gently(np.zeros(3)))

    def let_go(self, time_s: float, away_s: float) -> None:
        """Take the hands off the rim at `time_s`, until `away_s` later at least."""
        self.reaches, self._next_s = [], None
        self._back_s = max(self._back_s, time_s + away_s)

    def away(self, time_s: float) -> bool:
        """Whether they have let go and are not back yet."""
        return time_s < self._back_s

    def hands(self, time_s: float, pose: np.ndarray) -> list[np.ndarray]:
        """Return the velocity (3,) that each hand on the rim wants at `time_s`; it is at `pose`.

        Times must not fall; the gestures are drawn as they pass.
        """
        if self.away(time_s):
            return []
        if self._next_s is None or time_s >= self._next_s:
            self._begin(time_s if self._next_s is None else self._next_s, pose)
        wanted = [reach.velocity(time_s, pose) for reach in self.reaches]
        return [velocity for velocity in wanted if velocity is not None]

    def _begin(self, begin_s: float, pose: np.ndarray) -> None:
        random = self._random
        # people may have left it after whole rotations: that is as if there were none
        pose = pose - (0.0, 0.0, 2 * math.pi * round(pose[2] / (2 * math.pi)))
        kinds = (self._push, self._jerk, self._circle, self._rotate, self._two)
        kind = kinds[random.choice(len(kinds), p=SHARES)] if self._next_s else self._push
        self.reaches = kind(begin_s, pose)
        self._next_s = max(r.stop_s for r in self.reaches) + HOLD_S + random.uniform(*PAUSE_S)

    def _push(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        target = self._across(pose, 0.10, 0.20, pose[2] * self._random.uniform(0.0, 1.0))
        return [self._reach(begin_s, target - pose, PUSH_MPS)]

    def _jerk(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        way = self._way(pose) * self._random.uniform(0.04, 0.09)
        target = _gently(pose + np.array([*way, 0.0]))
        return [self._reach(begin_s, target - pose, JERK_MPS)]

    def _circle(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        target = _gently(pose * (0.6, 0.6, 0.5))
        heading = elementary.arctan2(pose[1], pose[0])  # the way back crosses the middle
        radius = self._random.uniform(0.04, 0.08)
        return [self._reach(begin_s, target - pose, CIRCLE_MPS, radius, heading)]

    def _rotate(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        yaw = -np.sign(pose[2] or 1.0) * self._random.uniform(0.12, 0.24)
        target = _gently(np.array([pose[0] * 0.5, pose[1] * 0.5, yaw]))
        return [self._reach(begin_s, target - pose, PUSH_MPS)]

    def _two(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        """One pushes; the other, at another side, soon pulls another way and rotates the rim."""
        first = self._across(pose, 0.10, 0.18, pose[2]) - pose
        off = self._random.choice((-1.0, 1.0)) * self._random.uniform(np.pi / 3, np.pi)
        way = elementary.arctan2(first[1], first[0]) + off
        far = self._random.uniform(0.05, 0.12)
        yaw = np.sign(off) * self._random.uniform(0.05, 0.15)
        end = pose + first + np.array([far * elementary.cos(way), far * elementary.sin(way), yaw])
        pushed = self._reach(begin_s, first, PUSH_MPS)
        late_s = begin_s + self._random.uniform(0.2, 0.6) * (pushed.stop_s - begin_s)
        return [pushed, self._reach(late_s, _gently(end) - pose - first, PUSH_MPS)]

    def _reach(
        self,
        begin_s: float,
        move: np.ndarray,
        speed: tuple[float, float],
        radius: float = 0.0,
        heading: float = 0.0,
    ) -> Reach:
        length = elementary.hypot(move[0], move[1]) + 0.4 * abs(move[2]) + 2 * np.pi * radius
        duration = max(SHORTEST_S, float(length) / self._random.uniform(*speed))
        return Reach(begin_s, begin_s + duration, move, radius, heading)

    def _way(self, pose: np.ndarray) -> np.ndarray:
        """Return a direction (2,), back over the middle where the rim stands off it."""
        off = elementary.hypot(pose[0], pose[1]) > 0.03
        back = elementary.arctan2(-pose[1], -pose[0]) if off else 0.0
        angle = back + self._random.uniform(-1, 1) * (np.pi / 3 if off else np.pi)
        return np.array([elementary.cos(angle), elementary.sin(angle)])

    def _across(self, pose: np.ndarray, near: float, far: float, yaw: float) -> np.ndarray:
        """Return a target across the middle, `near`..`far` from it."""
        x, y = self._way(pose) * self._random.uniform(near, far)
        return _gently(np.array([x, y, yaw]))


class Commands:
    """Commanded rim velocities: one hand for each source, its newest command counts."""

    def __init__(self) -> None:
        self.touched_s = -np.inf  # when a hand last moved the rim, or held against it
        self._newest: dict[str, tuple[float, np.ndarray]] = {}

    def take(self, stamp_s: float, source: str, velocity: Sequence[float], hold_s: float) -> None:
        """Hold `velocity` (vx, vy, yaw_rate) of `source` from `stamp_s` for `hold_s`, at most 1 s.

        Zero takes the hand off. A command with a value that is not finite is no command and is
        dropped.
        """
        wanted = np.asarray(velocity, float)
        if np.all(np.isfinite(wanted)) and np.isfinite(hold_s):
            until = stamp_s + min(max(hold_s, 0.0), MAX_HOLD_S)
            self._newest[source] = (until, wanted)
            if wanted.any():
                self.touched_s = stamp_s

    def hands(self, time_s: float) -> list[np.ndarray]:
        """Return the velocity (3,) that each hand wants at `time_s`; forget what has expired."""
        self._newest = {k: held for k, held in self._newest.items() if held[0] > time_s}
        return [held[1] for held in self._newest.values() if held[1].any()]


@entry
def drag(step_s, wanted, load, resists, pose, velocity, push, pulls, strong, firm):
    """Move `pose` and `velocity` (3,) of the rim by one step under hands and the springs' `load`.

    `wanted` (h, 3) is the velocity that each hand wants, `pulls` (h, 3) and `strong` (h,) take what
    it pulls with, N; `firm` (h,) must be true, and stays so for those that could pull harder still.
    `resists` (3,) is the stiffness of the table, N/m, `push` (3,) is for work. See `Rim`.
    """
    inertia = RIM_KG / step_s
    weak = True
    while weak:
        held = square = 0.0
        for p in range(3):
            push[p] = (inertia - 0.5 * step_s * resists[p]) * velocity[p] * ALIKE[p]
            push[p] += load[p] / ALIKE[p]
        for k in range(len(wanted)):
            held += HAND_NSPM if firm[k] else 0.0
            for p in range(3):
                push[p] += HAND_NSPM * ALIKE[p] * wanted[k, p] if firm[k] else pulls[k, p]
        for p in range(3):
            square += push[p] * push[p]
        left = max(0.0, 1.0 - ROLLING_N / math.sqrt(square))  # they roll, or hold
        for p in range(3):
            push[p] *= left / (inertia + 0.5 * step_s * resists[p] + held)
        weak = False
        for k in range(len(wanted)):
            if firm[k]:
                for p in range(3):
                    pulls[k, p] = HAND_NSPM * (ALIKE[p] * wanted[k, p] - push[p])
                strong[k] = math.sqrt(pulls[k, 0] ** 2 + pulls[k, 1] ** 2 + pulls[k, 2] ** 2)
                if strong[k] > HAND_N:
                    for p in range(3):
                        pulls[k, p] *= HAND_N / strong[k]
                    strong[k], firm[k], weak = HAND_N, False, True
    speed = math.sqrt(push[0] ** 2 + push[1] ** 2)
    slow = min(1.0, MAX_SPEED_MPS / max(speed, 1e-12))
    push[0], push[1] = slow * push[0], slow * push[1]
    push[2] = min(max(push[2] / ALIKE[2], -MAX_YAW_RATE_RADPS), MAX_YAW_RATE_RADPS)
    for p in range(3):
        pose[p] += 0.5 * step_s * (velocity[p] + push[p])
        velocity[p] = pose[p]
    keep_within(pose)
    for p in range(3):
        velocity[p] = 0.0 if abs(pose[p] - velocity[p]) > 1e-12 else push[p]


class Rim:
    """The rim under all hands: a square frame on casters, pulled by its springs and by people.

    A hand wants the rim to go at some velocity, and pulls with HAND_NSPM times what that lacks, at
    most with HAND_N. So hands that agree go at their common speed, and hands that do not stand
    against each other. `springs` gives the force (3,) of the springs on the rim at a pose, N and
    N m, and `stiffness` (N/m) is that of one of them; without them the rim runs free.

    `pose` and `velocity` are (3,), `load` (3,) is what the springs pulled with in the last step,
    `hands_n` how strongly each hand pulled, N.
    """

    def __init__(self, springs: Springs | None = None, stiffness: float = 0.0) -> None:
        self.pose = np.zeros(3)
        self.velocity = np.zeros(3)
        self.load = np.zeros(3)
        self.hands_n = np.zeros(0)
        self._springs, self._resists = springs, tuple(stiffness * share for share in RESISTS)
        self.advance(1.0, [np.zeros(3)])  # stays where it is: compiles or loads the loop

    def advance(self, step_s: float, hands: Sequence[np.ndarray]) -> None:
        """Move by one step under `hands`, the velocity (3,) that each of them wants.

        Implicit in the velocity, so that no step is too long; within it the springs resist as they
        do about the middle. Afterwards `pose` and `velocity` are the ends of a cubic path.
        """
        if self._springs is not None:
            self.load = self._springs(self.pose)
        wanted = np.array(hands, float).reshape(len(hands), 3)
        self.pose, self.velocity = self.pose.copy(), self.velocity.copy()
        self.hands_n = np.empty(len(wanted))
        drag(
            step_s, wanted, self.load, self._resists, self.pose, self.velocity, np.empty(3),
            np.empty_like(wanted), self.hands_n, np.ones(len(wanted), bool),
        )  # fmt: skip
