# SPDX-License-Identifier: Apache-2.0
"""Light in the whole image, from every fourth pixel of every fourth row.

A block covers about 130 of these samples, so none can be missed, and the sixteenth part of an image
is read in a fraction of the time that the whole takes.
"""

import math

import numpy as np
from numba import njit

STEP = 4  # px between samples
TILE = 16  # samples along the side of a tile of background
SEEK_PX = 12.0
AREA, ROW, COL, HIGH, WIDE = range(5)


def read_only(image: np.ndarray) -> np.ndarray:
    """Return `image` as the one type that loops are compiled for: contiguous, not to be written.

    For another type they would be compiled anew, while an image waits, and their fast arithmetic
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


@njit(cache=True, fastmath=True, error_model='numpy')
def erase(grid, tiles, squares, margin):
    """Put background in place of squares (n, >= 4), u, v, theta, half, grown by a margin."""
    for s in range(squares.shape[0]):
        u, v = (squares[s, 0] - 1) / STEP, (squares[s, 1] - 1) / STEP
        half = (squares[s, 3] + margin) / STEP
        c, sn = math.cos(squares[s, 2]), math.sin(squares[s, 2])
        reach = half * (abs(c) + abs(sn))
        for r in range(max(int(v - reach), 0), min(int(v + reach) + 2, grid.shape[0])):
            for q in range(max(int(u - reach), 0), min(int(u + reach) + 2, grid.shape[1])):
                x = (q - u) * c - (r - v) * sn
                y = -(q - u) * sn - (r - v) * c
                if abs(x) <= half and abs(y) <= half:
                    grid[r, q] = min(grid[r, q], tiles[r // TILE, q // TILE])


@njit(cache=True, fastmath=True, error_model='numpy')
def seek(grid, tiles, starts, half, over, found):
    """Look around `starts` (n, 3), u, v, theta, for where a square of light would fit best.

    half (n,) px of its side, over (n,) grey levels above the background that count as light. Fills
    found (n, 3): du, dv px in whole samples up to SEEK_PX, and how much fuller of light the square
    is than a rim around it, 0 where it holds little at all.
    """
    rows, cols = grid.shape
    most = int(SEEK_PX / STEP)
    for s in range(starts.shape[0]):
        found[s] = 0.0
        c, sn = math.cos(starts[s, 2]), math.sin(starts[s, 2])
        size = half[s] / STEP
        reach = int((size + 2.0) * (abs(c) + abs(sn))) + 1
        u0, v0 = (starts[s, 0] - 1) / STEP, (starts[s, 1] - 1) / STEP
        for dv in range(-most, most + 1):
            for du in range(-most, most + 1):
                u, v = u0 + du, v0 + dv
                inside = lit = rim = glow = 0.0
                for r in range(max(int(v) - reach, 0), min(int(v) + reach + 1, rows)):
                    for q in range(max(int(u) - reach, 0), min(int(u) + reach + 1, cols)):
                        x = abs((q - u) * c - (r - v) * sn)
                        y = abs((q - u) * sn + (r - v) * c)
                        far = max(x, y)
                        bright = grid[r, q] > tiles[r // TILE, q // TILE] + over[s]
                        if far < size - 0.3:
                            inside += 1.0
                            lit += 1.0 if bright else 0.0
                        elif size + 0.4 < far < size + 1.7:
                            rim += 1.0
                            glow += 1.0 if bright else 0.0
                if inside > 0 and lit > 0.3 * inside:
                    gain = lit / inside - glow / max(rim, 1.0)
                    if gain > found[s, 2]:
                        found[s, 0], found[s, 1], found[s, 2] = du * STEP, dv * STEP, gain


@njit(cache=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, fastmath=True, error_model='numpy')
def regions(grid, tiles, over, least, most, label, parent, stats, found):
    """Join neighbouring samples that exceed their background by `over`, and describe them.

    label (rows, cols) int32, parent (m,) int32 and stats (m, 9) float64 are scratch. Regions of
    `least` to `most` samples go to found (k, 6): u, v px, angle of a square of that shape, samples,
    height and width in px. Returns their number.
    """
    rows, cols = grid.shape
    n = 0
    limit = len(parent)
    first, last = rows, -1  # rows with any light
    for r in range(rows):
        bright = 0
        for tile in range(tiles.shape[1]):
            level = tiles[r // TILE, tile] + over
            for c in range(tile * TILE, min(tile * TILE + TILE, cols)):
                bright += 1 if grid[r, c] > level else 0
        if bright == 0:
            label[r, :] = -1
            continue
        first, last = min(first, r), r
        for c in range(cols):
            if grid[r, c] <= tiles[r // TILE, c // TILE] + over:
                label[r, c] = -1
                continue
            left = label[r, c - 1] if c > 0 else -1
            above = label[r - 1, c] if r > 0 else -1
            if left < 0 and above < 0:
                if n >= limit:
                    label[r, c] = -1
                    continue
                parent[n] = n
                label[r, c] = n
                n += 1
            elif left < 0 or above < 0 or left == above:
                label[r, c] = max(left, above)
            else:
                a, b = _root(parent, left), _root(parent, above)
                low, high = min(a, b), max(a, b)
                parent[high] = low
                label[r, c] = low
    for i in range(n):
        for k in range(9):
            stats[i, k] = 0.0
        stats[i, 5], stats[i, 7] = 1e9, 1e9
    for r in range(first, last + 1):
        for c in range(cols):
            if label[r, c] < 0:
                continue
            i = _root(parent, label[r, c])
            label[r, c] = i
            stats[i, 0] += 1.0
            stats[i, 1] += c
            stats[i, 2] += r
            stats[i, 5] = min(stats[i, 5], r)
            stats[i, 6] = max(stats[i, 6], r)
            stats[i, 7] = min(stats[i, 7], c)
            stats[i, 8] = max(stats[i, 8], c)
    for r in range(first, last + 1):  # the fourfold moment tells the angle of a square
        for c in range(cols):
            i = label[r, c]
            if i >= 0 and least <= stats[i, 0] <= most:
                x = c - stats[i, 1] / stats[i, 0]
                y = stats[i, 2] / stats[i, 0] - r
                stats[i, 3] += x * x * x * x - 6 * x * x * y * y + y * y * y * y
                stats[i, 4] += 4 * x * y * (x * x - y * y)
    k = 0
    for i in range(n):
        if parent[i] == i and least <= stats[i, 0] <= most and k < found.shape[0]:
            found[k, 0] = stats[i, 1] / stats[i, 0] * STEP + 1
            found[k, 1] = stats[i, 2] / stats[i, 0] * STEP + 1
            # corners of a square lie at 45 degrees, where cos 4 phi is least
            found[k, 2] = math.atan2(-stats[i, 4], -stats[i, 3]) / 4
            found[k, 3] = stats[i, 0]
            found[k, 4] = (stats[i, 6] - stats[i, 5] + 1) * STEP
            found[k, 5] = (stats[i, 8] - stats[i, 7] + 1) * STEP
            k += 1
    return k
