# SPDX-License-Identifier: Apache-2.0
"""Power series of sliding blocks in the plane: springs, geometric or linear, and Coulomb friction.

With q = d.d and r = q^(-1/2): r_k = 1/(k q_0) sum_j (j/2 - k) q_j r_(k-j), j = 1..k (power of a
series; Knuth, The Art of Computer Programming 2, 4.7, eq. 9). Friction needs the direction v/|v|
in the same way. A block that has just broken loose has v = t w(t): then v/|v| = w/|w|, which is
regular, and w_k follows from a linear equation at each order instead of by tiny first steps.
"""

import math

from numba import njit

from eol_ros.core.physics.event2d_lanes import DENSE
from eol_ros.core.physics.lattice import LANES
from eol_ros.core.physics.series import FAST

TINY = 1e-28  # squares of lengths and speeds below it are none: a plate's spring may have length 0


@njit(cache=True)
def force_on(i, u, at, x, y, co, si):
    """Return (fx, fy), the spring force (N) on block i; on a rail fy is 0."""
    if at.geometric:
        fx, fy = geometric_force(
            i, u, at.first, at.second, at.k, at.natural, at.rest, at.anchors, at.lo, at.near,
            at.spring, at.rim_lo, at.rim_spring, x, y, co, si,
        )
    else:
        fx, fy = linear_force(
            i, u, at.lo, at.near, at.k_near, at.k_sum, at.drive, x, y, co, si
        )
    return fx, 0.0 if at.rail else fy


@njit(cache=True)
def linear_force(i, u, lo, near, k_near, k_sum, drive, x, y, co, si):
    """Return (fx, fy), the force (N) of linear springs on block i."""
    fx = drive[i, 0] * x + drive[i, 1] * co - drive[i, 2] * si - k_sum[i] * u[i, 0]
    fy = drive[i, 0] * y + drive[i, 1] * si + drive[i, 2] * co - k_sum[i] * u[i, 1]
    for e in range(lo[i], lo[i + 1]):
        fx += k_near[e] * u[near[e], 0]
        fy += k_near[e] * u[near[e], 1]
    return fx, fy


@njit(cache=True)
def geometric_force(
    i, u, first, second, k, natural, rest, anchors, lo, near, spring, rim_lo, rim_spring,
    x, y, co, si,
):
    """Return (fx, fy), the force (N) of geometric springs on block i."""
    fx = fy = 0.0
    for q in range(lo[i], lo[i + 1]):
        e, j = spring[q], near[q]
        side = 1.0 if first[e] == i else -1.0
        dx = u[j, 0] - u[i, 0] + side * rest[e, 0]
        dy = u[j, 1] - u[i, 1] + side * rest[e, 1]
        length = math.sqrt(dx * dx + dy * dy)
        stiff = k[e] * (1.0 - natural[e] / length) if length > 0.0 else k[e]
        fx += stiff * dx
        fy += stiff * dy
    for q in range(rim_lo[i], rim_lo[i + 1]):
        e = rim_spring[q]
        a = second[e] - len(lo) + 1
        dx = x + co * anchors[a, 0] - si * anchors[a, 1] - u[i, 0] + rest[e, 0]
        dy = y + si * anchors[a, 0] + co * anchors[a, 1] - u[i, 1] + rest[e, 1]
        length = math.sqrt(dx * dx + dy * dy)
        stiff = k[e] * (1.0 - natural[e] / length) if length > 0.0 else k[e]
        fx += stiff * dx
        fy += stiff * dy
    return fx, fy


@njit(cache=True, fastmath=FAST)
def root_order(k, lanes, x, y, square, inverse, nx, ny):
    """Write order k of the square, the inverse length and the direction from orders 0..k."""
    for c in range(lanes):
        square[k, c] = 0.0
        nx[k, c] = 0.0
        ny[k, c] = 0.0
    half = (k + 1) // 2
    for j in range(half):
        for c in range(lanes):
            square[k, c] += 2.0 * (x[j, c] * x[k - j, c] + y[j, c] * y[k - j, c])
    if k % 2 == 0:
        for c in range(lanes):
            square[k, c] += x[half, c] ** 2 + y[half, c] ** 2
    if k == 0:
        for c in range(lanes):
            inverse[0, c] = 1.0 / math.sqrt(square[0, c]) if square[0, c] > TINY else 0.0
    else:
        for c in range(lanes):
            inverse[k, c] = 0.0
        for j in range(1, k + 1):
            weight = (0.5 * j - k) / k
            for c in range(lanes):
                inverse[k, c] += weight * square[j, c] * inverse[k - j, c]
        for c in range(lanes):
            inverse[k, c] *= inverse[0, c] * inverse[0, c]
    for j in range(k + 1):
        for c in range(lanes):
            nx[k, c] += inverse[j, c] * x[k - j, c]
            ny[k, c] += inverse[j, c] * y[k - j, c]


@njit(cache=True)
def spring_start(count, u, first, second, rest, n, anchors, act, x0, y0, co, si, dx, dy):
    """Write order 0 of the vectors along the active springs."""
    for q in range(count):
        e = act[q]
        i, j = first[e], second[e]
        if j >= n:
            px, py = anchors[j - n, 0], anchors[j - n, 1]
            x, y = x0 + co * px - si * py, y0 + si * px + co * py
        else:
            x, y = u[j, 0], u[j, 1]
        dx[0, q] = x - u[i, 0] + rest[e, 0]
        dy[0, q] = y - u[i, 1] + rest[e, 1]


@njit(cache=True)
def spring_ends(
    k, count, ax, ay, act_first, act_second, act_anchor, anchors, x0, y0, co, si, dx, dy
):
    """Write order k >= 1 of the vectors along the active springs."""
    for q in range(count):
        x = y = 0.0
        a, s, f = act_anchor[q], act_second[q], act_first[q]
        if a >= 0:
            x = x0 + co * anchors[a, 0] - si * anchors[a, 1]
            y = y0 + si * anchors[a, 0] + co * anchors[a, 1]
        elif s >= 0:
            x, y = ax[k, s], ay[k, s]
        if f >= 0:
            x -= ax[k, f]
            y -= ay[k, f]
        dx[k, q], dy[k, q] = x, y


@njit(cache=True, fastmath=FAST)
def spring_pull(k, count, m, stiff, natural, first, second, x, y, nx, ny, fx, fy):
    """Turn order k of the directions into the springs' forces, and add them up per block."""
    for q in range((count + LANES - 1) // LANES * LANES):
        nx[k, q] = stiff[q] * (x[k, q] - natural[q] * nx[k, q])
        ny[k, q] = stiff[q] * (y[k, q] - natural[q] * ny[k, q])
    for c in range(m):
        fx[c] = fy[c] = 0.0
    for q in range(count):
        s = first[q]
        if s >= 0:
            fx[s] += nx[k, q]
            fy[s] += ny[k, q]
        s = second[q]
        if s >= 0:
            fx[s] -= nx[k, q]
            fy[s] -= ny[k, q]


@njit(cache=True, fastmath=FAST)
def dense_pull(k, m, mp, dense, ax, ay, fx, fy):
    """Write order k of the linear spring forces of few sliding blocks on each other."""
    for c in range(mp):
        fx[c] = 0.0
        fy[c] = 0.0
    for j in range(m):
        x, y = ax[k, j], ay[k, j]
        for c in range(mp):
            fx[c] += dense[j, c] * x
            fy[c] += dense[j, c] * y


@njit(cache=True)
def sparse_pull(k, m, slot, slots, lo, near, k_near, k_sum, ax, ay, fx, fy):
    """Write order k of the linear spring forces of many sliding blocks on each other."""
    for c in range(m):
        i = slots[c]
        x, y = -k_sum[i] * ax[k, c], -k_sum[i] * ay[k, c]
        for e in range(lo[i], lo[i + 1]):
            j = slot[near[e]]
            if j >= 0:
                x += k_near[e] * ax[k, j]
                y += k_near[e] * ay[k, j]
        fx[c], fy[c] = x, y


@njit(cache=True, fastmath=FAST)
def rim_pull(mp, drive, x, y, co, si, fx, fy):
    """Add what the rim pulls with, for one order of its motion."""
    for c in range(mp):
        fx[c] += drive[0, c] * x + drive[1, c] * co - drive[2, c] * si
        fy[c] += drive[0, c] * y + drive[1, c] * si + drive[2, c] * co


@njit(cache=True, fastmath=FAST)
def speeds(k, m, mp, fresh, ax, ay, fx, fy, inverse, friction, wx, wy):
    """Write order k of w: the velocity, and for fresh lanes the velocity over t."""
    for c in range(mp):
        wx[k, c] = (k + 1) * ax[k + 1, c]
        wy[k, c] = (k + 1) * ay[k + 1, c]
    for c in range(m):
        if fresh[c]:
            wx[k, c] = wy[k, c] = 0.0
            if k == 0:
                force = math.sqrt(fx[c] * fx[c] + fy[c] * fy[c])
                size = (force - friction[c]) * inverse[c] / force
                wx[0, c], wy[0, c] = size * fx[c], size * fy[c]


@njit(cache=True, fastmath=FAST)
def move(k, mp, ax, ay, fx, fy, nx, ny, inverse, friction):
    """Write order k + 2 of the displacements from order k of forces and directions."""
    scale = 1.0 / ((k + 1) * (k + 2))
    for c in range(mp):
        ax[k + 2, c] = (fx[c] - friction[c] * nx[k, c]) * inverse[c] * scale
        ay[k + 2, c] = (fy[c] - friction[c] * ny[k, c]) * inverse[c] * scale


@njit(cache=True)
def move_fresh(k, m, fresh, ax, ay, wx, wy, square, root, inverse, friction):
    """Solve order k >= 1 for lanes that start at rest."""
    for c in range(m):
        if not fresh[c]:
            continue
        scale = 1.0 / ((k + 1) * (k + 2))
        x, y = ax[k + 2, c] / scale, ay[k + 2, c] / scale
        r0 = root[0, c]
        ox, oy = wx[0, c] * r0, wy[0, c] * r0
        along = x * ox + y * oy
        across = 1.0 / (k + 1 + friction[c] * inverse[c] * r0)
        x = along * ox / (k + 1) + (x - along * ox) * across
        y = along * oy / (k + 1) + (y - along * oy) * across
        more = 2.0 * (wx[0, c] * x + wy[0, c] * y)
        square[k, c] += more
        root[k, c] -= 0.5 * more * r0 * r0 * r0
        wx[k, c], wy[k, c] = x, y
        ax[k + 2, c], ay[k + 2, c] = x / (k + 2), y / (k + 2)


@njit(cache=True)
def blocks_series(order, m, count, u, v, used, at, pl, cx, cy, cc, cs):
    """Write the displacement series of the sliding blocks and, geometric, of the spring forces."""
    mp = (m + LANES - 1) // LANES * LANES
    wide = (count + LANES - 1) // LANES * LANES
    # every array by its own name: taking one out of a tuple counts a reference, each time
    ax, ay, fx, fy, slots, fresh = pl.ax, pl.ay, pl.fx, pl.fy, pl.slots, pl.fresh
    inverse, friction, dense, drive = pl.inverse, pl.friction, pl.dense, pl.drive
    wx, wy, w_square, w_inverse = pl.w.x, pl.w.y, pl.w.square, pl.w.inverse
    nx, ny = pl.w.nx, pl.w.ny
    dx, dy, d_square, d_inverse = pl.d.x, pl.d.y, pl.d.square, pl.d.inverse
    pull_x, pull_y, act = pl.d.nx, pl.d.ny, pl.act
    act_first, act_second, act_anchor = pl.act_first, pl.act_second, pl.act_anchor
    act_k, act_natural, anchors = pl.act_k, pl.act_natural, at.anchors
    starts = False
    for c in range(m):
        i = slots[c]
        ax[0, c], ay[0, c] = u[i, 0], u[i, 1]
        ax[1, c], ay[1, c] = v[i, 0], v[i, 1]
        starts = starts or fresh[c]
    for k in range(order - 1):
        x, y, co, si = cx[k], cy[k], cc[k], cs[k]
        if at.geometric:
            if k == 0:
                spring_start(
                    count, u, at.first, at.second, at.rest, at.n, anchors, act,
                    x, y, co, si, dx, dy,
                )
            else:
                spring_ends(
                    k, count, ax, ay, act_first, act_second, act_anchor, anchors,
                    x, y, co, si, dx, dy,
                )
            root_order(k, wide, dx, dy, d_square, d_inverse, pull_x, pull_y)
            spring_pull(
                k, count, m, act_k, act_natural, act_first, act_second,
                dx, dy, pull_x, pull_y, fx, fy,
            )
        elif k == 0:
            for c in range(m):
                fx[c], fy[c] = force_on(slots[c], u, at, x, y, co, si)
        else:
            if m <= DENSE:
                dense_pull(k, m, mp, dense, ax, ay, fx, fy)
            else:
                sparse_pull(
                    k, m, pl.slot, slots, at.lo, at.near, at.k_near, at.k_sum, ax, ay, fx, fy
                )
            if k <= used:
                rim_pull(mp, drive, x, y, co, si, fx, fy)
        if at.rail:
            for c in range(m):
                fy[c] = 0.0
        speeds(k, m, mp, fresh, ax, ay, fx, fy, inverse, friction, wx, wy)
        root_order(k, mp, wx, wy, w_square, w_inverse, nx, ny)
        move(k, mp, ax, ay, fx, fy, nx, ny, inverse, friction)
        if starts and k > 0:
            move_fresh(
                k, m, fresh, ax, ay, wx, wy, w_square, w_inverse, inverse, friction
            )
