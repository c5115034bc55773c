# SPDX-License-Identifier: Apache-2.0
"""How far a step in the plane may go, how blocks stop, and what the energy ledger says of it."""

import math

import numpy as np

from eol_ros.core.physics.event.lanes import LOOSE, WEAK
from eol_ros.core.physics.event.taylor import (
    TINY,
    force_on,
    rim_spring_series,
    spring_vector,
    to_rim,
)
from eol_ros.core.physics.numerics import ON_LIMIT
from eol_ros.core.physics.series import ROOT_ROUNDS, first_root, inlined, uncounted


@uncounted
def planar_reach(order, m, pl, relative, small, top):
    """Return the step at which the last two terms fall to the tolerances.

    `small` (m) bounds the displacement, `relative` the speed against the block's own speed.
    """
    h = top
    ax, ay = pl.ax, pl.ay
    for k in range(order - 1, order + 1):
        most = drift = rise = 0.0
        for c in range(m):
            size = max(abs(ax[c, k]), abs(ay[c, k]))
            most = max(most, size)
            # not by squares: just before a stop the last terms are beyond 1e150
            if pl.start[c] >= WEAK:
                h = min(h, weak_reach(k, c, relative, size, ax, ay))
            elif pl.start[c] == LOOSE:
                rise = max(rise, size / math.sqrt(ax[c, 2] ** 2 + ay[c, 2] ** 2))
            else:
                speed = math.sqrt(ax[c, 1] ** 2 + ay[c, 1] ** 2)
                if speed > 0.0:
                    drift = max(drift, size / speed)
        if most > 0.0:
            h = min(h, (small / most) ** (1.0 / k))
        if drift > 0.0:
            h = min(h, (relative / (k * drift)) ** (1.0 / (k - 1)))
        if rise > 0.0:
            h = min(h, (2.0 * relative / (k * rise)) ** (1.0 / (k - 2)))
    return h


@uncounted
def weak_reach(k, c, relative, size, ax, ay):
    """Return the step at which term k is `relative` to the speed that a weak start has won."""
    if size == 0.0:
        return np.inf
    h = 0.0
    for first in (1, 2, 3):
        speed = first * math.sqrt(ax[c, first] ** 2 + ay[c, first] ** 2)
        h = max(h, (relative * speed / (k * size)) ** (1.0 / (k - first)))
    return h


@uncounted
def growing_reach(order, s, h):
    """Return the step, at most h, in which a speed s, a series, loses less than half its gain."""
    for _ in range(ROOT_ROUNDS):
        loss = 0.0
        for k in range(order - 1, 0, -1):
            loss = (loss + max(0.0, -s[k])) * h
        if loss < 0.5 * (s[0] + (max(0.0, s[1]) + max(0.0, s[2]) * h) * h):
            break
        h *= 0.7
    return h


@uncounted
def slowing_reach(order, m, at, pl, h, share, work):
    """Return the step, at most h, within which no block loses more than 1 - `share` of its speed.

    Measured along its first direction. The series of v/|v| knows nothing beyond a point where v
    passes zero, and where v does so on a straight line nothing else would tell.
    """
    for c in range(m):
        if pl.start[c] >= WEAK:
            h = growing_reach(order, pl.w.inverse[c], h)
            continue
        if at.static[pl.slots[c]] == 0.0:
            continue  # it never stops
        first = 2 if pl.start[c] == LOOSE else 1
        x0, y0 = pl.w.x[c, 0], pl.w.y[c, 0]
        square = x0 * x0 + y0 * y0
        if square == 0.0:
            continue
        degree = order - first
        loss = 0.0
        for k in range(degree, 0, -1):
            q = k + first
            work[k] = q * (pl.ax[c, q] * x0 + pl.ay[c, q] * y0) / square
            loss = (loss + max(0.0, -work[k])) * h
        if loss < 1.0 - share:
            continue
        work[0] = 1.0 - share
        h, _ = first_root(work, degree, h)
    return h


@uncounted
def planar_swing(order, m, h, pl):
    """Write a bound of how far each block moves within a step h."""
    for c in range(m):
        x = y = 0.0
        for k in range(order, 0, -1):
            x = (x + abs(pl.ax[c, k])) * h
            y = (y + abs(pl.ay[c, k])) * h
        pl.swing[c] = math.sqrt(x * x + y * y)


@inlined
def would_pass(e, x, y, vx, vy, inverse, relative, small, at):
    """Return whether spring e, (x, y) long and changing at (vx, vy), is about to pass length zero.

    Its force reverses there, in a time len / |v|. So short that what it does meanwhile to ends
    of 1 / mass `inverse` is within the tolerances of a step, it is left out.
    """
    square, speed = x * x + y * y, math.sqrt(vx * vx + vy * vy)
    if square <= TINY:
        return True
    if x * vx + y * vy >= 0.0:
        return False
    length, push = math.sqrt(square), 2.0 * at.k[e] * at.natural[e] * inverse
    return push * length <= min(relative * speed, small * speed / length) * speed


@uncounted
def pass_zero(count, u, v, relative, small, at, pl, cx, cy, cc, cs):
    """Leave out the force of natural length in lanes about to pass zero."""
    for q in range(count):
        e, inverse = pl.act[q], 0.0
        pl.natural[q] = at.natural[e]
        if at.natural[e] == 0.0:
            continue
        x, y = spring_vector(e, u, at, cx[0], cy[0], cc[0], cs[0])
        vx, vy = spring_rate(q, v, at, pl, cx, cy, cc, cs)
        if pl.act_first[q] >= 0:
            inverse += at.inverse[at.first[e]]
        if pl.act_second[q] >= 0:
            inverse += at.inverse[at.second[e]]
        if would_pass(e, x, y, vx, vy, inverse, relative, small, at):
            pl.natural[q] = 0.0


@inlined
def spring_rate(q, v, at, pl, cx, cy, cc, cs):
    """Return how the vector along the spring in lane q changes, m/s."""
    e = pl.act[q]
    i, j = at.first[e], at.second[e]
    vx, vy = rim_order(1, pl.act_anchor[q], at, cx, cy, cc, cs)
    if j < at.n:
        vx, vy = v[j, 0], v[j, 1]
    return vx - v[i, 0], vy - v[i, 1]


@inlined
def rim_order(k, a, at, cx, cy, cc, cs):
    """Return order k of where anchor a is; none for a < 0, a spring between blocks."""
    if a < 0:
        return 0.0, 0.0
    ax, ay = at.anchors[a, 0], at.anchors[a, 1]
    return cx[k] + cc[k] * ax - cs[k] * ay, cy[k] + cs[k] * ax + cc[k] * ay


@inlined
def length_reach(degree, x0, y0, h, passing, work):
    """Return the step, at most h, after which a spring has a tenth of its length left,

    or, where it passes zero, as much on the far side; `work` has its vector, x in the first half.
    """
    square, half = x0 * x0 + y0 * y0, len(work) // 2
    most, total = 0.9, 0.0
    if passing:
        most = 2.0 * math.sqrt(max(square, TINY))
    for k in range(degree, 0, -1):
        x, y = work[k], work[half + k]
        work[k] = -math.sqrt(x * x + y * y) if passing else (x * x0 + y * y0) / square
        total = (total - min(work[k], 0.0)) * h
    if total < most:
        return h
    work[0] = most
    h, _ = first_root(work, degree, h)
    return h


@uncounted
def zero_reach(
    order, used, count, watching, watched, h, rim_far, small, relative, u, at, pl, cx, cy, cc, cs,
    work,
):  # fmt: skip
    """Return (h, near, through): the step, at most h, in which no spring passes length zero,

    whether one comes near it, and how many pass it now: each in a step of its own, `pass_zero`
    says which. No series of d/|d| holds across zero, and where ends meet head-on d/|d| is constant
    until there: nothing else would tell. `rim_far` (m) bounds the way of the rim's anchors.
    """
    half, near, through = len(work) // 2, False, 0
    for q in range(count):
        e, f, s, a = pl.act[q], pl.act_first[q], pl.act_second[q], pl.act_anchor[q]
        if at.natural[e] == 0.0:
            continue
        x, y = spring_vector(e, u, at, cx[0], cy[0], cc[0], cs[0])
        far = rim_far if a >= 0 else 0.0
        if f >= 0:
            far += pl.swing[f]
        if s >= 0:
            far += pl.swing[s]
        passing = pl.natural[q] == 0.0
        if not passing and far * far < 0.81 * (x * x + y * y):
            continue
        near = True
        if passing:
            through += 1
        elif x * x + y * y <= TINY:
            continue  # met by chance: it passes in the next step
        for k in range(1, order + 1):
            dx, dy = rim_order(k, a if k <= used else -1, at, cx, cy, cc, cs)
            if s >= 0:
                dx, dy = dx + pl.ax[s, k], dy + pl.ay[s, k]
            if f >= 0:
                dx, dy = dx - pl.ax[f, k], dy - pl.ay[f, k]
            work[k], work[half + k] = dx, dy
        h = length_reach(order, x, y, h, passing, work)
    for p in range(watching if rim_far > 0.0 else 0):
        j = watched[p]
        for q in range(at.rim_lo[j], at.rim_lo[j + 1]):
            e = at.rim_spring[q]
            x, y = to_rim(e, u[j, 0], u[j, 1], at, cx[0], cy[0], cc[0], cs[0])
            if at.natural[e] == 0.0 or rim_far * rim_far < 0.81 * (x * x + y * y):
                continue
            near, a = True, at.second[e] - at.n
            for k in range(1, used + 1):
                work[k], work[half + k] = rim_order(k, a, at, cx, cy, cc, cs)
            passing = would_pass(
                e, x, y, work[1], work[half + 1], at.inverse[j], relative, small, at
            )
            if passing:
                through += 1
            h = length_reach(used, x, y, h, passing, work)
    return h, near, through


@uncounted
def planar_state(order, m, h, pl, u, v):
    """Write place and velocity of the sliding blocks at h into u and v."""
    for c in range(m):
        x, y, a, b = pl.ax[c, order], pl.ay[c, order], 0.0, 0.0
        for q in range(order - 1, -1, -1):
            a, b = a * h + x, b * h + y
            x, y = x * h + pl.ax[c, q], y * h + pl.ay[c, q]
        i = pl.slots[c]
        u[i, 0], u[i, 1], v[i, 0], v[i, 1] = x, y, a, b


@uncounted
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


@uncounted
def break_root(j, fx0, fy0, order, used, count, h, small, u, at, pl, cx, cy, cc, cs, fx, fy, out):
    """Return (x, found): when the force on the stuck block j next reaches its limit."""
    degree = order - 2 if at.geometric else order
    for k in range(1, degree + 1):
        fx[k] = fy[k] = 0.0
    fx[0], fy[0] = fx0, fy0
    if at.geometric:
        for q in range(at.lo[j], at.lo[j + 1]):
            lane = pl.place[at.spring[q]]
            if lane >= 0:
                side = 1.0 if at.first[at.spring[q]] == j else -1.0
                for k in range(1, degree + 1):
                    fx[k] += side * pl.px[lane, k]
                    fy[k] += side * pl.py[lane, k]
        for q in range(at.rim_lo[j], at.rim_lo[j + 1]):
            e = at.rim_spring[q]
            if used > 0:
                rim_spring_series(e, count, degree, used, u, at, pl, cx, cy, cc, cs)
                pl.place[e] = -1  # the lane is lent for a moment
                top = max(abs(pl.px[count, degree]), abs(pl.py[count, degree])) / at.k[e]
                if top > 0.0:
                    h = min(h, (small / top) ** (1.0 / degree))
                for k in range(1, degree + 1):
                    fx[k] += pl.px[count, k]
                    fy[k] += pl.py[count, k]
    else:
        for k in range(1, min(used, degree) + 1):
            fx[k] = at.drive[j, 0] * cx[k] + at.drive[j, 1] * cc[k] - at.drive[j, 2] * cs[k]
            fy[k] = at.drive[j, 0] * cy[k] + at.drive[j, 1] * cs[k] + at.drive[j, 2] * cc[k]
        for e in range(at.lo[j], at.lo[j + 1]):
            c = pl.slot[at.near[e]]
            if c >= 0:
                for k in range(1, degree + 1):
                    fx[k] += at.k_near[e] * pl.ax[c, k]
                    fy[k] += at.k_near[e] * pl.ay[c, k]
    if at.rail:
        for k in range(degree + 1):
            fy[k] = 0.0
    return limit_root(at.static[j], degree, h, fx, fy, out)


@uncounted
def limit_root(limit, degree, h, fx, fy, out):
    """Return (x, found): when the length of the series (fx, fy) reaches `limit`."""
    for k in range(2 * degree + 1):
        total = 0.0
        for a in range(max(0, k - degree), min(k, degree) + 1):
            total += fx[a] * fx[k - a] + fy[a] * fy[k - a]
        out[k] = -total / (limit * limit)
    now = math.sqrt(fx[0] * fx[0] + fy[0] * fy[0])
    out[0] = (limit - now) * (limit + now) / (limit * limit)
    if out[0] <= ON_LIMIT:  # on the limit: it breaks now, or the force is on its way back
        if out[1] < 0.0:
            return 0.0, True
        out[0] = ON_LIMIT
    return first_root(out, 2 * degree, h)


@inlined
def spring_reach(e, dx, dy, far, at):
    """Return (fx, fy, more, spare) of a spring: force (N), its change while an end moves by `far`,

    and how far (m) an end may move with no more change than its stiffness says.
    """
    length, natural = math.sqrt(dx * dx + dy * dy), at.natural[e]
    stiff = at.k[e] * (1.0 - natural / length) if length > 0.0 else at.k[e]
    more, spare = at.k[e] * far, np.inf
    if natural > 0.0:
        spare = length - 0.5 * natural
        if far >= spare:  # short springs rotate faster than they stretch
            length -= far
            more = np.inf if length <= 0.0 else at.k[e] * far * max(1.0, natural / length - 1.0)
    return stiff * dx, stiff * dy, more, spare


@inlined
def force_and_reach(j, u, rim_far, rim_yaw, x, y, co, si, at, pl):
    """Return (fx, fy, more, spare): of the stuck block j what `spring_reach` says of a spring."""
    more, spare = 0.0, np.inf
    if not at.geometric:
        fx, fy = force_on(j, u, at, x, y, co, si)
        for q in range(at.lo[j], at.lo[j + 1]):
            c = pl.slot[at.near[q]]
            if c >= 0:
                more += at.k_near[q] * pl.swing[c]
        return fx, fy, more + rim_far * at.drive[j, 0] + rim_yaw * at.arm[j], spare
    fx = fy = 0.0
    for q in range(at.lo[j], at.lo[j + 1]):
        e, i = at.spring[q], at.near[q]
        side = 1.0 if at.first[e] == j else -1.0
        dx = u[i, 0] - u[j, 0] + side * at.rest[e, 0]
        dy = u[i, 1] - u[j, 1] + side * at.rest[e, 1]
        far = pl.swing[pl.slot[i]] if pl.slot[i] >= 0 else 0.0
        px, py, rise, free = spring_reach(e, dx, dy, far, at)
        fx, fy, more, spare = fx + px, fy + py, more + rise, min(spare, free)
    for q in range(at.rim_lo[j], at.rim_lo[j + 1]):
        e = at.rim_spring[q]
        dx, dy = to_rim(e, u[j, 0], u[j, 1], at, x, y, co, si)
        px, py, rise, free = spring_reach(e, dx, dy, rim_far + rim_yaw * at.far, at)
        fx, fy, more, spare = fx + px, fy + py, more + rise, min(spare, free)
    return fx, 0.0 if at.rail else fy, more, spare


@uncounted
def suspects(
    watching,
    watched,
    u,
    rim_far,
    rim_yaw,
    x,
    y,
    co,
    si,
    found,
    at_x,
    at_y,
    push,
    slack,
    spare,
    at,
    pl,
):
    """Write the stuck blocks that may break within a step, their force and its reach (N).

    `slack` (N) is how far each force is from its limit at least, `spare` (m) how far the ends of
    its springs may move before that is no longer sure: while they last, forces are not worked out.
    """
    count = 0
    for p in range(watching):
        j = watched[p]
        more = rim_far * at.drive[j, 0] + rim_yaw * at.arm[j]
        far = rim_far + rim_yaw * at.far if more > 0.0 else 0.0
        for q in range(at.lo[j], at.lo[j + 1]):
            c = pl.slot[at.near[q]]
            if c >= 0:
                more += at.k_near[q] * pl.swing[c]
                far = max(far, pl.swing[c])
        if more < slack[j] and far < spare[j]:
            slack[j] -= more
            spare[j] -= far
            continue
        fx, fy, more, free = force_and_reach(j, u, rim_far, rim_yaw, x, y, co, si, at, pl)
        slack[j] = at.static[j] * (1.0 - ON_LIMIT) - math.sqrt(fx * fx + fy * fy) - more
        spare[j] = free - far
        if slack[j] <= 0.0:
            found[count], at_x[count], at_y[count], push[count] = j, fx, fy, more
            count += 1
    return count


@uncounted
def planar_ledger(order, m, u, at, pl, cx, cy, cc, cs, used, h, energy, here, rate, gauss):
    """Add the drive work and the friction heat (J) of a step h to `energy`.

    `gauss` (2, g): nodes and weights on 0..1.
    """
    for i in range(at.n):
        here[i, 0], here[i, 1] = u[i, 0], u[i, 1]
    for g in range(gauss.shape[1]):
        s, weight = gauss[0, g] * h, gauss[1, g] * h
        planar_state(order, m, s, pl, here, rate)
        for c in range(m):
            i = pl.slots[c]
            speed = math.sqrt(rate[i, 0] ** 2 + rate[i, 1] ** 2)
            energy[1] += weight * at.friction[i] * speed
        if used == 0:
            continue
        x, xr, y, yr = cx[used], 0.0, cy[used], 0.0
        co, cor, si, sir = cc[used], 0.0, cs[used], 0.0
        for q in range(used - 1, -1, -1):
            xr, yr, cor, sir = xr * s + x, yr * s + y, cor * s + co, sir * s + si
            x, y, co, si = x * s + cx[q], y * s + cy[q], co * s + cc[q], si * s + cs[q]
        for i in range(at.n):
            for q in range(at.rim_lo[i], at.rim_lo[i + 1]):
                e = at.rim_spring[q]
                bx, by = at.anchors[at.second[e] - at.n, 0], at.anchors[at.second[e] - at.n, 1]
                dx = x + co * bx - si * by - here[i, 0]
                dy = y + si * bx + co * by - here[i, 1]
                pull = at.k[e]
                if at.geometric:
                    dx += at.rest[e, 0]
                    dy += at.rest[e, 1]
                    if at.natural[e] > 0.0:
                        pull *= 1.0 - at.natural[e] / math.sqrt(dx * dx + dy * dy)
                power = pull * dx * (xr + cor * bx - sir * by)
                if at.geometric or not at.rail:  # a rail takes the force, and the spring stretches
                    power += pull * dy * (yr + sir * bx + cor * by)
                energy[0] += weight * power
