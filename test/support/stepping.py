# SPDX-License-Identifier: Apache-2.0
"""Time stepping after Moreau and Jean: half a drift, the velocity with its friction, half a drift.

Jean, Comput. Methods Appl. Mech. Eng. 177 (1999), with theta = 1/2 for the positions and the forces
taken at the middle of the step. First order in the step, because events fall between steps: a
reference that shares no method with the solvers.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.drive import CIRCLE, POSES, VELOCITY
from eol_ros.core.physics.kernel_args import empty_log
from eol_ros.core.physics.result import Run, in_time
from eol_ros.core.physics.scene import Scene

MOST_EVENTS = 200_000


@njit(cache=True)
def rim_pose(kind, par, knots, cubics, t):
    """Return x, y, phi of the rim at t; the compiled twin of `Drive.pose`."""
    if kind == VELOCITY:
        return par[0] * t, par[1] * t, 0.0
    if kind == CIRCLE:
        half = math.sin(0.5 * par[1] * t)
        return (
            par[0] * math.sin(par[1] * t),
            2.0 * par[0] * half * half,
            par[2] * math.sin(par[3] * t),
        )
    if kind == POSES:
        last = len(cubics) - 1
        s = min(max(t, knots[0]), knots[last + 1])
        p = 0
        while p < last and knots[p + 1] <= s:
            p += 1
        s -= knots[p]
        c = cubics[p]
        return (
            c[0, 0] + s * (c[0, 1] + s * (c[0, 2] + s * c[0, 3])),
            c[1, 0] + s * (c[1, 1] + s * (c[1, 2] + s * c[1, 3])),
            c[2, 0] + s * (c[2, 1] + s * (c[2, 2] + s * c[2, 3])),
        )
    return 0.0, 0.0, 0.0


@njit(cache=True)
def place_anchors(ends, n, anchors, x, y, phi):
    """Write the displacements of the rim's anchors behind those of the n blocks in `ends`."""
    sine = math.sin(phi)
    half = math.sin(0.5 * phi)
    cosine_1 = -2.0 * half * half
    for a in range(len(anchors)):
        ax, ay = anchors[a, 0], anchors[a, 1]
        ends[n + a, 0] = x + cosine_1 * ax - sine * ay
        ends[n + a, 1] = y + sine * ax + cosine_1 * ay


@njit(cache=True)
def spring_forces(ends, force, first, second, k, natural, rest, geometric):
    """Write the force of all springs on all ends (blocks and anchors) into `force`."""
    for i in range(len(force)):
        force[i, 0] = force[i, 1] = 0.0
    for s in range(len(k)):
        i, j = first[s], second[s]
        dx = ends[j, 0] - ends[i, 0]
        dy = ends[j, 1] - ends[i, 1]
        stiff = k[s]
        if geometric:
            dx += rest[s, 0]
            dy += rest[s, 1]
            if natural[s] > 0.0:
                length = math.sqrt(dx * dx + dy * dy)
                stiff = stiff * (1.0 - natural[s] / length) if length > 0.0 else 0.0
        fx, fy = stiff * dx, stiff * dy
        force[i, 0] += fx
        force[i, 1] += fy
        force[j, 0] -= fx
        force[j, 1] -= fy


@njit(cache=True)
def step_many(ends, v, moving, force, t0, steps, h, at, rim, log, logged):
    """Take `steps` steps of h from t0, in place; return how many events there were.

    `ends` (n + a, 2), `v` (n, 2), `moving` (n,) bool. What the log has no room for is counted.
    """
    n, anchors, rail = at.n, at.anchors, at.rail
    mass, static = at.mass, at.static
    for step in range(steps):
        t = t0 + step * h
        for i in range(n):
            if moving[i]:
                ends[i, 0] += 0.5 * h * v[i, 0]
                ends[i, 1] += 0.5 * h * v[i, 1]
        x, y, phi = rim_pose(rim.kind, rim.par, rim.knots, rim.cubics, t + 0.5 * h)
        place_anchors(ends, n, anchors, x, y, phi)
        spring_forces(ends, force, at.first, at.second, at.k, at.natural, at.rest, at.geometric)
        for i in range(n):
            fx = force[i, 0]
            fy = 0.0 if rail else force[i, 1]
            if not moving[i]:
                if fx * fx + fy * fy <= static[i] * static[i]:
                    continue
                moving[i] = True
                if logged < len(log.t):
                    log.t[logged], log.block[logged], log.start[logged] = t + 0.5 * h, i, 1
                logged += 1
            vx = v[i, 0] + h * fx / mass[i]
            vy = v[i, 1] + h * fy / mass[i]
            speed = math.sqrt(vx * vx + vy * vy)
            hold = at.friction[i]
            loss = h * hold / mass[i]
            # without friction it stops where it turns back
            reverses = hold == 0.0 < static[i] and vx * v[i, 0] + vy * v[i, 1] < 0.0
            if speed > loss and not reverses:
                v[i, 0] = vx * (1.0 - loss / speed)
                v[i, 1] = vy * (1.0 - loss / speed)
            else:
                v[i, 0] = 0.0
                v[i, 1] = 0.0
                if fx * fx + fy * fy <= static[i] * static[i]:
                    moving[i] = False
                    if logged < len(log.t):
                        log.t[logged], log.block[logged], log.start[logged] = t + 0.5 * h, i, 0
                    logged += 1
            ends[i, 0] += 0.5 * h * v[i, 0]
            ends[i, 1] += 0.5 * h * v[i, 1]
    return logged


def solve(scene: Scene, times: np.ndarray, step_s: float) -> Run:
    """Return the run of a scene in steps of `step_s` at most, whole between `times` (p,), s."""
    m = scene.lattice
    ends = np.concatenate([scene.u0, np.zeros_like(m.anchors)])
    v, force = scene.v0.copy(), np.zeros_like(ends)
    moving = np.any(v != 0, axis=1) | (m.static == 0)
    log, logged, steps = empty_log(MOST_EVENTS), 0, 0
    u_out, v_out = [scene.u0], [v.copy()]
    for begin, span in zip(times[:-1], np.diff(times), strict=True):
        count = max(1, int(np.ceil(span / step_s * (1 - 1e-9))))
        logged = step_many(
            ends, v, moving, force, begin, count, span / count, m, scene.drive, log, logged
        )
        steps += count
        u_out.append(ends[: m.n].copy())
        v_out.append(v.copy())
    samples = times, np.array(u_out), np.array(v_out)
    return Run(
        'stepping', 'ok', *samples, *in_time(log, min(logged, MOST_EVENTS)), steps, float(times[-1])
    )
