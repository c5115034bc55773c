# SPDX-License-Identifier: Apache-2.0
"""From one image to the next: following, carrying, giving back, and suspecting a swap. Compiled."""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, exp, hypot, sin
from eol_ros.core.geometry import COLS, N_BLOCKS, PITCH_M, ROWS
from eol_ros.core.vision.identity.fitting import (
    MIN_SPACING_M,
    affine,
    assign,
    folds,
    match,
    strain,
    turn,
)

CANDIDATES = 32  # lights that are remembered without being a block
STICK_M = 0.014  # mu_s m g / (4 k): friction holds a block this far from where its springs want it
RIM_DOUBT_M = 0.05  # the rim is not seen
STRAY_M = 0.03  # and hardly ever so far from it
FOLLOW_M = 0.012  # a followed block is found within this of its prediction, at rest
LAMP_M = 0.005  # a light this near to where a lamp was is that lamp
THROWN_M = 0.04  # and within this when it was hit, if the light is nobody else's
AWAY_M_S = 0.15  # faster a block of which an arm hides some hardly goes away from its fellows
NEAR_M = 0.010  # a hidden block this close to where it went is itself
BEND_M = 0.08  # neighbours stand this close to where the lattice wants them, nearly always
FAR_M = 0.08  # and beyond this it is not
SOON_S = 0.025  # a light must last before it can be a block: near its place,
LATER_S = 0.06  # and elsewhere; a sound one need not, up to THROWN_M away
LONG_S = 0.5  # a light that lasts so long may take the better of two doubtful places
PATIENCE_S = 0.1  # a swap must be better for so long
LAMP_S = 0.1  # a light that has been no block for so long is not taken for one on the way
WAITED_S = 0.1  # a light that waits for so long is reason to read the whole lattice again,
MANY = 3  # as are at once so many that wait, where as many blocks are hidden that they may be
REST_M = 6e-4  # a lattice whose blocks stay within this rests
GAIN = 0.7  # of the filter of a block's velocity
LASTS_S = 0.2  # how a block moved, and how far it stood from there, when it was last seen
SWEEPS = 12  # over the hidden blocks, each of which moves where its neighbours let it
FEW = 4  # blocks that tell how the lattice is turned
QUARTER = np.pi / 2


@njit(cache=True)
def advance(
    stamp_s, step, points, faint, xy, velocity, seen, sigma, firm, rest, angle, place, born, last,
    at,
):  # fmt: skip
    """Follow what was seen, carry what is hidden, and remember the other lights of one image.

    faint (n,): points of which little is in view. firm (25,): blocks that have gone along with
    their fellows since they were not faint, or given back: no edge of an arm stands for them.
    Changes xy, velocity, sigma and firm, and what is remembered (see remember). Returns xy (25, 2)
    as it was, index (25,) or -1, and whether so many lights wait that the whole lattice is to be
    read, or there is another reason to.
    """
    before = xy.copy()
    index = follow(xy, velocity, seen, step, points, place[stamp_s - born > LAMP_S])
    held = index >= 0
    doubtful = np.zeros(N_BLOCKS, np.bool_)
    for i in range(N_BLOCKS):
        firm[i] &= held[i]
        if held[i]:
            xy[i] = points[index[i]]
            doubtful[i] = faint[index[i]]
            firm[i] |= not doubtful[i]
    if doubtful.any():
        gone = reject_outliers(xy, held, doubtful, rest, angle)
        for i in range(N_BLOCKS):
            if doubtful[i]:
                firm[i] &= _goes_along(i, before, xy, held, step)
        for i in range(N_BLOCKS):
            if gone[i] and not firm[i]:
                index[i], held[i] = -1, False
    _lose(seen & ~held, velocity, sigma, step)
    predict_occluded(before, xy, held, rest, angle, velocity, sigma, step)
    remember(stamp_s, points, index, place, born, last, at)
    hidden = N_BLOCKS - held.sum()
    waiting = 0
    long = False
    for k in range(CANDIDATES):
        if at[k] >= 0 and stamp_s - born[k] > 0.0:
            waiting += 1
            long |= stamp_s - born[k] > WAITED_S
    many = min(waiting, hidden) >= MANY
    return before, index, many, (hidden > 0 and long) or folds(xy, held) > 0


@njit(cache=True)
def _lose(lost, velocity, sigma, step):
    """Leave blocks that are lost now so much of their velocity as is more than the noise of it.

    That noise follows from sigma of the places, through the filter in conclude.
    """
    for i in range(N_BLOCKS):
        if lost[i]:
            noise = 4.0 * GAIN * GAIN / (2.0 - GAIN) * (sigma[i] / step) ** 2  # of both axes
            moves = velocity[i, 0] ** 2 + velocity[i, 1] ** 2
            velocity[i] *= max(1.0 - noise / moves, 0.0) if moves > 0.0 else 0.0


@njit(cache=True)
def _goes_along(block, before, xy, held, step):
    """Whether a block goes as those beside it do, and not away from them as an arm's edge may."""
    dx = dy = 0.0
    n = 0
    for j in range(N_BLOCKS):
        beside = abs(j // COLS - block // COLS) < 2 and abs(j % COLS - block % COLS) < 2
        if held[j] and beside and j != block:
            dx += xy[j, 0] - before[j, 0]
            dy += xy[j, 1] - before[j, 1]
            n += 1
    dx = xy[block, 0] - before[block, 0] - dx / max(n, 1)
    dy = xy[block, 1] - before[block, 1] - dy / max(n, 1)
    return n > 0 and hypot(dx, dy) < AWAY_M_S * step


@njit(cache=True)
def conclude(
    stamp_s, step, points, spread, sound, give_back, before, was, index, angle, xy, velocity,
    sigma, firm, seen_s, rest_xy, swaps, place, born, at,
):  # fmt: skip
    """Take what one image says of each block, once its names are given; see advance.

    spread (n,) m: of the points. sound (n,): can be nothing but blocks. give_back: lights may still
    become hidden blocks. Changes index, xy, velocity, sigma, firm, seen_s, and rest_xy where the
    lattice does not rest. Returns seen (25,), whether it rests, and suspect_swaps.
    """
    if give_back:
        back = reacquire(stamp_s, xy, index, sigma, seen_s, angle, place, born, at, sound)
        for i in range(N_BLOCKS):
            if back[i]:
                xy[i] = points[index[i]]
                firm[i] = True
    seen = index >= 0
    rests = True
    for i in range(N_BLOCKS):
        if not seen[i]:
            continue
        for k in range(2):
            if was[i] and step > 0:
                velocity[i, k] += GAIN * ((xy[i, k] - before[i, k]) / step - velocity[i, k])
            rests &= abs(xy[i, k] - rest_xy[i, k]) <= REST_M
        seen_s[i] = stamp_s
        sigma[i] = spread[index[i]]
    if not rests:
        rest_xy[:] = xy
    return seen, rests, suspect_swaps(xy, seen, angle, step, swaps)


@njit(cache=True)
def turn_yaws(step, yaws, xy, seen, index, rest, yaw, angle, turn_rate):
    """Unwrap the yaw (25,) of the seen blocks by `yaws` (n,); hidden ones turn with the lattice.

    Returns angle and turn rate of the lattice after `step`, and how many blocks are seen.
    """
    change = np.empty(N_BLOCKS)
    n = 0
    for i in range(N_BLOCKS):
        if seen[i]:
            change[n] = (yaws[index[i]] - yaw[i] + np.pi / 4) % QUARTER - np.pi / 4
            yaw[i] += change[n]
            n += 1
    if n == 0:
        return angle, turn_rate, n
    if n >= FEW:
        by = (turn(rest, xy, seen) - angle + np.pi) % (2 * np.pi) - np.pi
    else:
        by = np.median(change[:n])
    for i in range(N_BLOCKS):
        if not seen[i]:
            yaw[i] += by
    return angle + by, turn_rate + 0.2 * (by / step - turn_rate), n


@njit(cache=True)
def follow(xy, velocity, seen, step, points, lamps):
    """Find in this image the blocks that were seen in the last one; index (25,) or -1.

    lamps (m, 2): lights that are known to be something else.
    """
    free = np.ones(points.shape[0], np.bool_)
    for j in range(points.shape[0]):
        for k in range(lamps.shape[0]):
            if hypot(points[j, 0] - lamps[k, 0], points[j, 1] - lamps[k, 1]) < LAMP_M:
                free[j] = False
    names = np.flatnonzero(free)
    points = points[names]
    n = 0
    blocks = np.empty(N_BLOCKS, np.int64)
    expected = np.empty((N_BLOCKS, 2))
    gate = np.empty(N_BLOCKS)
    for i in range(N_BLOCKS):
        if seen[i]:
            blocks[n] = i
            dx = velocity[i, 0] * step
            dy = velocity[i, 1] * step
            expected[n, 0] = xy[i, 0] + dx
            expected[n, 1] = xy[i, 1] + dy
            gate[n] = FOLLOW_M + 0.5 * hypot(dx, dy)
            n += 1
    found = match(expected[:n], gate[:n], points)
    index = np.full(N_BLOCKS, -1, np.int64)
    free = np.ones(points.shape[0], np.bool_)
    missed = 0
    for k in range(n):
        if found[k] >= 0:
            index[blocks[k]] = names[found[k]]
            free[found[k]] = False
        else:
            missed += 1
    left = np.flatnonzero(free)
    if missed == 0 or left.size == 0:
        return index
    # A knock throws a block further than it can be predicted: look around for those that are left.
    again = np.flatnonzero(found < 0)
    wide = np.full(again.size, THROWN_M)
    found = match(expected[again], wide, points[left])
    for k in range(again.size):
        if found[k] >= 0:
            index[blocks[again[k]]] = names[left[found[k]]]
    return index


@njit(cache=True)
def predict_occluded(before, xy, held, rest, angle, velocity, sigma, step):
    """Let the hidden blocks follow their neighbours as springs and friction make them.

    A block sticks until its springs pull it harder than friction holds it: so it is never further
    than STICK_M from the middle of its four neighbours. Where a neighbour is the rim, the lattice
    continued (an affine fit of what is seen) stands for it; as that is a guess, a block that was
    just seen further off comes back to within STICK_M by degrees. It goes on as it was seen to
    move, for a while. Changes xy, velocity and sigma of blocks not held.

    before (25, 2): places in the last image. held (25,): seen in this one. rest (25, 2).
    """
    if held.sum() < 6:
        _drift(before, xy, held, velocity, sigma, step)
        return
    fit, fit_before = affine(rest, xy, held), affine(rest, before, held)
    every = np.ones(N_BLOCKS, np.bool_)
    most_m = np.full(N_BLOCKS, STICK_M)
    lasts = exp(-step / LASTS_S)
    for h in range(N_BLOCKS):
        if not held[h]:
            ex, ey = _between(h, before, every, fit_before, angle)
            far = hypot(before[h, 0] - ex, before[h, 1] - ey)
            most_m[h] = STICK_M + lasts * max(far - STICK_M, 0.0)
            for k in range(2):
                xy[h, k] += lasts * velocity[h, k] * step
    for _ in range(SWEEPS):
        for h in range(N_BLOCKS):
            if held[h]:
                continue
            ex, ey = _between(h, xy, every, fit, angle)
            ox, oy = xy[h, 0] - ex, xy[h, 1] - ey
            far = hypot(ox, oy)
            if far > most_m[h]:
                xy[h, 0] = ex + ox * most_m[h] / far
                xy[h, 1] = ey + oy * most_m[h] / far
    for h in range(N_BLOCKS):
        if held[h]:
            continue
        row, column = h // COLS, h % COLS
        # Under an arm it may stick or slide whenever its fellows move, unseen.
        moved = doubt = 0.0
        beside = 0
        for j in range(N_BLOCKS):
            dr, dc = abs(j // COLS - row), abs(j % COLS - column)
            if held[j] and dr < 2 and dc < 2:
                moved = max(
                    moved,
                    hypot(xy[j, 0] - before[j, 0], xy[j, 1] - before[j, 1]),
                )
            if dr + dc == 1:
                beside += 1
                doubt += 0.0 if held[j] else sigma[j] ** 2
        doubt += (4 - beside) * RIM_DOUBT_M**2
        velocity[h, 0] = (xy[h, 0] - before[h, 0]) / step
        velocity[h, 1] = (xy[h, 1] - before[h, 1]) / step
        most = np.sqrt((0.8 * STICK_M) ** 2 + doubt / 9.0)
        grown = sigma[h] + 0.5 * moved + 0.0005 * step
        sigma[h] = max(min(grown, most), min(sigma[h], 2 * most))


@njit(cache=True)
def _between(block, xy, use, fit, angle):
    """Return where the springs of a block to its four neighbours want it, m.

    Where one is the rim, or is not in `use` (25,), the lattice continued by `fit` stands for it.
    """
    ca, sa = cos(angle) * PITCH_M, sin(angle) * PITCH_M
    ex = ey = 0.0
    for k in range(4):
        dc = 1 if k == 0 else (-1 if k == 1 else 0)
        dr = 1 if k == 2 else (-1 if k == 3 else 0)
        c, r = block % COLS + dc, block // COLS + dr
        j = r * COLS + c
        if 0 <= c < COLS and 0 <= r < ROWS and use[j]:
            px, py = xy[j, 0], xy[j, 1]
        else:
            gx, gy = (c - 2) * PITCH_M, (r - 2) * PITCH_M
            px = fit[0, 0] + fit[1, 0] * gx + fit[2, 0] * gy
            py = fit[0, 1] + fit[1, 1] * gx + fit[2, 1] * gy
        ex += 0.25 * (px - ca * dc + sa * dr)
        ey += 0.25 * (py - sa * dc - ca * dr)
    return ex, ey


@njit(cache=True)
def reject_outliers(xy, held, faint, rest, angle):
    """Which faint blocks (25,) stand where springs and friction would not let them: an arm's edge.

    faint (25,): held, but with little of the outline in view.
    """
    away = np.zeros(N_BLOCKS, np.bool_)
    if held.sum() < 12 or not faint.any():
        return away
    sure = held & ~faint
    fit = affine(rest, xy, sure)
    for h in range(N_BLOCKS):
        if faint[h]:
            ex, ey = _between(h, xy, sure, fit, angle)
            away[h] = hypot(xy[h, 0] - ex, xy[h, 1] - ey) > STRAY_M
    return away


@njit(cache=True)
def _drift(before, xy, held, velocity, sigma, step):
    """With hardly anything in sight, hidden blocks go along with the mean of what is."""
    n = max(held.sum(), 1)
    mx = my = 0.0
    for j in range(N_BLOCKS):
        if held[j]:
            mx += (xy[j, 0] - before[j, 0]) / n
            my += (xy[j, 1] - before[j, 1]) / n
    for h in range(N_BLOCKS):
        if not held[h]:
            xy[h, 0] += mx
            xy[h, 1] += my
            velocity[h] = 0.0
            sigma[h] = min(sigma[h] + 0.3 * step + 0.5 * hypot(mx, my), 0.5)


@njit(cache=True)
def remember(stamp_s, points, index, place, born, last, at):
    """Follow the lights that are no block, so that their age is known; fills `at` with indices."""
    n = points.shape[0]
    free = np.ones(n, np.bool_)
    for i in range(N_BLOCKS):
        if index[i] >= 0:
            free[index[i]] = False
    for k in range(CANDIDATES):
        at[k] = -1
        if born[k] == np.inf:
            continue
        best = 0.02**2
        for j in range(n):
            if free[j]:
                d = (points[j, 0] - place[k, 0]) ** 2 + (points[j, 1] - place[k, 1]) ** 2
                if d < best:
                    best = d
                    at[k] = j
        if at[k] >= 0:
            place[k] = points[at[k]]
            last[k] = stamp_s
            free[at[k]] = False
        elif stamp_s - last[k] > 0.03:
            born[k] = np.inf
    for j in range(n):
        if free[j]:
            for k in range(CANDIDATES):
                if born[k] == np.inf:
                    place[k] = points[j]
                    born[k] = stamp_s
                    last[k] = stamp_s
                    at[k] = j
                    break


@njit(cache=True)
def forget_named(xy, seen, place, born):
    """Forget lights that are blocks by now; else `follow` would take those blocks for lamps."""
    for k in range(CANDIDATES):
        if born[k] == np.inf:
            continue
        for i in range(N_BLOCKS):
            if seen[i] and hypot(xy[i, 0] - place[k, 0], xy[i, 1] - place[k, 1]) < LAMP_M:
                born[k] = np.inf


@njit(cache=True)
def reacquire(stamp_s, xy, index, sigma, seen_s, angle, place, born, at, sound):
    """Give lights back to hidden blocks; sets `index`, returns which blocks came back (25,).

    sound (n,): detections that can be nothing but a block.
    """
    back = np.zeros(N_BLOCKS, np.bool_)
    seen = index >= 0
    hidden = np.flatnonzero(~seen)
    if hidden.size == 0:
        return back
    ca = cos(angle)
    sa = sin(angle)
    lights = np.empty(CANDIDATES, np.int64)
    m = 0
    for k in range(CANDIDATES):
        if born[k] == np.inf or at[k] < 0:
            continue
        if stamp_s - born[k] < SOON_S and not sound[at[k]]:
            continue
        clear = True
        for i in range(N_BLOCKS):
            if seen[i]:
                d = (xy[i, 0] - place[k, 0]) ** 2 + (xy[i, 1] - place[k, 1]) ** 2
                if d < MIN_SPACING_M * MIN_SPACING_M:
                    clear = False
        if clear:
            lights[m] = k
            m += 1
    if m == 0:
        return back
    h = hidden.size
    price = np.full((h, m), 1e3)
    for a in range(h):
        i = hidden[a]
        for b in range(m):
            k = lights[b]
            if born[k] < seen_s[i]:  # it shone while the block was elsewhere
                continue
            off = hypot(xy[i, 0] - place[k, 0], xy[i, 1] - place[k, 1])
            near = sound[at[k]] or off < NEAR_M + min(sigma[i], 0.01)
            if off > FAR_M or (stamp_s - born[k] < LATER_S and not near):
                continue
            if not fits(i, place[k], xy, seen, ca, sa):
                continue
            price[a, b] = off
    cost = np.full((h, m + h), FAR_M)
    for a in range(h):
        for b in range(m):
            cost[a, b] = price[a, b]
    column = assign(cost)
    for a in range(h):
        b = column[a]
        if b >= m or price[a, b] >= FAR_M:
            continue
        k = lights[b]
        i = hidden[a]
        rival = np.inf  # another home for this light, or another light for this home
        for other in range(h):
            j = hidden[other]
            if j != i:
                rival = min(rival, hypot(xy[j, 0] - place[k, 0], xy[j, 1] - place[k, 1]))
        for other in range(m):
            if other != b:
                rival = min(rival, price[a, other])
        if price[a, b] > (0.5 if stamp_s - born[k] < LONG_S else 0.8) * rival:
            continue
        index[i] = at[k]
        born[k] = np.inf
        back[i] = True
    return back


@njit(cache=True)
def fits(block, place, xy, seen, ca, sa):
    """Whether `place` stands about where each seen 4-neighbour of `block` wants it."""
    row = block // COLS
    column = block % COLS
    for k in range(4):
        dc = 1 if k == 0 else (-1 if k == 1 else 0)
        dr = 1 if k == 2 else (-1 if k == 3 else 0)
        r = row + dr
        c = column + dc
        if 0 <= r < ROWS and 0 <= c < COLS and seen[r * COLS + c]:
            j = r * COLS + c
            dx = place[0] - xy[j, 0]
            dy = place[1] - xy[j, 1]
            if dx * dx + dy * dy < MIN_SPACING_M * MIN_SPACING_M:
                return False
            ex = dx + PITCH_M * (ca * dc - sa * dr)
            ey = dy + PITCH_M * (sa * dc + ca * dr)
            if ex * ex + ey * ey > BEND_M * BEND_M:
                return False
    return True


@njit(cache=True)
def suspect_swaps(xy, seen, angle, step, clock):
    """Advance the patience of each pair of neighbours; return a * 25 + b to exchange, or -1.

    A pair is crosswise when the seen neighbours of both, and their own order, fit better the other
    way round. Pairs of one seen and one hidden block count too: the light may be the other's.
    """
    ca = cos(angle)
    sa = sin(angle)
    for a in range(N_BLOCKS):
        row = a // COLS
        column = a % COLS
        for k in range(4):
            r = row + (1 if k > 0 else 0)
            c = column + (1 if k == 0 else k - 2)
            if k == 0:
                r = row
            if not (0 <= r < ROWS and 0 <= c < COLS):
                continue
            b = r * COLS + c
            if not (seen[a] or seen[b]):
                clock[a, b] = 0.0
                continue
            now = then = 0.0
            if seen[a]:
                now += strain(a, xy[a], xy, seen, ca, sa, b)
                then += strain(b, xy[a], xy, seen, ca, sa, a)
            if seen[b]:
                now += strain(b, xy[b], xy, seen, ca, sa, a)
                then += strain(a, xy[b], xy, seen, ca, sa, b)
            dx = (c - column) * PITCH_M
            dy = (r - row) * PITCH_M
            wx = ca * dx - sa * dy
            wy = sa * dx + ca * dy
            gx = xy[b, 0] - xy[a, 0]
            gy = xy[b, 1] - xy[a, 1]
            if seen[a] and seen[b] and now < np.inf and then < np.inf:
                now += (gx - wx) ** 2 + (gy - wy) ** 2
                then += (gx + wx) ** 2 + (gy + wy) ** 2
            crosswise = then < 0.7 * now
            if not (seen[a] and seen[b]):  # one light, two homes: only where it is plainly wrong
                crosswise = now < np.inf and now > BEND_M * BEND_M and then < 0.3 * now
            if crosswise:
                clock[a, b] += step
                if clock[a, b] >= PATIENCE_S:
                    clock[a, b] = 0.0
                    return a * N_BLOCKS + b
            else:
                clock[a, b] = 0.0
    return -1
