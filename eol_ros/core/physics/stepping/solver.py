# SPDX-License-Identifier: Apache-2.0
"""The stepping path: a whole run in fixed steps, as a preview and an independent check."""

import numpy as np

from eol_ros.core.physics.model import Model
from eol_ros.core.physics.numerics import energy_ledger
from eol_ros.core.physics.result import Limits, Run
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT, WORDS
from eol_ros.core.physics.stepping.moreau_jean import place_anchors, step_many


def solve(scene: Scene, model: Model, times: np.ndarray, limits: Limits, step_s: float) -> Run:
    """Return the run of a scene in steps of `step_s` at most, whole between `times` (p,), s."""
    m = model
    ends = np.concatenate([scene.u0, np.zeros_like(m.anchors)])
    place_anchors(ends, m.n, m.anchors, *scene.drive.pose(0.0))
    v, force = scene.v0.copy(), np.zeros_like(ends)
    moving = np.any(v != 0, axis=1) | (m.static == 0)
    work_and_heat, counts = np.zeros(2), np.zeros(1, np.int64)
    log = (
        np.empty(limits.events),
        np.empty(limits.events, np.int64),
        np.empty(limits.events, np.int8),
    )
    u_out, v_out = np.zeros((len(times), m.n, 2)), np.zeros((len(times), m.n, 2))
    u_out[0], v_out[0] = scene.u0, v
    logged = steps = 0
    status = OK
    reached = 0
    for sample in range(1, len(times)):
        span = times[sample] - times[sample - 1]
        count = max(1, int(np.ceil(span / step_s * (1 - 1e-9))))
        if steps + count > limits.steps:
            status = STEP_LIMIT
            break
        logged = step_many(
            ends,
            v,
            moving,
            force,
            work_and_heat,
            counts,
            times[sample - 1],
            count,
            span / count,
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
            m.kind,
            m.par,
            m.knots,
            m.cubics,
            *log,
            logged,
        )
        steps += count
        reached = sample
        u_out[sample], v_out[sample] = ends[: m.n], v
        if not np.all(np.isfinite(ends)):
            status = NOT_FINITE
            break
        if logged > limits.events:
            status, logged = EVENT_LIMIT, limits.events
            break
    done = slice(0, reached + 1)
    run = Run(
        'stepping',
        WORDS[status],
        times[done],
        u_out[done],
        v_out[done],
        log[0][:logged].copy(),
        log[1][:logged].copy(),
        log[2][:logged].copy(),
        steps,
        float(times[reached]),
    )
    run.energy = energy_ledger(scene, m, ends[: m.n], v, float(times[reached]), work_and_heat)
    return run
