# SPDX-License-Identifier: Apache-2.0
"""The compiled loop of the exact path along x: from event to event."""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.drive import VELOCITY
from eol_ros.core.physics.numerics import ON_LIMIT
from eol_ros.core.physics.series import UNCOUNTED, add_exactly
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT
from eol_ros.lab.exact.closed_form import (
    clear_of_limits,
    lone_path,
    lone_slip,
    lone_state,
    march,
    modes_of,
    modes_path,
    modes_state,
)
from eol_ros.lab.exact.taylor import (
    DENSE,
    Lanes,
    bounds,
    break_root,
    drive_work,
    fill_lanes,
    force_now,
    ledger_step,
    reach_of,
    segment_series,
    state_at,
    stop_root,
)

FAR = 1e18  # of the truncation error: the distance after which the origin moves along
LANES = 4  # of a vector: rows of series are padded to it
STIFF_AFTER = 24  # steps of one segment before its modes pay
BY_SERIES, BY_ONE, BY_MODES = 0, 1, 2
# A part of `run`, written into it: handing over its arrays would cost up to 15 % of all.
PART = {'cache': True, 'inner': True, 'forceinline': True} | UNCOUNTED


def make_lanes(n: int, order: int) -> Lanes:
    """Return empty lanes for n blocks."""
    wide = (n + LANES - 1) // LANES * LANES
    side = min(DENSE, wide)
    return Lanes._make([
        np.full(n, -1, np.int64), np.empty(n, np.int64), np.zeros((order + 2, wide)),
        *[np.zeros(wide) for _ in range(5)], np.zeros((side, side)),
        *[np.zeros(wide) for _ in range(3)],
    ])  # fmt: skip


@njit(cache=True, inner=True)
def modes_ledger(mo, m, h, t, speed, u, at, la, x, d, paths, energy):
    """Add the drive work and the friction heat (J) of a step h by modes to `energy`."""
    modes_state(mo, h, m, x, d, paths)
    for c in range(m):
        energy[1] += la.friction[c] * abs(x[c])
        paths[c] = 0.0
    for k in range(m if speed != 0.0 else 0):
        path = modes_path(mo, k, h)
        for c in range(m):
            paths[c] += mo.root[c] * mo.shape[c, k] * path
    energy[0] += drive_work(h, t, speed, u, paths, at, la)


@njit(**PART)
def watch_stuck(t, u, speed, at, slot, stale, watch, due, watched, forces):
    """Write which stuck blocks to watch, and their forces; return how many, and when one is due.

    What is not watched is pulled at a constant rate: it breaks at `due`. Only what is `stale` is
    looked at again.
    """
    next_due = np.inf
    count = 0
    for i in range(at.n):
        if slot[i] >= 0:
            continue
        if stale[i]:
            stale[i] = False
            watch[i] = False
            for e in range(at.lo[i], at.lo[i + 1]):
                if slot[at.near[e]] >= 0:
                    watch[i] = True
            due[i] = np.inf
            if not watch[i]:
                f = force_now(i, u, at, speed * t)
                rate = at.drive[i, 0] * speed
                if rate > 0.0:
                    due[i] = t + max(0.0, (at.static[i] - f) / rate)
                elif rate < 0.0:
                    due[i] = t + max(0.0, (-at.static[i] - f) / rate)
        if watch[i]:
            watched[count] = i
            forces[count] = force_now(i, u, at, speed * t)
            count += 1
        elif due[i] < next_due:
            next_due = due[i]
    return count, next_due


@njit(**PART)
def first_event(order, h, m, count, sign, watched, forces, speed, at, la, work):
    """Return (h, kind, block, found): the first stop (2) or break (3) within the step h.

    Kind 0 ends the step before it is sure that anything happens.
    """
    top, kind, block, found = h, 0, -1, False
    for c in range(m):
        if la.sign[c] == 0.0:
            continue
        s, a, share = sign[la.slots[c]], la.a, h / top
        tail = la.tail[c] * share * share  # the bound holds for the shortened step too
        if s * a[1, c] > 0.0:
            if min(s * a[1, c], s * (a[1, c] + 2.0 * h * a[2, c])) > tail:
                continue
        elif s * a[2, c] > 0.0 and 2.0 * s * a[2, c] * h > tail:
            continue
        x, hit = stop_root(order, a, c, s, h, work)
        if hit or x < h:
            h, kind, block, found = x, 2 if hit else 0, la.slots[c], True
    for p in range(count):
        j, share = watched[p], h / top
        push = abs(at.drive[j, 0] * speed) * top
        for e in range(at.lo[j], at.lo[j + 1]):
            c = la.slot[at.near[e]]
            if c >= 0:
                push += at.k_near[e] * la.swing[c]
        if abs(forces[p]) + share * push < at.static[j] * (1.0 - ON_LIMIT):
            continue
        x, hit = break_root(j, forces[p], order, at, speed, h, la, work)
        if hit or x < h:
            h, kind, block, found = x, 3 if hit else 0, j, True
    return h, kind, block, found


@njit(**PART)
def close_ranks(m, before, at, slot, slots, stale):
    """Take out of the lanes what has stopped; return how many slide.

    Blocks beside what stopped, or began (lanes from `before` on), are stale from now on.
    """
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
            for e in range(at.lo[i], at.lo[i + 1]):
                stale[at.near[e]] = True
    return kept


@njit(**PART)
def begin(v, sign, at, la):
    """Let slide what moves or has no friction; return how many do."""
    m = 0
    for i in range(at.n):
        if v[i] != 0.0 or at.static[i] == 0.0:
            sign[i] = np.sign(v[i]) if at.static[i] > 0.0 else 0.0
            la.slot[i] = m
            la.slots[m] = i
            m += 1
    return m


@njit(**PART)
def series_step(
    order, m, mp, small, t, h, ends, speed, u, v, count, sign, watched, forces, at, la, work,
):  # fmt: skip
    """Write the series of what slides; return (h, ends, kind, block) of the step they hold for.

    Kind and block are those of `first_event`; `ends` is False where the step is less than `h`.
    """
    near = h
    if m > 0:
        segment_series(order, m, mp, u, v, at, speed * t, speed, la)
        near = reach_of(order, mp, la.a, small, h)
    if near < h:
        h, ends = near, False
    kind_of, who, top = 0, -1, h
    if top > 0.0 and (m > 0 or count > 0):
        bounds(order, mp, h, la)
        h, kind, block, found = first_event(
            order, h, m, count, sign, watched, forces, speed, at, la, work
        )
        if found:
            ends, kind_of, who = False, kind, block
    if kind_of == 0 and not ends and h < top:
        h = min(top, max(h, 1e-15 * max(t, 1e-3)))  # a near miss: creep past it
    return h, ends, kind_of, who


@njit(**PART)
def go_alone(who, motion, h, stops, t, speed, u, v, at, la, ledger, energy):
    """Move the one block that slides by a step."""
    x, d = lone_state(motion, h)
    if ledger:
        energy[1] += at.friction[who] * abs(x)
        la.tail[0] = lone_path(motion, h)
        energy[0] += drive_work(h, t, speed, u, la.tail, at, la)
    u[who] += x
    v[who] = 0.0 if stops else d


@njit(**PART)
def go_by_modes(modes, m, h, u, v, la, x_out, d_out, a_out):
    """Move what slides by a step, from its modes."""
    modes_state(modes, h, m, x_out, d_out, a_out)
    for c in range(m):
        u[la.slots[c]] += x_out[c]
        v[la.slots[c]] = d_out[c]
        la.a[1, c], la.a[2, c] = d_out[c], 0.5 * a_out[c]


@njit(**PART)
def break_overloaded(t, now, events, m, u, speed, sign, stale, at, log, la):
    """Let blocks slide whose force is beyond the limit; return (events, slots in use).

    Events are -1 where the log is full.
    """
    for i in range(at.n):
        if la.slot[i] >= 0 or not stale[i]:
            continue
        f = force_now(i, u, at, speed * t)
        if abs(f) > at.static[i] * (1.0 + ON_LIMIT):
            sign[i] = np.sign(f)
            la.slot[i] = m
            la.slots[m] = i
            m += 1
            if events >= len(log.t):
                return -1, m
            log.t[events], log.block[events], log.start[events] = now, i, 1
            events += 1
            for e in range(at.lo[i], at.lo[i + 1]):
                stale[at.near[e]] = True
    return events, m


@njit(**PART)
def happen(
    t, now, kind, who, events, m, u, v, speed, sign, watch, due, stale, at, log, la
):  # fmt: skip
    """Stop and break what is due at `t`, in the order of the blocks.

    Returns (events, or -1 where the log is full; slots in use; whether any began or stopped;
    whether a lane is to be filled again). `now` is the time that is written.
    """
    slot, slots = la.slot, la.slots
    before, fastest = m, abs(speed)
    for c in range(m):
        fastest = max(fastest, abs(v[slots[c]]))
    changed = refill = False
    for i in range(at.n):
        if events >= len(log.t):
            return -1, m, changed, refill
        c = slot[i]
        if c >= 0 and c < before:
            if at.static[i] == 0.0:
                continue
            halts = i == who and kind == 2
            if not halts and abs(v[i]) <= ON_LIMIT * fastest:
                halts = sign[i] * la.a[2, c] < 0.0 or sign[i] * la.a[1, c] > 0.0
            if not halts:
                continue
            v[i] = 0.0
            f = force_now(i, u, at, speed * t)
            if abs(f) > at.static[i] * (1.0 + ON_LIMIT):
                sign[i] = np.sign(f)  # reverses: its speed is zero for no time at all
                refill = True
                continue
            sign[i] = 0.0
            slot[i] = -2
            changed = True
            log.t[events], log.block[events], log.start[events] = now, i, 0
            events += 1
        elif c == -1:
            breaks = i == who and kind == 3
            if not breaks:
                if watch[i]:
                    if kind == 2:
                        continue
                elif due[i] > t + ON_LIMIT * max(1.0, t):
                    continue
            f = force_now(i, u, at, speed * t)
            if not breaks and abs(f) < at.static[i] * (1.0 - ON_LIMIT):
                if watch[i]:
                    continue
                if due[i] > t * (1.0 + 4e-16):
                    stale[i] = True
                    continue
            sign[i] = np.sign(f)
            v[i] = 0.0
            slot[i] = m
            slots[m] = i
            m += 1
            changed = True
            log.t[events], log.block[events], log.start[events] = now, i, 1
            events += 1
    if changed:
        m = close_ranks(m, before, at, slot, slots, stale)
    return events, m, changed, refill or changed


@njit(cache=True)
def run(u, v, t_end, order, small, at, rim, grid, log, max_steps, energy, ledger, la):
    """Advance `u`, `v` (n,) to `t_end` in place; return (status, t, events, steps, base).

    `grid` is filled at its times. If the rim has constant speed, `u` is relative to its place at
    `base` (s).
    """
    n = at.n
    slot, slots = la.slot, la.slots
    sign = np.zeros(n)
    wide = len(la.sign)
    x_out, d_out, a_out = np.zeros(wide), np.zeros(wide), np.zeros(wide)
    work = np.zeros(order + 2)
    due = np.full(n, np.inf)  # when a stuck block without sliding neighbours breaks
    speed = rim.par[0] if rim.kind == VELOCITY else 0.0
    watch = np.zeros(n, np.bool_)  # stuck, and the force on it is not linear in time
    stale = np.ones(n, np.bool_)
    watched, forces = np.empty(n, np.int64), np.empty(n)
    # times and places are local, so that they do not lose digits in a long run: the rim and all
    # blocks are set back together, by a time that is a power of two, and `base` remembers
    t, rest, base, back = 0.0, 0.0, 0.0, np.inf
    if speed != 0.0:
        far_s = min(max(FAR * small / abs(speed), 1e-9), 1e300)
        back = 2.0 ** math.ceil(math.log2(far_s))
    end = t_end
    events = steps = sampled = since = 0
    m = begin(v, sign, at, la)
    check = True  # look for blocks whose force is beyond the limit now
    refill = True
    while True:
        if t >= back:
            t, base = t - back, base + back
            end = t_end - base
            u -= speed * back
            due -= back
        if check:
            check = False
            before = m
            events, m = break_overloaded(t, base + t, events, m, u, speed, sign, stale, at, log, la)
            if events < 0:
                return EVENT_LIMIT, base + t, len(log.t), steps, base
            refill = refill or m > before
        mp = (m + LANES - 1) // LANES * LANES
        if refill:
            refill = False
            since = 0
            fill_lanes(m, mp, at, sign, la)
        count, next_due = watch_stuck(t, u, speed, at, slot, stale, watch, due, watched, forces)
        h, ends = end - t, True
        if next_due - t < h:
            h, ends = max(next_due - t, 0.0), False
        kind_of, who, by = 0, -1, BY_SERIES
        if m == 1 and la.sign[0] != 0.0 and la.k_sum[0] > 0.0:
            motion, stops = lone_slip(slots[0], sign[slots[0]], u, v, t, speed, at)
            if stops < h:
                far, _ = lone_state(motion, stops)
                if clear_of_limits(watched, count, forces, stops, abs(far), slots[0], speed, at):
                    by, kind_of, who, h, ends = BY_ONE, 2, slots[0], stops, False
            elif stops == np.inf and h > 0.0:  # it is dragged along, and swings about that
                far = abs(motion.b) * h + 2.0 * abs(motion.e) + abs(motion.q) / motion.w
                if clear_of_limits(watched, count, forces, h, far, slots[0], speed, at):
                    by, who = BY_ONE, slots[0]
        if by == BY_SERIES and 1 < m <= DENSE and since >= STIFF_AFTER and h > 0.0:
            modes = modes_of(m, u, v, t, speed, h, at, la)
            near, kind_of, who = march(
                modes, m, h, forces, speed, watched, count, at, la, x_out, d_out, a_out
            )
            if near > 0.0 or kind_of > 0:
                by = BY_MODES
                if near < h or kind_of > 0:
                    h, ends = near, False
            since = 0
        if by == BY_SERIES:
            h, ends, kind_of, who = series_step(
                order, m, mp, small, t, h, ends, speed, u, v, count, sign, watched, forces, at, la,
                work,
            )  # fmt: skip
            if not h >= 0.0:
                return NOT_FINITE, base + t, events, steps, base
        due_now = kind_of == 0 and next_due <= t + h
        while sampled < len(grid.t) and (grid.t[sampled] - base <= t + h or ends):
            s = grid.t[sampled] - base - t
            for i in range(n):
                grid.u[sampled, i] = u[i] + speed * base
                grid.v[sampled, i] = 0.0
            if by == BY_ONE:
                x, d = lone_state(motion, s)
                grid.u[sampled, who] += x
                grid.v[sampled, who] = d
            elif by == BY_MODES:
                modes_state(modes, s, m, x_out, d_out, a_out)
                for c in range(m):
                    grid.u[sampled, slots[c]] += x_out[c]
                    grid.v[sampled, slots[c]] = d_out[c]
            else:
                state_at(order, mp, s, la, x_out, d_out)
                for c in range(m):
                    grid.u[sampled, slots[c]] = x_out[c] + speed * base
                    grid.v[sampled, slots[c]] = d_out[c]
            sampled += 1
        if by == BY_ONE:
            go_alone(who, motion, h, kind_of == 2, t, speed, u, v, at, la, ledger, energy)
        elif by == BY_MODES:
            if ledger:
                modes_ledger(modes, m, h, t, speed, u, at, la, x_out, d_out, a_out, energy)
            go_by_modes(modes, m, h, u, v, la, x_out, d_out, a_out)
        else:
            if ledger:
                ledger_step(order, m, at, u, t, speed, h, la, a_out, energy)
            state_at(order, mp, h, la, x_out, d_out)
            for c in range(m):
                u[slots[c]] = x_out[c]
                v[slots[c]] = d_out[c]
        t, rest = add_exactly(t, rest, h)
        steps += 1
        since += 1
        if m > 0 and not math.isfinite(u[slots[0]] + v[slots[0]]):
            return NOT_FINITE, base + t, events, steps, base
        if ends and kind_of == 0 and not due_now:
            t = end
            break
        if steps >= max_steps:
            return STEP_LIMIT, base + t, events, steps, base
        if kind_of == 0 and not due_now:
            continue
        # the event, and whatever happens at the same instant, in the order of the blocks
        events, m, changed, again = happen(
            t, base + t, kind_of, who, events, m, u, v, speed, sign, watch, due, stale, at, log, la
        )  # fmt: skip
        if events < 0:
            return EVENT_LIMIT, base + t, len(log.t), steps, base
        refill = refill or again
        check = not changed and kind_of != 2
    return OK, t_end, events, steps, base
