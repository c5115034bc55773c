# SPDX-License-Identifier: Apache-2.0
"""The live table's solver for blocks that rotate as they slide; imported only where they do."""

import numpy as np

from eol_ros.core.physics.event.solver import rules_for
from eol_ros.core.physics.exact.solver import length_scale
from eol_ros.core.physics.kernel_args import Grid, Log, Rim
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.rotation import kernel
from eol_ros.core.physics.rotation.solver import floor_speed, rotation_args
from eol_ros.core.physics.scene import Scene

# Of the positions, in 9 cm: 0.1 um in a second and a half, a hundredth of what the camera sees.
TOLERANCE = 1e-3
ORDER = 6  # of the series: most steps end at an event or an image, and a higher one is for longer


class Rotating:
    """Steps x, y and yaw of the blocks from image to image.

    `yaw` (n,) and `spin` (n,) are rad and rad/s; `arms` complex, from the centre of a block to
    where its spring to the rim is fixed, in the block's frame.
    """

    def __init__(self, scene: Scene, model: Model, samples: int):
        assert scene.rotation is not None
        self._model, self._args = model, rotation_args(scene)
        self._rules = rules_for(
            TOLERANCE, length_scale(scene, model), ORDER, floor_speed(TOLERANCE)
        )
        self._workspace = kernel.make_workspace(model.lattice, self._args, ORDER)
        self.yaw, self.spin = scene.rotation.yaw0.copy(), scene.rotation.spin0.copy()
        self._q, self._w = np.zeros((model.n, 3)), np.zeros((model.n, 3))
        rows = (samples, model.n, 3)
        self._grid = Grid(np.zeros(samples), np.zeros(rows), np.zeros(rows))

    def solve(
        self,
        u: np.ndarray,
        v: np.ndarray,
        moving: np.ndarray,
        span: float,
        rim: Rim,
        grid: Grid,
        log: Log,
        most_steps: int,
        work_and_heat: np.ndarray,
        counts: np.ndarray,
    ) -> tuple[int, int]:
        """Advance as `event.kernel.run` does; return status and count of events."""
        q, w, lever = self._q, self._w, self._args.lever
        q[:, :2], q[:, 2] = u, lever * self.yaw
        w[:, :2], w[:, 2] = v, lever * self.spin
        moving &= w.any(axis=1)  # what has only just broken loose does so again
        sampled = len(grid.t) > 0
        if sampled:
            self._grid.t[:] = grid.t
        status, _, events, _ = kernel.run(
            q,
            w,
            moving,
            span,
            self._rules,
            self._model.lattice,
            self._args,
            rim,
            self._grid,
            log,
            most_steps,
            work_and_heat,
            True,
            self._workspace,
        )
        u[:], v[:] = q[:, :2], w[:, :2]
        self.yaw, self.spin = q[:, 2] / lever, w[:, 2] / lever
        if sampled:
            grid.u[:], grid.v[:] = self._grid.u[:, :, :2], self._grid.v[:, :, :2]
        counts[0] += int(log.start[:events].sum())
        return int(status), int(events)

    def energy(self) -> float:
        """Return the energy (J) of rotation."""
        lever = self._args.lever
        return float(0.5 * np.sum(self._args.mass[:, 2] * (lever * self.spin) ** 2))

    def stop(self) -> None:
        """Stop all where they are."""
        self.spin[:] = 0.0
