# SPDX-License-Identifier: Apache-2.0
"""Light in the whole image, from every fourth pixel of every fourth row.

A block covers about 130 of these samples, so none can be missed, and the sixteenth part of an image
is read in a fraction of the time that the whole takes.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import arctan2, cos, sin

STEP = 4  # px between samples
TILE = 16  # samples along the side of a tile of background
SEEK_PX = 40.0  # the rim may have led a block that far while an arm hid it
# A square that is sought shows its sides where light falls at them. So many points of each side are
# read, on so much of it, so far inside and outside.
POINTS, ALONG, ACROSS_PX = 6, 0.85, 4.0
# Outside it is dark: more than the background by less than so much of what light falls by.
DARK, TILE_PX = 0.7, STEP * TILE
LEAST_OF_SIDE = 0.3  # so much shows of the better one of either two opposite sides
APART_PX = 12.0  # two places
# A side that shows within a square: light falls from so far inside of it to so far outside, and
# from there to beyond the square by more than so much of that.
WITHIN_PX, FADES = 2.0, 0.05


def read_only(image: np.ndarray) -> np.ndarray:
    """Return `image` as the one type that loops are compiled for: contiguous, not to be written.

    For another type they would be compiled again, while an image waits, and their fast arithmetic
    might then round differently in the last bit.
    """
    if image.flags.c_contiguous and not image.flags.writeable:
        return image
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
def span(at, slope, half, low, high):
    """Narrow `low`, `high` to where |at + slope x| <= half."""
    if abs(slope) < 1e-9:
        return (low, high) if abs(at) <= half else (1.0, 0.0)
    a, b = (-half - at) / slope, (half - at) / slope
    return max(low, min(a, b)), min(high, max(a, b))


@njit(inline='always')
def _columns(y, c, sn, half, reach, u, cols):
    """Return the samples (begin, end) of a row `y` below the centre that lie in a square."""
    low, high = span(-y * sn, c, half, -reach, reach)
    low, high = span(-y * c, -sn, half, low, high)
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
        c, sn = cos(squares[s, 2]), sin(squares[s, 2])
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
    c, sn = cos(theta), sin(theta)
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


@njit(cache=True, inner=True, error_model='numpy')
def _sides_shown(flat, width, tiles, u, v, outline, over, hits):
    """Return which share of the sides of a square at u, v shows; see seek.

    outline (4 POINTS, 2): by how much further in `flat` (h w,) points inside and outside lie. hits
    (4,) receives how many of each side show. 0 where an arm may show as much: it has one edge, or
    two alike.
    """
    place = v * width + u
    bare_most = tiles[v // TILE_PX, u // TILE_PX] + np.int64(DARK * over)
    for side in (0, 2, 1, 3):
        hits[side] = 0
        for i in range(side * POINTS, (side + 1) * POINTS):
            bare = np.int64(flat[place + outline[i, 1]])
            falls = np.int64(flat[place + outline[i, 0]]) - bare
            hits[side] += (falls > over) & (bare <= bare_most)
        if side == 2 and max(hits[0], hits[2]) < LEAST_OF_SIDE * POINTS:
            return 0.0
    if max(hits[1], hits[3]) < LEAST_OF_SIDE * POINTS:
        return 0.0
    return (hits[0] + hits[1] + hits[2] + hits[3]) / (4.0 * POINTS)


@njit(cache=True, error_model='numpy')
def seek(image, tiles, u, v, theta, half, over, taken, n, found):
    """Look up to SEEK_PX around u, v for where a square of light would show most of its sides.

    half px of its side; over grey levels by which light falls there. taken (m, >= 2): u, v of the
    first `n` squares that are there, on whose ground none can stand. found (k, 3) receives up to k
    places, the best first: u, v, and the share of its sides that shows, 0 where there is none.
    """
    height, width = image.shape
    c, sn = cos(theta), sin(theta)
    outline = np.empty((4 * POINTS, 2), np.int64)
    reach = 0
    for side in range(4):
        nu, nv = c, -sn
        for i in range(POINTS):
            t = (2.0 * i / (POINTS - 1) - 1.0) * ALONG * half
            for k in range(2):
                d = half + (ACROSS_PX if k else -ACROSS_PX)
                du, dv = round(nu * d + nv * t), round(nv * d - nu * t)
                outline[side * POINTS + i, k] = dv * width + du
                reach = max(reach, abs(du), abs(dv))
        c, sn = -sn, c
    flat, hits = image.reshape(height * width), np.empty(4, np.int64)
    found[:] = 0.0
    most = int(SEEK_PX / STEP)
    ground, near, m = 1.4 * half, np.empty((n, 2)), 0
    for i in range(n):
        if max(abs(taken[i, 0] - u), abs(taken[i, 1] - v)) < SEEK_PX + ground:
            near[m, 0], near[m, 1] = taken[i, 0], taken[i, 1]
            m += 1
    for row in range(-most, most + 1):
        y = round(v) + row * STEP
        for column in range(-most, most + 1):
            x = round(u) + column * STEP
            free = reach < x < width - reach - 1 and reach < y < height - reach - 1
            for i in range(m):
                free &= (near[i, 0] - x) ** 2 + (near[i, 1] - y) ** 2 > ground * ground
            if not free:
                continue
            share = _sides_shown(flat, width, tiles, x, y, outline, over, hits)
            k = len(found) - 1  # in place of one beside it, or of the last
            for i in range(len(found)):
                if abs(found[i, 0] - x) + abs(found[i, 1] - y) <= APART_PX:
                    k = i
                    break
            if share <= found[k, 2]:
                continue
            while k > 0 and share > found[k - 1, 2]:
                found[k] = found[k - 1]
                k -= 1
            found[k, 0], found[k, 1], found[k, 2] = x, y, share
    for k in range(len(found)):  # in the middle of the places that show most
        if found[k, 2] == 0.0:
            continue
        x0, y0, x_sum, y_sum, count = int(found[k, 0]), int(found[k, 1]), 0, 0, 0
        for i in range(25):
            x, y = x0 + (i % 5 - 2) * STEP // 2, y0 + (i // 5 - 2) * STEP // 2
            if not (reach <= x < width - reach and reach <= y < height - reach):
                continue
            share = _sides_shown(flat, width, tiles, x, y, outline, over, hits)
            if share > found[k, 2]:
                found[k, 2], x_sum, y_sum, count = share, 0, 0, 0
            if share == found[k, 2]:
                x_sum, y_sum, count = x_sum + x, y_sum + y, count + 1
        found[k, 0], found[k, 1] = x_sum / count, y_sum / count


@njit(cache=True, error_model='numpy')
def side_within(image, u, v, theta, half, over):
    """Return whether a side of the block shows within a square, and none at the square's own.

    Then an edge of an arm was taken for the side across. An arm that hides the square's own side
    has an edge within the square, too, but beyond it the arm is as bright all along; the light
    beside a cover fades. For the arguments see seek.
    """
    height, width = image.shape
    c, sn = cos(theta), sin(theta)
    reach = (half + ACROSS_PX) * (abs(c) + abs(sn)) + 1.0
    if not (reach < u < width - reach - 1 and reach < v < height - reach - 1):
        return False
    points, most, fading = 2 * POINTS, 0, 0.0
    for _ in range(4):
        own = 0
        for into in range(int(half)):
            shows, fades = 0, np.int64(0)
            for i in range(points):
                t = (2.0 * i / (points - 1) - 1.0) * ALONG * half
                x, y, d = u + sn * t, v + c * t, half - into
                inside, outside = d - WITHIN_PX, d + WITHIN_PX
                light = np.int64(image[round(y - sn * inside), round(x + c * inside)])
                light -= np.int64(image[round(y - sn * outside), round(x + c * outside)])
                if light > over:
                    near, far = d + ACROSS_PX, half + ACROSS_PX
                    shows += 1
                    fades += np.int64(image[round(y - sn * near), round(x + c * near)])
                    fades -= np.int64(image[round(y - sn * far), round(x + c * far)])
            if into <= WITHIN_PX:
                own = max(own, shows)
            elif shows - own > most and shows > LEAST_OF_SIDE * points:
                most, fading = shows - own, fades / shows
        c, sn = -sn, c
    return fading > FADES * over


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
        found[k, 2] = arctan2(-im, -re) / 4
        found[k, 3] = stats[i, 0]
        found[k, 4] = (stats[i, 4] - stats[i, 3] + 1) * STEP
        found[k, 5] = (stats[i, 6] - stats[i, 5] + 1) * STEP
        k += 1
    return k
