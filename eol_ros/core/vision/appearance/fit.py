# SPDX-License-Identifier: Apache-2.0
"""Position, angle, gain and ground of one block, fitted to its pixels.

The image of a block is

    g L(a, b) E(a) E(b) + o + oa a + ob b

with block coordinates a, b, brightness L of its face, gain g, a ground plane o, oa, ob and an edge
E that falls from 1 to 0 over the sides, as wide as lens and pixel make it. Gauss-Newton steps with
Tukey's weights (Huber and Ronchetti, Robust Statistics, 2009, 7.8) fit it to the pixels themselves,
none of which is interpolated. E is symmetric about the side: brightness learned wrongly does not
move a block.

Loops over pixels take LANES of them at a time, and say which lanes are added in which order.
"""

import math
from collections import namedtuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.lanes import (
    above,
    add_products,
    add_weighted,
    added,
    all_below,
    fma,
    least,
    less,
    magnitude,
    most,
    put,
    signed,
    take,
)  # fmt: skip
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
    CLUSTERS,
    EDGE,
    GREY,
    LIGHT,
    LIGHT_A,
    LIGHT_B,
    PART,
    SPREAD,
    TRUST,
    A,
    B,
    Q,
    constant,
)  # fmt: skip

NUMBERS = 7  # of a fit: a, b in px and turn in rad from where pixels were gathered, g, o, oa, ob
OWN = 3  # of a side: gain and ground beside the block's, slope of the gain over half a block
COLUMNS = NUMBERS + 1  # of the equations of one side, the last is that slope
SUMS = COLUMNS * (COLUMNS + 1) // 2
APART_SUMS = 8  # sums of the covariance for pixels apart from the sides
INFLUENCES = CLUSTERS + APART_SUMS


# Mills' ratio of a normal distribution, its tail over its density, over sqrt(2 pi): within 1e-4 of
# the tail when multiplied by the density
MILLS = (
    0.5, -0.397256105, 0.237381560, -0.101789536, 0.026252109, -0.002895429,
)  # fmt: skip
FAR = 4.2  # standard deviations from a side: E is 0 or 1 there


@njit(cache=True, inner=True, forceinline=True)
def _edge(a, half, per_blur):
    """Return E and its slope at a: E falls at +-half as the integral of a normal distribution.

    The density is the eighth power of a Taylor polynomial. Within 1e-4, symmetric about the side.
    """
    one = constant(1.0)
    d = (magnitude(a) - half) * per_blur
    z = least(magnitude(d), constant(FAR))
    u = z * z * constant(1 / 16)
    q = less(constant(0.5), u, less(constant(1 / 6), u, constant(1 / 24)))
    q = less(one, u, less(one, u, q))
    q = q * q
    q = q * q
    q = q * q
    tail = fma(constant(MILLS[5]), z, constant(MILLS[4]))
    tail = fma(fma(tail, z, constant(MILLS[3])), z, constant(MILLS[2]))
    tail = fma(fma(tail, z, constant(MILLS[1])), z, constant(MILLS[0])) * q
    slope = q * per_blur * constant(-1 / math.sqrt(2 * math.pi))
    return above(d, constant(0.0), tail, one - tail), signed(slope, a)


Numbers = namedtuple(
    'Numbers', 'a b cs sn gain ground by_a by_b slope half per per_blur safe n0 n1 pose gain2'
)
"""Of a fit to the pixels of one side, in all lanes."""


@njit(cache=True, inner=True, forceinline=True)
def numbers(half, blur, noise, fit, sigma2_px):
    """Return Numbers.

    half, blur: half a side and the standard deviation of its edge, px. noise (2,): variance of a
    dark pixel, and by how much it grows with a grey level. sigma2_px: variance of the pose.
    """
    c = constant
    return Numbers(
        c(fit[0]), c(fit[1]), c(cos(fit[2])), c(sin(fit[2])), c(fit[3]), c(fit[4]),
        c(fit[5] / half), c(fit[6] / half), c(fit[NUMBERS]), c(half), c(1.0 / half), c(1.0 / blur),
        c(half - FAR * blur), c(noise[0]), c(noise[1]), c(sigma2_px), c(fit[3] * fit[3]),
    )  # fmt: skip


@njit(cache=True, inner=True, forceinline=True)
def _edges(a, b, n):
    """Return E and its slope along a and along b; no side is near where lanes are far inside."""
    ea = eb = constant(1.0)
    sa = sb = constant(0.0)
    if not all_below(magnitude(a), n.safe):
        ea, sa = _edge(a, n.half, n.per_blur)
    if not all_below(magnitude(b), n.safe):
        eb, sb = _edge(b, n.half, n.per_blur)
    return ea, sa, eb, sb


@njit(cache=True, inner=True, forceinline=True)
def _light(px, group, a, b):
    """Return the brightness of the face at a, b near the pixels."""
    light = fma(take(px, group, LIGHT_B), b, take(px, group, LIGHT))
    return fma(take(px, group, LIGHT_A), a, light)


@njit(cache=True, inner=True, forceinline=True)
def _at(px, group, n):
    """Return the grey level of pixels, and where they lie from the fit along its axes."""
    x, y = take(px, group, A) - n.a, take(px, group, B) - n.b
    return take(px, group, GREY), fma(n.sn, y, n.cs * x), less(n.cs * y, n.sn, x)


@njit(cache=True, inner=True, forceinline=True)
def _variance(grey, n):
    """Return the variance of pixels by their grey level."""
    return most(fma(n.n1, grey, n.n0), constant(LEAST_VARIANCE))


@njit(cache=True, inner=True, forceinline=True)
def _seen(px, group, n):
    """Return a, b, g dL/da, g dL/db, E L, E, how far outside, residual, grey level, variance."""
    grey, a, b = _at(px, group, n)
    ea, sa, eb, sb = _edges(a, b, n)
    la, lb = take(px, group, LIGHT_A), take(px, group, LIGHT_B)
    light, e = fma(la, a, fma(lb, b, take(px, group, LIGHT))), ea * eb
    lit, out = light * e, (most(magnitude(a), magnitude(b)) - n.half) * n.per
    ta, tb = fma(light * sa, eb, la * e), fma(light * sb, ea, lb * e)
    r = less(grey - n.ground, fma(n.slope, out, n.gain), lit)
    r = less(less(r, n.by_a, a), n.by_b, b)
    s2 = _variance(grey, n)
    of_pose = fma(n.pose, fma(ta, ta, tb * tb), take(px, group, SPREAD) * e)
    return a, b, ta, tb, lit, e, out, r, grey, fma(n.gain2, of_pose, s2)


@njit(cache=True, inner=True, forceinline=True)
def _excess(r, grey):
    """Return the residual that counts: a saturated pixel may be as bright as the model has it."""
    return above(grey, constant(FULL), most(r, constant(0.0)), r)


@njit(cache=True, inner=True, forceinline=True)
def tukey(q):
    """Return the root of Tukey's weight of squared residuals in variances."""
    return most(less(constant(1.0), q, constant(1.0 / TUKEY)), constant(0.0))


@njit(cache=True, inner=True, forceinline=True)
def derivatives(px, group, n, per_widen):
    """Return the weight, derivatives with the residual, Q, E and the reciprocal variance.

    The weight is Tukey's over the variance.
    """
    a, b, ta, tb, lit, e, out, r, grey, s2 = _seen(px, group, n)
    one, zero, over = constant(1.0), constant(0.0), _excess(r, grey)
    per = one / s2
    q = over * over * per
    s2 = per * per_widen
    z = tukey(r * r * s2)
    weight = above(grey, constant(FULL), zero, z * z * s2 * take(px, group, TRUST))
    turn = n.gain * less(ta * b, tb, a)
    back = zero - n.gain
    return weight, (
        back * ta, back * tb, turn, lit, one, a * n.per, b * n.per, lit * out, r,
    ), q, e, per  # fmt: skip


@njit(cache=True, inner=True)
def normal_equations(px, start, stop, every, half, blur, noise, fit, sigma2_px, widen, sums, m):
    """Fill m (COLUMNS, COLUMNS + 1): the normal matrix, and the right side as its last column.

    Of every `every`-th group from start to stop, of which Q and EDGE are set. widen: by which all
    variances are multiplied. sums (SUMS + COLUMNS, LANES): scratch.
    """
    n, per_widen = numbers(half, blur, noise, fit, sigma2_px), constant(1.0 / widen)
    nothing = constant(0.0)
    for k in range(SUMS + COLUMNS):
        put(sums, k, 0, nothing)
    for group in range(start, stop, 2 * every):
        weight, values, q, e, _per = derivatives(px, group, n, per_widen)
        put(px, group, Q, q)
        put(px, group, EDGE, e)
        if group + every < stop:
            other, others, q, e, _per = derivatives(px, group + every, n, per_widen)
            put(px, group + every, Q, q)
            put(px, group + every, EDGE, e)
        else:
            other, others = nothing, values
        add_products(sums, weight, values, other, others)
    k = 0
    for i in range(COLUMNS):
        for j in range(i, COLUMNS):
            m[i, j] = m[j, i] = added(take(sums, k, 0))
            k += 1
        m[i, COLUMNS] = added(take(sums, SUMS + i, 0))


@njit(cache=True, error_model='numpy')
def eliminate(m, own, usual, gain, prior, kept, out):
    """Take the numbers `own` (OWN,) of one side out of its equations m; fill out (7, 8).

    usual (OWN,): what they are about, as shares of `gain`. prior (OWN,): reciprocal variances.
    kept (OWN, 8 + OWN): what `restore` gets them from once the block's numbers are known, then
    their covariance: an inverse by cofactors.
    """
    at = 3, 4, NUMBERS
    a, b, c = m[3, 3] + prior[0], m[4, 4] + prior[1], m[NUMBERS, NUMBERS] + prior[2]
    d, e, f = m[3, 4], m[3, NUMBERS], m[4, NUMBERS]
    kept[0, 8], kept[0, 9], kept[0, 10] = b * c - f * f, e * f - c * d, d * f - b * e
    per = 1.0 / (a * kept[0, 8] + d * kept[0, 9] + e * kept[0, 10])
    kept[1, 9], kept[1, 10], kept[2, 10] = a * c - e * e, d * e - a * f, a * b - d * d
    kept[1, 8], kept[2, 8], kept[2, 9] = kept[0, 9], kept[0, 10], kept[1, 10]
    for i in range(OWN):
        for k in range(OWN):
            kept[i, 8 + k] *= per
        for j in range(NUMBERS + 1):
            kept[i, j] = 0.0
        for k in range(OWN):
            by = kept[i, 8 + k]
            for j in range(NUMBERS):
                kept[i, j] += by * m[at[k], j]
            off = own[k] - gain * usual[k]
            kept[i, NUMBERS] += by * (m[at[k], COLUMNS] - prior[k] * off)
    for i in range(NUMBERS):
        for j in range(NUMBERS):
            out[i, j] = m[i, j]
        out[i, NUMBERS] = m[i, COLUMNS]
        for k in range(OWN):
            by = m[i, at[k]]
            for j in range(NUMBERS + 1):
                out[i, j] -= by * kept[k, j]


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
def of_side(fit, own, side_fit):
    """Fill side_fit (COLUMNS,) with the numbers of a fit at one side, given its `own` (OWN,)."""
    for i in range(NUMBERS):
        side_fit[i] = fit[i]
    side_fit[3], side_fit[4] = max(fit[3] + own[0], 1.0), fit[4] + own[1]
    side_fit[NUMBERS] = own[2]


@njit(cache=True, inner=True)
def all_residuals(px, starts, every, half, blur, noise, fit, own, sigma2_px):
    """Set Q and EDGE of every `every`-th group; own (5, OWN): of each side. See numbers."""
    side_fit = np.empty(COLUMNS)
    for side in range(5):
        of_side(fit, own[side], side_fit)
        n = numbers(half, blur, noise, side_fit, sigma2_px)
        for group in range(starts[side], starts[side + 1], every):
            _a, _b, _ta, _tb, _lit, e, _out, r, grey, s2 = _seen(px, group, n)
            r = _excess(r, grey)
            put(px, group, Q, r * r / s2)
            put(px, group, EDGE, e)


@njit(cache=True, inner=True)
def all_equations(
    px, starts, every, half, blur, noise, fit, own, usual, prior, sigma2_px, widen, room, kept,
    equations,
):  # fmt: skip
    """Fill equations (5, 7, 8) of each side, its own numbers eliminated, and of what lies apart.

    usual (4, OWN): what these are about, as shares of the gain. See eliminate.
    """
    (sums, m), side_fit = room, np.empty(COLUMNS)
    for side in range(5):
        if starts[side] == starts[side + 1]:
            kept[side], equations[side] = 0.0, 0.0
            continue
        of_side(fit, own[side], side_fit)
        normal_equations(
            px, starts[side], starts[side + 1], every, half, blur, noise, side_fit, sigma2_px,
            widen, sums, m,
        )  # fmt: skip
        if side < 4:
            eliminate(m, own[side], usual[side], fit[3], prior, kept[side], equations[side])
            continue
        for i in range(NUMBERS):
            for j in range(NUMBERS):
                equations[side, i, j] = m[i, j]
            equations[side, i, NUMBERS] = m[i, COLUMNS]


@njit(cache=True)
def solve(equations, without, prior, towards, m):
    """Solve equations (5, 7, 8), but for those of side `without`; return whether it can.

    prior (7,), on their diagonal, is about steps towards (7,). In m (7, 11): the step comes in
    column 7, the covariance of the pose in columns 8 to 10. Gauss-Jordan without pivots: the matrix
    is positive definite.
    """
    for i in range(NUMBERS):
        for j in range(NUMBERS + 1):
            m[i, j] = 0.0
            for side in range(5):
                if side != without:
                    m[i, j] += equations[side, i, j]
        m[i, NUMBERS] += prior[i] * towards[i]
        m[i, i] += 1e-9 * m[i, i] + prior[i]
        for j in range(3):
            m[i, 8 + j] = 1.0 if i == j else 0.0
    for i in range(NUMBERS):
        if not m[i, i] > 0.0:
            return False
        p = 1.0 / m[i, i]
        for j in range(i, 11):
            m[i, j] *= p
        for r in range(NUMBERS):
            if r != i:
                f = m[r, i]
                for j in range(i, 11):
                    m[r, j] -= f * m[i, j]
    return True


@njit(cache=True, inner=True)
def influences(kept, m, side, by):
    """Fill by (3, COLUMNS): what the right sides of one side's equations add to the pose.

    kept: of that side, its own numbers eliminated. m: after solve.
    """
    at = 3, 4, NUMBERS
    for c in range(3):
        by[c, NUMBERS] = 0.0
        for i in range(NUMBERS):
            by[c, i] = m[i, 8 + c]
        for k in range(OWN if side < 4 else 0):
            pull = 0.0
            for i in range(NUMBERS):
                pull += kept[k, i] * m[i, 8 + c]
            by[c, at[k]] -= pull


@njit(inline='always')
def _cluster(px, first, stop, group, side):
    """Return the cluster of correlated residuals of a group: parts of a side, or a band."""
    if side == 4:
        return CLUSTERS + (group - first) * APART_SUMS // (stop - first)
    return int(px[group, PART]) // TOGETHER


@njit(cache=True, inner=True)
def covariance(
    px, starts, without, half, blur, noise, fit, own, sigma2_px, widen, kept, m, usual, pulls, sums
):  # fmt: skip
    """Return the variances of place, the sum of both axes in px^2, and of turn, in rad^2.

    Of the residuals themselves: those of TOGETHER parts of a side err together (Liang and Zeger,
    Biometrika 73, 1986), as lamps, arms and uneven light make them. Call it after solve, which
    gives m and `kept`. usual (INFLUENCES, 3): influences that last, which move no block from image
    to image. sums (INFLUENCES, 3): filled with those of this image. pulls: scratch.
    """
    by, side_fit = np.empty((3, COLUMNS)), np.empty(COLUMNS)
    sums[:] = 0.0
    per_widen = constant(1.0 / widen)
    for i in range(COLUMNS):
        put(pulls, i, 0, constant(0.0))
    for side in range(5):
        if side == without:
            continue
        influences(kept[side], m, side, by)
        of_side(fit, own[side], side_fit)
        n = numbers(half, blur, noise, side_fit, sigma2_px)
        first, stop = starts[side], starts[side + 1]
        for group in range(first, stop):
            weight, values, _q, _e, _per = derivatives(px, group, n, per_widen)
            add_weighted(pulls, weight * values[COLUMNS], values)
            row = _cluster(px, first, stop, group, side)
            if group + 1 < stop and _cluster(px, first, stop, group + 1, side) == row:
                continue
            for i in range(COLUMNS):
                pull = added(take(pulls, i, 0))
                put(pulls, i, 0, constant(0.0))
                for c in range(3):
                    sums[row, c] += by[c, i] * pull
    place = turn = 0.0
    for i in range(sums.shape[0]):
        place += (sums[i, 0] - usual[i, 0]) ** 2 + (sums[i, 1] - usual[i, 1]) ** 2
        turn += (sums[i, 2] - usual[i, 2]) ** 2
    return place, turn


@njit(cache=True, inner=True)
def widening(px, groups, half, blur, noise, fit, reach):
    """Return sums (top, weight): their quotient is by how many px edges are wider than blur."""
    side_fit = np.zeros(COLUMNS)
    side_fit[:NUMBERS] = fit
    n = numbers(half, blur, noise, side_fit, 0.0)
    zero, far, full = constant(0.0), constant(reach), constant(FULL)
    top = weight = zero
    for group in range(groups):
        grey, a, b = _at(px, group, n)
        ea, sa, eb, sb = _edges(a, b, n)
        light = n.gain * _light(px, group, a, b)
        r = less(less(less(grey - n.ground, light, ea * eb), n.by_a, a), n.by_b, b)
        j = magnitude(sa) * eb * (magnitude(a) - n.half)
        j = light * n.per_blur * fma(ea * magnitude(sb), magnitude(b) - n.half, j)
        s2 = _variance(grey, n)
        r = above(far * s2, r * r, r, zero)
        j = j / s2
        top = fma(j, above(grey, full, zero, r), top)
        weight = fma(j * s2, j, weight)
    return added(top), added(weight)


@njit(cache=True, inner=True)
def quantile(values, share):
    """Return what `share` of values (n,) does not exceed, or 0 for none; they change their order.

    By Hoare's selection (1961): np.partition copies, and an image takes 4 % longer.
    """
    lo, hi, k = 0, len(values) - 1, int(share * len(values))
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
    return values[k] if len(values) else np.float32(0.0)


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
    return min(max(quantile(scratch[:n], 0.3) / 0.148, 1.0), most)  # that of chi squared


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
        if part:
            inner = quantile(scratch[:n], 0.5)
        else:
            outer = quantile(scratch[:n], 0.5)
    return inner, outer


@njit(cache=True, error_model='numpy')
def trust(px, starts, usual, bins):
    """Trust the pixels at each part of a side by their mean squared residual; see all_residuals.

    usual (4,): that of each side, in variances.

    An arm as dark as the ground hides the inner half of an edge and leaves the outer half, which
    would draw the side inwards; beside a part that an arm hides its border blurs the next one.
    bins (4, PARTS, 2): scratch.
    """
    bins[:] = 0.0
    one, zero = constant(1.0), constant(0.0)
    low, high = PART_MISFIT
    for side in range(4):
        rows, most_q = bins[side], constant(AGREE * usual[side])
        for group in range(starts[side], starts[side + 1]):
            first = int(px[group, PART]) // TOGETHER * TOGETHER
            part, q = take(px, group, PART), least(take(px, group, Q), most_q)
            for p in range(TOGETHER):
                middle = constant(first + p)
                its = above(constant(0.5), magnitude(part - middle), one, zero)
                row = rows[first % PARTS + p]
                row[0] += added(its)
                row[1] += added(its * q)
        for part in range(PARTS):
            rows[part, 1] /= max(rows[part, 0] * usual[side], 1.0)
        for part in range(PARTS):
            misfit = rows[part, 1]
            if part > 0:
                misfit = max(misfit, rows[part - 1, 1])
            if part < PARTS - 1:
                misfit = max(misfit, rows[part + 1, 1])
            rows[part, 0] = min(max((high - misfit) / (high - low), 0.0), 1.0)
        for group in range(starts[side], starts[side + 1]):
            first = int(px[group, PART]) // TOGETHER * TOGETHER
            part, level = take(px, group, PART), zero
            for p in range(TOGETHER):
                its = above(constant(0.5), magnitude(part - constant(first + p)), one, zero)
                level = fma(its, constant(rows[first % PARTS + p, 0]), level)
            put(px, group, TRUST, level)


@njit(cache=True, error_model='numpy')
def side_nats(px, starts, half, blur, noise, fit, own, near, widen, out):
    """Fill out (4,): log likelihood ratio that light falls at each side as E does, not steadily.

    Across a side light is fitted by a level, a slope and E: the glow of a lamp is all slope.
    own (5, OWN): numbers of each side. After all_residuals.
    """
    side_fit = np.empty(COLUMNS)
    one, zero, full, close = constant(1.0), constant(0.0), constant(FULL), constant(near)
    for side in range(4):
        of_side(fit, own[side], side_fit)
        n = numbers(half, blur, noise, side_fit, 0.0)
        ground, within = constant(fit[4]), constant(half - near)
        count = sd = sdd = se = sed = see = sv = svd = sve = step = noises = zero
        for group in range(starts[side], starts[side + 1]):
            grey, a, b = _at(px, group, n)
            far, t = (a, b) if side % 2 == 0 else (b, a)
            d = (far if side < 2 else zero - far) - n.half
            use = above(take(px, group, AREA), zero, one, zero)
            use = above(grey, full, zero, use)
            use = above(magnitude(d), close, zero, use)
            use = above(magnitude(t), within, zero, use)
            e = take(px, group, EDGE) * use  # far from the corners that of this side
            v = less(less(grey - ground, n.by_a, a), n.by_b, b) * use
            d = d * n.per_blur
            count = count + use
            sd = fma(d, use, sd)
            sdd = fma(d * use, d, sdd)
            se = se + e
            sed = fma(e, d, sed)
            see = fma(e, e, see)
            sv = sv + v
            svd = fma(v, d, svd)
            sve = fma(v, e, sve)
            step = fma(n.gain * use, _light(px, group, a, b), step)
            noises = fma(use, _variance(grey, n), noises)
        out[side] = _nats(
            np.float64(added(count)), added(sd), added(sdd), added(se), added(sed), added(see),
            added(sv), added(svd), added(sve), added(step), added(noises), widen,
        )  # fmt: skip


@njit(cache=True, error_model='numpy')
def _nats(n, sd, sdd, se, sed, see, sv, svd, sve, step, noises, widen):
    if n < 30.0:
        return 0.0
    sdd -= sd * sd / n
    sed -= se * sd / n
    svd -= sv * sd / n
    see -= se * se / n + sed * sed / sdd
    sve -= sv * se / n + sed * svd / sdd
    step /= n
    variance = noises / n * widen / see / step**2 + 0.02
    return (sve / see / step - 0.5) / variance
