# SPDX-License-Identifier: Apache-2.0
"""The event path for blocks that rotate as they slide; imported only where a scene asks for it."""

import numpy as np

from eol_ros.core.physics.event.solver import order_for, rules_for
from eol_ros.core.physics.kernel_args import Grid, empty_log
from eol_ros.core.physics.numerics import keep_ledger, length_scale, usual_size
from eol_ros.core.physics.result import Limits, Run, in_time
from eol_ros.core.physics.rotation import kernel
from eol_ros.core.physics.rotation.taylor import LEVER, RotationArgs
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import WORDS


def rotation_args(scene: Scene) -> RotationArgs:
    """Return what rotation adds to the lattice of a scene with rotation."""
    r = scene.rotation
    assert r is not None
    lever = LEVER * r.side_m
    inertia = scene.mass * r.side_m**2 / 6
    mass = np.stack([scene.mass, scene.mass, inertia / lever**2], axis=1)
    return RotationArgs(lever, mass, r.arm, r.arm_j)


def floor_speed(tolerance: float) -> float:
    """Return the speed (m/s) that counts as none; the error in place goes as its square."""
    return float(np.clip(1e-2 * np.sqrt(tolerance), 1e-9, 1e-6))


def start_of(scene: Scene, ra: RotationArgs) -> tuple[np.ndarray, np.ndarray]:
    """Return places and velocities (n, 3) of x, y and s = lever * yaw."""
    r = scene.rotation
    assert r is not None
    return (
        np.column_stack([scene.u0, ra.lever * r.yaw0]),
        np.column_stack([scene.v0, ra.lever * r.spin0]),
    )


def solve(scene: Scene, times: np.ndarray, limits: Limits, ledger: bool, tolerance: float) -> Run:
    """Return the run of a scene with rotation, sampled at `times` (p,), s."""
    given = scene
    scene, size = usual_size(given)
    ra = rotation_args(scene)
    q, v = start_of(scene, ra)
    rules = rules_for(tolerance, length_scale(scene), order_for(tolerance), floor_speed(tolerance))
    shape = (len(times), scene.n, 3)
    grid, log = Grid(times, np.zeros(shape), np.zeros(shape)), empty_log(limits.events)
    work_and_heat = np.zeros(2)
    status, t, events, steps = kernel.run(
        q,
        v,
        np.zeros(scene.n, bool),
        float(scene.duration_s),
        rules,
        scene.lattice,
        ra,
        scene.drive,
        grid,
        log,
        limits.steps,
        work_and_heat,
        ledger,
        kernel.make_workspace(scene.lattice, ra, rules.order),
    )
    u, w = grid.u[:, :, :2] / size, grid.v[:, :, :2] / size
    run = Run('event', WORDS[status], times, u, w, *in_time(log, events), steps, t)
    run.yaw, run.spin = grid.u[:, :, 2] / ra.lever, grid.v[:, :, 2] / ra.lever
    if ledger:
        yaw, spin = q[:, 2] / ra.lever, v[:, 2] / ra.lever
        u, w, booked = q[:, :2] / size, v[:, :2] / size, work_and_heat / size**2
        keep_ledger(run, given, u, w, booked, yaw, spin)
    return run
