# SPDX-License-Identifier: Apache-2.0
"""The 5x5 lattice read from nothing but lights: squares, spacing, a shared angle. Compiled."""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin
from eol_ros.core.geometry import COLS, N_BLOCKS, PITCH_M, ROWS
from eol_ros.core.vision.identity.fitting import MIN_SPACING_M, affine, folds, match, rotate_cell

REACH_CELLS = 0.3  # of the pitch, how near to its place a light beyond a gap must stand
GAP_CELLS = 2  # over so many a patch is continued, and then again from there
CORNER = 4  # blocks that say how a patch goes on
ENOUGH = 12  # blocks that say where the lattice is
# What is missing is hidden by something. A patch has that one of its possible places at which no
# more blocks than this would be missing on bare platform (an LED may be dark), if at all others so
# many would.
BARE, TOO_BARE = 1, 3


@njit(cache=True)
def common_angle(yaw):
    """Return the angle that most squares share, modulo 90 degrees, in (-pi/4, pi/4]."""
    use = np.ones(yaw.size, np.bool_)
    angle = 0.0
    for _ in range(3):
        c = s = 0.0
        for i in range(yaw.size):
            if use[i]:
                c += cos(4 * yaw[i])
                s += sin(4 * yaw[i])
        angle = arctan2(s, c) / 4
        for i in range(yaw.size):
            use[i] = cos(4 * (yaw[i] - angle)) > 0.0  # within 22.5 degrees
    return angle


@njit(cache=True)
def _links(p):
    """Mutual nearest neighbours to the right and upwards, cheapest first: (a, b, dc, dr) rows."""
    n = p.shape[0]
    best = np.full((4, n), -1, np.int64)
    price = np.full((4, n), np.inf)
    for i in range(n):
        for j in range(n):
            if i == j:
                continue
            dx = p[j, 0] - p[i, 0]
            dy = p[j, 1] - p[i, 1]
            for side in range(4):
                along = dx if side == 0 else (dy if side == 1 else (-dx if side == 2 else -dy))
                across = dy if side % 2 == 0 else dx
                if along < MIN_SPACING_M or along > 0.30 or abs(across) > 0.6 * along:
                    continue
                cost = (along - PITCH_M) ** 2 + across**2
                if cost < price[side, i]:
                    price[side, i] = cost
                    best[side, i] = j
    rows = np.empty((2 * n, 4), np.int64)
    costs = np.empty(2 * n)
    count = 0
    for i in range(n):
        for side in range(2):
            j = best[side, i]
            if j >= 0 and best[side + 2, j] == i:
                rows[count, 0] = i
                rows[count, 1] = j
                rows[count, 2] = 1 if side == 0 else 0
                rows[count, 3] = 1 if side == 1 else 0
                costs[count] = price[side, i]
                count += 1
    order = np.argsort(costs[:count])
    return rows[order]


@njit(cache=True)
def _grow(p):
    """Give each point of the largest consistent patch its column and row: (cell (n, 2), member)."""
    n = p.shape[0]
    group = np.arange(n)
    cell = np.zeros((n, 2), np.int64)
    rows = _links(p)
    for k in range(rows.shape[0]):
        a = rows[k, 0]
        b = rows[k, 1]
        ga = group[a]
        gb = group[b]
        if ga == gb:
            continue
        shift_c = cell[a, 0] + rows[k, 2] - cell[b, 0]
        shift_r = cell[a, 1] + rows[k, 3] - cell[b, 1]
        free = True
        for i in range(n):  # two points cannot share a cell
            if group[i] != gb:
                continue
            for j in range(n):
                if (
                    group[j] == ga
                    and cell[j, 0] == cell[i, 0] + shift_c
                    and cell[j, 1] == cell[i, 1] + shift_r
                ):
                    free = False
        if not free:
            continue
        for i in range(n):
            if group[i] == gb:
                cell[i, 0] += shift_c
                cell[i, 1] += shift_r
                group[i] = ga
    size = np.zeros(n, np.int64)
    for i in range(n):
        size[group[i]] += 1
    return cell, group == np.argmax(size)


@njit(cache=True)
def _reach(p, cell, member):
    """Take into the patch what lies on its lattice beyond a gap, as under an arm across the table.

    Sets cell (n, 2) and member (n,) of points that the patch, continued, has a free place for.
    """
    grown = True
    while grown and member.sum() >= CORNER:
        grown = False
        fit = affine(cell, p, member)
        det = fit[1, 0] * fit[2, 1] - fit[1, 1] * fit[2, 0]
        if abs(det) < 0.3 * PITCH_M * PITCH_M:
            return
        near = member.copy()
        for i in range(p.shape[0]):
            if member[i]:
                continue
            dx = p[i, 0] - fit[0, 0]
            dy = p[i, 1] - fit[0, 1]
            column = (dx * fit[2, 1] - dy * fit[2, 0]) / det
            row = (dy * fit[1, 0] - dx * fit[1, 1]) / det
            c = int(np.rint(column))
            r = int(np.rint(row))
            free = abs(column - c) < REACH_CELLS and abs(row - r) < REACH_CELLS
            beside = False
            for j in range(p.shape[0]):
                if near[j]:
                    beside |= max(abs(cell[j, 0] - c), abs(cell[j, 1] - r)) <= GAP_CELLS
                if member[j] and cell[j, 0] == c and cell[j, 1] == r:
                    free = False
            if free and beside:
                cell[i, 0] = c
                cell[i, 1] = r
                member[i] = grown = True


@njit(cache=True)
def read_lattice(xy, yaw, expected, trust_expected):
    """Find the 5x5 lattice among points, from nothing but squares and spacing.

    xy (n, 2), yaw (n,) modulo 90 degrees; expected (25, 2): where the blocks were believed to be,
    used only (`trust_expected`) to choose between placements that a hidden border row leaves open.
    Returns (index (25,) of the point on each cell or -1, angle in (-pi/4, pi/4], sure).
    """
    index = np.full(N_BLOCKS, -1, np.int64)
    n = xy.shape[0]
    if n < 9:
        return index, 0.0, False
    angle = common_angle(yaw)
    c = cos(angle)
    s = sin(angle)
    p = np.empty((n, 2))
    for i in range(n):
        p[i, 0] = c * xy[i, 0] + s * xy[i, 1]
        p[i, 1] = -s * xy[i, 0] + c * xy[i, 1]
    cell, member = _grow(p)
    _reach(p, cell, member)
    if member.sum() < 6:
        return index, angle, False
    low_c = 10**6
    low_r = 10**6
    high_c = -(10**6)
    high_r = -(10**6)
    for i in range(n):
        if member[i]:
            low_c = min(low_c, cell[i, 0])
            high_c = max(high_c, cell[i, 0])
            low_r = min(low_r, cell[i, 1])
            high_r = max(high_r, cell[i, 1])
    # Place the 5x5 window over the patch: the one that holds most; the believed places break ties.
    best = -1
    best_off = np.inf
    ties = 0
    at_c = low_c
    at_r = low_r
    first_c = min(low_c, high_c - COLS + 1)
    first_r = min(low_r, high_r - ROWS + 1)
    for oc in range(first_c, max(low_c, high_c - COLS + 1) + 1):
        for orow in range(first_r, max(low_r, high_r - ROWS + 1) + 1):
            inside = 0
            for i in range(n):
                cc = cell[i, 0] - oc
                rr = cell[i, 1] - orow
                if member[i] and 0 <= cc < COLS and 0 <= rr < ROWS:
                    inside += 1
            off = 0.0
            if trust_expected:
                off = _window_offset(cell, member, xy, expected, oc, orow)
            if inside > best:
                best = inside
                best_off = off
                ties = 1
                at_c = oc
                at_r = orow
            elif inside == best:
                ties += 1
                if off < best_off:
                    best_off = off
                    at_c = oc
                    at_r = orow
    use = np.zeros(n, np.bool_)
    for i in range(n):
        cell[i, 0] -= at_c
        cell[i, 1] -= at_r
        use[i] = member[i] and 0 <= cell[i, 0] < COLS and 0 <= cell[i, 1] < ROWS
    # Let the whole lattice follow, and take in what the patch had not reached.
    fit = affine(cell, p, use)
    guess = np.empty((N_BLOCKS, 2))
    gate = np.full(N_BLOCKS, 0.07)
    for i in range(N_BLOCKS):
        row = i // COLS
        column = i % COLS
        for a in range(2):
            guess[i, a] = fit[0, a] + fit[1, a] * column + fit[2, a] * row
    for i in range(n):
        if use[i]:
            b = cell[i, 1] * COLS + cell[i, 0]
            guess[b] = p[i]
    index = match(guess, gate, p)
    return index, angle, (ties == 1 or trust_expected) and _in_order(xy, index)


@njit(cache=True)
def _in_order(xy, index):
    """Return whether a reading holds enough blocks, none of which has passed another."""
    held = index >= 0
    seen = np.zeros((N_BLOCKS, 2))
    for b in range(N_BLOCKS):
        if held[b]:
            seen[b] = xy[index[b]]
    return held.sum() >= ENOUGH and folds(seen, held) == 0


@njit(cache=True)
def _around(index):
    """Return first column and row of the cells that blocks about a patch may be on, and how many.

    index: see continued; columns and rows as it counts them.
    """
    low_c, low_r, high_c, high_r = COLS, ROWS, -1, -1
    for b in range(N_BLOCKS):
        if index[b] >= 0:
            low_c, high_c = min(low_c, b % COLS), max(high_c, b % COLS)
            low_r, high_r = min(low_r, b // COLS), max(high_r, b // COLS)
    if high_c <= low_c or high_r <= low_r:
        return 0, 0, 0, 0
    wide, tall = low_c + 2 * COLS - 1 - high_c, low_r + 2 * ROWS - 1 - high_r
    return high_c - COLS + 1, high_r - ROWS + 1, wide, tall


@njit(cache=True)
def continued(xy, index):
    """Return where blocks (k, 2) may stand about a patch that was read, wherever its place may be.

    xy (n, 2); index (25,): of the point on each cell or -1, as read_lattice returns it. All cells
    of all 5x5 windows that hold the patch; none where it is no more than a line.
    """
    held = index >= 0
    at = np.empty((N_BLOCKS, 2))
    to = np.zeros((N_BLOCKS, 2))
    for b in range(N_BLOCKS):
        at[b, 0], at[b, 1] = b % COLS, b // COLS
        if held[b]:
            to[b] = xy[index[b]]
    fit = affine(at, to, held)
    first_c, first_r, wide, tall = _around(index)
    places = np.empty((wide * tall, 2))
    for k in range(wide * tall):
        c, r = first_c + k % wide, first_r + k // wide
        places[k] = fit[0] + c * fit[1] + r * fit[2]
        if 0 <= c < COLS and 0 <= r < ROWS and held[r * COLS + c]:
            places[k] = to[r * COLS + c]
    return places


@njit(cache=True)
def placed(xy, index, bare):
    """Return a reading where its missing blocks can be hidden, and whether that is one place only.

    xy, index: see continued; bare (k,): at which of its places nothing hides a block. Returns
    (index (25,), sure) as read_lattice does.
    """
    first_c, first_r, wide, tall = _around(index)
    moved = np.full(N_BLOCKS, -1, np.int64)
    possible = 0
    for up in range(tall - ROWS + 1):
        for right in range(wide - COLS + 1):
            missing = 0
            for b in range(N_BLOCKS):
                missing += bare[(up + b // COLS) * wide + right + b % COLS]
            possible += missing < TOO_BARE
            if missing <= BARE:
                by = (first_r + up) * COLS + first_c + right
                for b in range(N_BLOCKS):
                    if index[b] >= 0:
                        moved[b - by] = index[b]
    return moved, possible == 1 and _in_order(xy, moved)


@njit(cache=True)
def _window_offset(cell, member, xy, expected, oc, orow):
    """How far a placement lies from the believed places, at the best of the four turns."""
    best = np.inf
    for quarter in range(4):
        total = 0.0
        count = 0
        for i in range(xy.shape[0]):
            cc = cell[i, 0] - oc
            rr = cell[i, 1] - orow
            if member[i] and 0 <= cc < COLS and 0 <= rr < ROWS:
                b = rotate_cell(rr * COLS + cc, quarter)
                total += (xy[i, 0] - expected[b, 0]) ** 2 + (xy[i, 1] - expected[b, 1]) ** 2
                count += 1
        if count > 0:
            best = min(best, total / count)
    return best
