# SPDX-License-Identifier: Apache-2.0
"""Blocks that rotate with friction, by SciPy between events of its own: shares no code with ours.

The model of docs/explanation/numerics/physics.md in plain NumPy: springs at arms, Coulomb friction
against V = (vx, vy, c omega), c the mean distance of a square's points from its centre.
"""

import numpy as np

from eol_ros.core.physics.scene import Scene
from support.scipy_solver import Event, between_events

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
) -> tuple[np.ndarray, np.ndarray, list[Event]]:
    """Return u (k, n, 2), yaw (k, n) and events."""
    springs, kinetic, spun = Springs(scene), scene.kinetic_force, scene.rotation
    mass, half = springs.mass, 3 * scene.n
    q = np.column_stack([scene.u0, springs.lever * spun.yaw0])
    v = np.column_stack([scene.v0, springs.lever * spun.spin0])
    w = np.sqrt(8 * springs.lattice.k.max() / mass.min())

    def pull(t: float, y: np.ndarray) -> np.ndarray:
        return springs.pull(t, y[:half].reshape(-1, 3))

    def slope(t: float, y: np.ndarray, on: np.ndarray, lead: np.ndarray) -> np.ndarray:
        v = y[half:].reshape(-1, 3)
        size = np.linalg.norm(v, axis=1)[:, None]
        way = np.where(size > 1e-13, v / np.maximum(size, 1e-300), lead)
        rate = (pull(t, y) - kinetic[:, None] * way) / mass
        return np.concatenate([np.where(on[:, None], x, 0.0).ravel() for x in (v, rate)])

    out, events = between_events(
        scene, np.concatenate([q.ravel(), v.ravel()]), times, rtol, CAPTURE_MPS, ARM_S,
        slope=slope, pull=pull, way=lambda i, force: _way(force, mass[i], kinetic[i]),
        longest=lambda on: 0.1 * np.pi / w,
    )  # fmt: skip
    return out[:, :, :2], out[:, :, 2] / springs.lever, events
