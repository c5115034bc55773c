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
from eol_ros.core.lanes import (
    above,
    fma,
    least,
    less,
    look,
    magnitude,
    most,
    pluck,
    pluck_rows,
    put,
    splat8,
    take,
    whole,
)  # fmt: skip
from eol_ros.core.vision.appearance.model import (
    CELLS,
    EVERY,
    LANES,
    MOST_PX,
    OUTSIDE_PX,
    PARTS,
    TOGETHER,
)  # fmt: skip
from eol_ros.core.vision.calibration.mapping import to_pixel
from eol_ros.core.vision.outline import NONE, outside

# Numbers of a pixel. Of a patch: column and row from its middle, block coordinates in px of the
# block's scale, pixels that it stands for, brightness of the face and its slopes (LIGHT + LIGHT_A a
# + LIGHT_B b near the pixel), variance of the brightness, part of a side (side * PARTS + part, or
# -1). Of an image: grey level, trust in it. Of a fit: squared residual in variances, edge function.
(
    U, V, A, B, AREA, LIGHT, LIGHT_A, LIGHT_B, SPREAD, PART, GREY, TRUST, Q, EDGE,
) = range(0, 14 * LANES, LANES)  # fmt: skip
ROWS, REST_ROWS = 14, 6  # and of `linear`
CLUSTERS = 4 * PARTS // TOGETHER  # groups of side pixels with correlated errors
GROUPS = MOST_PX // LANES + CLUSTERS + 1  # each list is padded to whole LANES
_STEP_M = 0.03  # for derivatives of the camera's map: two thirds of half a block

PATCH = np.dtype(
    [
        ('x', 'f8'), ('y', 'f8'), ('yaw', 'f8'), ('scale', 'f8'),  # of its a and b; px per m
        ('near_px', 'f8'),  # how far from the sides every pixel is in it
        ('made_yaw', 'f8'), ('middle', 'i8', 2),  # where it was made: turn, and column and row
        ('shift', 'i8', 2),  # columns and rows that the block has moved since
        ('starts', 'i8', (6,)),  # all 0: none is kept
        # of a block that rests, see linear: whether it is kept, pose in px and rad, its sums, by
        # which variances are multiplied, pixels at each side and inside
        ('rests', '?'), ('stands', 'f8', 3), ('pulled', 'f8', 3), ('widened', 'f8', 2),
        ('counts', 'f8', 4), ('area', 'f8'),
    ]
)  # fmt: skip
"""One block's patch; its numbers are kept beside it."""


def empty_patches(n: int) -> tuple[np.ndarray, ...]:
    """Return room for the patches of n blocks.

    PATCH, numbers, those of `linear`, places in the image; and scratch.
    """
    return (
        np.zeros(n, PATCH),
        np.empty((n, GROUPS, ROWS * LANES), np.float32),
        np.empty((n, GROUPS, REST_ROWS * LANES), np.float32),
        np.empty((n, GROUPS * LANES), np.int32),
        np.empty((7, GROUPS * LANES), np.float32),
        np.empty(MOST_PX, np.int32),
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


@njit(cache=True, error_model='numpy')
def _row_of(square, per_a, per_b, at_a, at_b, u0):
    """Return the first and last column of a row that lie within a square of half side `square`.

    at_a, at_b: where the row crosses u0, in px along the block's axes. per_a, per_b: columns a px.
    """
    low = max(-abs(square * per_a) - at_a * per_a, -abs(square * per_b) - at_b * per_b)
    high = min(abs(square * per_a) - at_a * per_a, abs(square * per_b) - at_b * per_b)
    return int(math.ceil(u0 + low)), int(math.floor(u0 + high))


@njit(cache=True, error_model='numpy')
def _pick(rows, cols, m, half_m, near_px, out_px, middle, us, vs, area, at):
    """Pick pixels of a block: columns and rows from its `middle`, and area; return their count.

    All within near_px of its sides; beyond that, as far as out_px, and inside every EVERY-th row
    and column. at: their places in an image of rows x cols.
    """
    scale, f, tiny = scale_of(m), np.float32, 1e-9
    per = scale / (m[1] * m[8] - m[2] * m[7])
    ia, ib, ja, jb = m[8] * per, -m[2] * per, -m[7] * per, m[1] * per
    per_a = 1 / (ia if abs(ia) > tiny else tiny)
    per_b = 1 / (ja if abs(ja) > tiny else tiny)
    half = half_m * scale
    reach = (abs(m[7]) + abs(m[8])) / scale * (half + out_px) + 1.0
    count = 0
    for v in range(max(int(m[6] - reach), 0), min(int(m[6] + reach) + 1, rows)):
        at_a, at_b = ib * (v - m[6]), jb * (v - m[6])
        near, nearly = _row_of(half + near_px, per_a, per_b, at_a, at_b, m[0])
        near, nearly = max(near, 0), min(nearly, cols - 1)
        first, last = near, nearly
        if v % EVERY == 0:
            first, last = _row_of(half + out_px, per_a, per_b, at_a, at_b, m[0])
            first, last = max(first, 0), min(last, cols - 1)
            if near > nearly:
                near, nearly = last + 1, last
        hole, holed = _row_of(half - near_px, per_a, per_b, at_a, at_b, m[0])
        if hole > holed:
            hole, holed = nearly + 1, nearly
        if count + last - first >= MOST_PX:
            break
        for part in range(5):  # sparse, dense, sparse inside, dense, sparse
            if part == 0:
                begin, end = first, near
            elif part == 1:
                begin, end = near, min(hole, nearly + 1)
            elif part == 2:
                begin, end = hole, holed + 1
            elif part == 3:
                begin, end = max(holed + 1, near), nearly + 1
            else:
                begin, end = nearly + 1, last + 1
            step, stands_for = 1, f(1.0)
            if part % 2 == 0:
                if v % EVERY:
                    continue
                step, stands_for = EVERY, f(EVERY * EVERY)
                begin += -begin % EVERY
            for u in range(begin, end, step):
                us[count], vs[count], area[count] = u - middle[0], v - middle[1], stands_for
                at[count] = v * cols + u
                count += 1
    return count


@njit(cache=True, inner=True, forceinline=True)
def constant(number):
    """Return `number` in all lanes."""
    return splat8(np.float32(number))


@njit(cache=True, inner=True, forceinline=True)
def _map(m, u, v):
    """Return what _place needs: of derivatives m, for pixels that count from column u and row v."""
    scale = scale_of(m)
    per, s2 = scale / (m[1] * m[8] - m[2] * m[7]), scale * scale
    return (
        constant(u - m[0]), constant(v - m[6]),
        constant(m[8] * per), constant(-m[2] * per), constant(-m[7] * per), constant(m[1] * per),
        constant(m[3] / s2), constant(m[4] / s2), constant(m[5] / s2),
        constant(m[9] / s2), constant(m[10] / s2), constant(m[11] / s2),
    )  # fmt: skip


@njit(cache=True, inner=True, forceinline=True)
def _place(u, v, by):
    """Return block coordinates, in px of the block's scale."""
    u, v = u + by[0], v + by[1]
    p, q = fma(by[2], u, by[3] * v), fma(by[4], u, by[5] * v)
    u = less(less(u, p, fma(by[6], p, by[7] * q)), q * q, by[8])
    v = less(less(v, p, fma(by[9], p, by[10] * q)), q * q, by[11])
    return fma(by[2], u, by[3] * v), fma(by[4], u, by[5] * v)


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


@njit(cache=True, inner=True)
def _name(count, half, near_px, room):
    """Set the part of a side at which each picked pixel lies, or -1."""
    zero, one, most_part = constant(0.0), constant(1.0), constant(PARTS - 1)
    for n in range(0, count, LANES):
        a, b, area = take(room, 2, n), take(room, 3, n), take(room, 4, n)
        far_a, far_b = magnitude(a), magnitude(b)
        side_a, side_b = above(a, zero, zero, constant(2.0)), above(b, zero, one, constant(3.0))
        side, t = above(far_a, far_b, side_a, side_b), above(far_a, far_b, b, a)
        p = most(least((t + constant(half)) * constant(PARTS / (2 * half)), most_part), zero)
        part = fma(side, constant(PARTS), whole(p))
        part = above(constant(half - near_px), most(far_a, far_b), zero - one, part)
        put(room, 5, n, above(area, one, zero - one, part))


@njit(cache=True, inner=True)
def _sort(count, room, picked, px, at, starts):
    """Put picked pixels into px and at, by the part of a side at which they lie."""
    us, vs, a, b, area, part, order = room
    ends = np.zeros(CLUSTERS + 1, np.int64)  # the last: pixels apart from the sides
    for n in range(count):
        if area[n] > np.float32(0.0):
            ends[CLUSTERS if part[n] < 0 else int(part[n]) // TOGETHER] += 1
    first, per_side = 0, CLUSTERS // 4
    for s in range(CLUSTERS + 1):
        if s % per_side == 0:
            starts[s // per_side] = first
        first, ends[s] = first + (ends[s] + LANES - 1) // LANES, first * LANES
    starts[5] = first
    for n in range(count):
        if area[n] > np.float32(0.0):
            s = CLUSTERS if part[n] < 0 else int(part[n]) // TOGETHER
            order[ends[s]], at[ends[s]] = n, picked[n]
            ends[s] += 1
    for s in range(CLUSTERS + 1):
        for n in range(ends[s], (ends[s] + LANES - 1) // LANES * LANES):
            order[n], at[n] = order[n - 1], at[n - 1]
    for group in range(first):
        its = take(room, 6, group * LANES)
        put(px, group, U, pluck(us, its))
        put(px, group, V, pluck(vs, its))
        put(px, group, A, pluck(a, its))
        put(px, group, B, pluck(b, its))
        put(px, group, AREA, pluck(area, its))
        put(px, group, PART, pluck(part, its))
    for s in range(CLUSTERS + 1):
        for n in range(ends[s], (ends[s] + LANES - 1) // LANES * LANES):
            px[n // LANES, n % LANES + AREA], px[n // LANES, n % LANES + PART] = 0.0, -1.0


@njit(cache=True, inner=True)
def shade(px, groups, half, light, spread, flat, cells):
    """Set what the face (CELLS, CELLS) says of each pixel. cells ((CELLS - 1)^2, 4): scratch.

    Where a cover is not flat its light does not move with its sides: slopes are 0.
    """
    n, spreads = CELLS - 1, spread.reshape(-1)
    for j in range(n):
        for i in range(n):  # bilinear
            c = cells[j * n + i]
            c[0], c[1] = light[j, i], light[j, i + 1] - light[j, i]
            c[2] = light[j + 1, i] - light[j, i]
            c[3] = light[j + 1, i + 1] - light[j + 1, i] - c[1]
    middle, last, zero = constant(CELLS / 2 - 0.5), constant(CELLS - 2), constant(0.0)
    per_cell, low, high = constant(CELLS / (2 * half)), constant(-0.5), constant(CELLS - 0.5)
    slope = constant(CELLS / (2 * half) if flat else 0.0)
    for group in range(groups):
        a, b = take(px, group, A), take(px, group, B)
        p = least(most(fma(a, per_cell, middle), low), high)
        q = least(most(fma(b, per_cell, middle), low), high)
        i, j = whole(least(most(p, zero), last)), whole(least(most(q, zero), last))
        level, by_p, by_q, both = pluck_rows(cells, fma(j, constant(n), i))
        p, q = p - i, q - j
        level = fma(by_p, p, level)
        by_q = fma(both, p, by_q)
        level, by_p = fma(by_q, q, level), fma(both, q, by_p)
        by_p, by_q = by_p * slope, by_q * slope
        level = most(level, constant(0.05))
        put(px, group, LIGHT, less(less(level, by_p, a), by_q, b))
        put(px, group, LIGHT_A, by_p)
        put(px, group, LIGHT_B, by_q)
        put(px, group, SPREAD, pluck(spreads, fma(j, constant(CELLS), i)))


@njit(inline='always')
def side_of(a, b):
    """Return the side (0 to 3) nearest to a point, and the point across and along that side."""
    if abs(a) > abs(b):
        return 0 if a > 0 else 2, abs(a), b
    return 1 if b > 0 else 3, abs(b), a


@njit(cache=True, inner=True)
def gather(rows, cols, m, half_m, near_px, out_px, table, sense, patch, px, at, room, picked):
    """Fill a patch, px and at for a block with derivatives m (12,).

    table: of outline.tabulate for covers in relief, with 0 first for flat ones. sense: -1 for a
    mirror image, else 1. room, picked: scratch, see empty_patches.
    """
    half, reach, middle, patch.rests = half_m * scale_of(m), 0.0, patch.middle, False
    middle[0], middle[1] = round(m[0]), round(m[6])
    patch.shift[:] = 0
    if table[0] > 0.0:
        for k in range(1, table.shape[0]):
            if table[k] != NONE:
                reach = max(reach, abs(table[k]))
    us, vs, a, b, area, _part, _order = room
    count = _pick(
        rows, cols, m, half_m, near_px + reach, out_px + reach, middle, us, vs, area, picked
    )
    by = _map(m, middle[0], middle[1])
    for n in range(0, count, LANES):
        x, y = _place(take(room, 0, n), take(room, 1, n), by)
        put(room, 2, n, x)
        put(room, 3, n, y)
    if table[0] > 0.0:
        _flatten(count, half, near_px + reach, table, sense, a, b, area)
    _name(count, half, near_px, room)
    _sort(count, room, picked, px, at, patch.starts)


@njit(cache=True, inner=True)
def read(image, at, shift, groups, px):
    """Read the grey levels of a patch from an image (h, w), `shift` columns and rows further.

    Set the trust of its pixels to 1, and of what fills its lists to 0.
    """
    flat, by = image.reshape(-1), shift[1] * image.shape[1] + shift[0]
    zero, one = constant(0.0), constant(1.0)
    for group in range(groups):
        put(px, group, GREY, look(flat, at, group * LANES, by))
        put(px, group, TRUST, above(take(px, group, AREA), zero, one, zero))


@njit(cache=True, inner=True)
def move(patch, m, half, rows, cols, px):
    """Move a patch to a block with derivatives m (12,); return whether all of it is in the image.

    It must be there before, too.
    """
    u, v, patch.rests = round(m[0]), round(m[6]), False
    reach = 1.6 * (half + patch.near_px + OUTSIDE_PX)  # above the half diagonal
    if u != patch.middle[0] or v != patch.middle[1]:
        for at, end in (
            (patch.middle[0], cols), (u, cols), (patch.middle[1], rows), (v, rows),
        ):  # fmt: skip
            if at < reach or at > end - 1 - reach:
                return False
    patch.shift[0], patch.shift[1] = u - patch.middle[0], v - patch.middle[1]
    by = _map(m, u, v)
    for group in range(patch.starts[5]):
        x, y = _place(take(px, group, U), take(px, group, V), by)
        put(px, group, A, x)
        put(px, group, B, y)
    return True
