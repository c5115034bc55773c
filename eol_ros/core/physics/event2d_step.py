# SPDX-License-Identifier: Apache-2.0
"""How far a step in the plane may go, how blocks stop, and what the energy books say of it."""

import math

import numpy as np
from numba import njit

from eol_ros.core.physics.event2d_series import geometric_force, linear_force
from eol_ros.core.physics.exact1d_series import GAUSS_W, GAUSS_X, ON_LIMIT
from eol_ros.core.physics.series import FAST, first_root


@njit(cache=True)
def planar_reach(order, m, pl, relative, small, top):
    """Return the step at which the last two terms fall to the tolerances.

    `small` (m) bounds the displacement, `relative` the speed against the block's own speed.
    """
    h = top
    ax, ay = pl.ax, pl.ay
    for k in range(order - 1, order + 1):
        most = drift = rise = 0.0
        for c in range(m):
            size = max(abs(ax[k, c]), abs(ay[k, c]))
            most = max(most, size)
            if pl.fresh[c]:
                rise = max(rise, size / math.sqrt(ax[2, c] ** 2 + ay[2, c] ** 2))
            else:
                square = ax[1, c] ** 2 + ay[1, c] ** 2
                if square > 0.0:
                    drift = max(drift, size / math.sqrt(square))
        if most > 0.0:
            h = min(h, (small / most) ** (1.0 / k))
        if drift > 0.0:
            h = min(h, (relative / (k * drift)) ** (1.0 / (k - 1)))
        if rise > 0.0:
            h = min(h, (2.0 * relative / (k * rise)) ** (1.0 / (k - 2)))
    return h


@njit(cache=True)
def slowing_reach(order, m, pl, h, share, work):
    """Return the step, at most h, within which no block loses more than 1 - `share` of its speed.

    Measured along its first direction. The series of v/|v| knows nothing beyond a point where v
    passes zero, and where v does so on a straight line nothing else would tell.
    """
    for c in range(m):
        first = 2 if pl.fresh[c] else 1
        x0, y0 = pl.w.x[0, c], pl.w.y[0, c]
        square = x0 * x0 + y0 * y0
        if square == 0.0:
            continue
        degree = order - first
        loss = 0.0
        for k in range(degree, 0, -1):
            q = k + first
            work[k] = q * (pl.ax[q, c] * x0 + pl.ay[q, c] * y0) / square
            loss = (loss + max(0.0, -work[k])) * h
        if loss < 1.0 - share:
            continue
        work[0] = 1.0 - share
        h, _ = first_root(work, degree, h)
    return h


@njit(cache=True, fastmath=FAST)
def planar_swing(order, m, h, pl):
    """Write a bound of how far each block moves within a step h."""
    for c in range(m):
        x = y = 0.0
        for k in range(order, 0, -1):
            x = (x + abs(pl.ax[k, c])) * h
            y = (y + abs(pl.ay[k, c])) * h
        pl.swing[c] = math.sqrt(x * x + y * y)


@njit(cache=True, fastmath=FAST)
def planar_state(order, m, h, pl, u, v):
    """Write place and velocity of the sliding blocks at h into u and v."""
    for c in range(m):
        x, y, a, b = pl.ax[order, c], pl.ay[order, c], 0.0, 0.0
        for q in range(order - 1, -1, -1):
            a, b = a * h + x, b * h + y
            x, y = x * h + pl.ax[q, c], y * h + pl.ay[q, c]
        i = pl.slots[c]
        u[i, 0], u[i, 1], v[i, 0], v[i, 1] = x, y, a, b


@njit(cache=True)
def stop_in_closed_form(vx, vy, fx, fy, limit):
    """Return (t, x, y, will): how a block under constant acceleration f < limit comes to rest.

    With s = |v|, f = |f|, c the cosine between them: t = s (mu + f c) / (mu^2 - f^2), along f
    s^2 (f + 2 mu c + f c^2) / (4 (mu^2 - f^2)), across s^2 sin (2 mu + f c) / (4 mu^2 - f^2).
    Found by integrating over the angle between v and f.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    f = math.sqrt(fx * fx + fy * fy)
    if f >= limit:
        return 0.0, 0.0, 0.0, False
    if f == 0.0:
        t = speed / limit
        return t, 0.5 * t * vx, 0.5 * t * vy, True
    ex, ey = fx / f, fy / f
    c = (vx * ex + vy * ey) / speed
    s = (vy * ex - vx * ey) / speed
    apart = (limit - f) * (limit + f)
    t = speed * (limit + f * c) / apart
    along = speed * speed * (f + 2.0 * limit * c + f * c * c) / (4.0 * apart)
    across = speed * speed * s * (2.0 * limit + f * c) / (4.0 * limit * limit - f * f)
    return t, along * ex - across * ey, along * ey + across * ex, True


@njit(cache=True)
def break_root(j, fx0, fy0, order, used, h, at, pl, cx, cy, cc, cs, fx, fy, out):
    """Return (x, found): when the force on the stuck block j next reaches its limit."""
    degree = order - 2 if at.geometric else order
    for k in range(1, degree + 1):
        fx[k] = fy[k] = 0.0
    fx[0], fy[0] = fx0, fy0
    if at.geometric:
        for rim in range(2):
            low, high = (at.lo[j], at.lo[j + 1]) if rim == 0 else (at.rim_lo[j], at.rim_lo[j + 1])
            for q in range(low, high):
                e = at.spring[q] if rim == 0 else at.rim_spring[q]
                lane = pl.place[e]
                if lane >= 0:
                    side = 1.0 if at.first[e] == j else -1.0
                    for k in range(1, degree + 1):
                        fx[k] += side * pl.d.nx[k, lane]
                        fy[k] += side * pl.d.ny[k, lane]
    else:
        for k in range(1, min(used, degree) + 1):
            fx[k] = at.drive[j, 0] * cx[k] + at.drive[j, 1] * cc[k] - at.drive[j, 2] * cs[k]
            fy[k] = at.drive[j, 0] * cy[k] + at.drive[j, 1] * cs[k] + at.drive[j, 2] * cc[k]
        for e in range(at.lo[j], at.lo[j + 1]):
            c = pl.slot[at.near[e]]
            if c >= 0:
                for k in range(1, degree + 1):
                    fx[k] += at.k_near[e] * pl.ax[k, c]
                    fy[k] += at.k_near[e] * pl.ay[k, c]
    if at.rail:
        fy[1 : degree + 1] = 0.0
    limit = at.static[j]
    for k in range(2 * degree + 1):
        out[k] = 0.0
    for a in range(degree + 1):
        for b in range(degree + 1):
            out[a + b] -= fx[a] * fx[b] + fy[a] * fy[b]
    now = math.sqrt(fx0 * fx0 + fy0 * fy0)
    out[0] = (limit - now) * (limit + now)
    for k in range(2 * degree + 1):
        out[k] /= limit * limit
    if out[0] <= ON_LIMIT:  # on the limit: it breaks now, or the force is on its way back
        if out[1] < 0.0:
            return 0.0, True
        out[0] = ON_LIMIT
    return first_root(out, 2 * degree, h)


@njit(cache=True)
def stretch(far, stiff, natural, inverse_length):
    """Return a bound (N) of the change of a spring's force while one end moves by `far`."""
    if natural > 0.0:
        length = (1.0 / inverse_length if inverse_length > 0.0 else 0.0) - far
        if length <= 0.5 * natural:  # short springs turn faster than they stretch
            return np.inf if length <= 0.0 else stiff * far * (natural / length - 1.0)
    return stiff * far


@njit(cache=True)
def suspects(
    watching, watched, u, rim_far, turn, x, y, co, si, found, found_x, found_y, push,
    first, second, k, natural, rest, anchors, lo, near, spring, rim_lo, rim_spring,
    k_near, k_sum, drive, static, geometric, rail, slot, swing, place, inverse_length,
):
    """Write the stuck blocks that may break within a step, their force and its reach (N)."""
    n, count = len(lo) - 1, 0
    for p in range(watching):
        j = watched[p]
        more = 0.0
        if geometric:
            fx, fy = geometric_force(
                j, u, first, second, k, natural, rest, anchors, lo, near, spring,
                rim_lo, rim_spring, x, y, co, si,
            )
            for q in range(lo[j], lo[j + 1]):
                if slot[near[q]] >= 0:
                    e = spring[q]
                    far = swing[slot[near[q]]]
                    more += stretch(far, k[e], natural[e], inverse_length[0, place[e]])
        else:
            fx, fy = linear_force(j, u, lo, near, k_near, k_sum, drive, x, y, co, si)
            for q in range(lo[j], lo[j + 1]):
                if slot[near[q]] >= 0:
                    more += k_near[q] * swing[slot[near[q]]]
        if rim_far + turn > 0.0:
            for q in range(rim_lo[j], rim_lo[j + 1]):
                e = rim_spring[q]
                a = second[e] - n
                far = rim_far + turn * math.sqrt(anchors[a, 0] ** 2 + anchors[a, 1] ** 2)
                if geometric:
                    more += stretch(far, k[e], natural[e], inverse_length[0, place[e]])
                else:
                    more += k[e] * far
        if rail:
            fy = 0.0
        if math.sqrt(fx * fx + fy * fy) + more >= static[j] * (1.0 - ON_LIMIT):
            found[count], found_x[count], found_y[count], push[count] = j, fx, fy, more
            count += 1
    return count


@njit(cache=True)
def planar_ledger(order, m, u, at, pl, cx, cy, cc, cs, used, h, energy, here, rate):
    """Add the drive work and the friction heat (J) of a step h to `energy`."""
    here[:] = u
    for g in range(len(GAUSS_X)):
        s = GAUSS_X[g] * h
        planar_state(order, m, s, pl, here, rate)
        for c in range(m):
            i = pl.slots[c]
            speed = math.sqrt(rate[i, 0] ** 2 + rate[i, 1] ** 2)
            energy[1] += h * GAUSS_W[g] * at.friction[i] * speed
        if used == 0:
            continue
        x, xr, y, yr = cx[used], 0.0, cy[used], 0.0
        co, cor, si, sir = cc[used], 0.0, cs[used], 0.0
        for q in range(used - 1, -1, -1):
            xr, yr, cor, sir = xr * s + x, yr * s + y, cor * s + co, sir * s + si
            x, y, co, si = x * s + cx[q], y * s + cy[q], co * s + cc[q], si * s + cs[q]
        for e in range(len(at.k)):
            if at.second[e] < at.n:
                continue
            bx, by = at.anchors[at.second[e] - at.n, 0], at.anchors[at.second[e] - at.n, 1]
            i = at.first[e]
            dx = x + co * bx - si * by - here[i, 0]
            dy = y + si * bx + co * by - here[i, 1]
            pull = at.k[e]
            if at.geometric:
                dx += at.rest[e, 0]
                dy += at.rest[e, 1]
                if at.natural[e] > 0.0:
                    pull *= 1.0 - at.natural[e] / math.sqrt(dx * dx + dy * dy)
            power = pull * dx * (xr + cor * bx - sir * by)
            if not at.rail:
                power += pull * dy * (yr + sir * bx + cor * by)
            energy[0] += h * GAUSS_W[g] * power
