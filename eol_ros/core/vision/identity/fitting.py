# SPDX-License-Identifier: Apache-2.0
"""Small exact solvers for 25 blocks: assignment, lattice angle and shape, order and strain.

Compiled, because they run on every image. All positions in metres, all angles in radians.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2
from eol_ros.core.geometry import COLS, PITCH_M, ROWS

MIN_SPACING_M = 0.075  # two 84 mm squares cannot be nearer, but for a measuring error


@njit(cache=True)
def assign(cost):
    """Return for each row of `cost` (n, m), n <= m, its column in the cheapest assignment.

    Shortest augmenting paths with dual variables (Jonker and Volgenant, Computing 38, 1987).
    """
    n, m = cost.shape
    u = np.zeros(n + 1)
    v = np.zeros(m + 1)
    row_of = np.zeros(m + 1, np.int64)
    way = np.zeros(m + 1, np.int64)
    least = np.empty(m + 1)
    used = np.empty(m + 1, np.bool_)
    for i in range(1, n + 1):
        row_of[0] = i
        j0 = 0
        least[:] = np.inf
        used[:] = False
        while True:
            used[j0] = True
            i0 = row_of[j0]
            delta = np.inf
            j1 = 0
            for j in range(1, m + 1):
                if not used[j]:
                    reduced = cost[i0 - 1, j - 1] - u[i0] - v[j]
                    if reduced < least[j]:
                        least[j] = reduced
                        way[j] = j0
                    if least[j] < delta:
                        delta = least[j]
                        j1 = j
            for j in range(m + 1):
                if used[j]:
                    u[row_of[j]] += delta
                    v[j] -= delta
                else:
                    least[j] -= delta
            j0 = j1
            if row_of[j0] == 0:
                break
        while j0 != 0:
            j1 = way[j0]
            row_of[j0] = row_of[j1]
            j0 = j1
    column = np.empty(n, np.int64)
    for j in range(1, m + 1):
        if row_of[j] > 0:
            column[row_of[j] - 1] = j - 1
    return column


@njit(cache=True)
def match(expected, gate, xy):
    """Pair expected places (k, 2) with points (n, 2) within `gate` (k,); -1 where there is none."""
    k = expected.shape[0]
    n = xy.shape[0]
    found = np.full(k, -1, np.int64)
    if k == 0 or n == 0:
        return found
    cost = np.empty((k, n + k))
    for i in range(k):
        limit = gate[i] * gate[i]
        for j in range(n):
            dx = expected[i, 0] - xy[j, 0]
            dy = expected[i, 1] - xy[j, 1]
            square = dx * dx + dy * dy
            cost[i, j] = square if square < limit else 1e3
        for j in range(n, n + k):
            cost[i, j] = limit
    column = assign(cost)
    for i in range(k):
        if column[i] < n and cost[i, column[i]] < 1e3:
            found[i] = column[i]
    return found


@njit(cache=True)
def affine(at, to, use):
    """Least squares to = [1, at] @ fit over the rows in `use` (n,); at, to (n, 2); fit (3, 2)."""
    n = sx = sy = 0.0
    for i in range(to.shape[0]):
        if use[i]:
            n += 1.0
            sx += at[i, 0]
            sy += at[i, 1]
    fit = np.zeros((3, 2))
    if n == 0.0:
        return fit
    sx /= n
    sy /= n
    xx = yy = 1e-9
    xy = 0.0
    for i in range(to.shape[0]):
        if use[i]:
            dx = at[i, 0] - sx
            dy = at[i, 1] - sy
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
            for a in range(2):
                fit[0, a] += to[i, a]
                fit[1, a] += to[i, a] * dx
                fit[2, a] += to[i, a] * dy
    det = xx * yy - xy * xy
    for a in range(2):
        px = fit[1, a]
        py = fit[2, a]
        fit[1, a] = (px * yy - py * xy) / det
        fit[2, a] = (py * xx - px * xy) / det
        fit[0, a] = fit[0, a] / n - fit[1, a] * sx - fit[2, a] * sy
    return fit


@njit(cache=True)
def turn(rest, xy, use):
    """Return the angle that best turns `rest` into `xy` over the blocks in `use` (Procrustes)."""
    rx = ry = px = py = 0.0
    n = 0
    for i in range(xy.shape[0]):
        if use[i]:
            rx += rest[i, 0]
            ry += rest[i, 1]
            px += xy[i, 0]
            py += xy[i, 1]
            n += 1
    if n < 2:
        return np.nan
    dot = cross = 0.0
    for i in range(xy.shape[0]):
        if use[i]:
            ax = rest[i, 0] - rx / n
            ay = rest[i, 1] - ry / n
            bx = xy[i, 0] - px / n
            by = xy[i, 1] - py / n
            dot += ax * bx + ay * by
            cross += ax * by - ay * bx
    return arctan2(cross, dot)


@njit(cache=True)
def rotate_cell(block, quarters):
    """Return the id that `block` becomes when the lattice is read turned by `quarters` x 90
    degrees.

    Axes turned by +90 degrees see the point (x, y) at (y, -x): column becomes row, row becomes
    4 - column.
    """
    row = block // COLS
    column = block % COLS
    for _ in range(quarters % 4):
        row, column = COLS - 1 - column, row
    return row * COLS + column


@njit(cache=True)
def folds(xy, held):
    """Count lattice triangles that are turned inside out: blocks cannot pass one another."""
    count = 0
    for row in range(ROWS - 1):
        for column in range(COLS - 1):
            a = row * COLS + column
            b = a + 1
            c = a + COLS
            d = c + 1
            for k in range(4):
                if k == 0:
                    i, j, m = a, b, c
                elif k == 1:
                    i, j, m = b, d, a
                elif k == 2:
                    i, j, m = d, c, b
                else:
                    i, j, m = c, a, d
                if held[i] and held[j] and held[m]:
                    area = (xy[j, 0] - xy[i, 0]) * (xy[m, 1] - xy[i, 1]) - (xy[j, 1] - xy[i, 1]) * (
                        xy[m, 0] - xy[i, 0]
                    )
                    if area < 0.0:
                        count += 1
    return count


@njit(cache=True)
def strain(block, place, xy, seen, ca, sa, skip):
    """Mean squared departure of `place` from where the seen neighbours of `block` want it, m^2.

    ca, sa: cosine and sine of the lattice angle. skip: one neighbour to leave out, or -1.
    """
    row = block // COLS
    column = block % COLS
    total = 0.0
    count = 0
    for r in range(max(row - 1, 0), min(row + 2, ROWS)):
        for c in range(max(column - 1, 0), min(column + 2, COLS)):
            j = r * COLS + c
            if j in (block, skip) or not seen[j]:
                continue
            dx = (column - c) * PITCH_M
            dy = (row - r) * PITCH_M
            ex = place[0] - xy[j, 0] - (ca * dx - sa * dy)
            ey = place[1] - xy[j, 1] - (sa * dx + ca * dy)
            total += ex * ex + ey * ey
            count += 1
    return total / count if count else np.inf
