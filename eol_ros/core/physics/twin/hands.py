# SPDX-License-Identifier: Apache-2.0
"""Who moves the rim: unattended visitors, and commanded velocities of visitors elsewhere.

A pose of the rim is (x, y, yaw) in metres and radians; a velocity is its rate.
"""

from collections.abc import Sequence

import numpy as np

from eol_ros.core.geometry import PLATFORM_SIDE_M, RIM_SIDE_M

YAW_LIMIT_RAD = 0.25
EASE_S = 0.06  # the rim is heavy: a commanded velocity is reached with this time constant
MAX_SPEED_MPS = 0.35
MAX_YAW_RATE_RADPS = 0.9
MAX_HOLD_S = 1.0


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


class Visitors:
    """Unattended hands: gestures with pauses between, the same for the same seed.

    A gesture goes from where the rim stands to a target, or along a circle, with the minimum-jerk
    speed of a human reach (Flash and Hogan, J. Neurosci. 5, 1985): s = 10 r^3 - 15 r^4 + 6 r^5.
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 0x68616E64])
        self._begin_s = -np.inf
        self._stop_s = 0.0
        self._pause_s = -np.inf
        self._move = np.zeros(3)
        self._turn = 0.0  # radius of a circling gesture, m
        self._heading = 0.0
        self._count = 0

    def velocity(self, time_s: float, pose: np.ndarray) -> np.ndarray:
        """Return the rim velocity (3,) at `time_s`; `pose` is where the rim stands now.

        Times must not fall; the schedule is drawn as they pass.
        """
        if time_s >= self._pause_s:
            self._next(self._pause_s if self._count else time_s, pose)
        if time_s >= self._stop_s:
            return np.zeros(3)
        duration = self._stop_s - self._begin_s
        r = (time_s - self._begin_s) / duration
        rate = 30 * r * r * (1 - r) ** 2 / duration
        velocity = self._move * rate
        if self._turn:
            s = r**3 * (10 - 15 * r + 6 * r * r)
            angle = self._heading + 2 * np.pi * s
            velocity[0] -= 2 * np.pi * rate * self._turn * np.sin(angle)
            velocity[1] += 2 * np.pi * rate * self._turn * np.cos(angle)
        return velocity

    def _next(self, begin_s: float, pose: np.ndarray) -> None:
        random = self._random
        kind = random.choice(4, p=[0.45, 0.2, 0.2, 0.15]) if self._count else 0
        self._count += 1
        self._turn = 0.0
        if kind == 0:  # push or pull: to the far side of the platform
            target = self._target(pose, 0.14, 0.21, 0.0)
        elif kind == 1:  # a tug: shorter and quicker
            target = self._target(pose, 0.08, 0.13, pose[2])
        elif kind == 2:  # rotate
            yaw = -np.sign(pose[2] or 1.0) * random.uniform(0.12, 0.24)
            target = np.array([pose[0] * 0.5, pose[1] * 0.5, yaw])
        else:  # circle
            target = np.array([pose[0] * 0.6, pose[1] * 0.6, pose[2] * 0.5])
            self._turn = random.uniform(0.05, 0.08)
            self._heading = np.arctan2(-pose[1], -pose[0]) + np.pi
        self._move = within_reach(target) - pose
        length = np.hypot(self._move[0], self._move[1]) + 0.4 * abs(self._move[2])
        length += 2 * np.pi * self._turn
        speed = random.uniform(0.10, 0.16) if kind == 1 else random.uniform(0.055, 0.10)
        self._begin_s = begin_s
        self._stop_s = begin_s + max(0.8, length / speed)
        self._pause_s = self._stop_s + random.uniform(2.0, 4.5)

    def _target(self, pose: np.ndarray, near: float, far: float, yaw: float) -> np.ndarray:
        """Return a target away from where the rim stands, `near`..`far` from the centre."""
        back = np.arctan2(-pose[1], -pose[0]) if np.hypot(pose[0], pose[1]) > 0.03 else 0.0
        spread = np.pi / 3 if np.hypot(pose[0], pose[1]) > 0.03 else np.pi
        angle = back + self._random.uniform(-spread, spread)
        distance = self._random.uniform(near, far)
        return np.array([distance * np.cos(angle), distance * np.sin(angle), yaw])


class Commands:
    """Commanded rim velocities: the newest of each source counts, all sources add up."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[float, np.ndarray]] = {}

    def take(self, stamp_s: float, source: str, velocity: Sequence[float], hold_s: float) -> None:
        """Hold `velocity` (vx, vy, yaw_rate) of `source` from `stamp_s` for `hold_s`, at most 1 s.

        A command with a value that is not finite is no command and is dropped.
        """
        wanted = np.asarray(velocity, float)
        if np.all(np.isfinite(wanted)) and np.isfinite(hold_s):
            until = stamp_s + min(max(hold_s, 0.0), MAX_HOLD_S)
            self._newest[source] = (until, wanted)

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
