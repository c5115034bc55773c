# SPDX-License-Identifier: Apache-2.0
"""A scene as the flat arrays that the compiled kernels take.

All springs stand in one list: those between blocks first, then those to the rim, whose second end
is point n + a, the a-th anchor.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.scene import Rotation, Scene


@dataclass(frozen=True)
class Model:
    """Springs, friction and drive over plain arrays; see `Scene` for units."""

    n: int
    first: np.ndarray  # (s,) block
    second: np.ndarray  # (s,) block, or n + anchor
    k: np.ndarray
    natural: np.ndarray
    rest: np.ndarray  # (s, 2)
    anchors: np.ndarray  # (a, 2)
    mass: np.ndarray
    static: np.ndarray  # (n,) N
    kinetic: np.ndarray  # (n,) N
    geometric: bool
    rail: bool  # y is held
    weakening: float
    drive: Drive
    rotation: Rotation | None = None

    @classmethod
    def of(cls, scene: Scene) -> 'Model':
        """Return the arrays of a scene."""
        between, to_frame = scene.between, scene.to_frame
        first = np.concatenate([between.i, to_frame.i])
        second = np.concatenate([between.j, scene.n + np.arange(len(to_frame.i), dtype=np.int64)])
        return cls(
            scene.n,
            first,
            second,
            np.concatenate([between.k, to_frame.k]),
            np.concatenate([between.natural, to_frame.natural]),
            np.concatenate([between.rest, to_frame.rest]),
            to_frame.anchor,
            scene.mass,
            scene.static_limit,
            scene.kinetic_force,
            scene.geometric,
            scene.dim1,
            scene.weakening_speed,
            scene.drive,
            scene.rotation,
        )

    @cached_property
    def lattice(self) -> Lattice:
        """The same for the kernels."""
        n = self.n
        rim = self.second >= n
        number = np.arange(len(self.k))
        a, b, k = self.first[~rim], self.second[~rim], self.k[~rim]
        ends, others = np.concatenate([a, b]), np.concatenate([b, a])
        both, spring = np.concatenate([k, k]), np.concatenate([number[~rim], number[~rim]])
        order = np.lexsort((spring, ends))
        rim_block = self.first[rim]
        rim_order = np.argsort(rim_block, kind='stable')
        pulls = self.k[rim, None] * np.column_stack([np.ones(rim.sum()), self.anchors])
        drive = np.zeros((n, 3))
        np.add.at(drive, rim_block, pulls)
        arms = np.hypot(self.anchors[:, 0], self.anchors[:, 1])
        return Lattice(
            n,
            self.first,
            self.second,
            self.k,
            self.natural,
            self.rest,
            self.anchors,
            np.searchsorted(ends[order], np.arange(n + 1)),
            others[order],
            both[order],
            spring[order],
            np.searchsorted(rim_block[rim_order], np.arange(n + 1)),
            number[rim][rim_order],
            np.bincount(ends, both, n) + np.bincount(rim_block, self.k[rim], n),
            drive,
            np.bincount(rim_block, self.k[rim] * arms[self.second[rim] - n], n),
            float(arms.max(initial=0.0)),
            self.mass,
            1.0 / self.mass,
            self.static,
            self.kinetic,
            float(self.weakening),
            bool(self.geometric),
            bool(self.rail),
        )

    def elastic_energy(self, u: np.ndarray, t: float, yaw: np.ndarray | None = None) -> float:
        """Return the energy (J) held in the springs; u (n, 2) m, yaw (n,) rad, at t."""
        d = self._along(u, t, yaw)
        if not self.geometric:
            if self.rail:
                d = d[:, :1]
            return float(0.5 * np.sum(self.k[:, None] * d**2))
        d = d + self.rest
        return float(0.5 * np.sum(self.k * (np.hypot(d[:, 0], d[:, 1]) - self.natural) ** 2))

    def kinetic_energy(self, v: np.ndarray) -> float:
        """Return the energy (J) of motion for velocities v (n, 2)."""
        return float(0.5 * np.sum(self.mass[:, None] * v**2))

    def _along(self, u: np.ndarray, t: float, yaw: np.ndarray | None) -> np.ndarray:
        ends = np.concatenate([u, self.drive.displacement(t, self.anchors)])
        d = ends[self.second] - ends[self.first]
        if yaw is None or self.rotation is None:
            return d
        inner = self.second < self.n
        d -= rotated(self.rotation.arm, yaw[self.first])
        d[inner] += rotated(self.rotation.arm_j[inner], yaw[self.second[inner]])
        return d


def rotated(arm: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Return by how much points `arm` (s, 2) of blocks are displaced by their yaw (s,)."""
    c, s = -2 * np.sin(yaw / 2) ** 2, np.sin(yaw)
    x, y = arm[:, 0], arm[:, 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=1)
