# SPDX-License-Identifier: Apache-2.0
"""The exact path: a constant pull along x on linear springs, event by event, to rounding."""

import numpy as np

from eol_ros.core.physics.drive import VELOCITY
from eol_ros.core.physics.kernel_args import Grid, empty_log
from eol_ros.core.physics.numerics import keep_ledger, length_scale
from eol_ros.core.physics.result import Limits, Run, in_time
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import WORDS
from eol_ros.lab.exact import kernel

ORDER = 14
TRUNCATION = 2e-17  # of the displacements' scale: below their rounding


def solve(scene: Scene, times: np.ndarray, limits: Limits, ledger: bool, order: int = ORDER) -> Run:
    """Return the run of a scene whose blocks move along x only; y is held at its start.

    times: (p,) s, at which it is sampled. ledger: keep the energy ledger, which costs time. Where a
    limit cuts the run short, its `status` says so.
    """
    u, v = scene.u0[:, 0].copy(), scene.v0[:, 0].copy()
    small = TRUNCATION * length_scale(scene)
    grid = Grid(times, np.zeros((len(times), scene.n)), np.zeros((len(times), scene.n)))
    log, work_and_heat = empty_log(limits.events), np.zeros(2)
    status, t, events, steps, base = kernel.run(
        u,
        v,
        float(scene.duration_s),
        order,
        small,
        scene.lattice,
        scene.drive,
        grid,
        log,
        limits.steps,
        work_and_heat,
        ledger,
        kernel.make_lanes(scene.n, order),
    )
    if scene.drive.kind == VELOCITY:
        u += scene.drive.par[0] * base
    u_out, v_out = np.zeros((2, *grid.u.shape, 2))
    u_out[:, :, 0], u_out[:, :, 1], v_out[:, :, 0] = grid.u, scene.u0[:, 1], grid.v
    run = Run('exact', WORDS[status], times, u_out, v_out, *in_time(log, events), steps, t)
    if ledger:
        end = np.column_stack([u, scene.u0[:, 1]])
        keep_ledger(run, scene, end, np.column_stack([v, 0 * v]), work_and_heat)
    return run
