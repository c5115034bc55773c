# SPDX-License-Identifier: Apache-2.0
"""The event path: motion in the plane, geometric or linear springs, located breaks and stops."""

import numpy as np

from eol_ros.core.physics.event import kernel
from eol_ros.core.physics.kernel_args import Grid, empty_log
from eol_ros.core.physics.numerics import keep_ledger, length_scale, usual_size
from eol_ros.core.physics.result import Limits, Run, in_time
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import WORDS

TIGHTEST, LOOSEST = 1e-15, 1e-3
SMALL = 0.01  # of tolerance and length scale: the error in place that a step may make
CAPTURE_MPS = 2e-2  # slower than this, the closed form of a stop is tried


def default_tolerance(scene: Scene) -> float:
    """Return the tolerance that keeps a busy table of 10 s within 1e-9 m.

    Linear springs take a finer one: their steps are cheaper, and their motions part sooner. Where
    friction does not drop when a block breaks loose, motions hardly part at all.
    """
    steady = np.all(scene.kinetic_force > 0) and np.all(scene.static_limit <= scene.kinetic_force)
    if steady and scene.rotation is None:
        return 1e-8 if scene.geometric else 1e-9
    return 1e-9 if scene.geometric else 1e-12


def order_for(tolerance: float) -> int:
    """Return the order of the series: half the digits as natural logarithm, and three.

    Jorba and Zou (2005) find -ln(tolerance) / 2 + 1 cheapest; here a step has work besides the
    series, so that two orders more pay.
    """
    return int(np.clip(np.ceil(-0.5 * np.log(tolerance)) + 3, 8, 24))


def floor_speed(tolerance: float) -> float:
    """Return the speed (m/s) that counts as none: what the model's "speed zero" means in the plane.

    The sequence of events depends on it as its square (docs/explanation/numerics/physics.md).
    """
    return float(np.clip(1e-4 * np.sqrt(tolerance), 1e-11, 1e-7))


def rules_for(
    tolerance: float, scale_m: float, order: int | None = None, floor: float | None = None
) -> kernel.Rules:
    """Return the kernel's rules for a tolerance and the scene's length scale, m.

    order, floor: of the series, and the speed (m/s) that counts as none; None: those of `order_for`
    and `floor_speed`.
    """
    order = order or order_for(tolerance)
    return kernel.Rules(
        order,
        SMALL * tolerance * scale_m,
        tolerance,
        CAPTURE_MPS,
        floor or floor_speed(tolerance),
    )


def solve(scene: Scene, times: np.ndarray, limits: Limits, ledger: bool, tolerance: float) -> Run:
    """Return the run of a scene by power series between events, steps bound by `tolerance`.

    times: (p,) s, at which it is sampled. ledger: keep the energy ledger, which costs time. Where a
    limit cuts the run short, its `status` says so.
    """
    given = scene
    scene, size = usual_size(given)
    u, v = scene.u0.copy(), scene.v0.copy()
    rules = rules_for(tolerance, length_scale(scene))
    shape = (len(times), scene.n, 2)
    grid, log = Grid(times, np.zeros(shape), np.zeros(shape)), empty_log(limits.events)
    work_and_heat, counts = np.zeros(2), np.zeros(3, np.int64)
    status, t, events, steps = kernel.run(
        u,
        v,
        np.zeros(scene.n, bool),
        float(scene.duration_s),
        rules,
        scene.lattice,
        scene.drive,
        grid,
        log,
        limits.steps,
        work_and_heat,
        ledger,
        counts,
        kernel.make_workspace(scene.lattice, rules.order),
    )
    for lengths in (u, v, grid.u, grid.v):
        lengths /= size
    run = Run('event', WORDS[status], times, grid.u, grid.v, *in_time(log, events), steps, t)
    if counts[1]:
        slowest = kernel.SLOWEST_MPS / size
        run.notes.append(f'{counts[1]} stops ended at the floor of {slowest:.3g} m/s')
    if counts[2]:
        run.notes.append(
            f'springs passed length zero, where they have no direction, {counts[2]} times: the '
            'model knows no contact'
        )
    if ledger:
        keep_ledger(run, given, u, v, work_and_heat / size**2)
    return run
