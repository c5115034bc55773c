# SPDX-License-Identifier: Apache-2.0
"""Blocks that rotate with friction, by SciPy between events of its own: shares no code with ours.

The model of docs/explanation/numerics/physics.md in plain NumPy: springs at arms, Coulomb friction
against V = (vx, vy, c omega), c the mean distance of a square's points from its centre.
"""

import numpy as np

from eol_ros.core.physics.scene import Scene

LEVER = (np.sqrt(2) + np.arcsinh(1)) / 6  # of the side, by integration over the square
CAPTURE_MPS, ARM_S = 1e-7, 1e-6


class Springs:
    """The springs of a scene whose blocks rotate."""

    def __init__(self, scene: Scene):
        """Take what forces need."""
        self.scene, self.lattice = scene, scene.lattice
        spun = scene.rotation
        assert spun is not None
        self.lever = LEVER * spun.side_m
        lattice = self.lattice
        self.inner = lattice.second < lattice.n
        self.mass = np.column_stack(
            [lattice.mass, lattice.mass, lattice.mass * spun.side_m**2 / 6 / self.lever**2]
        )
        self.arm, self.arm_j = spun.arm, np.where(self.inner[:, None], spun.arm_j, 0.0)

    def pull(self, t: float, q: np.ndarray) -> np.ndarray:
        """Return force and torque / lever (n, 3) on blocks at q (n, 3): x, y, lever * yaw."""
        lattice, inner = self.lattice, self.inner
        yaw = q[:, 2] / self.lever
        own = _turned(self.arm, yaw[lattice.first])
        there = np.where(inner, lattice.second, 0)
        tip = _turned(self.arm_j, np.where(inner, yaw[there], 0.0))
        led = self.scene.drive.displacement(t, lattice.anchors)
        far = (
            np.where(
                inner[:, None], q[there, :2], led[np.where(inner, 0, lattice.second - lattice.n)]
            )
            if len(led)
            else q[there, :2]
        )
        moved = far + tip - self.arm_j - q[lattice.first, :2] - own + self.arm
        if lattice.geometric:
            d = moved + lattice.rest
            f = d * (lattice.k * (1 - lattice.natural / np.hypot(*d.T)))[:, None]
        else:
            f = moved * lattice.k[:, None]
        total = np.zeros((lattice.n, 3))
        for ends, arm, force in ((lattice.first, own, f), (there[inner], tip[inner], -f[inner])):
            torque = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
            np.add.at(total, ends, np.column_stack([force, torque / self.lever]))
        return total


def _turned(arm: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]])


def _way(pull: np.ndarray, mass: np.ndarray, kinetic: float) -> np.ndarray:
    """Return the direction in which a block at rest sets off: l m n + F n = pull, |n| = 1, l > 0.

    Not along the pull: it is easier, or harder, to rotate than to push.
    """
    from scipy.optimize import brentq

    def off(rate: float) -> float:
        return float(np.linalg.norm(pull / (rate * mass + kinetic))) - 1.0

    most = float(np.linalg.norm(pull)) / mass.min()
    found = pull / (brentq(off, 0.0, most, xtol=1e-300, rtol=1e-15) * mass + kinetic)
    return found / np.linalg.norm(found)


def solve(
    scene: Scene, times: np.ndarray, rtol: float = 1e-12
) -> tuple[np.ndarray, np.ndarray, list[tuple[float, int, int]]]:
    """Return u (k, n, 2), yaw (k, n) and events: when, which block, 1 a break or 0 a stop."""
    from scipy.integrate import solve_ivp

    springs = Springs(scene)
    lattice, mass, n, spun = springs.lattice, springs.mass, scene.n, scene.rotation
    kinetic = lattice.friction
    q = np.column_stack([scene.u0, springs.lever * spun.yaw0])
    v = np.column_stack([scene.v0, springs.lever * spun.spin0])
    on, since, lead = (
        np.any(v != 0, axis=1) | (lattice.static == 0),
        np.full(n, -1.0),
        np.zeros((n, 3)),
    )
    out, events = np.zeros((len(times), n, 3)), []
    y, t, done = np.concatenate([q.ravel(), v.ravel()]), 0.0, 0

    def pull_of(t: float, y: np.ndarray) -> np.ndarray:
        return springs.pull(t, y[: 3 * n].reshape(-1, 3))

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        v = y[3 * n :].reshape(-1, 3)
        size = np.linalg.norm(v, axis=1)[:, None]
        way = np.where(size > 1e-13, v / np.maximum(size, 1e-300), lead)
        rate = (pull_of(t + s, y) - kinetic[:, None] * way) / mass
        return np.concatenate([np.where(on[:, None], x, 0.0).ravel() for x in (v, rate)])

    def breaks(s: float, y: np.ndarray) -> float:
        far = lattice.static - np.linalg.norm(pull_of(t + s, y), axis=1)
        return float(far[~on].min(initial=1.0))

    def stops(s: float, y: np.ndarray) -> float:
        speed = np.linalg.norm(y[3 * n :].reshape(-1, 3), axis=1)
        late = on & (kinetic > 0) & (t + s > since + ARM_S)
        return float((speed - CAPTURE_MPS)[late].min(initial=1.0))

    def set_off(pull: np.ndarray) -> None:
        size = np.linalg.norm(pull, axis=1)
        for i in np.flatnonzero(~on & (size >= lattice.static * (1 - 1e-11)) & (since < t)):
            on[i], since[i] = True, t
            lead[i] = _way(pull[i], mass[i], kinetic[i])
            events.append((t, int(i), 1))

    breaks.terminal = stops.terminal = True
    breaks.direction = stops.direction = -1
    set_off(pull_of(0.0, y))
    w = np.sqrt(8 * lattice.k.max() / mass.min())
    while t < times[-1]:
        run = solve_ivp(
            slope, (0.0, times[-1] - t), y, 'DOP853', rtol=rtol, atol=rtol * 1e-3,
            dense_output=True, events=(breaks, stops), max_step=0.1 * np.pi / w,
        )  # fmt: skip
        end = t + run.t[-1]
        while done < len(times) and times[done] <= end:
            here = run.sol(times[done] - t) if end > t else y
            out[done] = here[: 3 * n].reshape(-1, 3)
            done += 1
        y, t = run.y[:, -1].copy(), end
        v, pull = y[3 * n :].reshape(-1, 3), pull_of(t, y)
        size, speed = np.linalg.norm(pull, axis=1), np.linalg.norm(v, axis=1)
        slow = on & (speed <= CAPTURE_MPS * (1 + 1e-6)) & (t > since + ARM_S) & (kinetic > 0)
        for i in np.flatnonzero(slow):
            v[i] = 0.0
            if size[i] <= lattice.static[i]:
                on[i] = False
                events.append((t, int(i), 0))
            else:
                since[i], lead[i] = t, _way(pull[i], mass[i], kinetic[i])
        set_off(pull)
    out[done:] = y[: 3 * n].reshape(-1, 3)
    return out[:, :, :2], out[:, :, 2] / springs.lever, events
