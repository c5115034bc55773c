# SPDX-License-Identifier: Apache-2.0
"""Position, angle, gain and ground of one block, fitted to its pixels.

The image of a block is

    g L(a, b) E(a) E(b) + o + oa a + ob b

with block coordinates a, b, brightness L of its face, gain g, a ground plane o, oa, ob and an edge
E that falls from 1 to 0 over the sides, as wide as lens and pixel make it. Gauss-Newton steps with
Tukey's weights (Huber and Ronchetti, Robust Statistics, 2009, 7.8) fit it to the pixels themselves,
none of which is interpolated. E is symmetric about the side: brightness learned wrongly does not
move a block.

Loops with `fastmath` are inner ones: they are compiled together with `register` and nowhere else,
for the order in which LLVM adds depends on what it compiles them with.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision.appearance.model import (
    AGREE,
    FULL,
    LANES,
    LEAST_VARIANCE,
    PART_MISFIT,
    PARTS,
    SIDE_MOST,
    TOGETHER,
    TUKEY,
)
from eol_ros.core.vision.appearance.pixels import (
    AREA,
    BY_A,
    BY_B,
    BY_GAIN,
    BY_O,
    BY_OA,
    BY_OB,
    BY_SLOPE,
    BY_TURN,
    CLUSTERS,
    EDGE,
    GREY,
    LIGHT,
    LIGHT_A,
    LIGHT_B,
    PART,
    RESIDUAL,
    SPREAD,
    TRUST,
    WEIGHT,
    A,
    B,
    Q,
)  # fmt: skip

NUMBERS = 7  # of a fit: a, b in px and turn in rad from where pixels were gathered, g, o, oa, ob
OWN = 3  # of a side: gain and ground beside the block's, slope of the gain over half a block
COLUMNS = NUMBERS + 1  # of the equations of one side, the last is that slope
SUMS = COLUMNS * (COLUMNS + 1) // 2
APART_SUMS = 8  # sums of the covariance for pixels apart from the sides
INFLUENCES = CLUSTERS + APART_SUMS


@njit(inline='always', error_model='numpy')
def edge(a, half, per_blur):
    """Return E and its slope at a: E falls at +-half as the integral of a normal distribution.

    Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.25, with the eighth power of a
    Taylor polynomial as exponential: within 2e-4, and symmetric about the side.
    """
    f, one = np.float32, np.float32(1.0)
    z = (abs(a) - half) * per_blur
    x2 = min(f(0.5) * z * z, f(9.0))
    u = f(0.125) * x2
    q = one - u * (one - u * (f(0.5) - u * (f(1 / 6) - u * f(1 / 24))))
    q = q * q
    q = q * q
    q = q * q
    t = one / (one + f(0.47047 / math.sqrt(2.0)) * abs(z))
    tail = f(0.5) * t * (f(0.3480242) - t * (f(0.0958798) - t * f(0.7478556))) * q
    slope = f(-1 / math.sqrt(2 * math.pi)) * q * per_blur
    return tail if z > 0 else one - tail, slope if a > 0 else -slope


@njit(inline='always')
def _floats(fit):
    """Return a, b, cosine and sine of the turn, gain and ground of a fit (8,) as float32."""
    f = np.float32
    cs, sn = f(cos(fit[2])), f(sin(fit[2]))
    return f(fit[0]), f(fit[1]), cs, sn, f(fit[3]), f(fit[4]), f(fit[5]), f(fit[6])


@njit(inline='always')
def _noise(noise):
    """Return the variance of a dark pixel, its growth by grey level, and the least."""
    return np.float32(noise[0]), np.float32(noise[1]), np.float32(LEAST_VARIANCE)


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def residuals(px, start, stop, every, half, blur, noise, fit, sigma2_px):
    """Set Q and EDGE of px, in every `every`-th group from start to stop.

    half, blur: half a side and the standard deviation of its edge, px. noise (2,): variance of a
    dark pixel, and by how much it grows with a grey level. sigma2_px: variance of the pose.
    """
    pa, pb, cs, sn, g, o, oa, ob = _floats(fit)
    g2, e2, h, zero = g * g, np.float32(sigma2_px), np.float32(half), np.float32(0.0)
    per_blur, per, full = np.float32(1.0 / blur), np.float32(1.0 / half), np.float32(FULL)
    (n0, n1, least), slope = _noise(noise), np.float32(fit[NUMBERS])
    for group in range(start, stop, every):
        for i in range(LANES):
            a0, b0, grey = px[group, A + i], px[group, B + i], px[group, GREY + i]
            x, y = a0 - pa, b0 - pb
            a, b = cs * x + sn * y, cs * y - sn * x
            ea, sa = edge(a, h, per_blur)
            eb, sb = edge(b, h, per_blur)
            light = px[group, LIGHT + i]
            light += px[group, LIGHT_A + i] * (a - a0) + px[group, LIGHT_B + i] * (b - b0)
            e = ea * eb
            ta, tb = light * sa * eb, light * ea * sb
            level = g + slope * (max(abs(a), abs(b)) - h) * per
            r = grey - level * light * e - o - (oa * a + ob * b) * per
            r = max(r, zero) if grey > full else r
            s2 = max(n0 + n1 * grey, least)
            s2 += g2 * (px[group, SPREAD + i] * e + e2 * (ta * ta + tb * tb))
            px[group, Q + i] = r * r / s2
            px[group, EDGE + i] = e


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _derivatives(px, start, stop, every, half, blur, noise, fit, sigma2_px, widen):
    """Set derivatives, residual and Tukey's weight over the variance, and what residuals sets."""
    zero, one = np.float32(0.0), np.float32(1.0)
    pa, pb, cs, sn, g, o, oa, ob = _floats(fit)
    g2, e2, wd, h = g * g, np.float32(sigma2_px), np.float32(widen), np.float32(half)
    per_blur, per = np.float32(1.0 / blur), np.float32(1.0 / half)
    cut, full = np.float32(1.0 / TUKEY), np.float32(FULL)
    (n0, n1, least), slope = _noise(noise), np.float32(fit[NUMBERS])
    for group in range(start, stop, every):
        for i in range(LANES):
            a0, b0, grey = px[group, A + i], px[group, B + i], px[group, GREY + i]
            x, y = a0 - pa, b0 - pb
            a, b = cs * x + sn * y, cs * y - sn * x
            ea, sa = edge(a, h, per_blur)
            eb, sb = edge(b, h, per_blur)
            la, lb = px[group, LIGHT_A + i], px[group, LIGHT_B + i]
            light = px[group, LIGHT + i] + la * (a - a0) + lb * (b - b0)
            e = ea * eb
            ta, tb = light * sa * eb + la * e, light * ea * sb + lb * e
            ja, jb = a * per, b * per
            out = (max(abs(a), abs(b)) - h) * per
            r = grey - (g + slope * out) * light * e - o - oa * ja - ob * jb
            s2 = max(n0 + n1 * grey, least)
            s2 = one / (s2 + g2 * (px[group, SPREAD + i] * e + e2 * (ta * ta + tb * tb)))
            over = max(r, zero) if grey > full else r
            px[group, Q + i], px[group, EDGE + i] = over * over * s2, e
            s2 /= wd
            z = max(one - r * r * s2 * cut, zero)
            px[group, BY_A + i], px[group, BY_B + i] = -g * ta, -g * tb
            px[group, BY_TURN + i], px[group, BY_GAIN + i] = g * (ta * b - tb * a), light * e
            px[group, BY_O + i], px[group, BY_OA + i], px[group, BY_OB + i] = one, ja, jb
            px[group, BY_SLOPE + i], px[group, RESIDUAL + i] = light * e * out, r
            px[group, WEIGHT + i] = zero if grey > full else z * z * s2 * px[group, TRUST + i]


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _row(px, at, start, groups, every, out):
    for group in range(groups):
        for i in range(LANES):
            out[group, i] = px[start + group * every, at + i]


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _times(x, y, n, out):
    for i in range(n):
        out[i] = x[i] * y[i]


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _dots(x, a, b, c, d, n):
    """Return the products of x with four vectors."""
    p = q = r = s = np.float32(0.0)
    for i in range(n):
        p += x[i] * a[i]
        q += x[i] * b[i]
        r += x[i] * c[i]
        s += x[i] * d[i]
    return p, q, r, s


@njit(cache=True, inner=True)
def normal_equations(
    px, start, stop, every, half, blur, noise, fit, sigma2_px, widen, rows, sums
):  # fmt: skip
    """Fill sums (44,): the upper triangle of the normal matrix row by row, then the right side.

    Of every `every`-th group from start to stop. rows (11, n): scratch, n at least the pixels of
    all of these. widen: by which all variances are multiplied.
    """
    _derivatives(px, start, stop, every, half, blur, noise, fit, sigma2_px, widen)
    groups = (stop - start + every - 1) // every
    n, k = groups * LANES, 0
    for r in range(COLUMNS + 2):
        _row(px, BY_A + r * LANES, start, groups, every, rows[r].reshape(-1, LANES))
    for i in range(COLUMNS):
        _times(rows[COLUMNS + 1], rows[i], n, rows[COLUMNS + 2])
        for j in range(i, COLUMNS + 1, 4):
            last = COLUMNS  # the residual
            at = min(j + 1, last), min(j + 2, last), min(j + 3, last)
            products = _dots(rows[COLUMNS + 2], rows[j], rows[at[0]], rows[at[1]], rows[at[2]], n)
            for t in range(4):
                if j + t < COLUMNS:
                    sums[k] = products[t]
                    k += 1
                elif j + t == COLUMNS:
                    sums[SUMS + i] = products[t]


@njit(cache=True)
def symmetric(sums, m):
    """Fill m (COLUMNS, COLUMNS + 1) with the matrix and the right side of `sums`."""
    k = 0
    for i in range(COLUMNS):
        for j in range(i, COLUMNS):
            m[i, j] = m[j, i] = sums[k]
            k += 1
        m[i, COLUMNS] = sums[SUMS + i]


@njit(cache=True)
def eliminate(m, own, usual, prior, kept, out):
    """Take the numbers `own` (OWN,) of one side out of its equations m; add the rest to out (7, 8).

    prior (OWN,): reciprocal variances of these numbers about what is usual. kept (OWN, 8 +
    OWN): what `restore` gets them from once the block's numbers are known, then their covariance.
    """
    at = 3, 4, NUMBERS
    a = np.zeros((OWN, OWN + NUMBERS + 1 + OWN))
    for i in range(OWN):
        for j in range(OWN):
            a[i, j] = m[at[i], at[j]]
        a[i, i] += prior[i]
        for j in range(NUMBERS):
            a[i, OWN + j] = m[at[i], j]
        a[i, OWN + NUMBERS] = m[at[i], COLUMNS] - prior[i] * (own[i] - usual[i])
        a[i, OWN + NUMBERS + 1 + i] = 1.0
    for i in range(OWN):
        a[i] /= a[i, i]
        for r in range(OWN):
            if r != i:
                a[r] -= a[r, i] * a[i]
    kept[:] = a[:, OWN:]
    for i in range(NUMBERS):
        for j in range(NUMBERS + 1):
            value = m[i, j if j < NUMBERS else COLUMNS]
            for k in range(OWN):
                value -= m[i, at[k]] * kept[k, j]
            out[i, j] += value


@njit(cache=True)
def restore(kept, step, gain, own):
    """Add to `own` its step, given that of the block's numbers; see eliminate."""
    for k in range(OWN):
        by = kept[k, NUMBERS]
        for j in range(NUMBERS):
            by -= kept[k, j] * step[j]
        most = SIDE_MOST[k] * gain
        own[k] = min(max(own[k] + by, -most), most)


@njit(cache=True, inner=True)
def _of_side(fit, own, side_fit):
    for i in range(NUMBERS):
        side_fit[i] = fit[i]
    side_fit[3], side_fit[4] = max(fit[3] + own[0], 1.0), fit[4] + own[1]
    side_fit[NUMBERS] = own[2]


@njit(cache=True, inner=True)
def all_residuals(px, starts, every, half, blur, noise, fit, own, sigma2_px):
    """Set Q and EDGE of all pixels; own (5, OWN): numbers of each side; see residuals."""
    side_fit = np.empty(COLUMNS)
    for side in range(5):
        _of_side(fit, own[side], side_fit)
        residuals(px, starts[side], starts[side + 1], every, half, blur, noise, side_fit, sigma2_px)


@njit(cache=True, inner=True)
def all_equations(
    px, starts, every, half, blur, noise, fit, own, usual, prior, sigma2_px, widen, room, kept,
    equations,
):  # fmt: skip
    """Fill equations (5, 7, 8) of each side, its own numbers eliminated, and of what lies apart.

    usual (4, OWN): what these are about, as shares of the gain. See eliminate.
    """
    (rows, sums, m), side_fit = room, np.empty(COLUMNS)
    equations[:] = 0.0
    for side in range(5):
        if starts[side] == starts[side + 1]:
            kept[side] = 0.0
            continue
        _of_side(fit, own[side], side_fit)
        normal_equations(
            px, starts[side], starts[side + 1], every, half, blur, noise, side_fit, sigma2_px,
            widen, rows, sums,
        )  # fmt: skip
        symmetric(sums, m)
        if side < 4:
            eliminate(m, own[side], fit[3] * usual[side], prior, kept[side], equations[side])
            continue
        for i in range(NUMBERS):
            for j in range(NUMBERS + 1):
                equations[side, i, j] = m[i, j if j < NUMBERS else COLUMNS]


@njit(cache=True)
def solve(equations, without, prior, towards, m):
    """Solve equations (5, 7, 8), but for those of side `without`; return whether it can.

    prior (7,), on their diagonal, is about steps towards (7,). In m (7, 11): the step comes in
    column 7, the covariance of the pose in columns 8 to 10. Gauss-Jordan without pivots: the matrix
    is positive definite.
    """
    m[:] = 0.0
    for side in range(5):
        if side != without:
            m[:, : NUMBERS + 1] += equations[side]
    for i in range(NUMBERS):
        m[i, NUMBERS] += prior[i] * towards[i]
        m[i, i] += 1e-9 * m[i, i] + prior[i]
        if i < 3:
            m[i, 8 + i] = 1.0
    for i in range(NUMBERS):
        p = m[i, i]
        if not p > 0.0:
            return False
        for j in range(i, 11):
            m[i, j] /= p
        for r in range(NUMBERS):
            if r != i:
                f = m[r, i]
                for j in range(i, 11):
                    m[r, j] -= f * m[i, j]
    return True


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _influences(px, start, stop, by, apart, sums):
    """Add the influence of each cluster of pixels on the pose to sums; by (3, COLUMNS) float32."""
    for group in range(start, stop):
        place_x = place_y = angle = np.float32(0.0)
        for i in range(LANES):
            x = y = turn = np.float32(0.0)
            for k in range(COLUMNS):
                j = px[group, BY_A + k * LANES + i]
                x += by[0, k] * j
                y += by[1, k] * j
                turn += by[2, k] * j
            pull = px[group, WEIGHT + i] * px[group, RESIDUAL + i]
            place_x += pull * x
            place_y += pull * y
            angle += pull * turn
        row = sums[CLUSTERS + group % APART_SUMS if apart else int(px[group, PART]) // TOGETHER]
        row[0] += place_x
        row[1] += place_y
        row[2] += angle


@njit(cache=True, inner=True)
def covariance(px, starts, without, kept, m, usual, sums):
    """Return the variances of place, the sum of both axes in px^2, and of turn, in rad^2.

    Of the residuals themselves: those of TOGETHER parts of a side err together (Liang and Zeger,
    Biometrika 73, 1986), as lamps, arms and uneven light make them. Call it after solve, which
    gives m and `kept`, and all_equations of every pixel. usual (INFLUENCES, 3): influences that
    last, which move no block from image to image. sums, as large: filled with those of this image.
    """
    by, at = np.empty((3, COLUMNS)), (3, 4, NUMBERS)
    sums[:] = 0.0
    for side in range(5):
        if side == without:
            continue
        for c in range(3):
            by[c, NUMBERS] = 0.0
            for i in range(NUMBERS):
                by[c, i] = m[i, 8 + c]
            for k in range(OWN if side < 4 else 0):
                for i in range(NUMBERS):
                    by[c, at[k]] -= kept[side, k, i] * m[i, 8 + c]
        b = by.astype(np.float32)
        _influences(px, starts[side], starts[side + 1], b, side == 4, sums)
    place = turn = 0.0
    for i in range(sums.shape[0]):
        place += (sums[i, 0] - usual[i, 0]) ** 2 + (sums[i, 1] - usual[i, 1]) ** 2
        turn += (sums[i, 2] - usual[i, 2]) ** 2
    return place, turn


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def widening(px, groups, half, blur, noise, fit, reach):
    """Return sums (top, weight): their quotient is by how many px edges are wider than blur."""
    pa, pb, cs, sn, g, o, oa, ob = _floats(fit)
    zero = np.float32(0.0)
    h, per_blur, per = np.float32(half), np.float32(1.0 / blur), np.float32(1.0 / half)
    full, far = np.float32(FULL), np.float32(reach)
    n0, n1, least = _noise(noise)
    for group in range(groups):
        for i in range(LANES):
            x, y, grey = px[group, A + i] - pa, px[group, B + i] - pb, px[group, GREY + i]
            a, b = cs * x + sn * y, cs * y - sn * x
            ea, sa = edge(a, h, per_blur)
            eb, sb = edge(b, h, per_blur)
            light = g * px[group, LIGHT + i]
            r = grey - light * ea * eb - o - (oa * a + ob * b) * per
            j = light * per_blur * (abs(sa) * eb * (abs(a) - h) + ea * abs(sb) * (abs(b) - h))
            s2 = max(n0 + n1 * grey, least)
            r = r if r * r < far * s2 else zero
            r = zero if grey > full else r
            px[group, BY_A + i], px[group, BY_B + i] = j * r / s2, j * j / s2
    top = weight = 0.0
    for group in range(groups):
        for i in range(LANES):
            top += px[group, BY_A + i]
            weight += px[group, BY_B + i]
    return top, weight


@njit(cache=True, inner=True)
def quantile(values, n, share):
    """Return what `share` of values[:n] does not exceed (Hoare, 1961); they change their order."""
    lo, hi, k = 0, n - 1, int(share * n)
    while lo < hi:
        pivot = values[(lo + hi) // 2]
        i, j = lo, hi
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            hi = j
        elif k >= i:
            lo = i
        else:
            break
    return values[k]


@njit(cache=True)
def widen_of(px, starts, every, most, scratch):
    """Return by how much squared residuals of every `every`-th group exceed their variance.

    1 to `most`, by the 30 % quantile: up to two thirds of a block may be covered.
    """
    n, step = 0, max(12 // every, 1)
    for side in range(5):
        for group in range(starts[side], starts[side + 1], every):
            for i in range(group % step, LANES, step):
                if px[group, AREA + i] > 0.0:
                    scratch[n] = px[group, Q + i]
                    n += 1
    return min(max(quantile(scratch, n, 0.3) / 0.148, 1.0), most)  # that of chi squared


@njit(cache=True)
def levels(px, groups, half, blur, scratch):
    """Return the median grey level inside a square and outside of it."""
    inner = outer = 0.0
    for part in range(2):
        n = 0
        for i in range(part, groups * LANES, 7):
            k, z = i // LANES, i % LANES
            if px[k, z + AREA] == 0.0:
                continue
            far = max(abs(px[k, z + A]), abs(px[k, z + B]))
            if (far < half - 2 * blur) if part else (far > half + 2 * blur):
                scratch[n] = px[k, z + GREY]
                n += 1
        if n and part:
            inner = quantile(scratch, n, 0.5)
        elif n:
            outer = quantile(scratch, n, 0.5)
    return inner, outer


@njit(cache=True, error_model='numpy')
def trust(px, groups, usual, bins):
    """Trust the pixels at each part of a side by their mean squared residual; see residuals.

    usual (4,): that of each side, in variances.

    An arm as dark as the ground hides the inner half of an edge and leaves the outer half, which
    would draw the side inwards; beside a part that an arm hides its border blurs the next one.
    bins (4, PARTS, 2): scratch.
    """
    bins[:] = 0.0
    for i in range(groups * LANES):
        k, z = i // LANES, i % LANES
        part = int(px[k, z + PART])
        if part >= 0:
            row = bins[part // PARTS, part % PARTS]
            row[0] += 1.0
            row[1] += min(px[k, z + Q], AGREE * usual[part // PARTS])
    low, high = PART_MISFIT
    for side in range(4):
        rows = bins[side]
        for part in range(PARTS):
            rows[part, 1] /= max(rows[part, 0] * usual[side], 1.0)
        for part in range(PARTS):
            misfit = rows[part, 1]
            if part > 0:
                misfit = max(misfit, rows[part - 1, 1])
            if part < PARTS - 1:
                misfit = max(misfit, rows[part + 1, 1])
            rows[part, 0] = min(max((high - misfit) / (high - low), 0.0), 1.0)
    for i in range(groups * LANES):
        k, z = i // LANES, i % LANES
        part = int(px[k, z + PART])
        if part >= 0:
            px[k, z + TRUST] = bins[part // PARTS, part % PARTS, 0]


@njit(cache=True, error_model='numpy')
def side_nats(px, starts, half, blur, noise, fit, own, near, widen, m, out):
    """Fill out (4,): log likelihood ratio that light falls at each side as E does, not steadily.

    Across a side light is fitted by a level, a slope and E: the glow of a lamp is all slope.
    own (5, OWN): numbers of each side. m (4, 11): scratch. After residuals.
    """
    m[:] = 0.0
    cs, sn = cos(fit[2]), sin(fit[2])
    for side in range(4):
        row = m[side]
        for i in range(starts[side] * LANES, starts[side + 1] * LANES):
            k, z = i // LANES, i % LANES
            grey = px[k, z + GREY]
            x, y = px[k, z + A] - fit[0], px[k, z + B] - fit[1]
            a, b = cs * x + sn * y, cs * y - sn * x
            far, t = (a, b) if side % 2 == 0 else (b, a)
            d = (far if side < 2 else -far) - half
            if px[k, z + AREA] == 0.0 or grey > FULL or abs(d) > near or abs(t) > half - near:
                continue
            e = px[k, z + EDGE]  # far from the corners that of this side
            v = grey - fit[4] - (fit[5] * a + fit[6] * b) / half
            d /= blur
            row[0] += 1.0
            row[1] += d
            row[2] += d * d
            row[3] += e
            row[4] += e * d
            row[5] += e * e
            row[6] += v
            row[7] += v * d
            row[8] += v * e
            row[9] += (fit[3] + own[side, 0]) * px[k, z + LIGHT]
            row[10] += max(noise[0] + noise[1] * grey, LEAST_VARIANCE)
    for side in range(4):
        n, sd, sdd, se, sed, see, sv, svd, sve, step, noises = m[side]
        out[side] = 0.0
        if n < 30.0:
            continue
        sdd -= sd * sd / n
        sed -= se * sd / n
        svd -= sv * sd / n
        see -= se * se / n + sed * sed / sdd
        sve -= sv * se / n + sed * svd / sdd
        step /= n
        variance = noises / n * widen / see / step**2 + 0.02
        out[side] = (sve / see / step - 0.5) / variance
