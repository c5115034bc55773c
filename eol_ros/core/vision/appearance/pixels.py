# SPDX-License-Identifier: Apache-2.0
"""The pixels of one block, in block coordinates, for loops that take LANES of them at a time.

`px` is (groups, ROWS * LANES): a row of it holds LANES pixels, each number of them side by side.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision.appearance.model import CELLS, EVERY, LANES, MOST_PX
from eol_ros.core.vision.calibration.mapping import to_pixel
from eol_ros.core.vision.detect.scan import span

# Numbers of a pixel: block coordinates in px of the block's scale, grey level, brightness of the
# face there and its slopes, variance of the grey level, of the brightness, pixels that it stands
# for, trust in it; then what a fit makes of it: squared residual in variances, edge function,
# derivatives by pose (3), gain, ground (3), residual, weight.
(
    A, B, GREY, LIGHT, LIGHT_A, LIGHT_B, NOISE, SPREAD, AREA, TRUST, Q, EDGE,
    BY_A, BY_B, BY_TURN, BY_GAIN, BY_O, BY_OA, BY_OB, RESIDUAL, WEIGHT,
) = range(0, 21 * LANES, LANES)  # fmt: skip
ROWS = 21
_STEP_M = 0.03  # for derivatives of the camera's map: two thirds of half a block


@njit(cache=True)
def empty():
    """Return room for the pixels of one block."""
    return np.empty((MOST_PX // LANES, ROWS * LANES), np.float32)


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
def _pick(image, m, half_m, near_px, out_px, px):
    """Put pixels of a block into px: u, v from its middle, grey level, area; return their count.

    All within near_px of its sides; beyond that, as far as out_px, and inside every EVERY-th row
    and column.
    """
    rows, cols = image.shape
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
            area = 1.0
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
                area = float(EVERY * EVERY)
            k, z = count // LANES, count % LANES
            px[k, z + A], px[k, z + B] = u - m[0], dv
            px[k, z + GREY], px[k, z + AREA] = image[v, u], area
            count += 1
            u += 1
    for i in range(count, (count + LANES - 1) // LANES * LANES):
        k, z = i // LANES, i % LANES
        for r in range(ROWS):
            px[k, z + r * LANES] = 0.0
    return count


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _place(m, px, groups):
    """Turn u, v of px into block coordinates, in px of the block's scale."""
    f, scale = np.float32, scale_of(m)
    det, s2 = m[1] * m[8] - m[2] * m[7], scale * scale
    ia, ib = f(m[8] / det * scale), f(-m[2] / det * scale)
    ja, jb = f(-m[7] / det * scale), f(m[1] / det * scale)
    qa, qb, qc = f(m[3] / s2), f(m[4] / s2), f(m[5] / s2)
    ra, rb, rc = f(m[9] / s2), f(m[10] / s2), f(m[11] / s2)
    for group in range(groups):
        for i in range(LANES):
            du, dv = px[group, A + i], px[group, B + i]
            a, b = ia * du + ib * dv, ja * du + jb * dv
            du -= a * (qa * a + qb * b) + b * qc * b
            dv -= a * (ra * a + rb * b) + b * rc * b
            px[group, A + i], px[group, B + i] = ia * du + ib * dv, ja * du + jb * dv


@njit(cache=True, error_model='numpy')
def shade(px, count, half, noise, light, spread):
    """Set what the face (CELLS, CELLS) and the noise of the image (32,) say of each pixel."""
    per_cell, one = np.float32(CELLS / (2 * half)), np.float32(1.0)
    mid, low, high = np.float32(CELLS / 2 - 0.5), np.float32(-0.5), np.float32(CELLS - 0.5)
    for n in range(count):
        k, z = n // LANES, n % LANES
        p = min(max(px[k, z + A] * per_cell + mid, low), high)
        q = min(max(px[k, z + B] * per_cell + mid, low), high)
        i, j = min(max(int(p), 0), CELLS - 2), min(max(int(q), 0), CELLS - 2)
        fp, fq = p - np.float32(i), q - np.float32(j)
        l00, l01 = light[j, i], light[j, i + 1]
        l10, l11 = light[j + 1, i], light[j + 1, i + 1]
        top, bottom = l00 + fp * (l01 - l00), l10 + fp * (l11 - l10)
        px[k, z + LIGHT] = max(top + fq * (bottom - top), np.float32(0.05))
        px[k, z + LIGHT_A] = ((l01 - l00) * (one - fq) + (l11 - l10) * fq) * per_cell
        px[k, z + LIGHT_B] = (bottom - top) * per_cell
        px[k, z + NOISE] = noise[int(px[k, z + GREY]) >> 3]
        px[k, z + SPREAD] = spread[j, i]
        px[k, z + TRUST] = one
    for n in range(count, (count + LANES - 1) // LANES * LANES):
        px[n // LANES, n % LANES + NOISE] = 1e12


@njit(cache=True, inner=True)
def gather(image, m, half_m, near_px, out_px, noise, light, spread, px):
    """Fill px with the pixels of a block with derivatives m (12,); return their count."""
    count = _pick(image, m, half_m, near_px, out_px, px)
    _place(m, px, (count + LANES - 1) // LANES)
    shade(px, count, half_m * scale_of(m), noise, light, spread)
    return count
