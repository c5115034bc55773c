# SPDX-License-Identifier: Apache-2.0
"""The compiled loop of the event path in the plane: only what slides is integrated."""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.drive import NONE
from eol_ros.core.physics.event.lanes import (
    CREEPING,
    LEVEL,
    LOOSE,
    MOVING,
    NOTHING,
    WEAK,
    WEAKEST,
    Plane,
    fill_plane,
    make_plane,
)
from eol_ros.core.physics.event.step import (
    break_root,
    pass_zero,
    planar_ledger,
    planar_reach,
    planar_state,
    planar_swing,
    slowing_reach,
    stop_in_closed_form,
    suspects,
    zero_reach,
)
from eol_ros.core.physics.event.taylor import (
    TINY,
    blocks_series,
    force_on,
    keep_direction,
    may_creep,
    settle_directions,
)
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.numerics import GAUSS_W, GAUSS_X, ON_LIMIT
from eol_ros.core.physics.series import add_exactly, drive_series, entry, inlined, uncounted
from eol_ros.core.physics.status import EVENT_LIMIT, NOT_FINITE, OK, STEP_LIMIT

AFTER_S = 0.1  # for how long what a stop gets wrong goes on to act on the neighbours
KEPT = 0.1  # of its speed a block keeps at least within a step
KICK_MPS = 1e-6  # where mu_s = mu_k a block may be loose with no acceleration, and no growth of it
SLOWEST_MPS = 1e-11  # counts as none whatever the tolerance
CREEP_ROUNDS = 8  # in which the direction of what creeps has to settle,
CREEP_TOP_S = 1.5e-3  # for a step so long
SETTLED = 1e-12  # is as settled as rounding lets it be


class Rules(NamedTuple):
    """How exact: order of the series; `small` (m) and `relative` bound a step's error; below
    `capture` (m/s) a stop is finished in closed form where that is accurate, below `floor` always
    unless the pull is above friction.
    A block that rotates breaks loose at the speed `kick` (m/s) where less than `weakest` of the
    force is beyond friction: its direction would follow the force in many small steps. Against a
    pull above friction it stops below `slowest` only.
    """

    order: int
    small: float
    relative: float
    capture: float
    floor: float
    kick: float = KICK_MPS
    weakest: float = 1e-9
    slowest: float = SLOWEST_MPS


@uncounted
def stop_of(i, speed, x, y, v, rim_speed, rules, at):
    """Return (time, dx, dy, now): how slow block i comes to rest; `now` if exact enough."""
    limit = at.friction[i] * at.inverse[i]
    stop_s, dx, dy, will = stop_in_closed_form(
        v[i, 0], v[i, 1], x * at.inverse[i], y * at.inverse[i], limit
    )
    if not will or speed <= rules.floor:
        return stop_s, dx, dy, will
    jerk = at.drive[i, 0] * (rim_speed + speed)
    for q in range(at.lo[i], at.lo[i + 1]):
        j = at.near[q]
        jerk += at.k_near[q] * (speed + math.sqrt(v[j, 0] ** 2 + v[j, 1] ** 2))
    jerk *= at.inverse[i]
    margin = limit - math.sqrt(x * x + y * y) * at.inverse[i]
    late = at.k_sum[i] * at.inverse[i] * speed * stop_s * AFTER_S
    error = stop_s * (jerk * stop_s * stop_s / 6.0 + late)
    return stop_s, dx, dy, error < 10.0 * rules.small and jerk * stop_s < 0.2 * margin


class Workspace(NamedTuple):
    """The arrays that a run works in; they may be used again by the next one."""

    pl: Plane
    cx: np.ndarray  # series of the rim's x, y, cos(phi) - 1, sin(phi)
    cy: np.ndarray
    cc: np.ndarray
    cs: np.ndarray
    gx: np.ndarray
    gy: np.ndarray
    work: np.ndarray
    watched: np.ndarray
    found: np.ndarray
    found_x: np.ndarray
    found_y: np.ndarray
    push: np.ndarray
    slack: np.ndarray
    spare: np.ndarray
    fresh: np.ndarray  # blocks that begin to slide now
    kicked: np.ndarray
    crept: np.ndarray  # blocks whose lane has the direction of a creeping start already
    here: np.ndarray
    rate: np.ndarray
    gauss: np.ndarray


def make_workspace(at: Lattice, order: int) -> Workspace:
    """Return the arrays for a lattice and the order of the series."""
    n, size = at.n, order + 2
    return Workspace._make([
        make_plane(at, order), *np.zeros((6, size)), np.zeros(2 * size),
        *np.zeros((2, n), np.int64), *np.zeros((5, n)), *np.zeros((3, n), np.bool_),
        *np.zeros((2, n, 2)), np.stack((GAUSS_X, GAUSS_W)),
    ])  # fmt: skip


@uncounted
def begin_blocks(v, sliding, at, ws):
    """Let slide what moves or has no friction; forget what the run before left in `ws`.

    So slow that its direction is lost, a block rests.
    """
    for i in range(at.n):
        ws.fresh[i] = ws.kicked[i] = ws.crept[i] = False
        ws.slack[i] = 0.0
        if v[i, 0] ** 2 + v[i, 1] ** 2 > TINY or at.static[i] == 0.0:
            sliding[i] = True
            continue
        v[i, 0] = v[i, 1] = 0.0
        ws.fresh[i] = sliding[i]  # at rest for no time at all


@inlined
def start_slots(m, u, at, ws):
    """Write how each slot begins its step."""
    pl = ws.pl
    for c in range(m):
        i = pl.slots[c]
        pl.start[c] = MOVING
        if not ws.fresh[i]:
            continue
        ws.fresh[i] = False
        pl.start[c] = LOOSE
        x, y = force_on(i, u, at, ws.cx[0], ws.cy[0], ws.cc[0], ws.cs[0])
        force = math.sqrt(x * x + y * y)
        if at.friction[i] == 0.0:
            pl.start[c] = MOVING
        elif len(pl.past_x) > 0 and force - at.friction[i] <= WEAKEST * force:  # not of inf - inf
            pl.start[c] = LEVEL if force - at.friction[i] <= NOTHING * force else WEAK


@inlined
def kick_level(m, v, ws):
    """Push what is level and whose pull does not grow, to tell where it goes; return if any is."""
    again, pl = False, ws.pl
    for c in range(m):
        if pl.start[c] == LEVEL and pl.w.inverse[c, 2] <= 0.0:
            i, again = pl.slots[c], True
            force = pl.w.square[c, 0]
            v[i, 0] = KICK_MPS * pl.past_x[c, 0] / force
            v[i, 1] = KICK_MPS * pl.past_y[c, 0] / force
            ws.kicked[i], pl.start[c] = True, MOVING
    return again


@inlined
def record(log, events, t, block, start):
    """Write an event; return how many there are now, or -1 where the log is full."""
    if events >= len(log.t):
        return -1
    log.t[events], log.block[events], log.start[events] = t, block, start
    return events + 1


@uncounted
def break_overloaded(t, events, u, sliding, at, ws, log, counts):
    """Let blocks slide whose force is beyond the limit while they rest; return as `record`."""
    for i in range(at.n):
        if sliding[i]:
            continue
        x, y = force_on(i, u, at, ws.cx[0], ws.cy[0], ws.cc[0], ws.cs[0])
        if math.sqrt(x * x + y * y) >= at.static[i] * (1.0 + ON_LIMIT):
            events = record(log, events, t, i, 1)
            if events < 0:
                return events
            counts[0] += 1
            sliding[i] = ws.fresh[i] = True
    return events


@inlined
def watch_stuck(sliding, driven, at, watched):
    """Write the blocks at rest whose force may change; return how many there are.

    Those are the neighbours of what slides and, where the rim is `driven`, those that it pulls.
    """
    watching = 0
    for i in range(at.n):
        if sliding[i]:
            continue
        watch = driven and at.rim_lo[i] < at.rim_lo[i + 1]
        for q in range(at.lo[i], at.lo[i + 1]):
            if sliding[at.near[q]]:
                watch = True
        if watch:
            watched[watching] = i
            watching += 1
    return watching


@inlined
def first_break(doubtful, h, top, order, used, count, small, u, at, ws):
    """Return (h, who, hit): the step up to the first of the suspects that breaks in it.

    `who` is -1 where none does; without `hit` the step ends before it is sure that it breaks.
    """
    who, hit_any = -1, False
    for p in range(doubtful):
        j, x, y = ws.found[p], ws.found_x[p], ws.found_y[p]
        force = math.sqrt(x * x + y * y) + ws.push[p] * (h / top)
        if force < at.static[j] * (1.0 - ON_LIMIT):
            continue
        x, hit = break_root(
            j, x, y, order, used, count, h, small, u, at, ws.pl, ws.cx, ws.cy, ws.cc, ws.cs, ws.gx,
            ws.gy, ws.work,
        )  # fmt: skip
        if hit or x < h:
            h, who, hit_any = x, j, hit
    return h, who, hit_any


@inlined
def break_together(t, who, watching, events, u, sliding, at, ws, log, counts):
    """Let `who` slide, and what of the `watching` breaks at the same instant, in their order.

    Returns as `record`.
    """
    for p in range(watching):
        j = ws.watched[p]
        x, y = force_on(j, u, at, ws.cx[0], ws.cy[0], ws.cc[0], ws.cs[0])
        force = math.sqrt(x**2 + y**2)
        if j != who and force < at.static[j] * (1.0 - ON_LIMIT):
            continue
        events = record(log, events, t, j, 1)
        if events < 0:
            return events
        counts[0] += 1
        sliding[j] = ws.fresh[j] = True
    return events


@inlined
def stop_slow(
    t, until, rim_speed, events, u, v, m, rules, at, ws, sliding, log, energy, counts
):  # fmt: skip
    """Bring the blocks of the `m` slots to rest that are slow enough; return as `record`.

    A block whose way `until` then is sampled goes on to the floor.
    """
    pl, kicked, fresh, slack = ws.pl, ws.kicked, ws.fresh, ws.slack
    for c in range(m):
        i = pl.slots[c]
        speed = math.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
        if speed >= rules.capture or at.static[i] == 0.0:
            kicked[i] = False
            continue
        if kicked[i] and speed >= 0.5 * KICK_MPS:
            continue  # it has yet to gather speed
        if pl.start[c] == WEAK or pl.start[c] == LEVEL:
            if speed == 0.0:  # cut short at once
                fresh[i] = True
                continue
            if pl.start[c] == LEVEL:
                continue
        x, y = force_on(i, u, at, ws.cx[0], ws.cy[0], ws.cc[0], ws.cs[0])
        stop_s, dx, dy, now = 0.0, 0.0, 0.0, True
        if speed > 0.0:
            if x * v[i, 0] + y * v[i, 1] >= at.friction[i] * speed:
                continue  # gains speed
            stop_s, dx, dy, now = stop_of(i, speed, x, y, v, rim_speed, rules, at)
        if now and speed > rules.floor and t + stop_s > until:
            continue
        if not now:  # the pull is above friction: it may just be reversing
            if speed > SLOWEST_MPS:
                continue
            stop_s = dx = dy = 0.0
            counts[1] += 1
        v[i, 0] = v[i, 1] = 0.0
        if math.sqrt(x * x + y * y) > at.static[i]:
            fresh[i] = True  # reverses: its speed is zero for no time at all
            continue
        energy[1] += 0.5 * at.mass[i] * speed * speed + x * dx + y * dy
        u[i, 0] += dx
        u[i, 1] += dy
        slack[i] = 0.0
        for q in range(at.lo[i], at.lo[i + 1]):
            slack[at.near[q]] = 0.0
        events = record(log, events, t + stop_s, i, 0)
        if events < 0:
            return events
        sliding[i] = False
    return events


@inlined
def mark_creeping(m, h, gain, u, v, rules, at, ws):
    """Mark the slots that may creep; return (whether any does, the step for it, gain)."""
    pl, creeping = ws.pl, False
    for c in range(m if len(pl.past_x) > 0 else 0):
        i = pl.slots[c]
        if pl.start[c] == MOVING and at.friction[i] > 0.0:
            x, y = force_on(i, u, at, ws.cx[0], ws.cy[0], ws.cc[0], ws.cs[0])
            if may_creep(i, x, y, v[i, 0], v[i, 1], rules.small, at):
                pl.start[c], creeping, h = CREEPING, True, min(h, CREEP_TOP_S)
                for k in range(0 if ws.crept[i] else rules.order):
                    pl.known_x[c, k] = pl.known_y[c, k] = 0.0
                gain = gain if ws.crept[i] else 1.0
    return creeping, h, gain


@inlined
def settle_creep(m, count, used, gain, last, u, v, rules, at, ws):
    """Settle the directions of what creeps; return (gain, last) for the next step.

    gain: of a round that settles directions; last: their last change.
    """
    pl, order = ws.pl, rules.order
    for p in range(CREEP_ROUNDS):
        change = settle_directions(order, m, CREEP_TOP_S, pl)
        if p > 0:
            gain = min(change / last, 1.0)
        if change * gain < max(rules.relative, SETTLED):  # so little would change next
            break
        last = change
        if p == CREEP_ROUNDS - 1:  # not slow enough
            for c in range(m):
                if pl.start[c] == CREEPING:
                    pl.start[c] = MOVING
        blocks_series(order, m, count, u, v, used, at, pl, ws.cx, ws.cy, ws.cc, ws.cs)
    return gain, last


@entry
def run(
    u, v, sliding, t_end, rules, at, rim, grid, log, max_steps, energy, ledger, counts, ws,
):  # fmt: skip
    """Advance `u`, `v` (n, 2) and `sliding` (n,) to `t_end`; return (status, t, events, steps).

    `counts` (3,): slips begun, stops at the floor against a pull above mu_k, springs that passed
    length zero. Events are written in the order they are found: a stop may bear a time a little
    later than a break behind it.
    """
    order, n, pl = rules.order, at.n, ws.pl
    cx, cy, cc, cs, gx, work = ws.cx, ws.cy, ws.cc, ws.cs, ws.gx, ws.work
    watched, crept = ws.watched, ws.crept
    here, rate, gauss = ws.here, ws.rate, ws.gauss
    begin_blocks(v, sliding, at, ws)
    t, left = 0.0, 0.0
    events = steps = sampled = 0
    m = count = watching = 0
    changed = settle = by_zero = True
    gain = last = 1.0  # of a round that settles directions; the last change of them
    while True:
        reach, used = drive_series(
            rim.kind, rim.par, rim.knots, rim.cubics, t, order, cx, cy, cc, cs, gx
        )
        if settle:
            settle, before = False, events
            events = break_overloaded(t, events, u, sliding, at, ws, log, counts)
            if events < 0:
                return EVENT_LIMIT, t, len(log.t), steps
            changed = changed or events > before
        if changed:
            changed = False
            for i in range(n):
                crept[i] = False
            m, count = fill_plane(sliding, at, pl)
            by_zero = at.geometric
            watching = watch_stuck(sliding, rim.kind != NONE, at, watched)
        if by_zero:
            pass_zero(count, u, v, rules.relative, rules.small, at, pl, cx, cy, cc, cs)
        start_slots(m, u, at, ws)
        h = min(t_end - t, reach)
        creeping, h, gain = mark_creeping(m, h, gain, u, v, rules, at, ws)
        ends = h == t_end - t
        near = h
        if m > 0 or count > 0:
            blocks_series(order, m, count, u, v, used, at, pl, cx, cy, cc, cs)
            if creeping:
                gain, last = settle_creep(m, count, used, gain, last, u, v, rules, at, ws)
            if kick_level(m, v, ws):
                blocks_series(order, m, count, u, v, used, at, pl, cx, cy, cc, cs)
            near = planar_reach(order, m, pl, rules.relative, rules.small, h)
            near = slowing_reach(order, m, at, pl, near, KEPT, work)
        if used > 3:
            top = max(abs(cx[order]), abs(cy[order]))  # m, of the farthest anchor
            top = max(top, at.far * abs(cc[order]), at.far * abs(cs[order]))
            if top > 0.0:
                near = min(near, (rules.small / top) ** (1.0 / order))
        if near < h:
            h, ends = near, False
        if not h >= 0.0:
            return NOT_FINITE, t, events, steps
        # the first stuck block to break within the step
        top, who, hit_any, through = h, -1, False, 0
        if h > 0.0:
            planar_swing(order, m, h, pl)
            rim_far = rim_yaw = 0.0
            power = 1.0
            for q in range(1, used + 1):
                power *= h
                rim_far += power * math.sqrt(cx[q] ** 2 + cy[q] ** 2)
                rim_yaw += power * math.sqrt(cc[q] ** 2 + cs[q] ** 2)
            if at.geometric:
                clear, by_zero, through = zero_reach(
                    order, used, count, watching, watched, h, rim_far + rim_yaw * at.far,
                    rules.small, rules.relative, u, at, pl, cx, cy, cc, cs, work,
                )  # fmt: skip
                if clear < h:
                    h, top, ends = clear, clear, False
            doubtful = suspects(
                watching, watched, u, rim_far, rim_yaw, cx[0], cy[0], cc[0], cs[0], ws.found,
                ws.found_x, ws.found_y, ws.push, ws.slack, ws.spare, at, pl,
            )  # fmt: skip
            if doubtful > 0:
                h, who, hit_any = first_break(
                    doubtful, h, top, order, used, count, rules.small, u, at, ws
                )
                ends = ends and who < 0
            if h < top and not hit_any:
                h = min(top, max(h, 1e-15 * max(1.0, t)))  # a near miss: creep past it
        while sampled < len(grid.t) and (grid.t[sampled] <= t + h or ends):
            planar_state(order, m, grid.t[sampled] - t, pl, here, rate)
            for i in range(n):
                for q in range(2):
                    grid.u[sampled, i, q] = here[i, q] if sliding[i] else u[i, q]
                    grid.v[sampled, i, q] = rate[i, q] if sliding[i] else 0.0
            sampled += 1
        if ledger:
            planar_ledger(order, m, u, at, pl, cx, cy, cc, cs, used, h, energy, here, rate, gauss)
        planar_state(order, m, h, pl, u, v)
        for c in range(m):
            i = pl.slots[c]
            if not math.isfinite(u[i, 0] + v[i, 0] + u[i, 1] + v[i, 1]):
                return NOT_FINITE, t, events, steps
        for c in range(m if len(pl.past_x) > 0 else 0):
            crept[pl.slots[c]] = pl.start[c] == CREEPING
            if pl.start[c] == CREEPING:
                keep_direction(order, c, h, pl)
        t, left = add_exactly(t, left, h)
        steps += 1
        if through > 0 and h == top:
            counts[2] += through
            settle = True  # the force of these springs has reversed
        if ends:
            break
        if steps >= max_steps:
            return STEP_LIMIT, t, events, steps
        drive_series(rim.kind, rim.par, rim.knots, rim.cubics, t, 3, cx, cy, cc, cs, gx)
        rim_speed = math.sqrt(cx[1] ** 2 + cy[1] ** 2) + math.sqrt(cc[1] ** 2 + cs[1] ** 2)
        before = events
        until = grid.t[sampled] if sampled < len(grid.t) else np.inf
        events = stop_slow(
            t, until, rim_speed, events, u, v, m, rules, at, ws, sliding, log, energy, counts
        )
        if events < 0:
            return EVENT_LIMIT, t, len(log.t), steps
        changed = changed or events > before
        if hit_any:
            events = break_together(t, who, watching, events, u, sliding, at, ws, log, counts)
            if events < 0:
                return EVENT_LIMIT, t, len(log.t), steps
            changed = True
    return OK, t, events, steps
