# SPDX-License-Identifier: Apache-2.0
"""The simulated table as the twin runs it: from one image to the next, under a moving rim."""

import numpy as np

from eol_ros.core.geometry import BLOCK_MASS_KG, N_BLOCKS, rest_lattice
from eol_ros.core.physics import builders
from eol_ros.core.physics.drive import POSES, Drive
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.stepping import place_anchors, step_many

STEP_S = 1 / 4000
FRICTION_SPREAD = 0.15  # blocks differ by up to this share, as grit and weights do
OFFSET_M = 0.004  # the blocks are set down by hand


class LiveTable:
    """25 blocks with static and kinetic Coulomb friction, springs, and a rim that is led.

    `x`, `y`, `yaw` (25,) are the block centres (m, rad), `velocity` (25, 3) their rates, and
    `moving` (25,) tells which slide;
    `slips` counts slips begun, `energy_residual` (J) is what the ledger misses since the start.
    """

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng([seed, 0x7461626C])
        share = 1 + FRICTION_SPREAD * random.uniform(-1, 1, N_BLOCKS)
        scene = builders.table(
            {'kind': 'none'},
            0.0,
            mass=BLOCK_MASS_KG,
            geometric=True,
            mu_s=list(builders.MU_STATIC * share),
            mu_k=list(builders.MU_KINETIC * share),
            u0=random.uniform(-OFFSET_M, OFFSET_M, (N_BLOCKS, 2)).tolist(),
        )
        checked = from_mapping(scene)
        self._model = Model.of(checked)
        self._rest = rest_lattice()
        self._ends = np.concatenate([checked.u0, np.zeros_like(self._model.anchors)])
        self._v = checked.v0.copy()
        self._force = np.zeros_like(self._ends)
        self._work = np.zeros(2)
        self._counts = np.zeros(1, np.int64)
        self._log = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int8)
        self._energy0 = self._energy()
        self.moving = np.zeros(N_BLOCKS, bool)
        self.rim_pose = np.zeros(3)
        self._rim_rate = np.zeros(3)
        self._place()

    def advance(self, start_s: float, stop_s: float, pose: np.ndarray, rate: np.ndarray) -> None:
        """Move from `start_s` to `stop_s`; the rim goes to `pose` (3,), arriving at `rate` (3,)."""
        span = stop_s - start_s
        steps = max(1, int(np.ceil(span / STEP_S)))
        rows = np.zeros((2, 4))
        rows[1, 0] = span
        rows[0, 1:], rows[1, 1:] = self.rim_pose, pose
        drive = Drive.through(rows, np.stack([self._rim_rate, rate]))
        m = self._model
        step_many(
            self._ends,
            self._v,
            self.moving,
            self._force,
            self._work,
            self._counts,
            0.0,
            steps,
            span / steps,
            m.n,
            m.first,
            m.second,
            m.k,
            m.natural,
            m.rest,
            m.anchors,
            m.mass,
            m.static,
            m.kinetic,
            m.geometric,
            m.rail,
            m.weakening,
            POSES,
            drive.par,
            drive.knots,
            drive.cubics,
            *self._log,
            0,
        )
        self.rim_pose = np.array(pose, float)
        self._rim_rate = np.array(rate, float)
        self._place()

    @property
    def slips(self) -> int:
        """Slips begun since the start."""
        return int(self._counts[0])

    @property
    def energy_residual(self) -> float:
        """Drive work less friction heat less the change of energy (J) since the start."""
        return float(self._work[0] - self._work[1] - (self._energy() - self._energy0))

    def _energy(self) -> float:
        m = self._model
        d = self._ends[m.second] - self._ends[m.first] + m.rest
        held = 0.5 * np.sum(m.k * (np.hypot(d[:, 0], d[:, 1]) - m.natural) ** 2)
        return float(held + m.kinetic_energy(self._v))

    def _place(self) -> None:
        place_anchors(self._ends, N_BLOCKS, self._model.anchors, *self.rim_pose)
        self.x = self._rest[:, 0] + self._ends[:N_BLOCKS, 0]
        self.y = self._rest[:, 1] + self._ends[:N_BLOCKS, 1]
        self.yaw = np.zeros(N_BLOCKS)
        self.velocity = np.column_stack([self._v, np.zeros(N_BLOCKS)])
