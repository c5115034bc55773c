# SPDX-License-Identifier: Apache-2.0
"""The pixels of one block, in block coordinates, for loops that take LANES of them at a time.

`px` is (groups, ROWS * LANES): a row of it holds LANES pixels, each number of them side by side.
The pixels near each of the four sides come first, then all others; `starts` (6,) says with which
group each of these five lists begins. Its last group is filled with pixels of area 0. What does not
change while a block rests, its *patch*, is kept from image to image.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision.appearance.model import (
    CELLS,
    EVERY,
    LANES,
    MOST_BENT_PX,
    MOST_PX,
    OUTSIDE_PX,
    PARTS,
    TOGETHER,
)  # fmt: skip
from eol_ros.core.vision.calibration.mapping import to_pixel
from eol_ros.core.vision.outline import NONE, outside

# Numbers of a pixel. Of a patch: block coordinates in px of the block's scale, pixels that it
# stands for, brightness of the face there and its slopes, variance of the brightness, part of a
# side (side * PARTS + part, or -1). Of an image: grey level, trust in it. Of a fit: squared
# residual in variances, edge function, derivatives by pose (3), gain, ground (3) and the slope of a
# side, residual, weight.
(
    A, B, AREA, LIGHT, LIGHT_A, LIGHT_B, SPREAD, PART,
    GREY, TRUST, Q, EDGE, BY_A, BY_B, BY_TURN, BY_GAIN, BY_O, BY_OA, BY_OB, BY_SLOPE, RESIDUAL,
    WEIGHT,
) = range(0, 22 * LANES, LANES)  # fmt: skip
ROWS, KEPT_ROWS = 22, 8
CLUSTERS = 4 * PARTS // TOGETHER  # groups of side pixels with correlated errors
GROUPS = MOST_PX // LANES + CLUSTERS + 1  # each list is padded to whole LANES
_STEP_M = 0.03  # for derivatives of the camera's map: two thirds of half a block

PATCH = np.dtype(
    [
        ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'), ('scale', 'f8'),  # where it was made; px per m
        ('near_px', 'f8'),  # how far from the sides every pixel is in it
        ('map', 'f8', (12,)),  # see taylor
        # columns and rows that the block has moved since, and the same along a, b in px
        ('shift', 'i8', (2,)), ('offset', 'f8', (2,)),
        ('starts', 'i8', (6,)),  # all 0: none is kept
    ]
)  # fmt: skip
"""One block's patch; its numbers are kept beside it."""


@njit(inline='always')
def span(at, slope, half, low, high):
    """Narrow `low`, `high` to where |at + slope x| <= half."""
    if abs(slope) < 1e-9:
        return (low, high) if abs(at) <= half else (1.0, 0.0)
    a, b = (-half - at) / slope, (half - at) / slope
    return max(low, min(a, b)), min(high, max(a, b))


@njit(cache=True)
def empty():
    """Return room for the pixels of one block."""
    return np.empty((GROUPS, ROWS * LANES), np.float32)


def empty_patches(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return room for the patches of n blocks: PATCH, numbers, and places in the image."""
    return (
        np.zeros(n, PATCH),
        np.empty((n, GROUPS, KEPT_ROWS * LANES), np.float32),
        np.empty((n, GROUPS * LANES), np.int32),
    )


@njit(cache=True)
def taylor(c, x, y, yaw, out):
    """Fill out (12,): u, v of a block's middle and derivatives by its a and b in m, to 2nd order.

    u is out[0] + out[1] a + out[2] b + out[3] a^2 + out[4] a b + out[5] b^2; v from out[6] alike.
    """
    h = _STEP_M
    u0, v0 = to_pixel(c, x, y)
    ca, sa = cos(yaw) * h, sin(yaw) * h
    u1, v1 = to_pixel(c, x + ca, y + sa)
    u2, v2 = to_pixel(c, x - ca, y - sa)
    u3, v3 = to_pixel(c, x - sa, y + ca)
    u4, v4 = to_pixel(c, x + sa, y - ca)
    u5, v5 = to_pixel(c, x + ca - sa, y + sa + ca)
    u6, v6 = to_pixel(c, x - ca + sa, y - sa - ca)
    h2 = h * h
    uaa, ubb = (u1 - 2 * u0 + u2) / h2, (u3 - 2 * u0 + u4) / h2
    vaa, vbb = (v1 - 2 * v0 + v2) / h2, (v3 - 2 * v0 + v4) / h2
    out[0], out[1], out[2] = u0, (u1 - u2) / (2 * h), (u3 - u4) / (2 * h)
    out[3], out[4], out[5] = uaa / 2, ((u5 - 2 * u0 + u6) / h2 - uaa - ubb) / 2, ubb / 2
    out[6], out[7], out[8] = v0, (v1 - v2) / (2 * h), (v3 - v4) / (2 * h)
    out[9], out[10], out[11] = vaa / 2, ((v5 - 2 * v0 + v6) / h2 - vaa - vbb) / 2, vbb / 2


@njit(cache=True)
def scale_of(m):
    """Return the scale of a block with derivatives m (12,), px per m."""
    return math.sqrt(abs(m[1] * m[8] - m[2] * m[7]))


@njit(inline='always')
def _row_of(square, slope_a, slope_b, at_a, at_b, u0):
    """Return the columns between which a row lies within a square of half side `square`."""
    low, high = span(at_a, slope_a, square, -1e4, 1e4)
    low, high = span(at_b, slope_b, square, low, high)
    return u0 + low, u0 + high


@njit(cache=True, error_model='numpy')
def _pick(rows, cols, m, half_m, near_px, out_px, a, b, area, at):
    """Pick pixels of a block: u, v from its middle in a and b, and area; return their count.

    All within near_px of its sides; beyond that, as far as out_px, and inside every EVERY-th row
    and column. at: their places in an image of rows x cols.
    """
    det = m[1] * m[8] - m[2] * m[7]
    scale = scale_of(m)
    ia, ib, ja, jb = (
        m[8] / det * scale,
        -m[2] / det * scale,
        -m[7] / det * scale,
        m[1] / det * scale,
    )
    half = half_m * scale
    reach = (abs(m[7]) + abs(m[8])) / scale * (half + out_px) + 1.0
    count = 0
    for v in range(max(int(m[6] - reach), 0), min(int(m[6] + reach) + 1, rows)):
        dv = v - m[6]
        at_a, at_b = ib * dv, jb * dv
        sparse = v % EVERY == 0
        far = half + (out_px if sparse else near_px)
        low, high = _row_of(far, ia, ja, at_a, at_b, m[0])
        near, nearly = _row_of(half + near_px, ia, ja, at_a, at_b, m[0])
        hole, holed = _row_of(half - near_px, ia, ja, at_a, at_b, m[0])
        u, stop = max(int(math.ceil(low)), 0), min(int(math.floor(high)), cols - 1)
        while u <= stop and count < MOST_PX:
            stands_for = 1.0
            inside = hole < u < holed
            if inside and not sparse:
                u = int(holed) + 1
                continue
            if inside or u < near or u > nearly:
                if u % EVERY:
                    after = u + EVERY - u % EVERY
                    if u < near:
                        after = min(after, int(math.ceil(near)))
                    elif inside:
                        after = min(after, int(math.ceil(holed)))
                    u = max(after, u + 1)
                    continue
                stands_for = float(EVERY * EVERY)
            a[count], b[count], area[count] = u - m[0], dv, stands_for
            at[count] = v * cols + u
            count += 1
            u += 1
    return count


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _place(m, count, a, b):
    """Turn u, v in a and b into block coordinates, in px of the block's scale."""
    f, scale = np.float32, scale_of(m)
    det, s2 = m[1] * m[8] - m[2] * m[7], scale * scale
    ia, ib = f(m[8] / det * scale), f(-m[2] / det * scale)
    ja, jb = f(-m[7] / det * scale), f(m[1] / det * scale)
    qa, qb, qc = f(m[3] / s2), f(m[4] / s2), f(m[5] / s2)
    ra, rb, rc = f(m[9] / s2), f(m[10] / s2), f(m[11] / s2)
    for i in range(count):
        du, dv = a[i], b[i]
        p, q = ia * du + ib * dv, ja * du + jb * dv
        du -= p * (qa * p + qb * q) + q * qc * q
        dv -= p * (ra * p + rb * q) + q * rc * q
        a[i], b[i] = ia * du + ib * dv, ja * du + jb * dv


@njit(cache=True, error_model='numpy')
def _flatten(count, half, near_px, table, sense, a, b, area):
    """Move pixels of a cover in relief to where a flat one has them; see outline.tabulate.

    Those whose side has no outline there get no area. sense: -1 for a mirror image, else 1.
    """
    f = np.float32
    for n in range(count):
        side, far, t = side_of(a[n], b[n])
        along = f(sense) * (t if side == 0 or side == 3 else -t)
        d = outside(table, side if sense > 0 else -side % 4, along)
        if d == NONE:
            area[n] = f(0.0) if far > half - near_px else area[n]
        elif side % 2 == 0:
            a[n] -= d if side == 0 else -d
        else:
            b[n] -= d if side == 1 else -d


@njit(cache=True, error_model='numpy')
def _sort(count, half, near_px, room, picked, px, at, starts):
    """Put picked pixels into px and at, by the part of a side at which they lie."""
    f = np.float32
    a, b, area, part = room[0], room[1], room[2], room[3]
    one, per_part, within = f(1.0), f(PARTS / (2 * half)), f(half - near_px)
    ends = np.zeros(CLUSTERS + 1, np.int64)  # the last: pixels apart from the sides
    for n in range(count):
        side, far, t = side_of(a[n], b[n])
        part[n] = -1.0
        if area[n] == f(0.0):
            continue
        if area[n] == one and far >= within:
            p = side * PARTS + min(max(int((t + half) * per_part), 0), PARTS - 1)
            part[n] = p
            ends[p // TOGETHER] += 1
        else:
            ends[CLUSTERS] += 1
    first, per_side = 0, CLUSTERS // 4
    for s in range(CLUSTERS + 1):
        if s % per_side == 0:
            starts[s // per_side] = first
        first, ends[s] = first + (ends[s] + LANES - 1) // LANES, first * LANES
    starts[5] = first
    for n in range(count):
        if area[n] == f(0.0):
            continue
        s = CLUSTERS if part[n] < 0 else int(part[n]) // TOGETHER
        k, z = ends[s] // LANES, ends[s] % LANES
        px[k, z + A], px[k, z + B] = a[n], b[n]
        px[k, z + AREA], px[k, z + PART] = area[n], part[n]
        at[ends[s]] = picked[n]
        ends[s] += 1
    for s in range(CLUSTERS + 1):
        while ends[s] % LANES:
            k, z = ends[s] // LANES, ends[s] % LANES
            for r in range(KEPT_ROWS):
                px[k, z + r * LANES] = 0.0
            px[k, z + PART], at[ends[s]] = -1.0, -1
            ends[s] += 1


@njit(cache=True, error_model='numpy')
def shade(px, groups, half, light, spread, flat):
    """Set what the face (CELLS, CELLS) says of each pixel.

    Where a cover is not flat its light does not move with its sides: slopes are 0.
    """
    f = np.float32
    per_cell, least = f(CELLS / (2 * half)), f(0.05)
    mid, low, high = f(CELLS / 2 - 0.5), f(-0.5), f(CELLS - 0.5)
    cells = np.empty(((CELLS - 1) * (CELLS - 1), 5), np.float32)  # bilinear in each: one load
    for j in range(CELLS - 1):
        for i in range(CELLS - 1):
            c = cells[j * (CELLS - 1) + i]
            c[0], c[1] = light[j, i], light[j, i + 1] - light[j, i]
            c[2] = light[j + 1, i] - light[j, i]
            c[3] = light[j + 1, i + 1] - light[j + 1, i] - c[1]
            c[4] = spread[j, i]
    for n in range(groups * LANES):
        k, z = n // LANES, n % LANES
        p = min(max(px[k, z + A] * per_cell + mid, low), high)
        q = min(max(px[k, z + B] * per_cell + mid, low), high)
        i, j = min(max(int(p), 0), CELLS - 2), min(max(int(q), 0), CELLS - 2)
        fp, fq = p - f(i), q - f(j)
        c = cells[j * (CELLS - 1) + i]
        by_p, by_q = c[1] + fq * c[3], c[2] + fp * c[3]
        px[k, z + LIGHT] = max(c[0] + fp * c[1] + fq * by_q, least)
        px[k, z + LIGHT_A] = by_p * per_cell if flat else f(0.0)
        px[k, z + LIGHT_B] = by_q * per_cell if flat else f(0.0)
        px[k, z + SPREAD] = c[4]


@njit(inline='always')
def side_of(a, b):
    """Return the side (0 to 3) nearest to a point, and the point across and along that side."""
    if abs(a) > abs(b):
        return 0 if a > 0 else 2, abs(a), b
    return 1 if b > 0 else 3, abs(b), a


@njit(cache=True, inner=True)
def gather(rows, cols, m, half_m, near_px, out_px, table, sense, px, at, starts):
    """Fill px, at and starts for a block with derivatives m (12,).

    table: of outline.tabulate for covers in relief, with 0 first for flat ones. sense: -1 for a
    mirror image, else 1.
    """
    room, picked = np.empty((4, MOST_PX), np.float32), np.empty(MOST_PX, np.int32)
    half, reach = half_m * scale_of(m), 0.0
    if table[0] > 0.0:
        for k in range(1, table.shape[0]):
            if table[k] != NONE:
                reach = max(reach, abs(table[k]))
    count = _pick(
        rows, cols, m, half_m, near_px + reach, out_px + reach, room[0], room[1], room[2], picked
    )
    _place(m, count, room[0], room[1])
    if table[0] > 0.0:
        _flatten(count, half, near_px + reach, table, sense, room[0], room[1], room[2])
    _sort(count, half, near_px, room, picked, px, at, starts)


@njit(cache=True, inner=True)
def copy(source, groups, to):
    """Copy a patch, four numbers at a time: a compiler that may not reorder does no better."""
    for group in range(groups):
        row, out = source[group], to[group]
        for i in range(0, KEPT_ROWS * LANES, 4):
            a, b, c, d = row[i], row[i + 1], row[i + 2], row[i + 3]
            out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d


@njit(cache=True, inner=True)
def read(image, at, shift, groups, px):
    """Read the grey levels of a patch from an image (h, w), `shift` columns and rows further.

    Set the trust of its pixels to 1.
    """
    flat, f, zero, one = image.reshape(-1), np.float32, np.float32(0.0), np.float32(1.0)
    by = shift[1] * image.shape[1] + shift[0]
    for group in range(groups):
        for i in range(LANES):
            where = at[group * LANES + i]
            px[group, GREY + i] = f(flat[max(where + by, 0)])
            px[group, TRUST + i] = zero if where < 0 else one


@njit(cache=True, inner=True)
def shift(patch, u, v, rows, cols, half):
    """Shift a patch by whole pixels to the place nearest to u, v; return whether that is possible.

    The curvature of the camera's map must displace its border by at most MOST_BENT_PX, and all
    pixels must be in the image before and after. half: half a side, px.
    """
    m, du, dv = patch.map, round(u - patch.map[0]), round(v - patch.map[6])
    if du == 0 and dv == 0:
        patch.shift[:], patch.offset[:] = 0, 0.0
        return True
    bent = abs(m[3]) + abs(m[4]) + abs(m[5]) + abs(m[9]) + abs(m[10]) + abs(m[11])
    if 2 * bent / patch.scale**2 * max(abs(du), abs(dv)) * half > MOST_BENT_PX:
        return False
    reach = 1.6 * (half + patch.near_px + OUTSIDE_PX)  # above the half diagonal of the square
    for at, most in ((m[0], cols), (m[0] + du, cols), (m[6], rows), (m[6] + dv, rows)):
        if at < reach or at > most - 1 - reach:
            return False
    a, b = np.full(1, du, np.float32), np.full(1, dv, np.float32)
    _place(m, 1, a, b)
    patch.shift[0], patch.shift[1], patch.offset[0], patch.offset[1] = du, dv, a[0], b[0]
    return True
