# SPDX-License-Identifier: Apache-2.0
"""Blocks that rotate with friction, by SciPy between events of its own: shares no code with ours.

The model of docs/explanation/numerics/physics.md in plain NumPy: springs at arms, Coulomb friction
against V = (vx, vy, c omega), c the mean distance of a square's points from its centre.
"""

import numpy as np

from eol_ros.core.physics.scene import Scene
from support.scipy_solver import Event, between_events

LEVER = (np.sqrt(2) + np.arcsinh(1)) / 6  # of the side, by integration over the square


class Springs:
    """The springs of a scene whose blocks rotate."""

    def __init__(self, scene: Scene):
        """Take what forces need."""
        self.scene, self.lattice = scene, scene.lattice
        spun = scene.rotation
        assert spun is not None
        self.lever = LEVER * spun.side_m
        lattice, ends = self.lattice, np.arange(scene.n)[:, None]
        self.mass = np.column_stack(
            [lattice.mass, lattice.mass, lattice.mass * spun.side_m**2 / 6 / self.lever**2]
        )
        self.arm = _complex(spun.arm)
        self.arm_j = np.where(lattice.second < lattice.n, _complex(spun.arm_j), 0.0)
        self.rest, self.unmoved = _complex(lattice.rest), np.zeros(len(lattice.anchors))
        self.here = (lattice.first == ends).astype(float)  # (n, springs)
        self.there = (lattice.second == ends).astype(float)

    def pull(self, t: float, q: np.ndarray) -> np.ndarray:
        """Return force and torque / lever (n, 3) on blocks at q (n, 3): x, y, lever * yaw."""
        lattice, at = self.lattice, _complex(q)
        turned = np.exp(1j * np.concatenate([q[:, 2] / self.lever, self.unmoved]))
        own, tip = self.arm * turned[lattice.first], self.arm_j * turned[lattice.second]
        far = np.concatenate([at, _complex(self.scene.drive.displacement(t, lattice.anchors))])
        d = far[lattice.second] + tip - self.arm_j - at[lattice.first] - own + self.arm
        if lattice.geometric:
            d += self.rest
            f = lattice.k * (1 - lattice.natural / np.abs(d)) * d
        else:
            f = lattice.k * d
        torque = self.here @ (own.conj() * f).imag - self.there @ (tip.conj() * f).imag
        force = (self.here - self.there) @ f
        return np.column_stack([force.real, force.imag, torque / self.lever])


def _complex(places: np.ndarray) -> np.ndarray:
    return places[:, 0] + 1j * places[:, 1]


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
    scene: Scene,
    times: np.ndarray,
    rtol: float = 1e-12,
    capture_mps: float = 1e-7,
    arm_s: float = 1e-6,
) -> tuple[np.ndarray, np.ndarray, list[Event]]:
    """Return u (k, n, 2), yaw (k, n) and events; the options are those of `scipy_run`."""
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
        scene, np.concatenate([q.ravel(), v.ravel()]), times, rtol, capture_mps,
        arm_s,
        slope=slope, pull=pull, way=lambda i, force: _way(force, mass[i], kinetic[i]),
        longest=lambda on: 0.1 * np.pi / w,
    )  # fmt: skip
    return out[:, :, :2], out[:, :, 2] / springs.lever, events
