# SPDX-License-Identifier: Apache-2.0
"""From one image to the next: following, carrying, giving back, and suspecting a swap. Compiled."""

import numpy as np
from numba import njit

from eol_ros.core.geometry import COLS, N_BLOCKS, PITCH_M, ROWS
from eol_ros.core.vision.lattice_solve import MAX_SPACING_M, MIN_SPACING_M, assign, match, strain

CANDIDATES = 32  # lights that are remembered without being a block
FOLLOW_M = 0.012  # a followed block is found within this of its prediction, at rest
NEAR_M = 0.010  # a hidden block this close to where it went is itself
FAR_M = 0.10  # and beyond this it is not
SOON_S = 0.025  # a light must last before it can be a block: near its place,
LATER_S = 0.06  # and elsewhere
LONG_S = 0.4  # a light that lasts so long may take the better of two doubtful places
PATIENCE_S = 0.1  # a swap must be better for so long


@njit(cache=True)
def follow(xy, velocity, seen, step, points):
    """Find in this image the blocks that were seen in the last one; index (25,) or -1."""
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
            gate[n] = FOLLOW_M + 0.5 * np.hypot(dx, dy)
            n += 1
    found = match(expected[:n], gate[:n], points)
    index = np.full(N_BLOCKS, -1, np.int64)
    for k in range(n):
        index[blocks[k]] = found[k]
    return index


@njit(cache=True)
def carry(before, was, xy, held, velocity, sigma, step):
    """Move each hidden block with the rigid motion of the seen ones about it, nearest first.

    before, xy (25, 2): places in the last and in this image; was, held (25,): seen in them. Changes
    xy, velocity and sigma of the blocks that are not held.
    """
    for h in range(N_BLOCKS):
        if held[h]:
            continue
        total = ax = ay = bx = by = 0.0
        for j in range(N_BLOCKS):
            if held[j] and was[j]:
                dx = before[j, 0] - before[h, 0]
                dy = before[j, 1] - before[h, 1]
                w = np.exp(-(dx * dx + dy * dy) / (2 * 0.2 * 0.2))
                total += w
                ax += w * before[j, 0]
                ay += w * before[j, 1]
                bx += w * xy[j, 0]
                by += w * xy[j, 1]
        if total < 1e-3:
            sigma[h] = min(sigma[h] + 0.3 * step, 0.5)
            velocity[h] = 0.0
            continue
        ax /= total
        ay /= total
        bx /= total
        by /= total
        dot = 1e-6
        cross = 0.0
        spread = 0.0
        for j in range(N_BLOCKS):
            if held[j] and was[j]:
                dx = before[j, 0] - before[h, 0]
                dy = before[j, 1] - before[h, 1]
                w = np.exp(-(dx * dx + dy * dy) / (2 * 0.2 * 0.2))
                px = before[j, 0] - ax
                py = before[j, 1] - ay
                qx = xy[j, 0] - bx
                qy = xy[j, 1] - by
                dot += w * (px * qx + py * qy)
                cross += w * (px * qy - py * qx)
                mx = xy[j, 0] - before[j, 0] - (bx - ax)
                my = xy[j, 1] - before[j, 1] - (by - ay)
                spread += w * (mx * mx + my * my)
        angle = np.arctan2(cross, dot)
        c = np.cos(angle)
        s = np.sin(angle)
        rx = before[h, 0] - ax
        ry = before[h, 1] - ay
        nx = bx + c * rx - s * ry
        ny = by + s * rx + c * ry
        moved = np.hypot(nx - before[h, 0], ny - before[h, 1])
        xy[h, 0] = nx
        xy[h, 1] = ny
        velocity[h, 0] = (nx - before[h, 0]) / step
        velocity[h, 1] = (ny - before[h, 1]) / step
        # A block under an arm may stick while its fellows slide, so trust fades with their path.
        grown = np.sqrt(sigma[h] ** 2 + spread / total)
        sigma[h] = min(grown + 0.25 * moved + 0.0002 * step, 0.5)


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
def return_hidden(stamp_s, xy, index, sigma, seen_s, angle, place, born, last, at):
    """Give lights back to hidden blocks; sets `index`, returns which blocks came back (25,)."""
    back = np.zeros(N_BLOCKS, np.bool_)
    seen = index >= 0
    hidden = np.flatnonzero(~seen)
    if hidden.size == 0:
        return back
    ca = np.cos(angle)
    sa = np.sin(angle)
    lights = np.empty(CANDIDATES, np.int64)
    m = 0
    for k in range(CANDIDATES):
        if born[k] == np.inf or at[k] < 0 or stamp_s - born[k] < SOON_S:
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
            off = np.hypot(xy[i, 0] - place[k, 0], xy[i, 1] - place[k, 1])
            near = off < NEAR_M + min(sigma[i], 0.01)
            if off > FAR_M or (stamp_s - born[k] < LATER_S and not near):
                continue
            if not spaced(i, place[k], xy, seen):
                continue
            s2 = min(max(sigma[i], 0.004), 0.03) ** 2
            bend = strain(i, place[k], xy, seen, ca, sa, -1)
            if bend == np.inf:
                bend = off * off
            price[a, b] = off * off / s2 + bend / 0.03**2
    cost = np.full((h, m + h), 400.0)
    for a in range(h):
        for b in range(m):
            cost[a, b] = price[a, b]
    column = assign(cost)
    for a in range(h):
        b = column[a]
        if b >= m or price[a, b] >= 400.0:
            continue
        k = lights[b]
        if stamp_s - born[k] < LONG_S:
            rival = np.inf  # another home for this light, or another light for this home
            for other in range(h):
                if other != a:
                    rival = min(rival, price[other, b])
            for other in range(m):
                if other != b:
                    rival = min(rival, price[a, other])
            if rival < price[a, b] + 12.0:
                continue
        i = hidden[a]
        index[i] = at[k]
        born[k] = np.inf
        back[i] = True
    return back


@njit(cache=True)
def spaced(block, place, xy, seen):
    """Whether `place` keeps a possible distance from the seen 4-neighbours of `block`."""
    row = block // COLS
    column = block % COLS
    for k in range(4):
        r = row + (1 if k == 0 else (-1 if k == 1 else 0))
        c = column + (1 if k == 2 else (-1 if k == 3 else 0))
        if 0 <= r < ROWS and 0 <= c < COLS and seen[r * COLS + c]:
            j = r * COLS + c
            d = np.hypot(xy[j, 0] - place[0], xy[j, 1] - place[1])
            if d < MIN_SPACING_M or d > MAX_SPACING_M:
                return False
    return True


@njit(cache=True)
def suspect_swaps(xy, seen, angle, step, clock):
    """Advance the patience of each pair of neighbours; return a * 25 + b to exchange, or -1.

    A pair is crosswise when the seen neighbours of both, and their own order, fit better the other
    way round. Pairs of one seen and one hidden block count too: the light may be the other's.
    """
    ca = np.cos(angle)
    sa = np.sin(angle)
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
            if not (seen[a] and seen[b]):
                clock[a, b] = 0.0
                continue
            now = strain(a, xy[a], xy, seen, ca, sa, b) + strain(b, xy[b], xy, seen, ca, sa, a)
            then = strain(a, xy[b], xy, seen, ca, sa, b) + strain(b, xy[a], xy, seen, ca, sa, a)
            dx = (c - column) * PITCH_M
            dy = (r - row) * PITCH_M
            wx = ca * dx - sa * dy
            wy = sa * dx + ca * dy
            gx = xy[b, 0] - xy[a, 0]
            gy = xy[b, 1] - xy[a, 1]
            if now < np.inf and then < np.inf:
                now += (gx - wx) ** 2 + (gy - wy) ** 2
                then += (gx + wx) ** 2 + (gy + wy) ** 2
            if then < 0.7 * now:
                clock[a, b] += step
                if clock[a, b] >= PATIENCE_S:
                    clock[a, b] = 0.0
                    return a * N_BLOCKS + b
            else:
                clock[a, b] = 0.0
    return -1
