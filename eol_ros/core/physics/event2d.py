# SPDX-License-Identifier: Apache-2.0
"""The event path: motion in the plane, geometric or linear springs, located breaks and stops."""

import numpy as np

from eol_ros.core.physics import event2d_kernel
from eol_ros.core.physics.exact1d import books_of, length_scale
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.run import Limits, Run
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import WORDS

TOLERANCE = 1e-9  # of a step, relative; the error of a whole run is mostly smaller
TIGHTEST, LOOSEST = 1e-15, 1e-3
CAPTURE_MPS = 2e-2  # slower than this, the closed form of a stop is tried


def order_for(tolerance: float) -> int:
    """Return the order of the series: half the digits as natural logarithm, and three.

    Jorba and Zou (2005), eq. 3.2, find -ln(tolerance) / 2 + 1 cheapest; here a step has work besides
    the series, so that a few orders more pay.
    """
    return int(np.clip(np.ceil(-0.5 * np.log(tolerance)) + 3, 8, 24))


def floor_speed(tolerance: float) -> float:
    """Return the speed (m/s) that counts as none: what the model's "speed zero" means in the plane.

    The sequence of events depends on it as its square (docs/numerics.md).
    """
    return float(np.clip(1e-4 * np.sqrt(tolerance), 1e-11, 1e-7))


def solve(
    scene: Scene,
    model: Model,
    times: np.ndarray,
    limits: Limits,
    ledger: bool,
    tolerance: float = TOLERANCE,
    order: int | None = None,
    floor: float | None = None,
) -> Run:
    """Return the run of a scene by power series between events, steps bound by `tolerance`."""
    u, v = scene.u0.copy(), scene.v0.copy()
    order = order or order_for(tolerance)
    floor = floor or floor_speed(tolerance)
    small = 0.01 * tolerance * length_scale(scene, model)
    u_out, v_out = np.zeros((len(times), model.n, 2)), np.zeros((len(times), model.n, 2))
    log_t, log_block = np.empty(limits.events), np.empty(limits.events, np.int64)
    log_start = np.empty(limits.events, np.int8)
    books, counts = np.zeros(2), np.zeros(2, np.int64)
    sliding = np.zeros(model.n, bool)
    m = model
    status, t, events, steps = event2d_kernel.run(
        u,
        v,
        sliding,
        scene.duration_s,
        order,
        small,
        tolerance,
        CAPTURE_MPS,
        floor,
        m.n,
        m.first,
        m.second,
        m.k,
        m.natural,
        m.rest,
        m.anchors,
        m.start,
        m.spring,
        m.mass,
        m.static,
        m.kinetic,
        m.geometric,
        m.rail,
        m.kind,
        m.par,
        m.knots,
        m.cubics,
        times,
        u_out,
        v_out,
        log_t,
        log_block,
        log_start,
        limits.steps,
        books,
        ledger,
        counts,
    )
    in_time = np.argsort(log_t[:events], kind='stable')
    run = Run(
        'event',
        WORDS[status],
        times,
        u_out,
        v_out,
        log_t[in_time],
        log_block[in_time],
        log_start[in_time],
        steps,
        t,
    )
    if counts[1]:
        run.notes.append(f'{counts[1]} stops ended at the floor of {floor:g} m/s')
    if ledger:
        run.energy = books_of(scene, model, u, v, t, books)
    return run
