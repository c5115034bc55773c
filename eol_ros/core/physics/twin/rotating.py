# SPDX-License-Identifier: Apache-2.0
"""The live table's solver for blocks that rotate as they slide; imported only where they do."""

import numpy as np

from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.event.solver import rules_for
from eol_ros.core.physics.kernel_args import Grid, Ledger
from eol_ros.core.physics.numerics import length_scale
from eol_ros.core.physics.rotation import kernel
from eol_ros.core.physics.rotation.solver import floor_speed, rotation_args
from eol_ros.core.physics.scene import Scene

# Of the positions, in 9 cm: 0.1 um in a second and a half, a hundredth of what the camera sees.
TOLERANCE = 1e-3
KICK_MPS = 1e-5  # where mu_s is mu_k or little more: at 25 rad/s a slip is 0.4 um longer by it
WEAKEST = 0.01
ORDER = 6  # of the series: most steps end at an event or an image, and a higher one is for longer


class Rotating:
    """Steps x, y and yaw of the blocks from image to image.

    `yaw` (n,) and `spin` (n,) are rad and rad/s; `arms` complex, from the centre of a block to
    where its spring to the rim is fixed, in the block's frame.
    """

    def __init__(self, scene: Scene, samples: int):
        assert scene.rotation is not None
        self._lattice, self._args = scene.lattice, rotation_args(scene)
        slowest = floor_speed(TOLERANCE)
        rules = rules_for(TOLERANCE, length_scale(scene), ORDER, slowest)
        self._rules = rules._replace(kick=KICK_MPS, weakest=WEAKEST, slowest=slowest)
        self._workspace = kernel.make_workspace(self._lattice, self._args, ORDER)
        self.yaw, self.spin = scene.rotation.yaw0.copy(), scene.rotation.spin0.copy()
        self._q, self._w = np.zeros((scene.n, 3)), np.zeros((scene.n, 3))
        rows = (samples, scene.n, 3)
        self._grid = Grid(np.zeros(samples), np.zeros(rows), np.zeros(rows))

    def solve(
        self,
        u: np.ndarray,
        v: np.ndarray,
        moving: np.ndarray,
        span: float,
        rim: Drive,
        grid: Grid,
        ledger: Ledger,
        most_steps: int,
    ) -> tuple[int, int]:
        """Advance by `span`, s, as `event.kernel.run` does; return status and count of events.

        u, v: (n, 2), m and m/s, changed in place, as is moving: (n,) bool. `yaw` and `spin` become
        new arrays.
        """
        q, w, lever = self._q, self._w, self._args.lever
        q[:, :2], q[:, 2] = u, lever * self.yaw
        w[:, :2], w[:, 2] = v, lever * self.spin
        sampled = len(grid.t) > 0
        if sampled:
            self._grid.t[:] = grid.t
        status, _, events, _ = kernel.run(
            q,
            w,
            moving,
            span,
            self._rules,
            self._lattice,
            self._args,
            rim,
            self._grid,
            ledger.log,
            most_steps,
            ledger.work_and_heat,
            True,
            self._workspace,
        )
        u[:], self.yaw = q[:, :2], q[:, 2] / lever
        v[:], self.spin = w[:, :2], w[:, 2] / lever
        if sampled:
            grid.u[:], grid.v[:] = self._grid.u[:, :, :2], self._grid.v[:, :, :2]
        if events:
            ledger.counts[0] += int(ledger.log.start[:events].sum())
        return int(status), int(events)

    def stop(self) -> None:
        """Stop all where they are."""
        self.spin[:] = 0.0
