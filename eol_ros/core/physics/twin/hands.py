# SPDX-License-Identifier: Apache-2.0
"""Who moves the rim: unattended visitors, and commanded velocities of visitors elsewhere.

A pose of the rim is (x, y, yaw) in metres and radians; a velocity is its rate.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.physics.series import entry
from eol_ros.core.table import Table
from eol_ros.settings import TwinSettings

VISITORS_YAW_RAD = 0.25  # further, unattended hands do not rotate the rim
RIM_KG = 8.0  # of the paper's size: a frame of steel tube on four casters; a guess
ROLLING = 0.05  # small casters on grit; a guess
HAND_N = 60.0  # largest pull of one hand; 55 N hold all 25 blocks of 250 g at mu_s 0.9
HAND_NSPM = 1000.0  # how firmly it wants its velocity, N s/m
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
_PAPER = Table()  # the masses, forces and ways of hands here are for it


class Frame(NamedTuple):
    """The rim as hands move it: its outside on its platform, its mass, and how strong hands are.

    `most_yaw` is the largest angle at which the rim still fits on the platform, inf where it fits
    at any. The mass is the same along x, along y and along `gyration_m` times yaw.
    """

    width_m: float
    depth_m: float
    platform_x_m: float
    platform_y_m: float
    most_yaw: float
    gyration_m: float
    kg: float
    strength: float  # factor on the forces of hands, so that they can move all blocks together

    @classmethod
    def of(cls, table: Table, block_kg: float = TwinSettings.block_kg) -> 'Frame':
        """Return the rim of a table."""
        width, depth = table.rim_m()
        size = (width + depth) / sum(_PAPER.rim_m())
        blocks_kg = table.count * block_kg / (_PAPER.count * TwinSettings.block_kg)
        outer, deep = width + 2 * table.rim_width_m, depth + 2 * table.rim_width_m
        x, y = map(float, table.platform_m)
        return cls(
            outer, deep, x, y, min(_most_yaw(outer, deep, x), _most_yaw(deep, outer, y)),
            math.hypot(width, depth) / math.sqrt(12),  # as of a thin plate, a guess; see hands.js
            RIM_KG * size,
            max(1.0, blocks_kg),
        )  # fmt: skip


def _most_yaw(along: float, across: float, platform: float) -> float:
    """Return the angle at which a rectangle spans the platform along an axis; inf: none.

    At phi it spans along cos(phi) + across sin(phi) = d cos(phi - delta), d its diagonal.
    """
    diagonal = math.hypot(along, across)
    if diagonal <= platform:
        return math.inf
    return math.atan2(across, along) - math.acos(platform / diagonal)


def resists(table: Table) -> tuple[float, float, float]:
    """Return the resistance of a table to its rim along x, y and yaw, in springs.

    Springs to the rim resist along their axis, and by a third across it: that is what the paper's
    pre-tension leaves. In rotation the same forces act at their lever arms, where the pre-tension
    also pulls the rim further.
    """
    held, frame = table.grid(table.present), Frame.of(table)
    x, y = table.grid(table.rest.T)
    sides, ends = held[:, [0, -1]], held[[0, -1]]
    torque = np.sum(sides * y[:, [0, -1]] ** 2) + np.sum(ends * x[[0, -1]] ** 2)
    for count, size, gap in zip((sides, ends), table.rim_m(), table.gaps_m, strict=True):
        torque += count.sum() * size / 2 * (size / 2 - gap) / 3
    along_x, along_y = int(sides.sum()), int(ends.sum())
    return along_x + along_y / 3, along_y + along_x / 3, round(float(torque) / frame.gyration_m**2)


@entry
def reach_m(yaw, frame):
    """Return the distances (m) off centre, along x and y, at which the rim stays on the platform.

    A rectangle w x d rotated by phi spans w |cos phi| + d |sin phi| along x.
    """
    c, s = abs(cos(yaw)), abs(sin(yaw))
    wide = frame.width_m * (c + s * (frame.depth_m / frame.width_m))
    deep = frame.depth_m * (c + s * (frame.width_m / frame.depth_m))
    return (
        max(0.0, (frame.platform_x_m - wide) / 2),
        max(0.0, (frame.platform_y_m - deep) / 2),
    )


@entry
def keep_within(pose, frame):
    """Move `pose` (3,) to the nearest that keeps the rim of `frame` on the platform."""
    pose[2] = min(max(pose[2], -frame.most_yaw), frame.most_yaw)
    x, y = reach_m(pose[2], frame)
    pose[0] = min(max(pose[0], -x), x)
    pose[1] = min(max(pose[1], -y), y)


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
def follow(time_s, pose, begin_s, stop_s, move, circle, grip, gyration, place, wanted):
    """Write the velocity (3,) that a hand on its way wants of a rim at `pose`."""
    led(time_s, begin_s, stop_s, move, circle, grip, place, wanted)
    square = 0.0
    for p in range(3):
        place[p] = FOLLOW_PER_S * (place[p] - pose[p])
        square += ((gyration if p == 2 else 1.0) * place[p]) ** 2
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
    gyration_m: float = Frame.of(_PAPER).gyration_m  # of the rim
    grip: np.ndarray | None = None  # pose at which it took hold

    def velocity(self, time_s: float, pose: np.ndarray) -> np.ndarray | None:
        """Return the velocity (3,) that this hand wants of a rim at `pose`; None: it is off."""
        if not self.begin_s < time_s < self.stop_s + HOLD_S:
            return None
        if self.grip is None:
            self.grip = pose.copy()
        place, wanted = np.empty(3), np.empty(3)
        follow(time_s, pose, *self._way(), self.gyration_m, place, wanted)
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


def _gently(pose: np.ndarray, frame: Frame) -> np.ndarray:
    """Return the nearest pose (3,) to which unattended hands would lead the rim."""
    pose = np.array(pose, float)
    pose[2] = min(max(pose[2], -VISITORS_YAW_RAD), VISITORS_YAW_RAD)
    keep_within(pose, frame)
    return pose


class Visitors:
    """Hands of nobody, gentle and varied: they play while no person does, the same for a seed.

    Ways scale with how far the rim can move on its platform; lengths here are for the paper's.
    Gestures with pauses between: a push (slow and far), a jerk (short and quick), a circle, a
    rotation, and two people who begin one after the other and do not quite agree.
    """

    def __init__(self, seed: int, table: Table = Table()) -> None:
        self._random = np.random.default_rng([seed, 0x68616E64])
        self._frame = Frame.of(table)
        self._far = min(table.reach_m) / min(_PAPER.reach_m)
        self.reaches: list[Reach] = []
        self._next_s: float | None = None  # when the next gesture begins; None: now
        self._back_s = -np.inf  # until when they stay away
        # compiles or loads what moves them before the clock runs
        Reach(0.0, 1.0, np.zeros(3)).velocity(0.5, _gently(np.zeros(3), self._frame))

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
        way = self._way(pose) * self._random.uniform(0.04, 0.09) * self._far
        target = _gently(pose + np.array([*way, 0.0]), self._frame)
        return [self._reach(begin_s, target - pose, JERK_MPS)]

    def _circle(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        target = _gently(pose * (0.6, 0.6, 0.5), self._frame)
        heading = elementary.arctan2(pose[1], pose[0])  # the way back crosses the middle
        radius = self._random.uniform(0.04, 0.08) * self._far
        return [self._reach(begin_s, target - pose, CIRCLE_MPS, radius, heading)]

    def _rotate(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        yaw = -np.sign(pose[2] or 1.0) * self._random.uniform(0.12, 0.24)
        target = _gently(np.array([pose[0] * 0.5, pose[1] * 0.5, yaw]), self._frame)
        return [self._reach(begin_s, target - pose, PUSH_MPS)]

    def _two(self, begin_s: float, pose: np.ndarray) -> list[Reach]:
        """One pushes; the other, at another side, soon pulls another way and rotates the rim."""
        first = self._across(pose, 0.10, 0.18, pose[2]) - pose
        off = self._random.choice((-1.0, 1.0)) * self._random.uniform(np.pi / 3, np.pi)
        way = elementary.arctan2(first[1], first[0]) + off
        far = self._random.uniform(0.05, 0.12) * self._far
        yaw = np.sign(off) * self._random.uniform(0.05, 0.15)
        end = pose + first + np.array([far * elementary.cos(way), far * elementary.sin(way), yaw])
        pushed = self._reach(begin_s, first, PUSH_MPS)
        late_s = begin_s + self._random.uniform(0.2, 0.6) * (pushed.stop_s - begin_s)
        return [pushed, self._reach(late_s, _gently(end, self._frame) - pose - first, PUSH_MPS)]

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
        gyration_m = self._frame.gyration_m
        return Reach(begin_s, begin_s + duration, move, radius, heading, gyration_m)

    def _way(self, pose: np.ndarray) -> np.ndarray:
        """Return a direction (2,), back over the middle where the rim stands off it."""
        off = elementary.hypot(pose[0], pose[1]) > 0.03 * self._far
        back = elementary.arctan2(-pose[1], -pose[0]) if off else 0.0
        angle = back + self._random.uniform(-1, 1) * (np.pi / 3 if off else np.pi)
        return np.array([elementary.cos(angle), elementary.sin(angle)])

    def _across(self, pose: np.ndarray, near: float, far: float, yaw: float) -> np.ndarray:
        """Return a target across the middle, `near`..`far` from it."""
        x, y = self._way(pose) * self._random.uniform(near, far) * self._far
        return _gently(np.array([x, y, yaw]), self._frame)


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
def drag(step_s, wanted, load, resists, numbers, pose, velocity, pulls, strong, firm):
    """Move `pose` and `velocity` (3,) of the rim by one step under hands and the springs' `load`.

    `wanted` (h, 3) is the velocity that each hand wants, `pulls` (h + 1, 3) and `strong` (h,) take
    what it pulls with, N, the last row is for work; `firm` (h,) must be true, and stays so for
    those that could pull harder still. `resists` (3,) is the stiffness of the table, N/m. `numbers`
    (8,) is a `Frame`: an array is taken over faster than a tuple. See `Rim`.
    """
    n = numbers
    frame = Frame(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7])
    inertia, push = frame.kg / step_s, pulls[len(wanted)]
    alike = (1.0, 1.0, frame.gyration_m)  # m, m, rad into m: the mass is the same in all three
    rolling_n = ROLLING * frame.kg * 9.81
    hand_n, hand_nspm = HAND_N * frame.strength, HAND_NSPM * frame.strength
    weak = True
    while weak:
        held = square = 0.0
        for p in range(3):
            push[p] = (inertia - 0.5 * step_s * resists[p]) * velocity[p] * alike[p]
            push[p] += load[p] / alike[p]
        for k in range(len(wanted)):
            held += hand_nspm if firm[k] else 0.0
            for p in range(3):
                push[p] += hand_nspm * alike[p] * wanted[k, p] if firm[k] else pulls[k, p]
        for p in range(3):
            square += push[p] * push[p]
        left = max(0.0, 1.0 - rolling_n / math.sqrt(square))  # they roll, or hold
        for p in range(3):
            push[p] *= left / (inertia + 0.5 * step_s * resists[p] + held)
        weak = False
        for k in range(len(wanted)):
            if firm[k]:
                for p in range(3):
                    pulls[k, p] = hand_nspm * (alike[p] * wanted[k, p] - push[p])
                strong[k] = math.sqrt(pulls[k, 0] ** 2 + pulls[k, 1] ** 2 + pulls[k, 2] ** 2)
                if strong[k] > hand_n:
                    for p in range(3):
                        pulls[k, p] *= hand_n / strong[k]
                    strong[k], firm[k], weak = hand_n, False, True
    speed = math.sqrt(push[0] ** 2 + push[1] ** 2)
    slow = min(1.0, MAX_SPEED_MPS / max(speed, 1e-12))
    push[0], push[1] = slow * push[0], slow * push[1]
    push[2] = min(max(push[2] / alike[2], -MAX_YAW_RATE_RADPS), MAX_YAW_RATE_RADPS)
    for p in range(3):
        pose[p] += 0.5 * step_s * (velocity[p] + push[p])
        velocity[p] = pose[p]
    keep_within(pose, frame)
    for p in range(3):
        velocity[p] = 0.0 if abs(pose[p] - velocity[p]) > 1e-12 else push[p]


class Rim:
    """The rim under all hands: a frame on casters, pulled by its springs and by people.

    A hand wants the rim to go at some velocity, and pulls with HAND_NSPM times what that lacks, at
    most with HAND_N, or more where the blocks of the table weigh more than those of the paper. So
    hands that agree go at their common speed, and hands that do not stand against each other.
    `springs` gives the force (3,) of the springs on the rim at a pose, N and N m, and `stiffness`
    (N/m) is that of one of them; without them the rim runs free.

    `pose` and `velocity` are (3,), `load` (3,) is what the springs pulled with in the last step,
    `hands_n` how strongly each hand pulled, N.
    """

    def __init__(
        self,
        springs: Springs | None = None,
        stiffness: float = 0.0,
        table: Table = Table(),
        block_kg: float = TwinSettings.block_kg,
    ) -> None:
        self.pose = np.zeros(3)
        self.velocity = np.zeros(3)
        self.load = np.zeros(3)
        self.hands_n = np.zeros(0)
        self._springs, self._numbers = springs, np.array(Frame.of(table, block_kg))
        self._resists = np.array([stiffness * share for share in resists(table)])
        self.advance(1.0, [np.zeros(3)])  # stays where it is: compiles or loads the loop

    def advance(self, step_s: float, hands: Sequence[np.ndarray]) -> None:
        """Move by one step under `hands`, the velocity (3,) that each of them wants.

        Implicit in the velocity, so that no step is too long; within it the springs resist as they
        do about the middle. Afterwards `pose` and `velocity` are the ends of a cubic path.
        """
        if self._springs is not None:
            self.load = self._springs(self.pose)
        count = len(hands)
        wanted = np.array(hands, float) if count else np.empty((0, 3))
        self.pose, self.velocity = self.pose.copy(), self.velocity.copy()
        self.hands_n = np.empty(count)
        drag(
            step_s, wanted, self.load, self._resists, self._numbers, self.pose, self.velocity,
            np.empty((count + 1, 3)), self.hands_n, np.ones(count, bool),
        )  # fmt: skip
