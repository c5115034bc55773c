# SPDX-License-Identifier: Apache-2.0
"""Power series of sliding blocks in the plane: springs, geometric or linear, and Coulomb friction.

With q = d.d and r = q^(-1/2): r_k = 1/(k q_0) sum_j (j/2 - k) q_j r_(k-j), j = 1..k (power of a
series; Knuth, The Art of Computer Programming 2, 4.7, eq. 9). Friction needs the direction v/|v|
in the same way. A block that has just broken loose has v = t w(t): then v/|v| = w/|w|, which is regular,
and w_k is found from a linear equation at each order instead of by tiny first steps.
"""

import math

import numpy as np
from numba import njit

from eol_ros.core.physics.series import FAST, first_root


@njit(cache=True)
def spring_pull(e, first, second, u, n, k, natural, rest, anchors, geometric, x, y, co, si):
    """Return (fx, fy), the force (N) of spring e on its first end."""
    i, j = first[e], second[e]
    if j < n:
        dx, dy = u[j, 0] - u[i, 0], u[j, 1] - u[i, 1]
    else:
        ax, ay = anchors[j - n, 0], anchors[j - n, 1]
        dx = x + co * ax - si * ay - u[i, 0]
        dy = y + si * ax + co * ay - u[i, 1]
    stiff = k[e]
    if geometric:
        dx += rest[e, 0]
        dy += rest[e, 1]
        if natural[e] > 0.0:
            length = math.sqrt(dx * dx + dy * dy)
            stiff = stiff * (1.0 - natural[e] / length) if length > 0.0 else 0.0
    return stiff * dx, stiff * dy


@njit(cache=True)
def force_on(
    i, u, n, first, second, k, natural, rest, anchors, start, spring, geometric, rail, x, y, co, si
):
    """Return (fx, fy), the spring force (N) on block i; on a rail fy is 0."""
    fx = fy = 0.0
    for q in range(start[i], start[i + 1]):
        e = spring[q]
        px, py = spring_pull(
            e, first, second, u, n, k, natural, rest, anchors, geometric, x, y, co, si
        )
        if first[e] == i:
            fx += px
            fy += py
        else:
            fx -= px
            fy -= py
    return fx, 0.0 if rail else fy


@njit(cache=True)
def spring_ends(
    k, lanes, count, slot_first, slot_second, anchor, ax, ay, anchors, cx, cy, cc, cs, dx, dy
):
    """Write order k >= 1 of the vectors along the `count` active springs."""
    for q in range(count):
        x = y = 0.0
        s = slot_second[q]
        if s >= 0:
            x, y = ax[k, s], ay[k, s]
        elif anchor[q] >= 0:
            px, py = anchors[anchor[q], 0], anchors[anchor[q], 1]
            x = cx[k] + cc[k] * px - cs[k] * py
            y = cy[k] + cs[k] * px + cc[k] * py
        s = slot_first[q]
        if s >= 0:
            x -= ax[k, s]
            y -= ay[k, s]
        dx[k, q], dy[k, q] = x, y


@njit(cache=True, fastmath=FAST)
def spring_order(k, count, stiff, natural, dx, dy, qq, rr, fx, fy):
    """Write order k of the forces of the active springs, from orders 0..k of dx and dy."""
    for q in range(count):
        qq[k, q] = 0.0
        fx[k, q] = 0.0
        fy[k, q] = 0.0
    half = (k + 1) // 2
    for j in range(half):
        for q in range(count):
            qq[k, q] += 2.0 * (dx[j, q] * dx[k - j, q] + dy[j, q] * dy[k - j, q])
    if k % 2 == 0:
        for q in range(count):
            qq[k, q] += dx[half, q] ** 2 + dy[half, q] ** 2
    if k == 0:
        for q in range(count):
            rr[0, q] = 1.0 / math.sqrt(qq[0, q]) if qq[0, q] > 0.0 else 0.0
    else:
        for q in range(count):
            rr[k, q] = 0.0
        for j in range(1, k + 1):
            weight = (0.5 * j - k) / k
            for q in range(count):
                rr[k, q] += weight * qq[j, q] * rr[k - j, q]
        for q in range(count):
            rr[k, q] *= rr[0, q] * rr[0, q]
    for j in range(k + 1):
        for q in range(count):
            fx[k, q] += rr[j, q] * dx[k - j, q]
            fy[k, q] += rr[j, q] * dy[k - j, q]
    for q in range(count):
        fx[k, q] = stiff[q] * (dx[k, q] - natural[q] * fx[k, q])
        fy[k, q] = stiff[q] * (dy[k, q] - natural[q] * fy[k, q])


@njit(cache=True, fastmath=FAST)
def direction_order(k, m, wx, wy, ss, rr, nx, ny):
    """Write order k of the direction of motion w/|w|, from orders 0..k of w."""
    for c in range(m):
        ss[k, c] = 0.0
        nx[k, c] = 0.0
        ny[k, c] = 0.0
    half = (k + 1) // 2
    for j in range(half):
        for c in range(m):
            ss[k, c] += 2.0 * (wx[j, c] * wx[k - j, c] + wy[j, c] * wy[k - j, c])
    if k % 2 == 0:
        for c in range(m):
            ss[k, c] += wx[half, c] ** 2 + wy[half, c] ** 2
    if k == 0:
        for c in range(m):
            rr[0, c] = 1.0 / math.sqrt(ss[0, c]) if ss[0, c] > 0.0 else 0.0
    else:
        for c in range(m):
            rr[k, c] = 0.0
        for j in range(1, k + 1):
            weight = (0.5 * j - k) / k
            for c in range(m):
                rr[k, c] += weight * ss[j, c] * rr[k - j, c]
        for c in range(m):
            rr[k, c] *= rr[0, c] * rr[0, c]
    for j in range(k + 1):
        for c in range(m):
            nx[k, c] += rr[j, c] * wx[k - j, c]
            ny[k, c] += rr[j, c] * wy[k - j, c]


@njit(cache=True)
def linear_order(
    k,
    m,
    slots,
    slot,
    ax,
    ay,
    first,
    second,
    stiff,
    start,
    spring,
    n,
    anchors,
    used,
    cx,
    cy,
    cc,
    cs,
    fx,
    fy,
):
    """Write order k >= 1 of the linear spring forces on the sliding blocks."""
    for c in range(m):
        i = slots[c]
        x = y = 0.0
        for q in range(start[i], start[i + 1]):
            e = spring[q]
            j = second[e] if first[e] == i else first[e]
            px, py = -ax[k, c], -ay[k, c]
            if j >= n:
                if k <= used:
                    bx, by = anchors[j - n, 0], anchors[j - n, 1]
                    px += cx[k] + cc[k] * bx - cs[k] * by
                    py += cy[k] + cs[k] * bx + cc[k] * by
            elif slot[j] >= 0:
                px += ax[k, slot[j]]
                py += ay[k, slot[j]]
            x += stiff[e] * px
            y += stiff[e] * py
        fx[c], fy[c] = x, y


@njit(cache=True)
def blocks_series(
    order,
    m,
    slots,
    slot,
    fresh,
    u,
    v,
    n,
    first,
    second,
    stiff,
    natural,
    rest,
    anchors,
    start,
    spring,
    geometric,
    rail,
    inverse,
    friction,
    used,
    cx,
    cy,
    cc,
    cs,
    count,
    act,
    act_first,
    act_second,
    act_anchor,
    act_k,
    act_natural,
    ax,
    ay,
    wx,
    wy,
    ss,
    rr,
    nx,
    ny,
    dx,
    dy,
    qq,
    qr,
    px,
    py,
    fx,
    fy,
):
    """Write the displacement series ax, ay[k, c] of the m sliding blocks.

    For geometric springs also the force series px, py[k, q] of the `count` active springs. `fresh`
    marks lanes that start at rest. Other arrays are scratch.
    """
    for c in range(m):
        i = slots[c]
        ax[0, c], ay[0, c] = u[i, 0], u[i, 1]
        ax[1, c], ay[1, c] = v[i, 0], v[i, 1]
    for k in range(order - 1):
        if geometric:
            if k == 0:
                for q in range(count):
                    e = act[q]
                    i, j = first[e], second[e]
                    if j < n:
                        x, y = u[j, 0], u[j, 1]
                    else:
                        bx, by = anchors[j - n, 0], anchors[j - n, 1]
                        x = cx[0] + cc[0] * bx - cs[0] * by
                        y = cy[0] + cs[0] * bx + cc[0] * by
                    dx[0, q] = x - u[i, 0] + rest[e, 0]
                    dy[0, q] = y - u[i, 1] + rest[e, 1]
            else:
                spring_ends(
                    k,
                    0,
                    count,
                    act_first,
                    act_second,
                    act_anchor,
                    ax,
                    ay,
                    anchors,
                    cx,
                    cy,
                    cc,
                    cs,
                    dx,
                    dy,
                )
            spring_order(k, count, act_k, act_natural, dx, dy, qq, qr, px, py)
            for c in range(m):
                fx[c] = fy[c] = 0.0
            for q in range(count):
                s = act_first[q]
                if s >= 0:
                    fx[s] += px[k, q]
                    fy[s] += py[k, q]
                s = act_second[q]
                if s >= 0:
                    fx[s] -= px[k, q]
                    fy[s] -= py[k, q]
        elif k == 0:
            for c in range(m):
                fx[c], fy[c] = force_on(
                    slots[c],
                    u,
                    n,
                    first,
                    second,
                    stiff,
                    natural,
                    rest,
                    anchors,
                    start,
                    spring,
                    False,
                    rail,
                    cx[0],
                    cy[0],
                    cc[0],
                    cs[0],
                )
        else:
            linear_order(
                k,
                m,
                slots,
                slot,
                ax,
                ay,
                first,
                second,
                stiff,
                start,
                spring,
                n,
                anchors,
                used,
                cx,
                cy,
                cc,
                cs,
                fx,
                fy,
            )
        if rail:
            for c in range(m):
                fy[c] = 0.0
        for c in range(m):
            if fresh[c]:
                wx[k, c] = wy[k, c] = 0.0
                if k == 0:
                    force = math.sqrt(fx[c] * fx[c] + fy[c] * fy[c])
                    size = (force - friction[slots[c]]) * inverse[slots[c]] / force
                    wx[0, c], wy[0, c] = size * fx[c], size * fy[c]
            else:
                wx[k, c] = (k + 1) * ax[k + 1, c]
                wy[k, c] = (k + 1) * ay[k + 1, c]
        direction_order(k, m, wx, wy, ss, rr, nx, ny)
        scale = 1.0 / ((k + 1) * (k + 2))
        for c in range(m):
            i = slots[c]
            x = (fx[c] - friction[i] * nx[k, c]) * inverse[i]
            y = (fy[c] - friction[i] * ny[k, c]) * inverse[i]
            if fresh[c] and k > 0:
                r0 = rr[0, c]
                ox, oy = wx[0, c] * r0, wy[0, c] * r0
                along = x * ox + y * oy
                across = 1.0 / (k + 1 + friction[i] * inverse[i] * r0)
                wx[k, c] = along * ox / (k + 1) + (x - along * ox) * across
                wy[k, c] = along * oy / (k + 1) + (y - along * oy) * across
                more = 2.0 * (wx[0, c] * wx[k, c] + wy[0, c] * wy[k, c])
                ss[k, c] += more
                rr[k, c] -= 0.5 * more * r0 * r0 * r0
                x, y = (k + 1) * wx[k, c], (k + 1) * wy[k, c]
            ax[k + 2, c] = x * scale
            ay[k + 2, c] = y * scale


@njit(cache=True)
def planar_reach(order, m, ax, ay, fresh, relative, small, top):
    """Return the step at which the last two terms fall to the tolerances.

    `small` (m) bounds the displacement, `relative` the speed against the block's own speed.
    """
    h = top
    for c in range(m):
        speed = math.sqrt(ax[1, c] ** 2 + ay[1, c] ** 2)
        rate = 2.0 * math.sqrt(ax[2, c] ** 2 + ay[2, c] ** 2)
        for back in range(2):
            k = order - back
            size = max(abs(ax[k, c]), abs(ay[k, c]))
            if size <= 0.0:
                continue
            if size * h**k > small:
                h = (small / size) ** (1.0 / k)
            if fresh[c]:
                if k * size * h ** (k - 2) > relative * rate:
                    h = (relative * rate / (k * size)) ** (1.0 / (k - 2))
            elif speed > 0.0 and k * size * h ** (k - 1) > relative * speed:
                h = (relative * speed / (k * size)) ** (1.0 / (k - 1))
    return h


@njit(cache=True)
def slowing_reach(order, m, ax, ay, wx, wy, fresh, h, share, work):
    """Return the step, at most h, within which no block loses more than 1 - `share` of its speed.

    Measured along its first direction. The series of v/|v| knows nothing beyond a point where v
    passes zero, and where v does so on a straight line nothing else would tell.
    """
    for c in range(m):
        first = 1 if not fresh[c] else 2
        x0, y0 = wx[0, c], wy[0, c]
        square = x0 * x0 + y0 * y0
        if square == 0.0:
            continue
        degree = order - first
        loss = 0.0
        for k in range(degree, 0, -1):
            q = k + first
            work[k] = q * (ax[q, c] * x0 + ay[q, c] * y0) / square
            loss = (loss + max(0.0, -work[k])) * h
        if loss < 1.0 - share:
            continue
        work[0] = 1.0 - share
        h, _ = first_root(work, degree, h)
    return h


@njit(cache=True, fastmath=FAST)
def planar_swing(order, m, ax, ay, h, swing):
    """Write a bound of how far each block moves within a step h."""
    for c in range(m):
        x = y = 0.0
        for k in range(order, 0, -1):
            x = (x + abs(ax[k, c])) * h
            y = (y + abs(ay[k, c])) * h
        swing[c] = math.sqrt(x * x + y * y)


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
def product(order, fx, fy, limit, out):
    """Write limit^2 - fx^2 - fy^2 over limit^2 as a polynomial of degree 2 * order."""
    out[:] = 0.0
    for j in range(order + 1):
        for k in range(order + 1):
            out[j + k] -= fx[j] * fx[k] + fy[j] * fy[k]
    low = np.sqrt(fx[0] ** 2 + fy[0] ** 2)
    out[0] = (limit - low) * (limit + low)
    for k in range(2 * order + 1):
        out[k] /= limit * limit
