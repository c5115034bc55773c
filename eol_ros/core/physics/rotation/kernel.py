# SPDX-License-Identifier: Apache-2.0
"""The compiled loop for blocks that rotate: from event to event in x, y and s = c theta."""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core import algebra
from eol_ros.core.elementary_kernels import exp
from eol_ros.core.physics.drive import NONE
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.numerics import ON_LIMIT
from eol_ros.core.physics.rotation.taylor import (
    RotationArgs,
    Series,
    make_series,
    rotating_series,
    springs_order,
    start_series,
)
from eol_ros.core.physics.series import (
    add_exactly,
    drive_series,
    entry,
    first_root,
    inlined,
    uncounted,
)
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT

KEPT = 0.1  # of its speed a block keeps at least within a step
STOP_ROUNDS = 8  # a stop is followed until ln(speed) is STOP_LOG less, in so many rounds,
STOP_LOG = 3.2
STOP_FORCE = 0.6  # or in more where a force near friction changes the direction quickly,
STOP_TOP = 0.99  # but none where it is nearer than this
STOP_MISS = 2e-3  # what they miss of the way: they are over at 4 % of the speed
STOP_SHARE = 0.1  # of `small` (m) a stop in closed form may miss


@uncounted
def size_of(v, i):
    """Return the length of row i."""
    return math.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2 + v[i, 2] ** 2)


@uncounted
def step_of(order, sliding, fresh, driven, rules, at, b, h, work):
    """Return the step, at most h: truncation within the rules, no block slower than KEPT allows."""
    for k in range(order - 1, order + 1):
        most, moving, begun = 0.0, np.inf, np.inf  # a power of the least, not the least power
        for i in range(at.n):
            if not sliding[i]:
                continue
            top = max(abs(b.a[i, 0, k]), abs(b.a[i, 1, k]), abs(b.a[i, 2, k]))
            if top > 0.0:
                most = max(most, top)
                first = 2 if fresh[i] else 1
                rate = math.sqrt(
                    b.a[i, 0, first] ** 2 + b.a[i, 1, first] ** 2 + b.a[i, 2, first] ** 2
                )
                if rate > 0.0 and fresh[i]:
                    begun = min(begun, rules.relative * rate / (k * top))
                elif rate > 0.0:
                    moving = min(moving, rules.relative * rate / (k * top))
        if most > 0.0:
            h = min(h, (rules.small / most) ** (1.0 / k))
        if moving < np.inf:
            h = min(h, moving ** (1.0 / (k - 1)))
        if begun < np.inf:
            h = min(h, begun ** (1.0 / (k - 2)))
    for e in range(len(at.k)):  # a spring may be the only thing that moves
        if driven and at.second[e] >= at.n and at.k[e] > 0.0:
            top = max(abs(b.springs.px[order - 2, e]), abs(b.springs.py[order - 2, e])) / at.k[e]
            if top > 0.0:
                h = min(h, (rules.small / top) ** (1.0 / (order - 2)))
    for i in range(at.n):
        if not sliding[i] or at.static[i] == 0.0:
            continue
        first = 2 if fresh[i] else 1
        degree, loss, square = order - first, 0.0, b.square[i, 0]
        if square == 0.0:
            continue
        for k in range(degree, 0, -1):
            work[k] = 0.0
            for p in range(3):
                work[k] += (k + first) * b.a[i, p, k + first] * b.w[i, p, 0] / square
            loss = (loss + max(0.0, -work[k])) * h
        if loss >= 1.0 - KEPT:
            work[0] = 1.0 - KEPT
            h, _ = first_root(work, degree, h)
    return h


@inlined
def fall(gx, gy, gz, x, y, z, friction, mass):
    """Return (slowing, dx, dy, dz): dv/dt of a block that slides along (x, y, z), and what its
    direction changes by as ln v grows by one.
    """
    ax = (gx - friction * x) / mass[0]
    ay = (gy - friction * y) / mass[1]
    az = (gz - friction * z) / mass[2]
    along = x * ax + y * ay + z * az
    return along, ax / along - x, ay / along - y, az / along - z


@uncounted
def stop_of(i, speed, force, v, rules, at, mass, jerk, out):
    """Return (time, now): how slow block i comes to rest, its way in out[:3]; `now` if exact.

    Under a force that does not change, direction n depends on ln v alone, and the rest of the way
    is the integral of v^2 n / (dv/dt) over it: smooth to the end, where time is not. By Runge and
    Kutta's rule of fourth order; the last 4 % of the speed fall along a line.
    """
    friction, g0, g1, g2 = at.friction[i], force[0], force[1], force[2]
    x, y, z = v[i, 0] / speed, v[i, 1] / speed, v[i, 2] / speed
    a1, kx, ky, kz = fall(g0, g1, g2, x, y, z, friction, mass)
    size = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    if not size <= STOP_TOP * friction:  # nor where it is no number
        return 0.0, False
    slowing = (friction - size) / mass[2]  # at least
    bound_s = speed / slowing
    change = jerk * bound_s / (slowing * mass[2])
    swing = math.sqrt(at.k_sum[i] / mass[0]) * bound_s
    missed = 0.5 * speed * bound_s * (STOP_MISS + change + swing)
    if not (missed <= STOP_SHARE * rules.small and change <= 0.2):
        return 0.0, False
    out[0] = out[1] = out[2] = 0.0
    spare = (friction - size) / ((1.0 - STOP_FORCE) * friction)
    rounds = int(STOP_ROUNDS / min(1.0, spare))
    stop_s, h, u = 0.0, -STOP_LOG / rounds, speed
    middle, end = exp(0.5 * h), exp(h)
    for _ in range(rounds):
        half = 0.5 * h
        x2, y2, z2 = x + half * kx, y + half * ky, z + half * kz
        a2, lx, ly, lz = fall(g0, g1, g2, x2, y2, z2, friction, mass)
        x3, y3, z3 = x + half * lx, y + half * ly, z + half * lz
        a3, mx, my, mz = fall(g0, g1, g2, x3, y3, z3, friction, mass)
        x4, y4, z4 = x + h * mx, y + h * my, z + h * mz
        a4, nx, ny, nz = fall(g0, g1, g2, x4, y4, z4, friction, mass)
        t1, t2, t3, t4 = u / a1, 2.0 * middle * u / a2, 2.0 * middle * u / a3, end * u / a4
        stop_s += h / 6.0 * (t1 + t2 + t3 + t4)
        w = u * h / 6.0
        t2, t3, t4 = middle * t2, middle * t3, end * t4
        out[0] += w * (t1 * x + t2 * x2 + t3 * x3 + t4 * x4)
        out[1] += w * (t1 * y + t2 * y2 + t3 * y3 + t4 * y4)
        out[2] += w * (t1 * z + t2 * z2 + t3 * z3 + t4 * z4)
        x += h / 6.0 * (kx + 2.0 * (lx + mx) + nx)
        y += h / 6.0 * (ky + 2.0 * (ly + my) + ny)
        z += h / 6.0 * (kz + 2.0 * (lz + mz) + nz)
        long = 1.0 / math.sqrt(x * x + y * y + z * z)
        x, y, z, u = x * long, y * long, z * long, u * end
        a1, kx, ky, kz = fall(g0, g1, g2, x, y, z, friction, mass)
    last = -0.5 * u * u / a1
    out[0], out[1], out[2] = out[0] + last * x, out[1] + last * y, out[2] + last * z
    return stop_s - u / a1, True


@uncounted
def first_break(order, sliding, at, b, h, work):
    """Return (h, block, found): the first block at rest whose force reaches its limit."""
    degree, who, found = order - 2, -1, False
    for j in range(at.n):
        if sliding[j]:
            continue
        limit, reach = at.static[j], 0.0
        for k in range(degree, 0, -1):
            size = abs(b.g[j, 0, k]) + abs(b.g[j, 1, k]) + abs(b.g[j, 2, k])
            reach = (reach + size) * h
        now = math.sqrt(b.g[j, 0, 0] ** 2 + b.g[j, 1, 0] ** 2 + b.g[j, 2, 0] ** 2)
        if reach == 0.0 or now + reach < limit * (1.0 - ON_LIMIT):
            continue
        for k in range(2 * degree + 1):
            total = 0.0
            for a in range(max(0, k - degree), min(k, degree) + 1):
                for p in range(3):
                    total += b.g[j, p, a] * b.g[j, p, k - a]
            work[k] = -total / (limit * limit)
        work[0] = (limit - now) * (limit + now) / (limit * limit)
        if work[0] <= ON_LIMIT:
            if work[1] < 0.0:
                return 0.0, j, True
            work[0] = ON_LIMIT
        x, hit = first_root(work, 2 * degree, h)
        if hit or x < h:
            h, who, found = x, j, hit
    return h, who, found


@uncounted
def state_at(order, sliding, at, b, h, q, v):
    """Write place and velocity of what slides at h."""
    for i in range(at.n):
        if sliding[i]:
            for p in range(3):
                x, d = b.a[i, p, order], 0.0
                for k in range(order - 1, -1, -1):
                    d = d * h + x
                    x = x * h + b.a[i, p, k]
                q[i, p], v[i, p] = x, d


@uncounted
def add_ledger(order, sliding, at, b, cx, cy, cc, cs, used, h, energy, gauss):
    """Add the drive work and the friction heat (J) of a step h to `energy`."""
    for g in range(gauss.shape[1]):
        s, weight = gauss[0, g] * h, gauss[1, g] * h
        for i in range(at.n):
            if sliding[i]:
                square = 0.0
                for p in range(3):
                    d = 0.0
                    for k in range(order, 0, -1):
                        d = d * s + k * b.a[i, p, k]
                    square += d * d
                energy[1] += weight * at.friction[i] * math.sqrt(square)
    if used == 0:
        return
    for g in range(gauss.shape[1]):
        s, weight = gauss[0, g] * h, gauss[1, g] * h
        xr = yr = cor = sir = x = y = along = across = 0.0
        for k in range(used, 0, -1):
            xr, yr = xr * s + k * cx[k], yr * s + k * cy[k]
            cor, sir = cor * s + k * cc[k], sir * s + k * cs[k]
        for k in range(order - 2, -1, -1):
            x, y = x * s + b.rim[0, k], y * s + b.rim[1, k]
            across, along = across * s + b.rim[2, k], along * s + b.rim[3, k]
        energy[0] += weight * (x * xr + y * yr + along * cor + across * sir)


class Workspace(NamedTuple):
    """The arrays that a run works in."""

    b: Series
    rim: np.ndarray  # (4, size) series of the rim's x, y, cos(phi) - 1, sin(phi)
    work: np.ndarray
    flags: np.ndarray  # (2, n) begins to slide now; slid until now: its springs are to be looked at
    state: np.ndarray  # (2, n, 3) of a sample
    gauss: np.ndarray


def make_workspace(at: Lattice, ra: RotationArgs, order: int) -> Workspace:
    """Return the arrays for a lattice and the order of the series."""
    n, size = at.n, order + 2
    return Workspace._make([
        make_series(at, ra, order), np.zeros((4, size)), np.zeros(2 * size),
        np.zeros((2, n), np.bool_), np.zeros((2, n, 3)), gauss_rule(order),
    ])  # fmt: skip


def gauss_rule(order: int) -> np.ndarray:
    """Return nodes and weights (2, m) on 0..1 for the power of a step.

    They are exact for the rim's, a product of series; the speed is a root of one, and smooth.
    """
    x, weight = algebra.gauss_legendre(min(order // 2 + 1, 10))
    return np.stack((0.5 * (x + 1), 0.5 * weight))


@entry
def run(q, v, sliding, t_end, rules, at, ra, rim, grid, log, max_steps, energy, ledger, ws):
    """Advance `q`, `v` (n, 3): x, y, s, to `t_end`; `sliding` (n,) takes which blocks slide then.

    What slides has a speed: what has only just broken loose does so again. Returns (status, t,
    events, steps); `grid` takes u and v of (k, n, 3).
    """
    b, work, gauss = ws.b, ws.work, ws.gauss  # few arrays: each costs 0.1 us to take over
    cx, cy, cc, cs = ws.rim[0], ws.rim[1], ws.rim[2], ws.rim[3]
    fresh, moved, here, rate = ws.flags[0], ws.flags[1], ws.state[0], ws.state[1]
    order, n, driven = rules.order, at.n, rim.kind != NONE
    t, left = 0.0, 0.0
    events = steps = sampled = 0
    for i in range(n):
        fresh[i], moved[i] = False, True
        sliding[i] = size_of(v, i) > 0.0 or at.static[i] == 0.0
    settle, due = True, -1
    while True:
        reach, used = drive_series(
            rim.kind, rim.par, rim.knots, rim.cubics, t, order, cx, cy, cc, cs, work
        )
        known = settle
        if settle:  # what is beyond its limit breaks now; the forces of now tell it
            settle = False
            start_series(q, v, sliding, moved, ra, b)
            springs_order(0, sliding, at, ra, b, cx[0], cy[0], cc[0], cs[0])
            for i in range(n):
                force = math.sqrt(b.g[i, 0, 0] ** 2 + b.g[i, 1, 0] ** 2 + b.g[i, 2, 0] ** 2)
                if not sliding[i] and (i == due or force >= at.static[i] * (1.0 - ON_LIMIT)):
                    if events >= len(log.t):
                        return EVENT_LIMIT, t, events, steps
                    log.t[events], log.block[events], log.start[events] = t, i, 1
                    events += 1
                    sliding[i] = True
                    fresh[i] = force - at.friction[i] > rules.weakest * force
                    for p in range(3):
                        v[i, p] = 0.0 if fresh[i] else rules.kick * b.g[i, p, 0] / force
            due = -1
        start_series(q, v, sliding, moved, ra, b)
        if not known:
            springs_order(0, sliding, at, ra, b, cx[0], cy[0], cc[0], cs[0])
        for i in range(n):
            moved[i] = False
        rotating_series(order, sliding, fresh, at, ra, b, cx, cy, cc, cs, work)
        h = min(t_end - t, reach)
        near = step_of(order, sliding, fresh, driven and used > 0, rules, at, b, h, work)
        ends = near == t_end - t
        h = near
        if not h >= 0.0:
            return NOT_FINITE, t, events, steps
        top = h
        h, who, hit = first_break(order, sliding, at, b, h, work)
        if who >= 0:
            ends = False
            if not hit:
                h = min(top, max(h, 1e-15 * max(1.0, t)))  # a near miss: creep past it
        while sampled < len(grid.t) and (grid.t[sampled] <= t + h or ends):
            for i in range(n):
                for p in range(3):
                    here[i, p], rate[i, p] = q[i, p], 0.0
            state_at(order, sliding, at, b, grid.t[sampled] - t, here, rate)
            for i in range(n):
                for p in range(3):
                    grid.u[sampled, i, p], grid.v[sampled, i, p] = here[i, p], rate[i, p]
            sampled += 1
        if ledger:
            add_ledger(order, sliding, at, b, cx, cy, cc, cs, used, h, energy, gauss)
        state_at(order, sliding, at, b, h, q, v)
        t, left = add_exactly(t, left, h)
        steps += 1
        settle, due = hit, who
        for i in range(n):
            fresh[i] = fresh[i] and h == 0.0
            if not math.isfinite(q[i, 0] + q[i, 1] + q[i, 2] + v[i, 0]):
                return NOT_FINITE, t, events, steps
        if ends:
            return OK, t, events, steps
        if steps >= max_steps:
            return STEP_LIMIT, t, events, steps
        for i in range(n):  # blocks that come to rest
            speed = size_of(v, i)
            if not sliding[i] or at.static[i] == 0.0 or fresh[i] or not speed < rules.capture:
                continue
            slow = speed <= rules.floor
            if at.static[i] - at.friction[i] <= rules.weakest * at.static[i]:
                slow = speed <= max(rules.floor, 0.5 * rules.kick)
            along = force = jerk = spin = 0.0
            for p in range(3):
                g = d = 0.0
                for k in range(order - 2, -1, -1):
                    d = d * h + g
                    g = g * h + b.g[i, p, k]
                work[p] = g
                along += g * v[i, p]
                force += g * g
                jerk += abs(d)
                spin += ra.mass[i, p] * v[i, p] * v[i, p]
            if along >= at.friction[i] * speed and speed > 0.0:
                continue  # gains speed
            stop_s, now = 0.0, False
            if speed > 0.0:
                stop_s, now = stop_of(i, speed, work, v, rules, at, ra.mass[i], jerk, work[3:])
            above = force > at.friction[i] * at.friction[i] and force <= at.static[i] * at.static[i]
            if above and not now:
                slow = speed <= rules.slowest  # slower yet, it may reverse
            if not (now or slow):
                continue
            energy[1] += 0.5 * spin
            for p in range(3):
                v[i, p] = 0.0
                if now:
                    energy[1] += work[p] * work[3 + p]
                    q[i, p] += work[3 + p]
            force = math.sqrt(force)
            if force > at.static[i]:  # reverses: its speed is zero for no time at all
                fresh[i] = force - at.friction[i] > rules.weakest * force
                for p in range(3):
                    v[i, p] = 0.0 if fresh[i] else rules.kick * work[p] / force
                continue
            if events >= len(log.t):
                return EVENT_LIMIT, t, events, steps
            log.t[events], log.block[events], log.start[events] = t + stop_s, i, 0
            events += 1
            sliding[i], moved[i] = False, True
