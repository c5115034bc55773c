# SPDX-License-Identifier: Apache-2.0
"""Power series of the blocks along x: what the exact path makes each segment from.

Between two events each sliding block has a friction of fixed sign, so m u'' = -K u + f(t) is linear
and its series follows from u^(k+2) = (f_k - K u_k) / m. Every step ends where the last terms fall
below the rounding of u, and events are located in the series itself (series.first_root).
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.numerics import ON_LIMIT
from eol_ros.core.physics.series import FAST, first_root

DENSE = 48  # up to so many sliding blocks their stiffness stands as a square matrix


class Lanes(NamedTuple):
    """The sliding blocks side by side: lane c is block slots[c], and slot[i] is i's lane or -1."""

    slot: np.ndarray
    slots: np.ndarray
    a: np.ndarray  # (order + 2, lanes): displacement series
    sign: np.ndarray
    inverse: np.ndarray
    friction: np.ndarray
    k_sum: np.ndarray
    pull: np.ndarray  # (lanes,) N/m, of the springs to the rim
    dense: np.ndarray  # (DENSE, DENSE)
    force: np.ndarray
    swing: np.ndarray
    tail: np.ndarray


@njit(cache=True, inner=True)
def force_now(i, u, at, x):
    """Return the spring force (N) on block i along x, the rim being at x."""
    f = at.drive[i, 0] * x - at.k_sum[i] * u[i]
    for e in range(at.lo[i], at.lo[i + 1]):
        f += at.k_near[e] * u[at.near[e]]
    return f


@njit(cache=True, inner=True)
def fill_lanes(m, mp, at, sign, la):
    """Take constants of the m sliding blocks into their lanes; lanes m..mp stay zero for good."""
    for c in range(m):
        i = la.slots[c]
        la.sign[c] = sign[i]
        la.inverse[c] = at.inverse[i]
        la.friction[c] = at.friction[i]
        la.k_sum[c] = at.k_sum[i]
        la.pull[c] = at.drive[i, 0]
    for c in range(m, mp):
        la.inverse[c] = la.friction[c] = la.k_sum[c] = la.sign[c] = 0.0
        la.pull[c] = la.a[0, c] = la.a[1, c] = 0.0
    if m <= DENSE:
        for c in range(m):
            for j in range(mp):
                la.dense[c, j] = 0.0
            i = la.slots[c]
            la.dense[c, c] = -at.k_sum[i]
            for e in range(at.lo[i], at.lo[i + 1]):
                j = la.slot[at.near[e]]
                if j >= 0:
                    la.dense[c, j] += at.k_near[e]


@njit(cache=True, inner=True, fastmath=FAST)
def segment_series(order, m, mp, u, v, at, x, speed, la):
    """Write the displacement series la.a[k, c] of the m sliding blocks (mp with the padding)."""
    a, w = la.a, la.force
    for c in range(m):
        i = la.slots[c]
        a[0, c], a[1, c] = u[i], v[i]
        w[c] = force_now(i, u, at, x)
    for c in range(m, mp):
        w[c] = 0.0
    for k in range(order - 1):
        if k > 0:
            if m <= DENSE:
                for c in range(mp):
                    w[c] = 0.0
                for j in range(m):
                    for c in range(mp):
                        w[c] += la.dense[j, c] * a[k, j]
            else:
                for c in range(m):
                    i = la.slots[c]
                    f = -la.k_sum[c] * a[k, c]
                    for e in range(at.lo[i], at.lo[i + 1]):
                        j = la.slot[at.near[e]]
                        if j >= 0:
                            f += at.k_near[e] * a[k, j]
                    w[c] = f
            if k == 1:
                for c in range(mp):
                    w[c] += la.pull[c] * speed
        if k == 0:
            for c in range(mp):
                w[c] -= la.sign[c] * la.friction[c]
        scale = 1.0 / ((k + 1) * (k + 2))
        for c in range(mp):
            a[k + 2, c] = w[c] * scale * la.inverse[c]


@njit(cache=True, inner=True, fastmath=FAST)
def reach_of(order, mp, a, small, top):
    """Return the step at which the last two terms of every series fall to `small`."""
    h = top
    for k in range(order - 1, order + 1):
        most = 0.0
        for c in range(mp):
            most = max(most, abs(a[k, c]))
        if most > 0.0:
            h = min(h, (small / most) ** (1.0 / k))
    return h


@njit(cache=True, inner=True, fastmath=FAST)
def bounds(order, mp, h, la):
    """Write sum |a_k| h^k over k >= 1 (swing) and the same of the speed over k >= 3 (tail)."""
    a, swing, tail = la.a, la.swing, la.tail
    for c in range(mp):
        swing[c] = tail[c] = 0.0
    for k in range(order, 2, -1):
        for c in range(mp):
            size = abs(a[k, c])
            swing[c] = (swing[c] + size) * h
            tail[c] = (tail[c] + k * size) * h
    for c in range(mp):
        swing[c] = ((swing[c] + abs(a[2, c])) * h + abs(a[1, c])) * h
        tail[c] *= h


@njit(cache=True, inner=True, fastmath=FAST)
def state_at(order, mp, h, la, x, d):
    """Write displacement and speed of every lane at h."""
    a = la.a
    for c in range(mp):
        x[c] = a[order, c]
        d[c] = 0.0
    for k in range(order - 1, -1, -1):
        for c in range(mp):
            d[c] = d[c] * h + x[c]
            x[c] = x[c] * h + a[k, c]


@njit(cache=True, inner=True)
def stop_root(order, a, c, sign, h, work):
    """Return (x, found): when lane c's speed next falls to zero, its start at rest left out."""
    begin = 1
    while begin < 3 and begin < order and sign * a[begin, c] <= 0.0:
        begin += 1  # a block that has just broken loose starts with speed 0 (mu_s = mu_k: rate 0)
    if sign * a[begin, c] <= 0.0:
        return 0.0, True
    degree = order - begin
    for k in range(degree + 1):
        work[k] = sign * (k + begin) * a[k + begin, c]
    return first_root(work, degree, h)


@njit(cache=True, inner=True)
def break_root(j, force, order, at, speed, h, la, work):
    """Return (x, found): when the force on the stuck block j next reaches its limit."""
    for k in range(1, order + 1):
        work[k] = at.drive[j, 0] * speed if k == 1 else 0.0
    for e in range(at.lo[j], at.lo[j + 1]):
        s = la.slot[at.near[e]]
        if s >= 0:
            for k in range(1, order + 1):
                work[k] += at.k_near[e] * la.a[k, s]
    best, found = h, False
    for side in (-1.0, 1.0):  # limit - F, then limit + F
        for k in range(1, order + 1):
            work[k] = -work[k]
        work[0] = at.static[j] + side * force
        least = ON_LIMIT * at.static[j]
        if work[0] <= least:  # on the limit: it breaks now, or the force is on its way back
            if work[1] < 0.0:
                return 0.0, True
            work[0] = least
        x, hit = first_root(work, order, best)
        if x < best or hit:
            best, found = x, hit
    return best, found


@njit(cache=True, inner=True)
def drive_work(h, t, speed, u, paths, at, la):
    """Return the work (J) of the rim in a step h.

    paths (lanes,): integrals over the step of how far each lane has moved.
    """
    work = 0.0
    for i in range(at.n if speed != 0.0 else 0):
        if at.drive[i, 0] != 0.0:
            path = paths[la.slot[i]] if la.slot[i] >= 0 else 0.0
            work += speed * at.drive[i, 0] * (h * (speed * (t + 0.5 * h) - u[i]) - path)
    return work


@njit(cache=True, inner=True)
def ledger_step(order, m, at, u, t, speed, h, la, paths, energy):
    """Add the drive work and the friction heat (J) of a step h to `energy`; paths is scratch."""
    a = la.a
    for c in range(m):
        x = paths[c] = 0.0
        for k in range(order, 0, -1):
            x = (x + a[k, c]) * h
            paths[c] = (paths[c] + a[k, c] / (k + 1)) * h
        paths[c] *= h
        energy[1] += la.friction[c] * abs(x)
    energy[0] += drive_work(h, t, speed, u, paths, at, la)
