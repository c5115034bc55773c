# SPDX-License-Identifier: Apache-2.0
"""The compiled loop of the exact path along x: from event to event."""

import math

import numpy as np
from numba import njit

from eol_ros.core.physics.drive import NONE, VELOCITY
from eol_ros.core.physics.exact1d_series import (
    ON_LIMIT,
    advance,
    bounds,
    break_root,
    force_now,
    ledger_step,
    reach_of,
    segment_series,
    stop_root,
)
from eol_ros.core.physics.series import add_exactly, drive_series
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT


@njit(cache=True)
def run(
    u,
    v,
    t_end,
    order,
    small,
    near,
    first,
    last,
    k_near,
    k_sum,
    drive,
    inverse,
    static,
    friction,
    speed,
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
    rim_block,
    rim_k,
    rim_at,
    energy,
    ledger,
    state,
):
    """Advance `u`, `v` (n,) to `t_end` in place; return (status, t, events, steps).

    `grid` (g,) are the times at which `grid_u`, `grid_v` (g, n) are written; `state` (n,) int8
    comes back 1 for blocks that slide. `drive` (n, 3): what the rim's x, cos - 1 and sin pull with.
    """
    n = len(u)
    sign = np.zeros(n)
    slot = np.full(n, -1)
    slots = np.empty(n, np.int64)
    m = 0
    a = np.zeros((order + 2, n))
    w = np.zeros((order, n))
    r = np.zeros((order, n if speed > 0.0 else 1))
    swing, tail = np.empty(n), np.empty(n)
    cx, cy = np.zeros(order + 2), np.zeros(order + 2)
    cc, cs = np.zeros(order + 2), np.zeros(order + 2)
    work = np.zeros(order + 2)
    due = np.full(n, -np.inf)  # when a stuck block without sliding neighbours breaks; -inf: unknown
    plain = kind in (VELOCITY, NONE)
    watch = np.zeros(n, np.bool_)  # stuck, and the force on it is not linear in time
    stale = np.ones(n, np.bool_)
    watched = np.empty(n, np.int64)
    t, rest = 0.0, 0.0
    events = steps = sampled = 0
    for i in range(n):
        if v[i] != 0.0 or static[i] == 0.0:
            sign[i] = np.sign(v[i]) if friction[i] > 0.0 else 0.0
            slot[i] = m
            slots[m] = i
            m += 1
    check = True  # look for blocks whose force is beyond the limit now
    while True:
        reach, used = drive_series(kind, par, knots, cubics, t, order, cx, cy, cc, cs)
        if check:
            check = False
            for i in range(n):
                if slot[i] >= 0 or not stale[i]:
                    continue
                f = force_now(i, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0])
                if abs(f) > static[i] * (1.0 + ON_LIMIT):
                    sign[i] = np.sign(f)
                    slot[i] = m
                    slots[m] = i
                    m += 1
                    if events >= len(log_t):
                        return EVENT_LIMIT, t, events, steps
                    log_t[events], log_block[events], log_start[events] = t, i, 1
                    events += 1
        # which stuck blocks to watch, and when the others are due
        next_due = np.inf
        count = 0
        for i in range(n):
            if slot[i] >= 0:
                continue
            if stale[i]:
                stale[i] = False
                watch[i] = not plain and (
                    drive[i, 0] != 0.0 or drive[i, 1] != 0.0 or drive[i, 2] != 0.0
                )
                for e in range(first[i], last[i]):
                    if slot[near[e]] >= 0:
                        watch[i] = True
                due[i] = np.inf
                if not watch[i]:
                    f = force_now(
                        i, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0]
                    )
                    rate = drive[i, 0] * cx[1] if kind == VELOCITY else 0.0
                    if rate > 0.0:
                        due[i] = t + max(0.0, (static[i] - f) / rate)
                    elif rate < 0.0:
                        due[i] = t + max(0.0, (-static[i] - f) / rate)
            if watch[i]:
                watched[count] = i
                count += 1
            elif due[i] < next_due:
                next_due = due[i]
        h = t_end - t
        ends = True
        if next_due - t < h:
            h, ends = max(next_due - t, 0.0), False
        if reach < h:
            h, ends = reach, False
        if m > 0:
            segment_series(
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
            )
            near_end = reach_of(order, m, a, small, h)
            if near_end < h:
                h, ends = near_end, False
        if not plain and used == order:
            most = max(abs(cx[order]), abs(cs[order]), abs(cc[order]))
            if most > 0.0:
                near_end = (small / most) ** (1.0 / order)
                if near_end < h:
                    h, ends = near_end, False
        if not h >= 0.0:
            return NOT_FINITE, t, events, steps
        kind_of, who, earliest = 0, -1, h
        if next_due <= t + h:
            kind_of = 1
        if m > 0 or count > 0:
            bounds(order, m, a, h, tail, swing)
            for c in range(m):
                i = slots[c]
                if friction[i] == 0.0:
                    continue
                s = sign[i]
                if s * a[1, c] > 0.0:
                    low = min(s * a[1, c], s * (a[1, c] + 2.0 * h * a[2, c]))
                    if low > tail[c]:
                        continue
                elif s * a[2, c] > 0.0 and 2.0 * s * a[2, c] * h > tail[c]:
                    continue
                x, hit = stop_root(order, a, c, s, earliest, work)
                if hit or x < earliest:
                    earliest, kind_of, who = x, 2 if hit else 0, i
            moved = 0.0
            for k in range(1, used + 1):
                moved = max(moved, abs(cx[k]), abs(cc[k]), abs(cs[k]))
            for p in range(count):
                j = watched[p]
                force = force_now(
                    j, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0]
                )
                push = 0.0
                if moved > 0.0:
                    for k in range(used, 0, -1):
                        push = (
                            push
                            + abs(drive[j, 0] * cx[k] + drive[j, 1] * cc[k] - drive[j, 2] * cs[k])
                        ) * h
                for e in range(first[j], last[j]):
                    s2 = slot[near[e]]
                    if s2 >= 0:
                        push += k_near[e] * swing[s2]
                if abs(force) + push < static[j] * (1.0 - ON_LIMIT):
                    continue
                x, hit = break_root(
                    j,
                    force,
                    order,
                    a,
                    slot,
                    near,
                    first,
                    last,
                    k_near,
                    drive,
                    cx,
                    cc,
                    cs,
                    used,
                    static[j],
                    earliest,
                    work,
                )
                if hit or x < earliest:
                    earliest, kind_of, who = x, 3 if hit else 0, j
        h_used = earliest
        if h_used < h:
            ends = False
        if kind_of == 0 and not ends and h_used <= 1e-15 * max(t, 1e-300) and h_used < reach:
            h_used = max(h_used, 1e-16)  # rounding of t: creep on, bounded by max_steps
        while sampled < len(grid) and (grid[sampled] <= t + h_used or ends):
            s = grid[sampled] - t
            for i in range(n):
                grid_u[sampled, i] = u[i]
                grid_v[sampled, i] = 0.0
            for c in range(m):
                x = a[order, c]
                d = 0.0
                for k in range(order - 1, -1, -1):
                    d = d * s + x
                    x = x * s + a[k, c]
                grid_u[sampled, slots[c]] = x
                grid_v[sampled, slots[c]] = d
            sampled += 1
        if ledger:
            ledger_step(
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
                h_used,
                energy,
            )
        advance(order, m, slots, a, h_used, u, v)
        t, rest = add_exactly(t, rest, h_used)
        if ends:
            t = t_end
        steps += 1
        if m > 0 and not math.isfinite(u[slots[0]] + v[slots[0]]):
            return NOT_FINITE, t, events, steps
        if ends and kind_of == 0:
            break
        if steps >= max_steps:
            return STEP_LIMIT, t, events, steps
        if kind_of == 0:
            continue
        # the event, and whatever happens at the same instant, in the order of the blocks
        reach, used = drive_series(kind, par, knots, cubics, t, 1, cx, cy, cc, cs)
        fastest = abs(cx[1])
        for c in range(m):
            fastest = max(fastest, abs(v[slots[c]]))
        before = m
        changed = False
        for i in range(n):
            if events >= len(log_t):
                return EVENT_LIMIT, t, events, steps
            c = slot[i]
            if c >= 0 and c < before:
                if friction[i] == 0.0:
                    continue
                stops = i == who and kind_of == 2
                if not stops and abs(v[i]) <= ON_LIMIT * fastest:
                    stops = sign[i] * a[2, c] < 0.0 or sign[i] * a[1, c] > 0.0
                if not stops:
                    continue
                v[i] = 0.0
                f = force_now(i, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0])
                if abs(f) > static[i] * (1.0 + ON_LIMIT):
                    sign[i] = np.sign(f)  # turns round: its speed is zero for no time at all
                    continue
                sign[i] = 0.0
                slot[i] = -2
                changed = True
                log_t[events], log_block[events], log_start[events] = t, i, 0
                events += 1
            elif c == -1:
                breaks = i == who and kind_of == 3
                if not breaks:
                    if watch[i]:
                        if kind_of != 3 and kind_of != 1:
                            continue
                    elif due[i] > t + ON_LIMIT * max(1.0, t):
                        continue
                f = force_now(i, u, near, first, last, k_near, k_sum, drive, cx[0], cc[0], cs[0])
                if not breaks and abs(f) < static[i] * (1.0 - ON_LIMIT):
                    if not watch[i]:
                        if due[i] > t * (1.0 + 4e-16):
                            stale[i] = True
                            continue
                    else:
                        continue
                sign[i] = np.sign(f)
                v[i] = 0.0
                slot[i] = m
                slots[m] = i
                m += 1
                changed = True
                log_t[events], log_block[events], log_start[events] = t, i, 1
                events += 1
        if changed:
            kept = 0
            for c in range(m):
                i = slots[c]
                touched = slot[i] == -2 or c >= before
                if slot[i] == -2:
                    slot[i] = -1
                    stale[i] = True
                else:
                    slots[kept] = i
                    slot[i] = kept
                    kept += 1
                if touched:
                    for e in range(first[i], last[i]):
                        stale[near[e]] = True
            m = kept
        elif kind_of == 1 or kind_of == 3:
            check = True
    for i in range(n):
        state[i] = 1 if slot[i] >= 0 else 0
    return OK, t, events, steps
