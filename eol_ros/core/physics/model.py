# SPDX-License-Identifier: Apache-2.0
"""A scene as the flat arrays that the compiled kernels take.

All springs stand in one list: those between blocks first, then those to the rim, whose second end
is point n + a, the a-th anchor.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.lattice import Lattice, Rim, lattice_of, rim_of
from eol_ros.core.physics.scene import Scene


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
    kind: int
    par: np.ndarray
    knots: np.ndarray
    cubics: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> 'Model':
        """Return the arrays of a scene."""
        between, to_frame = scene.between, scene.to_frame
        first = np.concatenate([between.i, to_frame.i])
        second = np.concatenate([between.j, scene.n + np.arange(len(to_frame.i), dtype=np.int64)])
        drive = scene.drive
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
            drive.kind,
            drive.par,
            drive.knots,
            drive.cubics,
        )

    @cached_property
    def lattice(self) -> Lattice:
        """The same for the kernels."""
        return lattice_of(self)

    @cached_property
    def rim(self) -> Rim:
        """The drive for the kernels."""
        return rim_of(self)

    def tension(self, u: np.ndarray, t: float) -> np.ndarray:
        """Return the force (s, 2) N of each spring on its first end, for displacements u (n, 2)."""
        ends = self._ends(u, t)
        d = ends[self.second] - ends[self.first]
        if not self.geometric:
            return self.k[:, None] * d
        d = d + self.rest
        length = np.hypot(d[:, 0], d[:, 1])
        scale = np.divide(self.natural, length, out=np.zeros_like(length), where=length > 0)
        return (self.k * (1 - scale))[:, None] * d

    def force(self, u: np.ndarray, t: float) -> np.ndarray:
        """Return the spring force (n, 2) N on each block."""
        pull = self.tension(u, t)
        total = np.zeros((self.n + len(self.anchors), 2))
        np.add.at(total, self.first, pull)
        np.subtract.at(total, self.second, pull)
        return total[: self.n]

    def elastic_energy(self, u: np.ndarray, t: float) -> float:
        """Return the energy (J) held in the springs."""
        ends = self._ends(u, t)
        d = ends[self.second] - ends[self.first]
        if not self.geometric:
            if self.rail:
                d = d[:, :1]
            return float(0.5 * np.sum(self.k[:, None] * d**2))
        d = d + self.rest
        return float(0.5 * np.sum(self.k * (np.hypot(d[:, 0], d[:, 1]) - self.natural) ** 2))

    def kinetic_energy(self, v: np.ndarray) -> float:
        """Return the energy (J) of motion for velocities v (n, 2)."""
        return float(0.5 * np.sum(self.mass[:, None] * v**2))

    def _ends(self, u: np.ndarray, t: float) -> np.ndarray:
        drive = Drive(self.kind, self.par, self.knots, self.cubics)
        return np.concatenate([u, drive.displacement(t, self.anchors)])
