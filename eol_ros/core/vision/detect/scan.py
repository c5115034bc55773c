# SPDX-License-Identifier: Apache-2.0
"""Light in the whole image, from every fourth pixel of every fourth row.

A block covers about 130 of these samples, so none can be missed, and the sixteenth part of an image
is read in a fraction of the time that the whole takes.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit

STEP = 4  # px between samples
TILE = 16  # samples along the side of a tile of background
SEEK_PX = 24.0  # the rim may have led a block that far while an arm hid it
COARSE, BEST = 2, 3  # samples between places that are tried first, and how many are looked at again


def read_only(image: np.ndarray) -> np.ndarray:
    """Return `image` as the one type that loops are compiled for: contiguous, not to be written.

    For another type they would be compiled again, while an image waits, and their fast arithmetic
    might then round differently in the last bit.
    """
    image = np.ascontiguousarray(image).view()
    image.flags.writeable = False
    return image


@njit(cache=True)
def sample(image, grid):
    """Copy every STEP-th pixel of `image` (h, w) into `grid` (h // 4, w // 4)."""
    for r in range(grid.shape[0]):
        for c in range(grid.shape[1]):
            grid[r, c] = image[r * STEP + 1, c * STEP + 1]


@njit(cache=True)
def backgrounds(grid, tiles, begin, stride):
    """Set every `stride`-th tile from `begin` to the 30 % quantile of its samples."""
    counts = np.zeros(256, np.int64)
    wide = tiles.shape[1]
    for tile in range(begin, tiles.shape[0] * wide, stride):
        r0, c0 = tile // wide * TILE, tile % wide * TILE
        r1, c1 = min(r0 + TILE, grid.shape[0]), min(c0 + TILE, grid.shape[1])
        counts[:] = 0
        for r in range(r0, r1):
            for c in range(c0, c1):
                counts[grid[r, c]] += 1
        need = (r1 - r0) * (c1 - c0) * 3 // 10
        level = 0
        while level < 255 and need >= counts[level]:
            need -= counts[level]
            level += 1
        tiles[tile // wide, tile % wide] = level


@njit(cache=True)
def bright_level(grid, share):
    """Return the grey level that `share` of all samples exceeds."""
    counts = np.zeros(256, np.int64)
    for r in range(grid.shape[0]):
        for c in range(grid.shape[1]):
            counts[grid[r, c]] += 1
    need = share * grid.size
    level = 255
    while level > 0 and need > counts[level]:
        need -= counts[level]
        level -= 1
    return level


@njit(inline='always')
def _span(at, slope, half, low, high):
    """Narrow `low`, `high` to where |at + slope x| <= half."""
    if abs(slope) < 1e-9:
        return (low, high) if abs(at) <= half else (1.0, 0.0)
    a, b = (-half - at) / slope, (half - at) / slope
    return max(low, min(a, b)), min(high, max(a, b))


@njit(inline='always')
def _columns(y, c, sn, half, reach, u, cols):
    """Return the samples (begin, end) of a row `y` below the centre that lie in a square."""
    low, high = _span(-y * sn, c, half, -reach, reach)
    low, high = _span(-y * c, -sn, half, low, high)
    if low > high:
        return 0, 0
    return max(int(math.ceil(u + low)), 0), min(int(math.floor(u + high)) + 1, cols)


@njit(cache=True)
def erase(grid, tiles, squares, begin, end, margin):
    """Put background in place of squares (n, >= 4), u, v, theta, half, grown by a margin.

    Those from `begin` to `end` only.
    """
    rows, cols = grid.shape
    for s in range(begin, end):
        u, v = (squares[s, 0] - 1) / STEP, (squares[s, 1] - 1) / STEP
        half = (squares[s, 3] + margin) / STEP
        c, sn = math.cos(squares[s, 2]), math.sin(squares[s, 2])
        reach = half * (abs(c) + abs(sn))
        for r in range(max(int(v - reach), 0), min(int(v + reach) + 2, rows)):
            first, last = _columns(r - v, c, sn, half, reach, u, cols)
            for q in range(first, last):
                grid[r, q] = min(grid[r, q], tiles[r // TILE, q // TILE])


@njit(cache=True)
def lit(grid, tiles, u, v, theta, half, over, least):
    """Return whether more than a share `least` of a square's samples exceeds the background.

    By `over` grey levels. Most squares show it in a few rows.
    """
    rows, cols = grid.shape
    u, v, half = (u - 1) / STEP, (v - 1) / STEP, half / STEP
    c, sn = math.cos(theta), math.sin(theta)
    reach = half * (abs(c) + abs(sn))
    enough = least * (2.0 * reach + 2.0) ** 2  # as many samples as it can have at most
    found = all_of_it = 0
    for r in range(max(int(v - reach), 0), min(int(v + reach) + 2, rows)):
        first, last = _columns(r - v, c, sn, half, reach, u, cols)
        for q in range(first, last):
            all_of_it += 1
            found += 1 if grid[r, q] > tiles[r // TILE, q // TILE] + over else 0
        if found > enough:
            return True
    return found > least * max(all_of_it, 1)


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _fit_of(lit, n, room, x0, y0, size, areas):
    """Return how well a square at x0, y0 fits lit samples (see seek), and how much fuller it is.

    areas: of its inside, of the strip along its sides, and of the rim around it, in samples.
    """
    inside, within, rim = areas
    zero, one = np.float32(0.0), np.float32(1.0)
    core = np.float32(size - 1.6)
    well, low, high = np.float32(size - 0.3), np.float32(size + 0.4), np.float32(size + 1.7)
    f_x, f_y = np.float32(x0), np.float32(y0)
    across = lit[room:]  # indices that are plainly not negative: else each would be tested
    full = below = near = deep = zero
    for i in range(n):
        x, y = abs(lit[i] - f_x), abs(across[i] - f_y)
        away = x if x > y else y
        deep += one if away < core else zero
        full += one if away < well else zero
        below += one if away < high else zero
        near += one if away <= low else zero
    gain = full / inside - (below - near) / rim
    if full <= 0.3 * inside or gain <= 0.0:
        return 0.0, 0.0
    return gain + (full - deep) / within, gain


@njit(cache=True, fastmath=True, error_model='numpy')
def seek(grid, tiles, u, v, theta, half, over, lit):
    """Look around u, v for where a square of light would fit best.

    half px of its side, over grey levels above the background that count as light, lit (2 m,)
    float32 scratch. Returns (du, dv) px in whole samples up to SEEK_PX, and how much fuller of
    light the square is than a rim around it, 0 where it holds little at all.
    """
    rows, cols = grid.shape
    most = int(SEEK_PX / STEP)
    c, sn = math.cos(theta), math.sin(theta)
    size = half / STEP
    reach = int((size + 2.0) * (abs(c) + abs(sn))) + 1
    u0, v0 = (u - 1) / STEP, (v - 1) / STEP
    far = reach + most
    n, room = 0, len(lit) // 2
    for r in range(max(int(v0) - far, 0), min(int(v0) + far + 1, rows)):
        for q in range(max(int(u0) - far, 0), min(int(u0) + far + 1, cols)):
            if grid[r, q] > tiles[r // TILE, q // TILE] + over and n < room:
                lit[n], lit[room + n] = (q - u0) * c - (r - v0) * sn, (q - u0) * sn + (r - v0) * c
                n += 1
    inside, rim = 4.0 * (size - 0.3) ** 2, 4.0 * ((size + 1.7) ** 2 - (size + 0.4) ** 2)
    within = inside - 4.0 * (size - 1.6) ** 2
    if n <= 0.3 * inside:
        return 0.0, 0.0, 0.0
    areas = inside, within, rim
    # on a coarse grid first: where a square of light stands, places beside it hold most of it
    best = np.zeros((BEST, 3))
    for dv in range(-most, most + 1, COARSE):
        for du in range(-most, most + 1, COARSE):
            edge, _ = _fit_of(lit, n, room, du * c - dv * sn, du * sn + dv * c, size, areas)
            if edge > best[BEST - 1, 0]:
                k = BEST - 1
                while k > 0 and edge > best[k - 1, 0]:
                    best[k] = best[k - 1]
                    k -= 1
                best[k, 0], best[k, 1], best[k, 2] = edge, du, dv
    best_u = best_v = most_edge = fuller = 0.0
    for k in range(BEST):
        if best[k, 0] == 0.0:
            break
        for i in range(9):
            du, dv = best[k, 1] + i % 3 - 1, best[k, 2] + i // 3 - 1
            edge, gain = _fit_of(lit, n, room, du * c - dv * sn, du * sn + dv * c, size, areas)
            if edge > most_edge:
                best_u, best_v, most_edge, fuller = du * STEP, dv * STEP, edge, gain
    return best_u, best_v, fuller


@njit(cache=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def regions(grid, tiles, over, least, most, label, parent, stats, found):
    """Join neighbouring samples that exceed their background by `over`, and describe them.

    label (rows, cols) int16, parent (m,) int32 and stats (m, 7) float64 are scratch. Regions of
    `least` to `most` samples go to found (k, 6): u, v px, angle of a square of that shape, samples,
    height and width in px. Returns their number.
    """
    rows, cols = grid.shape
    n = 0
    limit = len(parent)
    levels = np.zeros(cols, np.uint8)
    bright = np.zeros((cols + 7) // 8 * 8, np.uint8)
    eights = bright.view(np.uint64)  # of samples: nearly all of them are dark
    for r in range(rows):
        if r % TILE == 0:
            for c in range(cols):
                levels[c] = min(tiles[r // TILE, c // TILE] + over, 255.0)
        samples, labels = grid[r], label[r]
        for c in range(cols):
            bright[c] = 1 if samples[c] > levels[c] else 0
            labels[c] = -1
        c = 0
        while c < cols:
            if bright[c] == 0:
                c += 8 if c % 8 == 0 and eights[c // 8] == 0 else 1
                continue
            begin, i, before = c, -1, -1
            while c < cols and bright[c] == 1:
                above = label[r - 1, c] if r > 0 else -1
                if above >= 0 and above != before:
                    a = _root(parent, above)
                    b = a if i < 0 else i
                    i = min(a, b)
                    parent[max(a, b)] = i
                    before = above
                c += 1
            if i < 0:
                if n == limit:
                    continue
                i = n
                n += 1
                parent[i] = i
                for k in range(3):
                    stats[i, k] = 0.0
                stats[i, 3], stats[i, 5], stats[i, 6] = r, begin, begin
            for q in range(begin, c):
                labels[q] = i
            stats[i, 0] += c - begin
            stats[i, 1] += (c - begin) * (begin + c - 1) / 2
            stats[i, 2] += (c - begin) * r
            stats[i, 4] = r
            stats[i, 5], stats[i, 6] = min(stats[i, 5], begin), max(stats[i, 6], c - 1)
    for i in range(n - 1, -1, -1):  # a parent always comes before its children
        j = parent[i]
        if j != i:
            for k in range(3):
                stats[j, k] += stats[i, k]
            stats[j, 3], stats[j, 4] = min(stats[j, 3], stats[i, 3]), max(stats[j, 4], stats[i, 4])
            stats[j, 5], stats[j, 6] = min(stats[j, 5], stats[i, 5]), max(stats[j, 6], stats[i, 6])
    k = 0
    for i in range(n):
        if parent[i] != i or not least <= stats[i, 0] <= most or k == len(found):
            continue
        column, row = stats[i, 1] / stats[i, 0], stats[i, 2] / stats[i, 0]
        re = im = 0.0  # the fourfold moment tells the angle of a square
        for r in range(int(stats[i, 3]), int(stats[i, 4]) + 1):
            for c in range(int(stats[i, 5]), int(stats[i, 6]) + 1):
                if label[r, c] >= 0 and _root(parent, label[r, c]) == i:
                    x, y = c - column, row - r
                    re += x * x * x * x - 6 * x * x * y * y + y * y * y * y
                    im += 4 * x * y * (x * x - y * y)
        found[k, 0], found[k, 1] = column * STEP + 1, row * STEP + 1
        # corners of a square lie at 45 degrees, where cos 4 phi is least
        found[k, 2] = math.atan2(-im, -re) / 4
        found[k, 3] = stats[i, 0]
        found[k, 4] = (stats[i, 4] - stats[i, 3] + 1) * STEP
        found[k, 5] = (stats[i, 6] - stats[i, 5] + 1) * STEP
        k += 1
    return k
