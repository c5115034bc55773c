# SPDX-License-Identifier: Apache-2.0
"""The compiled loop of the event path in the plane: only what slides is integrated."""

import math

import numpy as np
from numba import njit

from eol_ros.core.physics.event2d_series import (
    blocks_series,
    force_on,
    planar_reach,
    planar_swing,
    product,
    slowing_reach,
    stop_in_closed_form,
)
from eol_ros.core.physics.exact1d_series import GAUSS_W, GAUSS_X, ON_LIMIT
from eol_ros.core.physics.series import add_exactly, drive_series, first_root
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT

AFTER_S = 0.1  # for how long what a stop gets wrong goes on to act on the neighbours
KEPT = 0.1  # of its speed a block keeps at least within a step
KICK_MPS = 1e-12  # where mu_s = mu_k a block breaks loose with no acceleration at all


@njit(cache=True)
def coupled_series(
    j,
    order,
    n,
    first,
    second,
    stiff,
    anchors,
    start,
    spring,
    geometric,
    rail,
    slot,
    place,
    ax,
    ay,
    px,
    py,
    used,
    cx,
    cy,
    cc,
    cs,
    fx,
    fy,
):
    """Write orders k >= 1 of the force on the stuck block j."""
    fx[1:] = 0.0
    fy[1:] = 0.0
    for q in range(start[j], start[j + 1]):
        e = spring[q]
        if geometric:
            lane = place[e]
            if lane >= 0:
                side = 1.0 if first[e] == j else -1.0
                for k in range(1, order + 1):
                    fx[k] += side * px[k, lane]
                    fy[k] += side * py[k, lane]
            continue
        other = second[e] if first[e] == j else first[e]
        if other >= n:
            bx, by = anchors[other - n, 0], anchors[other - n, 1]
            for k in range(1, used + 1):
                fx[k] += stiff[e] * (cx[k] + cc[k] * bx - cs[k] * by)
                fy[k] += stiff[e] * (cy[k] + cs[k] * bx + cc[k] * by)
        elif slot[other] >= 0:
            for k in range(1, order + 1):
                fx[k] += stiff[e] * ax[k, slot[other]]
                fy[k] += stiff[e] * ay[k, slot[other]]
    if rail:
        fy[1:] = 0.0


@njit(cache=True)
def planar_ledger(
    order,
    m,
    slots,
    slot,
    ax,
    ay,
    u,
    friction,
    n,
    first,
    second,
    k,
    natural,
    rest,
    anchors,
    geometric,
    rail,
    cx,
    cy,
    cc,
    cs,
    used,
    h,
    energy,
    here,
):
    """Add the drive work and the friction heat (J) of a step h to `energy`."""
    for g in range(len(GAUSS_X)):
        s = GAUSS_X[g] * h
        for c in range(m):
            i = slots[c]
            x, y, dx, dy = ax[order, c], ay[order, c], 0.0, 0.0
            for q in range(order - 1, -1, -1):
                dx, dy = dx * s + x, dy * s + y
                x, y = x * s + ax[q, c], y * s + ay[q, c]
            here[i, 0], here[i, 1] = x, y
            energy[1] += h * GAUSS_W[g] * friction[i] * math.sqrt(dx * dx + dy * dy)
        if used == 0:
            continue
        x, xr, y, yr = cx[used], 0.0, cy[used], 0.0
        co, cor, si, sir = cc[used], 0.0, cs[used], 0.0
        for q in range(used - 1, -1, -1):
            xr, yr, cor, sir = xr * s + x, yr * s + y, cor * s + co, sir * s + si
            x, y, co, si = x * s + cx[q], y * s + cy[q], co * s + cc[q], si * s + cs[q]
        for e in range(len(k)):
            if second[e] < n:
                continue
            bx, by = anchors[second[e] - n, 0], anchors[second[e] - n, 1]
            i = first[e]
            dx = x + co * bx - si * by - here[i, 0]
            dy = y + si * bx + co * by - here[i, 1]
            pull = k[e]
            if geometric:
                dx += rest[e, 0]
                dy += rest[e, 1]
                if natural[e] > 0.0:
                    pull *= 1.0 - natural[e] / math.sqrt(dx * dx + dy * dy)
            power = pull * dx * (xr + cor * bx - sir * by)
            if not rail:
                power += pull * dy * (yr + sir * bx + cor * by)
            energy[0] += h * GAUSS_W[g] * power


@njit(cache=True)
def run(
    u,
    v,
    sliding,
    t_end,
    order,
    small,
    relative,
    capture,
    floor,
    n,
    first,
    second,
    k,
    natural,
    rest,
    anchors,
    start,
    spring,
    mass,
    static,
    friction,
    geometric,
    rail,
    kind,
    par,
    knots,
    cubics,
    grid,
    grid_u,
    grid_v,
    log_t,
    log_block,
    log_start,
    max_steps,
    energy,
    ledger,
    counts,
):
    """Advance `u`, `v` (n, 2) and `sliding` (n,) to `t_end`; return (status, t, events, steps).

    `grid` (g,) are the times at which `grid_u`, `grid_v` (g, n, 2) are written. Below `capture`
    (m/s) a stop is finished in closed form where that is accurate, below `floor` always;
    `relative` and `small` (m) bound a step's error. `counts` (2,): slips begun, stops at the floor
    against a pull above mu_k.
    """
    inverse = 1.0 / mass
    slot = np.full(n, -1)
    slots = np.empty(n, np.int64)
    fresh_block = np.zeros(n, np.bool_)
    fresh = np.zeros(n, np.bool_)
    size = order + 2
    ax, ay = np.zeros((size, n)), np.zeros((size, n))
    wx, wy, ss = np.zeros((size, n)), np.zeros((size, n)), np.zeros((size, n))
    rr, nx, ny = np.zeros((size, n)), np.zeros((size, n)), np.zeros((size, n))
    lanes = len(k) if geometric else 1
    dx, dy, qq = np.zeros((size, lanes)), np.zeros((size, lanes)), np.zeros((size, lanes))
    qr, px, py = np.zeros((size, lanes)), np.zeros((size, lanes)), np.zeros((size, lanes))
    act, act_first = np.empty(lanes, np.int64), np.empty(lanes, np.int64)
    act_second, act_anchor = np.empty(lanes, np.int64), np.empty(lanes, np.int64)
    act_k, act_natural = np.empty(lanes), np.empty(lanes)
    place = np.full(lanes, -1)
    fx, fy = np.zeros(n), np.zeros(n)
    gx, gy = np.zeros(size), np.zeros(size)
    cx, cy, cc, cs = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    work = np.zeros(2 * size)
    swing = np.zeros(n)
    watched = np.empty(n, np.int64)
    on_rim = np.zeros(n, np.bool_)
    here = u.copy()
    for e in range(len(k)):
        if second[e] >= n:
            on_rim[first[e]] = True
    m = 0
    for i in range(n):
        if sliding[i] or v[i, 0] != 0.0 or v[i, 1] != 0.0 or static[i] == 0.0:
            sliding[i] = True
    t, left = 0.0, 0.0
    events = steps = sampled = count = watching = 0
    changed = True
    settle = True  # look for stuck blocks whose force is beyond the limit already
    while True:
        reach, used = drive_series(kind, par, knots, cubics, t, order, cx, cy, cc, cs)
        if settle:
            settle = False
            for i in range(n):
                if sliding[i]:
                    continue
                x, y = force_on(
                    i,
                    u,
                    n,
                    first,
                    second,
                    k,
                    natural,
                    rest,
                    anchors,
                    start,
                    spring,
                    geometric,
                    rail,
                    cx[0],
                    cy[0],
                    cc[0],
                    cs[0],
                )
                if math.sqrt(x * x + y * y) >= static[i] * (1.0 + ON_LIMIT):
                    if events >= len(log_t):
                        return EVENT_LIMIT, t, events, steps
                    log_t[events], log_block[events], log_start[events] = t, i, 1
                    events += 1
                    counts[0] += 1
                    sliding[i] = True
                    fresh_block[i] = True
                    changed = True
        if changed:
            changed = False
            m = 0
            for i in range(n):
                slot[i] = -1
                if sliding[i]:
                    slot[i] = m
                    slots[m] = i
                    m += 1
            watching = 0
            for i in range(n):
                if sliding[i]:
                    continue
                watch = on_rim[i] and kind != 0
                for q in range(start[i], start[i + 1]):
                    e = spring[q]
                    j = second[e] if first[e] == i else first[e]
                    if j < n and sliding[j]:
                        watch = True
                if watch:
                    watched[watching] = i
                    watching += 1
            count = 0
            if geometric:
                for e in range(len(k)):
                    i, j = first[e], second[e]
                    rim = j >= n
                    place[e] = -1
                    if sliding[i] or (sliding[j] if not rim else kind != 0):
                        place[e] = count
                        act[count] = e
                        act_first[count] = slot[i]
                        act_second[count] = -1 if rim else slot[j]
                        act_anchor[count] = j - n if rim else -1
                        act_k[count], act_natural[count] = k[e], natural[e]
                        count += 1
        for c in range(m):
            fresh[c] = fresh_block[slots[c]]
            fresh_block[slots[c]] = False
            if fresh[c]:
                i = slots[c]
                x, y = force_on(
                    i,
                    u,
                    n,
                    first,
                    second,
                    k,
                    natural,
                    rest,
                    anchors,
                    start,
                    spring,
                    geometric,
                    rail,
                    cx[0],
                    cy[0],
                    cc[0],
                    cs[0],
                )
                force = math.sqrt(x * x + y * y)
                if force - friction[i] <= 1e-9 * force or friction[i] == 0.0:
                    fresh[c] = False
                    if force > 0.0 and friction[i] > 0.0:
                        v[i, 0], v[i, 1] = KICK_MPS * x / force, KICK_MPS * y / force
        h = t_end - t
        ends = True
        if reach < h:
            h, ends = reach, False
        if m > 0 or count > 0:
            blocks_series(
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
                k,
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
            )
            near = planar_reach(order, m, ax, ay, fresh, relative, small, h)
            near = slowing_reach(order, m, ax, ay, wx, wy, fresh, near, KEPT, work)
            if m == 0:
                for q in range(count):
                    top = max(abs(px[order - 2, q]), abs(py[order - 2, q])) / act_k[q]
                    if top > 0.0:
                        near = min(near, (small / top) ** (1.0 / (order - 2)))
            if near < h:
                h, ends = near, False
        if kind >= 2 and used > 3:
            top = max(abs(cx[order]), abs(cy[order]), abs(cc[order]), abs(cs[order]))
            if top > 0.0:
                near = (small / top) ** (1.0 / order)
                if near < h:
                    h, ends = near, False
        if not h >= 0.0:
            return NOT_FINITE, t, events, steps
        # the first stuck block to break within the step
        planar_swing(order, m, ax, ay, h, swing)
        rim = turn = 0.0
        power = 1.0
        for q in range(1, used + 1):
            power *= h
            rim += power * math.sqrt(cx[q] ** 2 + cy[q] ** 2)
            turn += power * math.sqrt(cc[q] ** 2 + cs[q] ** 2)
        earliest, who, hit_any = h, -1, False
        for p in range(watching):
            j = watched[p]
            x, y = force_on(
                j,
                u,
                n,
                first,
                second,
                k,
                natural,
                rest,
                anchors,
                start,
                spring,
                geometric,
                rail,
                cx[0],
                cy[0],
                cc[0],
                cs[0],
            )
            push = 0.0
            for q in range(start[j], start[j + 1]):
                e = spring[q]
                o = second[e] if first[e] == j else first[e]
                far = 0.0
                if o >= n:
                    far = rim + turn * math.sqrt(anchors[o - n, 0] ** 2 + anchors[o - n, 1] ** 2)
                elif slot[o] >= 0:
                    far = swing[slot[o]]
                stiff = k[e]
                if geometric and far > 0.0 and natural[e] > 0.0:
                    length = 1.0 / qr[0, place[e]] - far
                    if length <= 0.5 * natural[e]:
                        stiff = np.inf if length <= 0.0 else stiff * (natural[e] / length - 1.0)
                push += stiff * far
            force = math.sqrt(x * x + y * y)
            if force + push < static[j] * (1.0 - ON_LIMIT):
                continue
            gx[0], gy[0] = x, y
            degree = order - 2 if geometric else order
            coupled_series(
                j,
                degree,
                n,
                first,
                second,
                k,
                anchors,
                start,
                spring,
                geometric,
                rail,
                slot,
                place,
                ax,
                ay,
                px,
                py,
                min(used, degree),
                cx,
                cy,
                cc,
                cs,
                gx,
                gy,
            )
            product(degree, gx, gy, static[j], work)
            if work[0] <= 0.0:
                if work[1] < 0.0:
                    earliest, who, hit_any = 0.0, j, True
                    break
                work[0] = 1e-300
            x, hit = first_root(work, 2 * degree, earliest)
            if hit or x < earliest:
                earliest, who, hit_any = x, j, hit
        if earliest < h:
            h, ends = earliest, False
            if not hit_any:
                h = max(h, 1e-15 * max(1.0, t))
        elif hit_any:
            ends = False
        while sampled < len(grid) and (grid[sampled] <= t + h or ends):
            s = grid[sampled] - t
            grid_u[sampled] = u
            grid_v[sampled] = v
            for c in range(m):
                x, y, a, b = ax[order, c], ay[order, c], 0.0, 0.0
                for q in range(order - 1, -1, -1):
                    a, b = a * s + x, b * s + y
                    x, y = x * s + ax[q, c], y * s + ay[q, c]
                i = slots[c]
                grid_u[sampled, i, 0], grid_u[sampled, i, 1] = x, y
                grid_v[sampled, i, 0], grid_v[sampled, i, 1] = a, b
            sampled += 1
        if ledger:
            here[:] = u
            planar_ledger(
                order,
                m,
                slots,
                slot,
                ax,
                ay,
                u,
                friction,
                n,
                first,
                second,
                k,
                natural,
                rest,
                anchors,
                geometric,
                rail,
                cx,
                cy,
                cc,
                cs,
                used,
                h,
                energy,
                here,
            )
        for c in range(m):
            x, y, a, b = ax[order, c], ay[order, c], 0.0, 0.0
            for q in range(order - 1, -1, -1):
                a, b = a * h + x, b * h + y
                x, y = x * h + ax[q, c], y * h + ay[q, c]
            i = slots[c]
            u[i, 0], u[i, 1], v[i, 0], v[i, 1] = x, y, a, b
        t, left = add_exactly(t, left, h)
        steps += 1
        if m > 0 and not math.isfinite(u[slots[0], 0] + v[slots[0], 0] + u[slots[0], 1]):
            return NOT_FINITE, t, events, steps
        if ends:
            break
        if steps >= max_steps:
            return STEP_LIMIT, t, events, steps
        # blocks that come to rest
        drive_series(kind, par, knots, cubics, t, 3, cx, cy, cc, cs)
        rim_speed = math.sqrt(cx[1] ** 2 + cy[1] ** 2) + math.sqrt(cc[1] ** 2 + cs[1] ** 2)
        for c in range(m):
            i = slots[c]
            if friction[i] == 0.0:
                continue
            speed = math.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
            if speed >= capture:
                continue
            x, y = force_on(
                i,
                u,
                n,
                first,
                second,
                k,
                natural,
                rest,
                anchors,
                start,
                spring,
                geometric,
                rail,
                cx[0],
                cy[0],
                cc[0],
                cs[0],
            )
            if speed > 0.0 and (x * v[i, 0] + y * v[i, 1]) >= friction[i] * speed:
                continue  # gains speed
            stop_s, x1, y1, will = 0.0, 0.0, 0.0, speed == 0.0
            if speed > 0.0:
                limit = friction[i] * inverse[i]
                stop_s, x1, y1, will = stop_in_closed_form(
                    v[i, 0], v[i, 1], x * inverse[i], y * inverse[i], limit
                )
                if will and speed > floor:
                    jerk, soft = 0.0, 0.0
                    for q in range(start[i], start[i + 1]):
                        e = spring[q]
                        j = second[e] if first[e] == i else first[e]
                        other = rim_speed
                        if j < n:
                            other = math.sqrt(v[j, 0] ** 2 + v[j, 1] ** 2)
                        jerk += k[e] * (other + speed) * inverse[i]
                        soft += k[e] * inverse[i]
                    room = limit - math.sqrt(x * x + y * y) * inverse[i]
                    error = stop_s * (jerk * stop_s**2 / 6.0 + soft * speed * stop_s * AFTER_S)
                    will = error < 10.0 * small and jerk * stop_s < 0.2 * room
            if not will:
                if speed > floor:
                    continue
                stop_s = x1 = y1 = 0.0
                counts[1] += 1
            v[i, 0] = v[i, 1] = 0.0
            if math.sqrt(x * x + y * y) > static[i]:
                fresh_block[i] = True  # turns round: its speed is zero for no time at all
                continue
            energy[1] += 0.5 * mass[i] * speed * speed + x * x1 + y * y1
            u[i, 0] += x1
            u[i, 1] += y1
            if events >= len(log_t):
                return EVENT_LIMIT, t, events, steps
            log_t[events], log_block[events], log_start[events] = t + stop_s, i, 0
            events += 1
            sliding[i] = False
            changed = True
        if hit_any:
            for p in range(watching):
                j = watched[p]
                x, y = force_on(
                    j,
                    u,
                    n,
                    first,
                    second,
                    k,
                    natural,
                    rest,
                    anchors,
                    start,
                    spring,
                    geometric,
                    rail,
                    cx[0],
                    cy[0],
                    cc[0],
                    cs[0],
                )
                if j != who and math.sqrt(x * x + y * y) < static[j] * (1.0 - ON_LIMIT):
                    continue
                if events >= len(log_t):
                    return EVENT_LIMIT, t, events, steps
                log_t[events], log_block[events], log_start[events] = t, j, 1
                events += 1
                counts[0] += 1
                sliding[j] = True
                fresh_block[j] = True
                changed = True
    return OK, t, events, steps
