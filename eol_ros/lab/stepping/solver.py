# SPDX-License-Identifier: Apache-2.0
"""The stepping path: a whole run in fixed steps, as a preview and an independent check."""

import numpy as np

from eol_ros.core.physics.kernel_args import empty_log
from eol_ros.core.physics.numerics import energy_ledger
from eol_ros.core.physics.result import Limits, Run, in_time
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT, WORDS
from eol_ros.lab.stepping.moreau_jean import place_anchors, step_many


def solve(scene: Scene, times: np.ndarray, limits: Limits, step_s: float) -> Run:
    """Return the run of a scene in steps of `step_s` at most, whole between `times` (p,), s."""
    m = scene.lattice
    ends = np.concatenate([scene.u0, np.zeros_like(m.anchors)])
    place_anchors(ends, m.n, m.anchors, *scene.drive.pose(0.0))
    v, force = scene.v0.copy(), np.zeros_like(ends)
    moving = np.any(v != 0, axis=1) | (m.static == 0)
    work_and_heat, log = np.zeros(2), empty_log(limits.events)
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
            ends, v, moving, force, work_and_heat, times[sample - 1], count, span / count,
            m, scene.drive, log, logged,
        )  # fmt: skip
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
    t = float(times[reached])
    samples = times[done], u_out[done], v_out[done]
    run = Run('stepping', WORDS[status], *samples, *in_time(log, logged), steps, t)
    run.energy = energy_ledger(scene, ends[: m.n], v, t, work_and_heat)
    return run
