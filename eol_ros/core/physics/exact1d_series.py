# SPDX-License-Identifier: Apache-2.0
"""Power series of the blocks along x: what the exact path makes each segment from.

Between two events each sliding block has a friction of fixed sign, so m u'' = -K u + f(t) is linear
and its series follows from u^(k+2) = (f_k - K u_k) / m. Every segment is cut where the last terms
fall below the rounding of u, and events are located in the series itself (series.first_root).
"""

import numpy as np
from numba import njit

from eol_ros.core.physics.series import FAST, first_root

ON_LIMIT = 1e-13  # a force this close to the limit, relative, is on it: simultaneous breaks
GAUSS_X, GAUSS_W = np.polynomial.legendre.leggauss(10)
GAUSS_X, GAUSS_W = 0.5 * (GAUSS_X + 1), 0.5 * GAUSS_W


@njit(cache=True)
def force_now(i, u, near, first, last, k_near, k_sum, drive, cx, cc, cs):
    """Return the spring force (N) on block i along x."""
    f = drive[i, 0] * cx + drive[i, 1] * cc - drive[i, 2] * cs - k_sum[i] * u[i]
    for e in range(first[i], last[i]):
        f += k_near[e] * u[near[e]]
    return f


@njit(cache=True, fastmath=FAST)
def segment_series(
    order,
    m,
    slots,
    u,
    v,
    sign,
    near,
    first,
    last,
    k_near,
    k_sum,
    drive,
    inverse,
    friction,
    speed,
    cx,
    cc,
    cs,
    used,
    slot,
    a,
    w,
    r,
):
    """Write the displacement series a[k, c] of the m sliding blocks `slots`.

    `w` (order, m) is scratch for the force, `r` (order, m) for the speed dependence of friction.
    """
    for c in range(m):
        i = slots[c]
        a[0, c] = u[i]
        a[1, c] = v[i]
        f = force_now(i, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0])
        hold = friction[i]
        if speed > 0.0:
            r[0, c] = 1.0 / (1.0 + sign[i] * v[i] / speed)
            hold *= r[0, c]
        a[2, c] = 0.5 * (f - sign[i] * hold) * inverse[i]
    for k in range(1, order - 1):
        scale = 1.0 / ((k + 1) * (k + 2))
        for c in range(m):
            i = slots[c]
            f = -k_sum[i] * a[k, c]
            for e in range(first[i], last[i]):
                s = slot[near[e]]
                if s >= 0:
                    f += k_near[e] * a[k, s]
            w[k, c] = f
        if k <= used:
            for c in range(m):
                i = slots[c]
                w[k, c] += drive[i, 0] * cx[k] + drive[i, 1] * cc[k] - drive[i, 2] * cs[k]
        if speed > 0.0:
            for c in range(m):
                i = slots[c]
                total = 0.0
                for j in range(1, k + 1):
                    total += (j + 1) * a[j + 1, c] * r[k - j, c]
                r[k, c] = -total * sign[i] / speed * r[0, c]
                w[k, c] -= sign[i] * friction[i] * r[k, c]
        for c in range(m):
            a[k + 2, c] = w[k, c] * scale * inverse[slots[c]]


@njit(cache=True, fastmath=FAST)
def reach_of(order, m, a, small, top):
    """Return the step at which the last two terms of every series fall to `small`."""
    h = top
    for back in range(2):
        k = order - back
        most = 0.0
        for c in range(m):
            most = max(most, abs(a[k, c]))
        if most > 0.0:
            h = min(h, (small / most) ** (1.0 / k))
    return h


@njit(cache=True, fastmath=FAST)
def bounds(order, m, a, h, tail, swing):
    """Write sum |a_k| h^k over k >= 1 (`swing`) and the same of the speed over k >= 3 (`tail`)."""
    for c in range(m):
        swing[c] = 0.0
        tail[c] = 0.0
    for k in range(order, 2, -1):
        for c in range(m):
            size = abs(a[k, c])
            swing[c] = (swing[c] + size) * h
            tail[c] = (tail[c] + k * size) * h
    for c in range(m):
        swing[c] = ((swing[c] + abs(a[2, c])) * h + abs(a[1, c])) * h
        tail[c] *= h


@njit(cache=True, fastmath=FAST)
def advance(order, m, slots, a, h, u, v):
    """Take the sliding blocks to the end of a step h."""
    for c in range(m):
        x = a[order, c]
        d = 0.0
        for k in range(order - 1, -1, -1):
            d = d * h + x
            x = x * h + a[k, c]
        u[slots[c]] = x
        v[slots[c]] = d


@njit(cache=True)
def stop_root(order, a, c, sign, h, work):
    """Return (x, found): when block c's speed next falls to zero, its start at rest left out."""
    begin = 1
    while begin < 3 and begin < order and sign * a[begin, c] <= 0.0:
        begin += (
            1  # a block that has just broken loose starts with speed 0 (and, mu_s = mu_k, rate 0)
        )
    if sign * a[begin, c] <= 0.0:
        return 0.0, True
    degree = order - begin
    for k in range(degree + 1):
        work[k] = sign * (k + begin) * a[k + begin, c]
    return first_root(work, degree, h)


@njit(cache=True)
def break_root(
    j, force, order, a, slot, near, first, last, k_near, drive, cx, cc, cs, used, limit, h, work
):
    """Return (x, found): when the force on the stuck block j next reaches its limit."""
    work[0] = force
    for k in range(1, order + 1):
        f = 0.0
        if k <= used:
            f = drive[j, 0] * cx[k] + drive[j, 1] * cc[k] - drive[j, 2] * cs[k]
        for e in range(first[j], last[j]):
            s = slot[near[e]]
            if s >= 0:
                f += k_near[e] * a[k, s]
        work[k] = f
    best, found = h, False
    for _side in range(2):
        for k in range(order + 1):
            work[k] = -work[k]
        work[0] += limit
        if work[0] <= 0.0:
            rising = work[1] < 0.0
            if rising:
                return 0.0, True
            work[0] = 1e-300
        x, hit = first_root(work, order, best)
        work[0] -= limit
        if x < best or hit:
            best, found = x, hit
    return best, found


@njit(cache=True)
def ledger_step(
    order,
    m,
    slots,
    slot,
    a,
    u,
    friction,
    sign,
    speed,
    rim_block,
    rim_k,
    rim_at,
    cx,
    cc,
    cs,
    used,
    h,
    energy,
):
    """Add the drive work and the friction heat (J) of a step h to `energy`."""
    for c in range(m):
        if speed <= 0.0:
            x = 0.0
            for k in range(order, 0, -1):
                x = (x + a[k, c]) * h
            energy[1] += friction[slots[c]] * abs(x)
    for g in range(len(GAUSS_X)):
        s = GAUSS_X[g] * h
        if speed > 0.0:
            for c in range(m):
                d = 0.0
                for k in range(order, 0, -1):
                    d = d * s + k * a[k, c]
                d = abs(d)
                energy[1] += h * GAUSS_W[g] * friction[slots[c]] * d / (1.0 + d / speed)
        if used == 0:
            continue
        x, xr, co, cor, si, sir = cx[used], 0.0, cc[used], 0.0, cs[used], 0.0
        for k in range(used - 1, -1, -1):
            xr, cor, sir = xr * s + x, cor * s + co, sir * s + si
            x, co, si = x * s + cx[k], co * s + cc[k], si * s + cs[k]
        power = 0.0
        for f in range(len(rim_block)):
            i = rim_block[f]
            ax, ay = rim_at[f, 0], rim_at[f, 1]
            c = slot[i]
            here = u[i]
            if c >= 0:
                here = a[order, c]
                for k in range(order - 1, -1, -1):
                    here = here * s + a[k, c]
            power += rim_k[f] * (x + co * ax - si * ay - here) * (xr + cor * ax - sir * ay)
        energy[0] += h * GAUSS_W[g] * power
