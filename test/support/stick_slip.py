# SPDX-License-Identifier: Apache-2.0
"""A small seeded table with known truth, to measure identity and motion by; not the twin.

25 blocks of 0.25 kg with static and kinetic Coulomb friction, tied by springs to each other and to
a square rim that hands push, pull and turn; arms that lie over blocks, lights that are none,
darkness. It shares no code with what it measures, and integrates semi-implicitly with a fixed
small step.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.compiled import njit
from support.paper import BLOCK_MASS_KG, COLS, N_BLOCKS, PITCH_M, ROWS, rest_lattice

SPRING_N_PER_M = 40.0
GRAVITY_MPS2 = 9.81
MU_STATIC = 0.55
MU_DROP = 0.265  # static minus kinetic: 2.6 m/s^2 at the onset of a slip
CONTACT_M = 0.088
CONTACT_N_PER_M = 4000.0


@njit(cache=True)
def _integrate(xy, v, yaw, stuck, onset, end, mu, rim0, rim1, offsets, now, span, steps):
    """Advance all blocks by `span` seconds while the rim goes from rim0 to rim1 (x, y, yaw)."""
    dt = span / steps
    weight = BLOCK_MASS_KG * GRAVITY_MPS2
    for k in range(steps):
        f = (k + 1) / steps
        rx = rim0[0] + f * (rim1[0] - rim0[0])
        ry = rim0[1] + f * (rim1[1] - rim0[1])
        angle = rim0[2] + f * (rim1[2] - rim0[2])
        c = np.cos(angle) * PITCH_M
        s = np.sin(angle) * PITCH_M
        force = np.zeros((N_BLOCKS, 2))
        for i in range(N_BLOCKS):
            row = i // COLS
            column = i % COLS
            for side in range(4):
                dc = 1 if side == 0 else (-1 if side == 1 else 0)
                dr = 1 if side == 2 else (-1 if side == 3 else 0)
                ex = c * dc - s * dr
                ey = s * dc + c * dr
                cc = column + dc
                rr = row + dr
                if 0 <= cc < COLS and 0 <= rr < ROWS:
                    j = rr * COLS + cc
                    ox = xy[j, 0]
                    oy = xy[j, 1]
                else:
                    ox = rx + c * (cc - 2) - s * (rr - 2)
                    oy = ry + s * (cc - 2) + c * (rr - 2)
                force[i, 0] += SPRING_N_PER_M * (ox - xy[i, 0] - ex)
                force[i, 1] += SPRING_N_PER_M * (oy - xy[i, 1] - ey)
        for i in range(N_BLOCKS):
            for j in range(i):
                dx = xy[i, 0] - xy[j, 0]
                dy = xy[i, 1] - xy[j, 1]
                d = np.sqrt(dx * dx + dy * dy)
                if d < CONTACT_M:
                    push = CONTACT_N_PER_M * (CONTACT_M - d) / d
                    force[i, 0] += push * dx
                    force[i, 1] += push * dy
                    force[j, 0] -= push * dx
                    force[j, 1] -= push * dy
        for i in range(N_BLOCKS):
            size = np.sqrt(force[i, 0] ** 2 + force[i, 1] ** 2)
            if stuck[i]:
                if size <= mu[i] * weight:
                    continue
                stuck[i] = False
                onset[i] = now + k * dt
                end[i] = np.inf
                v[i, 0] = 0.0
                v[i, 1] = 0.0
            speed = np.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
            kinetic = (mu[i] - MU_DROP) * weight
            if speed > 1e-9:
                fx = force[i, 0] - kinetic * v[i, 0] / speed
                fy = force[i, 1] - kinetic * v[i, 1] / speed
            else:
                fx = force[i, 0] * (1 - kinetic / size)
                fy = force[i, 1] * (1 - kinetic / size)
            nx = v[i, 0] + dt * fx / BLOCK_MASS_KG
            ny = v[i, 1] + dt * fy / BLOCK_MASS_KG
            if speed > 1e-9 and nx * v[i, 0] + ny * v[i, 1] <= 0 and size <= mu[i] * weight:
                stuck[i] = True
                end[i] = now + (k + 1) * dt
                v[i, 0] = 0.0
                v[i, 1] = 0.0
                continue
            v[i, 0] = nx
            v[i, 1] = ny
            xy[i, 0] += dt * nx
            xy[i, 1] += dt * ny
            turn = min(1.0, 30.0 * dt * np.sqrt(nx * nx + ny * ny))
            yaw[i] += turn * (angle + offsets[i] - yaw[i])


@njit(cache=True)
def _push(rim, speed, want, span):
    """Let hands bring the rim (x, y, yaw) to the speed they want, as far as the table goes."""
    limit = 8.0 * span
    for k in range(3):
        speed[k] += min(max(want[k] - speed[k], -limit), limit)
        rim[k] += speed[k] * span
    for k in range(2):
        if abs(rim[k]) > 0.2:
            rim[k] = min(max(rim[k], -0.2), 0.2)
            speed[k] = want[k] = 0.0


@dataclass
class Moment:
    """The truth of one image: xy (25, 2) m, yaw (25,) rad, stuck (25,), rim (3,), stamp_s."""

    stamp_s: float
    xy: np.ndarray
    yaw: np.ndarray
    stuck: np.ndarray
    rim: np.ndarray


class Table:
    """The moving table; `begun` lists (onset_s, block) of every slip so far, `slips` the ended
    ones.

    rough: 1 for ordinary visitors, more for rougher ones. fine: steps of 0.26 ms, for onset times.
    askew_rad: standard deviation of the yaws at which blocks stand on the lattice.
    """

    def __init__(
        self,
        seed: int,
        fps: float,
        rough: float = 1.0,
        fine: bool = False,
        askew_rad: float = 0.05,
    ):
        self.random = np.random.default_rng(seed)
        self.fps = fps
        self.rough = rough
        self.steps = max(int(round((3840 if fine else 960) / fps)), 1)
        self.xy = rest_lattice()
        self.v = np.zeros((N_BLOCKS, 2))
        self.yaw = np.zeros(N_BLOCKS)
        self.stuck = np.ones(N_BLOCKS, bool)
        self.onset = np.full(N_BLOCKS, -np.inf)
        self.end = np.full(N_BLOCKS, -np.inf)
        self.mu = MU_STATIC * self.random.uniform(0.85, 1.15, N_BLOCKS)
        self.offsets = askew_rad * self.random.normal(0, 1, N_BLOCKS)
        self.rim = np.zeros(3)
        self.rim_speed = np.zeros(3)
        self.want = np.zeros(3)
        self.until_s = 1.0
        self.image = 0
        self.slips: list[tuple[float, float, int, float]] = []  # onset, end, block, distance
        self.begun: list[tuple[float, int]] = []
        self._from = self.xy.copy()

    def step(self) -> Moment:
        """Advance by one image and return its truth."""
        now = self.image / self.fps
        span = 1.0 / self.fps
        before = self.rim.copy()
        self._hands(now, span)
        was = self.stuck.copy()
        old = self.onset.copy()
        start = self.xy.copy()
        _integrate(self.xy, self.v, self.yaw, self.stuck, self.onset, self.end, self.mu, before,
                   self.rim, self.offsets, now, span, self.steps)  # fmt: skip
        for i in np.flatnonzero(self.onset != old):
            self.begun.append((self.onset[i], int(i)))
            if was[i]:
                self._from[i] = start[i]
        for i in np.flatnonzero(self.stuck & (~was | (self.onset != old))):
            far = float(np.hypot(*(self.xy[i] - self._from[i])))
            self.slips.append((self.onset[i], self.end[i], int(i), far))
        self.image += 1
        return Moment(
            self.image / self.fps, self.xy.copy(), self.yaw.copy(), self.stuck.copy(),
            self.rim.copy(),
        )  # fmt: skip

    def _hands(self, now: float, span: float) -> None:
        r = self.random
        if now >= self.until_s:
            self.until_s = now + r.uniform(0.4, 3.0)
            self.want[:] = 0.0
            if r.random() < 0.7:
                speed = self.rough * r.uniform(0.1, 1.0) ** 2
                way = r.uniform(0, 2 * np.pi)
                self.want[:2] = speed * np.cos(way), speed * np.sin(way)
            if r.random() < 0.35:
                self.want[2] = min(self.rough, 1.0) * r.choice([-1, 1]) * r.uniform(0.1, 2.0)
        _push(self.rim, self.rim_speed, self.want, span)


@dataclass
class Detections:
    """What a camera would report: xy (n, 2) m, yaw (n,) rad mod 90 deg, sigma (n,) m, true (n,).

    true: the block behind each light, -1 for none. whole (n,): no arm is near its cover.
    """

    xy: np.ndarray
    yaw: np.ndarray
    sigma: np.ndarray
    true: np.ndarray
    whole: np.ndarray


class Onlooker:
    """Arms, false lights, darkness and noise between the table and the camera."""

    def __init__(
        self,
        seed: int,
        noise_m: float = 40e-6,
        arms: float = 1.0,
        false_per_image: float = 0.3,
        permanent: int = 0,
        losses_per_hour: float = 30.0,
    ):
        self.random = np.random.default_rng([seed, 7])
        self.noise_m = noise_m
        self.arm_rate = 0.9 * arms  # arms that come, per second
        self.false_per_image = false_per_image
        self.permanent = self.random.uniform(-0.5, 0.5, (permanent, 2))
        self.loss_rate = losses_per_hour / 3600.0
        self.dark_until_s = -1.0
        self.arms: list[tuple[float, np.ndarray, np.ndarray, np.ndarray, float]] = []
        self.last_s = 0.0

    def look(self, moment: Moment) -> Detections:
        """Return what is seen of `moment`."""
        r = self.random
        hidden, touched = self._arms(moment)
        shown = np.flatnonzero(~hidden)
        count = r.poisson(self.false_per_image)
        false = np.concatenate([r.uniform(-0.7, 0.7, (count, 2)), self.permanent])
        if moment.stamp_s < self.dark_until_s:
            shown = shown[:0]
            false = false[:0]
        xy = np.concatenate([moment.xy[shown], false])
        xy = xy + r.normal(0, self.noise_m, xy.shape)
        yaw = np.concatenate([moment.yaw[shown], r.uniform(-0.7, 0.7, len(false))])
        yaw = yaw + r.normal(0, 0.001, len(yaw))
        yaw = (yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
        true = np.concatenate([shown, np.full(len(false), -1)])
        order = r.permutation(len(true))
        whole = np.append(~touched, False)[true]
        return Detections(
            xy[order], yaw[order], np.full(len(true), self.noise_m), true[order], whole[order]
        )

    def listen(self, begun: list[tuple[float, int]]) -> list[tuple[float, int]]:
        """Return the taps (stamp_s, block) of slips that began so: 3 % are lost, 8 ms of jitter."""
        r = self.random
        return [(on + r.normal(0, 0.008), b) for on, b in begun if r.random() > 0.03]

    def _arms(self, moment: Moment) -> tuple[np.ndarray, np.ndarray]:
        """Return which blocks (25,) arms hide, and of which they cover any part."""
        r = self.random
        now = moment.stamp_s
        step = now - self.last_s
        self.last_s = now
        if now > self.dark_until_s and r.random() < self.loss_rate * step:
            self.dark_until_s = now + r.uniform(0.5, 3.0)
        if len(self.arms) < 4 and r.random() < self.arm_rate * step:
            way = r.uniform(0, 2 * np.pi)
            shoulder = 0.95 * np.array([np.cos(way), np.sin(way)])
            hand = r.uniform(-0.4, 0.4, 2)
            self.arms.append(
                (
                    now + r.uniform(0.5, 4.0),
                    shoulder,
                    hand,
                    r.normal(0, 0.15, 2),
                    r.uniform(0.04, 0.06),
                )
            )
        hidden, touched = np.zeros((2, N_BLOCKS), bool)
        kept = []
        for until, shoulder, hand, speed, width in self.arms:
            if now > until:
                continue
            hand = hand + speed * step
            _cover(moment.xy, shoulder, hand, width, hidden, touched)
            kept.append((until, shoulder, hand, speed, width))
        self.arms = kept
        return hidden, touched


@njit(cache=True)
def _cover(xy, shoulder, hand, width, hidden, touched):
    """Set which blocks (25,) an arm so wide hides, and of which it covers any part."""
    ax, ay = hand[0] - shoulder[0], hand[1] - shoulder[1]
    length2 = ax * ax + ay * ay
    for i in range(N_BLOCKS):
        dx, dy = xy[i, 0] - shoulder[0], xy[i, 1] - shoulder[1]
        t = min(max((dx * ax + dy * ay) / length2, 0.0), 1.0)
        near = np.hypot(dx - t * ax, dy - t * ay)
        hidden[i] |= near < width + 0.02
        touched[i] |= near < width + 0.06  # half the diagonal of a cover
