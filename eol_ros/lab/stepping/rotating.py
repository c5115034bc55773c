# SPDX-License-Identifier: Apache-2.0
"""Moreau-Jean time stepping for blocks that rotate: a preview, and an independent check.

As `stepping`, in x, y and s = lever * yaw, with plain arrays: forces at the middle of the step,
friction implicit in the new velocity, m (V - V_free) = -h F V / |V|, from the root of its size.
"""

import numpy as np

from eol_ros.core.physics.model import Model
from eol_ros.core.physics.result import Limits, Run
from eol_ros.core.physics.rotation.solver import energy_ledger, rotation_args, start_of
from eol_ros.core.physics.rotation.taylor import RotationArgs
from eol_ros.core.physics.scene import Scene
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT, WORDS


def forces(
    model: Model, ra: RotationArgs, q: np.ndarray, t: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and torque / lever (n, 3) on each block, and the springs' forces (s, 2)."""
    yaw = q[:, 2] / ra.lever
    pull = model.tension(q[:, :2], t, yaw)
    total = np.zeros((model.n, 3))
    inner = model.second < model.n
    for ends, arm, f in (
        (model.first, ra.arm, pull),
        (model.second[inner], ra.arm_j[inner], -pull[inner]),
    ):
        c, s = np.cos(yaw[ends]), np.sin(yaw[ends])
        x, y = c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]
        torque = x * f[:, 1] - y * f[:, 0]
        np.add.at(total, ends, np.column_stack([f, torque / ra.lever]))
    return total, pull


def braked(free: np.ndarray, impulse: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Return V (n, 3) with mass (V - free) = -impulse V / |V|, or 0 where friction takes all."""
    momentum = mass * free
    size = np.linalg.norm(momentum, axis=1)
    holds = size <= impulse
    impulse = np.where(holds, 0.5 * size, impulse)  # any that has a root: the result is not used
    least = mass[:, 0]
    rate = impulse / np.maximum(np.linalg.norm(free, axis=1) - impulse / least, 1e-12)
    for _ in range(60):  # Newton on sum (l p / (m + l))^2 = impulse^2, kept positive
        part = rate[:, None] * momentum / (mass + rate[:, None])
        gap = np.sum(part**2, axis=1) - impulse**2
        slope = 2 * np.sum(part * momentum * mass / (mass + rate[:, None]) ** 2, axis=1)
        step = np.divide(gap, slope, out=np.zeros_like(gap), where=slope > 0)
        rate = np.maximum(rate - step, 0.5 * rate)
    return np.where(holds[:, None], 0.0, momentum / (mass + rate[:, None]))


def solve(scene: Scene, model: Model, times: np.ndarray, limits: Limits, step_s: float) -> Run:
    """Return the run of a scene with rotation in steps of `step_s`, whole between `times` (p,)."""
    ra = rotation_args(scene)
    q, v = start_of(scene, ra)
    moving = np.any(v != 0, axis=1) | (model.static == 0)
    shape = (len(times), model.n, 3)
    q_out, v_out = np.zeros(shape), np.zeros(shape)
    q_out[0], v_out[0] = q, v
    work_and_heat, log = np.zeros(2), []
    status, steps, reached = OK, 0, 0
    rim = model.second >= model.n
    for sample in range(1, len(times)):
        span = times[sample] - times[sample - 1]
        count = max(1, int(np.ceil(span / step_s * (1 - 1e-9))))
        if steps + count > limits.steps:
            status = STEP_LIMIT
            break
        h = span / count
        for step in range(count):
            t = times[sample - 1] + step * h
            q += 0.5 * h * v
            pull, spring = forces(model, ra, q, t + 0.5 * h)
            led = scene.drive.displacement(t + h, model.anchors)
            led = led - scene.drive.displacement(t, model.anchors)
            work_and_heat[0] += np.sum(spring[rim] * led[model.second[rim] - model.n])
            size = np.linalg.norm(pull, axis=1)
            starts = ~moving & (size > model.static)
            free = v + h * pull / ra.mass
            moving |= starts
            new = np.where(moving[:, None], braked(free, h * model.kinetic, ra.mass), 0)
            reverses = np.sum(ra.mass * new * v, axis=1) < 0  # without friction they stop there
            new[reverses & (model.kinetic == 0) & (model.static > 0)] = 0.0
            stops = moving & ~np.any(new, axis=1) & (size <= model.static)
            log += [(t + 0.5 * h, i, 1) for i in np.flatnonzero(starts)]
            log += [(t + 0.5 * h, i, 0) for i in np.flatnonzero(stops)]
            moving &= ~stops
            gain = 0.5 * np.sum(ra.mass * (new**2 - v**2))
            work_and_heat[1] += 0.5 * h * np.sum(pull * (v + new)) - gain
            v = new
            q += 0.5 * h * v
        steps += count
        reached = sample
        q_out[sample], v_out[sample] = q, v
        if not np.all(np.isfinite(q)):
            status = NOT_FINITE
            break
        if len(log) > limits.events:
            status, log = EVENT_LIMIT, log[: limits.events]
            break
    done = slice(0, reached + 1)
    when, block, start = (
        (np.array(column) for column in zip(*log, strict=True)) if log else (np.empty(0),) * 3
    )
    run = Run(
        'stepping',
        WORDS[status],
        times[done],
        q_out[done, :, :2],
        v_out[done, :, :2],
        when,
        block.astype(np.int64),
        start.astype(np.int8),
        steps,
        float(times[reached]),
        yaw=q_out[done, :, 2] / ra.lever,
        spin=v_out[done, :, 2] / ra.lever,
    )
    run.energy = energy_ledger(scene, model, ra, q, v, float(times[reached]), work_and_heat)
    return run
