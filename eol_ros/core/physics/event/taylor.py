# SPDX-License-Identifier: Apache-2.0
"""Power series of sliding blocks in the plane: springs, geometric or linear, and Coulomb friction.

With q = d.d and r = q^(-1/2): r_k = 1/(k q_0) sum_j (j/2 - k) q_j r_(k-j), j = 1..k (power of a
series; Knuth, The Art of Computer Programming 2, 4.7, eq. 9). Friction needs the direction v/|v|
in the same way. A block that has just broken loose has v = t w(t): then v/|v| = w/|w|, which is
regular, and w_k follows from a linear equation at each order instead of by tiny first steps.
"""

import math

from eol_ros.core.physics.event.lanes import CREEPING, MOVING, NOTHING, WEAK, take_lane
from eol_ros.core.physics.series import inlined, uncounted

CREEP_S = 1e-3  # of a time so long a direction must settle
CREEP = 10.0  # times at least; so many steps would follow it
TINY = 1e-28  # squares of lengths and speeds below it are none: a plate's spring may have length 0


@uncounted
def force_on(i, u, at, x, y, co, si):
    """Return (fx, fy), the spring force (N) on block i; on a rail fy is 0."""
    if not at.geometric:
        fx = at.drive[i, 0] * x + at.drive[i, 1] * co - at.drive[i, 2] * si - at.k_sum[i] * u[i, 0]
        fy = at.drive[i, 0] * y + at.drive[i, 1] * si + at.drive[i, 2] * co - at.k_sum[i] * u[i, 1]
        for e in range(at.lo[i], at.lo[i + 1]):
            j = at.near[e]
            fx += at.k_near[e] * u[j, 0]
            fy += at.k_near[e] * u[j, 1]
        return fx, 0.0 if at.rail else fy
    fx = fy = 0.0
    for q in range(at.lo[i], at.lo[i + 1]):
        e, j = at.spring[q], at.near[q]
        side = 1.0 if at.first[e] == i else -1.0
        dx = u[j, 0] - u[i, 0] + side * at.rest[e, 0]
        dy = u[j, 1] - u[i, 1] + side * at.rest[e, 1]
        length = math.sqrt(dx * dx + dy * dy)
        stiff = at.k[e] * (1.0 - at.natural[e] / length) if length > 0.0 else at.k[e]
        fx += stiff * dx
        fy += stiff * dy
    for q in range(at.rim_lo[i], at.rim_lo[i + 1]):
        e = at.rim_spring[q]
        dx, dy = to_rim(e, u[i, 0], u[i, 1], at, x, y, co, si)
        length = math.sqrt(dx * dx + dy * dy)
        stiff = at.k[e] * (1.0 - at.natural[e] / length) if length > 0.0 else at.k[e]
        fx += stiff * dx
        fy += stiff * dy
    return fx, 0.0 if at.rail else fy


@inlined
def to_rim(e, ux, uy, at, x, y, co, si):
    """Return the vector along spring e, from its block displaced by u to the rim."""
    a = at.second[e] - at.n
    ax, ay = at.anchors[a, 0], at.anchors[a, 1]
    dx = x + co * ax - si * ay - ux + at.rest[e, 0]
    return dx, y + si * ax + co * ay - uy + at.rest[e, 1]


@inlined
def spring_vector(e, u, at, x, y, co, si):
    """Return the vector along spring e from its first end to its second, a block or the rim."""
    i, j = at.first[e], at.second[e]
    if j >= at.n:
        return to_rim(e, u[i, 0], u[i, 1], at, x, y, co, si)
    return u[j, 0] - u[i, 0] + at.rest[e, 0], u[j, 1] - u[i, 1] + at.rest[e, 1]


@inlined
def direction_order(k, q, x, y, square, inverse):
    """Write order k of the square and the inverse length in row q; return that of the direction."""
    xk, yk = x[q, k], y[q, k]
    if k == 0:
        s = xk * xk + yk * yk
        r = 1.0 / math.sqrt(s) if s > TINY else 0.0
        square[q, 0], inverse[q, 0] = s, r
        return r * xk, r * yk
    x0, y0, r0 = x[q, 0], y[q, 0], inverse[q, 0]
    s, r, nx, ny = 2.0 * (x0 * xk + y0 * yk), 0.0, 0.0, 0.0
    half = 0.5 / k
    for j in range(1, k):
        xj, yj, rj = x[q, j], y[q, j], inverse[q, k - j]
        s += xj * x[q, k - j] + yj * y[q, k - j]
        r += (half * j - 1.0) * square[q, j] * rj
        nx += rj * xj
        ny += rj * yj
    r = (r - 0.5 * s * r0) * r0 * r0
    square[q, k], inverse[q, k] = s, r
    return nx + r0 * xk + r * x0, ny + r0 * yk + r * y0


@inlined
def pull_order(k, q, at, pl):
    """Write order k of the force of the spring in lane q."""
    e = pl.act[q]
    stiff, natural = at.k[e], pl.natural[q]
    x, y = pl.d.x[q, k], pl.d.y[q, k]
    if natural > 0.0:
        nx, ny = direction_order(k, q, pl.d.x, pl.d.y, pl.d.square, pl.d.inverse)
        x -= natural * nx
        y -= natural * ny
    pl.px[q, k], pl.py[q, k] = stiff * x, stiff * y


@inlined
def springs_order(k, count, u, at, pl, x0, y0, co, si):
    """Write order k of the springs' vectors and forces, and add these up per block."""
    for q in range(count):
        f, s, a = pl.act_first[q], pl.act_second[q], pl.act_anchor[q]
        if k == 0:
            x, y = spring_vector(pl.act[q], u, at, x0, y0, co, si)
        else:
            x = y = 0.0
            if a >= 0:
                x = x0 + co * at.anchors[a, 0] - si * at.anchors[a, 1]
                y = y0 + si * at.anchors[a, 0] + co * at.anchors[a, 1]
            elif s >= 0:
                x, y = pl.ax[s, k], pl.ay[s, k]
            if f >= 0:
                x -= pl.ax[f, k]
                y -= pl.ay[f, k]
        pl.d.x[q, k], pl.d.y[q, k] = x, y
        pull_order(k, q, at, pl)
        if f >= 0:
            pl.fx[f] += pl.px[q, k]
            pl.fy[f] += pl.py[q, k]
        if s >= 0:
            pl.fx[s] -= pl.px[q, k]
            pl.fy[s] -= pl.py[q, k]


@uncounted
def rim_spring_series(e, lane, degree, used, u, at, pl, cx, cy, cc, cs):
    """Write the series of a spring between the rim and a block at rest, in a lane of its own."""
    take_lane(e, lane, at, pl)
    i, a = at.first[e], at.second[e] - at.n
    x, y = to_rim(e, u[i, 0], u[i, 1], at, cx[0], cy[0], cc[0], cs[0])
    pl.d.x[lane, 0], pl.d.y[lane, 0] = x, y
    pull_order(0, lane, at, pl)
    for k in range(1, degree + 1):
        pl.d.x[lane, k] = pl.d.y[lane, k] = 0.0
        if k <= used:
            ax, ay = at.anchors[a, 0], at.anchors[a, 1]
            pl.d.x[lane, k] = cx[k] + cc[k] * ax - cs[k] * ay
            pl.d.y[lane, k] = cy[k] + cs[k] * ax + cc[k] * ay
        pull_order(k, lane, at, pl)


@inlined
def linear_order(k, m, used, u, at, pl, x, y, co, si):
    """Write order k of the linear springs' forces on the sliding blocks."""
    for c in range(m):
        i = pl.slots[c]
        if k == 0:
            pl.fx[c], pl.fy[c] = force_on(i, u, at, x, y, co, si)
            continue
        fx, fy = -at.k_sum[i] * pl.ax[c, k], -at.k_sum[i] * pl.ay[c, k]
        for e in range(pl.tie_lo[c], pl.tie_lo[c + 1]):
            j, stiff = pl.tie[e], pl.tie_k[e]
            fx += stiff * pl.ax[j, k]
            fy += stiff * pl.ay[j, k]
        if k <= used:
            fx += at.drive[i, 0] * x + at.drive[i, 1] * co - at.drive[i, 2] * si
            fy += at.drive[i, 0] * y + at.drive[i, 1] * si + at.drive[i, 2] * co
        pl.fx[c], pl.fy[c] = fx, fy


@uncounted
def weak_order(k, c, mass_inverse, friction, pl):
    """Do what `slide_order` does for a lane that starts with little or no acceleration, or creeps.

    v = s n, n a unit vector, s a signed speed, both series of their own: m s' = f.n - F, and
    m s n' = f - (f.n) n gives n_k from s_1.. and n_0..n_(k-1), for s_0 = 0. Nothing is divided by
    the speed, so that the series does not end where v/|v| would: at the zero of s = s_1 t + s_2 t^2
    that lies just before the start. With s_1 = 0 it is asymptotic: its terms fall until
    k s_2 t = F / m, long after they are below any tolerance. Where s_0 is not 0, but small, the
    term m s_0 n' is taken from the round before, each of which gains a factor k m s_0 / (F t).
    """
    fx, fy, nx, ny = pl.past_x, pl.past_y, pl.w.x, pl.w.y
    g, s = pl.w.square, pl.w.inverse
    mass, top = 1.0 / mass_inverse, pl.known_x.shape[1] - 1
    fx[c, k], fy[c, k] = pl.fx[c], pl.fy[c]
    late_x, late_y, begin = 0.0, 0.0, 0.0
    if pl.start[c] == CREEPING:
        if k == 0:
            s[c, 0] = math.sqrt(pl.ax[c, 1] ** 2 + pl.ay[c, 1] ** 2)
        begin = s[c, 0]
        if k + 1 < top:
            late_x, late_y = begin * pl.known_x[c, k + 1], begin * pl.known_y[c, k + 1]
    if k == 0:
        x, y = fx[c, 0] - mass * late_x, fy[c, 0] - mass * late_y
        size = math.sqrt(x * x + y * y)
        nx[c, 0], ny[c, 0] = x / size, y / size
        g[c, 0] = fx[c, 0] * nx[c, 0] + fy[c, 0] * ny[c, 0]
        more = g[c, 0] - friction
        if pl.start[c] == CREEPING:
            pl.ax[c, 1], pl.ay[c, 1] = begin * nx[c, 0], begin * ny[c, 0]
        else:
            s[c, 0] = 0.0
            more = more if more > NOTHING * friction else 0.0
        s[c, 1] = more * mass_inverse
        pl.ax[c, 2] = 0.5 * (s[c, 1] * nx[c, 0] + late_x)
        pl.ay[c, 2] = 0.5 * (s[c, 1] * ny[c, 0] + late_y)
        return
    ex, ey = nx[c, 0], ny[c, 0]
    x = fx[c, k] - mass * (k + 1) * late_x
    y = fy[c, k] - mass * (k + 1) * late_y
    along = 0.0
    for j in range(1, k):
        back = g[c, k - j] + mass * j * s[c, k + 1 - j]
        x -= back * nx[c, j]
        y -= back * ny[c, j]
        along -= 0.5 * (nx[c, j] * nx[c, k - j] + ny[c, j] * ny[c, k - j])
    across = (y * ex - x * ey) / (g[c, 0] + mass * k * s[c, 1])
    nx[c, k], ny[c, k] = along * ex - across * ey, along * ey + across * ex
    total = 0.0
    for j in range(k + 1):
        total += fx[c, j] * nx[c, k - j] + fy[c, j] * ny[c, k - j]
    g[c, k] = total
    s[c, k + 1] = total * mass_inverse / (k + 1)
    x, y = late_x, late_y
    for j in range(k + 1):
        x += s[c, k + 1 - j] * nx[c, j]
        y += s[c, k + 1 - j] * ny[c, j]
    pl.ax[c, k + 2], pl.ay[c, k + 2] = x / (k + 2), y / (k + 2)


@uncounted
def settle_directions(order, m, span, pl):
    """Return by how much the directions of creeping lanes have changed since the round before."""
    change = 0.0
    for c in range(m):
        if pl.start[c] == CREEPING:
            power = 1.0
            for k in range(order - 1):
                x, y = pl.w.x[c, k], pl.w.y[c, k]
                more = abs(x - pl.known_x[c, k]) + abs(y - pl.known_y[c, k])
                change = max(change, more * power)
                pl.known_x[c, k], pl.known_y[c, k] = x, y
                power *= span
    return change


@uncounted
def keep_direction(order, c, h, pl):
    """Write the direction of a creeping lane as a series about h: where its next step begins."""
    x, y = pl.known_x, pl.known_y
    for k in range(order - 1):
        x[c, k], y[c, k] = pl.w.x[c, k], pl.w.y[c, k]
    x[c, order - 1] = y[c, order - 1] = 0.0
    for k in range(order - 2):
        for j in range(order - 3, k - 1, -1):
            x[c, j] += h * x[c, j + 1]
            y[c, j] += h * y[c, j + 1]


@uncounted
def may_creep(i, x, y, vx, vy, small, at):
    """Return whether block i, with force (x, y), is so slow that its direction is that force's.

    What it misses by being put on it must move it by less than `small`.
    """
    speed, limit = math.sqrt(vx * vx + vy * vy), at.friction[i] * at.inverse[i]
    if speed == 0.0 or limit * CREEP_S < CREEP * speed or x * vx + y * vy <= 0.0:
        return False
    aside = abs(x * vy - y * vx) / math.sqrt(x * x + y * y)
    return aside * speed < small * limit


@inlined
def slide_order(k, c, mass_inverse, friction, pl):
    """Write order k of the direction of lane c and order k + 2 of its displacement."""
    wx, wy, square, root = pl.w.x, pl.w.y, pl.w.square, pl.w.inverse
    fx, fy = pl.fx[c], pl.fy[c]
    if pl.start[c] >= WEAK:
        weak_order(k, c, mass_inverse, friction, pl)
        return
    if pl.start[c] == MOVING:
        wx[c, k], wy[c, k] = (k + 1) * pl.ax[c, k + 1], (k + 1) * pl.ay[c, k + 1]
        nx = ny = 0.0
        if friction > 0.0:
            nx, ny = direction_order(k, c, wx, wy, square, root)
        scale = mass_inverse / ((k + 1) * (k + 2))
        pl.ax[c, k + 2] = (fx - friction * nx) * scale
        pl.ay[c, k + 2] = (fy - friction * ny) * scale
        return
    if k == 0:
        force = math.sqrt(fx * fx + fy * fy)
        size = (force - friction) * mass_inverse / force
        wx[c, 0], wy[c, 0] = size * fx, size * fy
        direction_order(0, c, wx, wy, square, root)
    else:  # the direction without w_k, then w_k itself
        wx[c, k] = wy[c, k] = 0.0
        nx, ny = direction_order(k, c, wx, wy, square, root)
        x, y = (fx - friction * nx) * mass_inverse, (fy - friction * ny) * mass_inverse
        r0 = root[c, 0]
        ox, oy = wx[c, 0] * r0, wy[c, 0] * r0
        along = x * ox + y * oy
        across = 1.0 / (k + 1 + friction * mass_inverse * r0)
        x = along * ox / (k + 1) + (x - along * ox) * across
        y = along * oy / (k + 1) + (y - along * oy) * across
        more = 2.0 * (wx[c, 0] * x + wy[c, 0] * y)
        square[c, k] += more
        root[c, k] -= 0.5 * more * r0 * r0 * r0
        wx[c, k], wy[c, k] = x, y
    pl.ax[c, k + 2], pl.ay[c, k + 2] = wx[c, k] / (k + 2), wy[c, k] / (k + 2)


@uncounted
def blocks_series(order, m, count, u, v, used, at, pl, cx, cy, cc, cs):
    """Write the displacement series of the sliding blocks and, geometric, of their springs."""
    for c in range(m):
        i = pl.slots[c]
        pl.ax[c, 0], pl.ay[c, 0] = u[i, 0], u[i, 1]
        pl.ax[c, 1], pl.ay[c, 1] = v[i, 0], v[i, 1]
    for k in range(order - 1):
        if at.geometric:
            for c in range(m):
                pl.fx[c] = pl.fy[c] = 0.0
            springs_order(k, count, u, at, pl, cx[k], cy[k], cc[k], cs[k])
        else:
            linear_order(k, m, used, u, at, pl, cx[k], cy[k], cc[k], cs[k])
        for c in range(m):
            if at.rail:
                pl.fy[c] = 0.0
            i = pl.slots[c]
            slide_order(k, c, at.inverse[i], at.friction[i], pl)
