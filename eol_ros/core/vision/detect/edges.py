# SPDX-License-Identifier: Apache-2.0
"""A square measured by its edges: every image row or column that crosses a side is one profile.

Each profile answers where its edge lies (see profiles); all profiles of a block then agree, with
Tukey weights (Beaton and Tukey 1974), on centre, angle and half side. An intensity centroid is
pulled by texture, LED cores and flashes; an edge is not.

Image axes: u right, v down. A block at angle theta has its x axis at (cos, -sin), its y axis at
(-sin, -cos). Side k has the outward normal of angle theta + k 90 degrees; `t` runs along it,
counter-clockwise, `d` is the distance to it, positive outside.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.vision.detect import glow, profile_steps, profiles, usual_outline
from eol_ros.core.vision.detect.profiles import (
    _A,
    _B,
    _C,
    ALL,
    BEGIN,
    CORNER,
    COUNT,
    FIRST,
    FLAT,
    LANES,
    NU,
    NV,
    OFFSET,
    WEIGHT,
    T,
)

SETTLED_PX = 0.03  # a last step below this leaves no error that counts,
SETTLED_SIGMAS = 6.0  # nor one of so many standard deviations: a twentieth of a step is left
# On covers with relief a step stops short of its end by a quarter, as light inside is weighed from
# where it began. A step that noise may have caused is the last one, so that all of them are short
# by the same share: were the greatest followed by a second, noise would have long tails.
SOFT_SETTLED_SIGMAS = 12.0
SETTLED_MOST_PX = 0.2  # where the square was expected no further off than this
RUN = 10  # profiles of one stretch of an edge
CHANCE = 1.8  # noise alone makes stretches seldom differ by more
ALIKE_PX = 1.0  # what is further off is another edge
ALONE_FROM = 0.75  # share from which no light beside a square makes it half of another cover
DOUBTFUL = 0.65  # share below which a good start is mistrusted, and the edges are searched for
HOPELESS = 0.1  # share below which no round makes a square of it
# Share of the edge in sight from which a block needs no help, and below it, over how much of the
# share help comes gradually: noise moves the share, and a step there would move the block with it.
WHOLE, GRADUALLY = 0.9, 0.1
# Where an arm hides some of a block that is known, it is measured so often, until a step is short.
ROUNDS, NEAR_PX = 2, 0.1
# By how much a stretch of its edge may then differ from what is known, flat covers and with relief.
STRETCH_PX, SOFT_STRETCH_PX = 0.02, 0.05
LAMP_LEADS_PX = 0.3  # by so much a lamp may lead a block of which all edges stand in its glow
ARM_LEADS_PX = 0.2  # by so much an arm may lead a block of which hardly a line is as it was
# Share of the contrast by which light may fall in the flats beside an edge, and how fast more makes
# a lamp of it. Outside of covers with relief it is 0.12 at most, of lamps hardly ever below 0.2.
FALL, SOFT_FALL = (0.15, 2.5), (0.1, 5.0)
FIELDS = 13  # of one fitted square
(U, V, THETA, HALF, VISIBLE, SIGMA, QUALITY, CONTRAST, LEVEL, WORST, ALONE, MISFIT, ASIDE) = range(
    FIELDS
)


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _normal_equations(work, n, step, width, a, b):
    """Fill the lower half of `a`, and `b`, with Tukey weights about `step`.

    Returns (sum of weighted squared rests, sum of Tukey weights).
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    d0, d1, d2, d3 = (
        np.float32(step[0]),
        np.float32(step[1]),
        np.float32(step[2]),
        np.float32(step[3]),
    )
    per_width = np.float32(1.0 / width)
    a00 = a10 = a11 = a20 = a21 = a22 = a30 = a31 = a32 = a33 = zero
    b0 = b1 = b2 = b3 = spread = total = zero
    for i in range(n):
        j0, j1, t = work[NU + i], work[NV + i], work[T + i]
        offset = work[OFFSET + i]
        rest = offset - (j0 * d0 + j1 * d1 - t * d2 + d3)
        x = rest * per_width
        tukey = one - x * x
        tukey = tukey if tukey > zero else zero
        tukey = tukey if work[WEIGHT + i] > zero else zero
        tukey = tukey * tukey
        w = work[WEIGHT + i] * tukey
        spread += w * rest * rest
        total += tukey
        w0, w1, wt = w * j0, w * j1, w * t
        a00 += w0 * j0
        a10 += w0 * j1
        a11 += w1 * j1
        a20 -= w0 * t
        a21 -= w1 * t
        a22 += wt * t
        a30 += w0
        a31 += w1
        a32 -= wt
        a33 += w
        b0 += w0 * offset
        b1 += w1 * offset
        b2 -= wt * offset
        b3 += w * offset
    a[0, 0], a[1, 0], a[1, 1], a[2, 0], a[2, 1] = a00, a10, a11, a20, a21
    a[2, 2], a[3, 0], a[3, 1], a[3, 2], a[3, 3] = a22, a30, a31, a32, a33
    b[0], b[1], b[2], b[3] = b0, b1, b2, b3
    return spread, total


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _agree(work, ends, half_off, half_sigma, wide, tight, rounds, a, b, shares):
    """Find the step (du, dv, dtheta, dhalf) that most profiles agree on.

    Iteratively reweighted least squares of offset = n.dc - t dtheta + dhalf with Tukey's weight,
    whose width falls from `wide` px to six robust standard deviations (not below `tight` px).
    half_off, half_sigma: prior on the half side. `shares` (4,) receives the agreeing share of each
    side. Returns (agreeing share of all profiles, variance of a profile in units of its weight, and
    the last width); b holds the step, a its covariance but for that variance.
    """
    n = ends[LANES]
    b[:] = 0.0
    zero, one = np.float32(0.0), np.float32(1.0)
    weight_sum = weighted = zero
    for i in range(n):
        weight_sum += work[WEIGHT + i]
        weighted += one if work[WEIGHT + i] > zero else zero
    if weighted < 8:
        return 0.0, 1.0, wide
    mean_weight = weight_sum / weighted
    width = wide
    variance = 1.0
    for r in range(rounds):
        spread, total = _normal_equations(work, n, b, width, a, b)
        if total < 6.0:
            return 0.0, 1.0, wide
        variance = max(spread / max(total - 4.0, 1.0), 1e-12)
        # priors in the same units of weight: the half side, and a step that nothing speaks of is 0
        a[3, 3] += variance / (half_sigma * half_sigma)
        b[3] += half_off * variance / (half_sigma * half_sigma)
        a[0, 0] += variance / 9.0
        a[1, 1] += variance / 9.0
        a[2, 2] += variance / 0.04
        _solve4(a, b)
        if r < rounds - 1:
            narrow = max(6.0 * math.sqrt(variance / mean_weight), tight)
            width = max(narrow, 0.5 * width)
    agree = 0.0
    d0, d1, d2, d3 = np.float32(b[0]), np.float32(b[1]), np.float32(b[2]), np.float32(b[3])
    near = np.float32(width)
    for side in range(4):
        lines = work[ends[BEGIN + side] :]
        mine = zero
        for i in range(ends[COUNT + side]):
            rest = lines[OFFSET + i] - (
                lines[NU + i] * d0 + lines[NV + i] * d1 - lines[T + i] * d2 + d3
            )
            hit = one if abs(rest) < near else zero
            mine += hit if lines[WEIGHT + i] > zero else zero
        agree += float(mine)
        shares[side] = mine / max(ends[COUNT + side], 1)
    return agree / max(ends[ALL], 1), variance, width


@njit(cache=True, inner=True)
def _solve4(a, b):
    """Solve the symmetric positive system a x = b in place by Cholesky; leave a^-1 in `a`."""
    n = 4
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        a[j, j] = math.sqrt(max(a[j, j], 1e-18))
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
    for j in range(n):  # invert the triangle
        a[j, j] = 1.0 / a[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= a[i, k] * a[k, j]
            a[i, j] = total / a[i, i]
    for i in range(n):  # a^-1 = L^-T L^-1, lower half and diagonal first
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += a[k, i] * a[k, j]
            a[j, i] = total
    for i in range(n):
        for j in range(i):
            a[i, j] = a[j, i]
    x0 = a[0, 0] * b[0] + a[0, 1] * b[1] + a[0, 2] * b[2] + a[0, 3] * b[3]
    x1 = a[1, 0] * b[0] + a[1, 1] * b[1] + a[1, 2] * b[2] + a[1, 3] * b[3]
    x2 = a[2, 0] * b[0] + a[2, 1] * b[1] + a[2, 2] * b[2] + a[2, 3] * b[3]
    x3 = a[3, 0] * b[0] + a[3, 1] * b[1] + a[3, 2] * b[2] + a[3, 3] * b[3]
    b[0], b[1], b[2], b[3] = x0, x1, x2, x3


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _follow(work, n, step):
    """Count all distances from the edges where they are after `step`."""
    s0, s1, s2, s3 = (
        np.float32(step[0]),
        np.float32(step[1]),
        np.float32(step[2]),
        np.float32(step[3]),
    )
    for i in range(n):
        work[FIRST + i] -= work[NU + i] * s0 + work[NV + i] * s1 - work[T + i] * s2 + s3


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _alike(work, ends, step):
    """Return by how much more neighbouring profiles err alike than noise would: >= 1.

    Texture, arms and a shape that is not quite square move whole stretches of an edge. Means over
    RUN profiles then scatter more than single ones divided by RUN.
    """
    zero, near = np.float32(0.0), np.float32(ALIKE_PX)
    d0, d1, d2, d3 = (
        np.float32(step[0]),
        np.float32(step[1]),
        np.float32(step[2]),
        np.float32(step[3]),
    )
    for i in range(ends[LANES]):
        rest = work[OFFSET + i] - (work[NU + i] * d0 + work[NV + i] * d1 - work[T + i] * d2 + d3)
        w = work[WEIGHT + i] if abs(rest) < near else zero
        work[_A + i], work[_B + i], work[_C + i] = w, w * rest, w * rest * rest
    single = joint = used = runs = 0.0
    for side in range(4):
        end = ends[BEGIN + side] + ends[COUNT + side]
        for begin in range(ends[BEGIN + side], end - RUN + 1, RUN):
            weight = total = square = zero
            run = work[begin:]
            for i in range(RUN):
                weight += run[_A + i]
                total += run[_B + i]
                square += run[_C + i]
            if weight > zero:
                single += float(square)
                joint += float(total * total / weight)
                used += RUN
                runs += 1.0
    if runs < 4 or single <= 0.0:
        return 1.0
    ratio = joint / runs / (single / used)
    return min(ratio, RUN) if ratio > CHANCE else 1.0


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _fit(
    image,
    square,
    shear,
    blur,
    half_sigma,
    tight,
    searches,
    again,
    least,
    table,
    usual,
    predicted,
    work,
    ends,
    a,
    step,
    shares,
    spread,
):
    """Fit one square from `square` (FIELDS,): u, v, theta, half; fill in the other fields."""
    u, v, theta, half = square[U], square[V], square[THETA], square[HALF]
    expected = half
    for k in range(VISIBLE, FIELDS):
        square[k] = 0.0
    for _ in range(searches):
        profiles.gather(image, u, v, theta, half, blur, shear, table, work, ends)
        profile_steps.search(work, ends, abs(math.cos(theta)))
        share, variance, width = _agree(
            work, ends, expected - half, max(half_sigma, 0.02 * half), 9.0, 1.5, 5, a, step, shares
        )
        if share < 0.3:
            if again:
                return  # nothing better is known than where it was tried before
            break
        u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
        if theta > math.pi / 4:  # sides keep their rows and columns
            theta -= math.pi / 2
        elif theta <= -math.pi / 4:
            theta += math.pi / 2
    share = 0.0
    variance = 1.0
    contrast = level = 0.0
    soft = table[0] > 0.0
    flat, steep = SOFT_FALL if soft else FALL
    settled = SOFT_SETTLED_SIGMAS if soft else SETTLED_SIGMAS
    for gather in range(4):
        profiles.gather(image, u, v, theta, half, blur, shear, table, work, ends)
        slope, lean = abs(math.cos(theta)), -math.tan(theta)
        limit = half - CORNER * blur
        contrast, level = profiles.levels(work, ends, slope, lean, limit, FLAT * blur, spread, soft)
        share = 0.0
        if contrast == 0.0 or contrast < least:
            return
        if soft:
            profile_steps.saturate_alike(work, ends, slope, blur)
        profiles.shrink_levels(work, ends, spread, soft)
        far = 0.0
        for r in range(4):
            profile_steps.offsets(work, ends, slope, lean, limit, blur, spread, soft, contrast)
            first = r == 0 and gather == 0
            share, variance, width = _agree(
                work,
                ends,
                expected - half,
                half_sigma,
                3.0 if first else 1.0,
                0.05,
                4 if first else 3,
                a,
                step,
                shares,
            )
            if share < HOPELESS:
                return
            _follow(work, ends[LANES], step)
            u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
            change = max(abs(step[0]) + abs(step[1]), abs(step[2]) * half)
            far += change
            sigma = math.sqrt(variance * 0.5 * (a[0, 0] + a[1, 1]))
            if change < SETTLED_PX or (far < SETTLED_MOST_PX and change < settled * sigma):
                break
        if far < 0.2 or (far < 0.7 and share > WHOLE):  # levels were read in the right place
            break
    texture, fall, around, beside = spread[3], spread[4], spread[5], spread[6]
    lit = 0.0
    if predicted and soft and share < WHOLE and beside > glow.LAMP:
        lit = glow.admit(work, ends, slope, lean, limit, blur, around, usual, shares)
    if lit > 0.0:
        u0, v0, theta0, half0 = u, v, theta, half
        for _ in range(ROUNDS):
            profile_steps.offsets(work, ends, slope, lean, limit, blur, spread, soft, contrast)
            share, variance, width = _agree(
                work, ends, expected - half, half_sigma, 1.0, 0.05, 4, a, step, shares
            )
            _follow(work, ends[LANES], step)
            u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
        worst = min(min(shares[0], shares[1]), min(shares[2], shares[3])) * around
        if share < HOPELESS or worst < glow.LEAST:  # they stand elsewhere than the others
            step[0], step[1], step[2], step[3] = u0 - u, v0 - v, theta0 - theta, half0 - half
            _follow(work, ends[LANES], step)
            u, v, theta, half = u0, v0, theta0, half0
            glow.mute(work, ends)
            lit = 0.0
            profile_steps.offsets(work, ends, slope, lean, limit, blur, spread, soft, contrast)
            share, variance, width = _agree(
                work, ends, expected - half, half_sigma, 1.0, 0.05, 3, a, step, shares
            )
    free_half, free_share = half, share
    touched = 0.0
    if tight > 0 and lit == 0.0:
        touched = usual_outline.touched(usual, share * around, texture)
    noise = 0.5 * (a[0, 0] + a[1, 1])  # variance of the place, but for that of a profile
    aside = 0.0
    if tight > 0 and lit == 0.0:
        sigma = math.sqrt(variance * noise)
        aside = usual_outline.aside(work, ends, half, half - expected, step, sigma, False, usual)
    scatter = part = square[MISFIT] = 1.0
    if touched < 1.0:
        if tight > 0 and share < WHOLE:
            # an arm along one side moves it; what is known of the size speaks for the side across
            slope, lean = abs(math.cos(theta)), -math.tan(theta)
            profile_steps.offsets(work, ends, slope, lean, limit, blur, spread, soft, contrast)
            part = min((WHOLE - share) / GRADUALLY, 1.0)
            share, variance, width = _agree(
                work, ends, expected - half, tight, 0.6, 0.05, 4, a, step, shares
            )
            if share == 0.0:
                return
            u, v = u + part * step[0], v + part * step[1]
            theta, half = theta + part * step[2], half + part * step[3]
            noise += part * (0.5 * (a[0, 0] + a[1, 1]) - noise)
        if not soft:
            scatter = variance * _alike(work, ends, step)
        elif min(share * around, 1.0) < WHOLE:
            # what noise alone explains, and how much further an arm may have led it: see MISFIT
            more = max(variance * _alike(work, ends, step), 1.0) - 1.0
            scatter = 1.0 + min((WHOLE - min(share * around, 1.0)) / GRADUALLY, 1.0) * more
            square[MISFIT] = 1.0 + (1.0 - touched) * (math.sqrt(scatter) - 1.0)
        usual_outline.learn(
            work,
            ends,
            half,
            half - expected,
            step,
            part,
            width,
            free_share * around,
            texture,
            aside,
            lit,
            usual,
        )
    else:
        usual_outline.forget(usual)
    scatter *= noise
    if lit > 0.0:
        led = lit * LAMP_LEADS_PX * LAMP_LEADS_PX
        square[MISFIT] *= math.sqrt(1.0 + led / scatter)
        scatter += led
    if touched > 0.0 or aside > 0.0:
        # lines that arms touch are left out, and the others taken for what they usually are
        s0, s1, s2, s3 = shares[0], shares[1], shares[2], shares[3]
        u0, v0, theta0, half0, agree = u, v, theta, half, 0.0
        usual_half = expected + usual[usual_outline.WIDER]
        for _ in range(ROUNDS):
            profiles.gather(image, u, v, theta, half, blur, shear, table, work, ends)
            slope, lean = abs(math.cos(theta)), -math.tan(theta)
            limit, wide = half - CORNER * blur, FLAT * blur
            near = profiles.levels(work, ends, slope, lean, limit, wide, spread, soft)[0]
            if near > 0.0:
                usual_outline.mute_unlike(work, ends, half, near, usual)
                near = profiles.levels(work, ends, slope, lean, limit, wide, spread, soft)[0]
            if near == 0.0:
                agree = 0.0
                break
            if soft:
                profile_steps.saturate_alike(work, ends, slope, blur)
            profiles.shrink_levels(work, ends, spread, soft)
            profile_steps.offsets(work, ends, slope, lean, limit, blur, spread, soft, contrast)
            usual_outline.recall(work, ends, half, usual)
            agree, variance, width = _agree(
                work, ends, usual_half - half, tight, 1.0, 0.05, 4, a, step, shares
            )
            if agree < HOPELESS:
                break
            u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
            if abs(step[0]) + abs(step[1]) < NEAR_PX:  # levels were read in the right place
                break
        if agree < HOPELESS:  # hardly a line is as it was
            u, v, theta, half = u0, v0, theta0, half0
            scatter += touched * ARM_LEADS_PX * ARM_LEADS_PX
        else:
            more, sigma = half - expected, math.sqrt(variance * 0.5 * (a[0, 0] + a[1, 1]))
            left = usual_outline.aside(work, ends, half, more, step, sigma, True, usual)
            if aside > left:  # the light has told which side an arm hides
                told = min(aside / usual_outline.NARROW_PX, 1.0) * (1.0 - left / aside)
                touched = max(touched, told)
            aside += touched * (left - aside)
            u, v = u0 + touched * (u - u0), v0 + touched * (v - v0)
            theta, half = theta0 + touched * (theta - theta0), half0 + touched * (half - half0)
            unlike = SOFT_STRETCH_PX if soft else STRETCH_PX
            more = RUN * usual_outline.mean_weight(work, ends) * unlike * unlike
            more += max(variance * _alike(work, ends, step), 1.0 if soft else 0.0)
            scatter += touched * (more * 0.5 * (a[0, 0] + a[1, 1]) - scatter)
        shares[0], shares[1], shares[2], shares[3] = s0, s1, s2, s3
        scatter += aside * aside
    square[ASIDE] = aside
    square[U], square[V], square[THETA], square[HALF] = u, v, theta, half
    share = min(share * around, 1.0)
    for side in range(4):
        shares[side] = min(shares[side] * around, 1.0)
    square[VISIBLE] = share
    square[SIGMA] = math.sqrt(scatter)
    both_ways = min(max(shares[0], shares[2]), max(shares[1], shares[3]))
    off = (free_half - expected) / (3.0 * half_sigma + 0.04 * expected)
    sharp = 1.0 - min(max(steep * (fall - flat), 0.0), 1.0)
    # covers do not overlap: light like a cover's just outside says that this is half beside one
    alone = 1.0 if share > ALONE_FROM else max(1.0 - 5.0 * beside, 0.0)
    square[QUALITY] = share * both_ways * math.exp(-0.5 * off * off) * sharp
    square[ALONE] = alone
    square[WORST] = min(min(shares[0], shares[1]), min(shares[2], shares[3]))
    square[CONTRAST] = contrast
    square[LEVEL] = level


@njit(inline='always')
def scratch():
    """Return small arrays for fit_square, for all squares of an image."""
    return np.zeros((4, 4)), np.zeros(4), np.zeros(4), np.zeros(7), np.zeros(FIELDS)


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def fit_square(
    image, square, shear_re, shear_im, blur, half_sigma, tight, search, least, table, usual,
    predicted, work, ends, small,
):  # fmt: skip
    """Fit a square to `image` (h, w) uint8 from `square` (FIELDS,): u, v, theta, half as expected.

    shear, table: see profiles.gather. search: rounds of rough search before the fit (0 when the
    start is good to 2 px; a fit that comes out poor then searches once itself). least: contrast
    below which no answer is wanted. predicted: a block should be here, so light beside it may be a
    lamp's (see glow); a light that nobody expects may be a lamp alone.

    `square` then holds u, v, theta, half, agreeing share of the edges, sigma px, quality, contrast,
    level inside, agreeing share of the worst side, how certainly no other cover's light stands
    beside it, the misfit: sigma over what noise alone would make of it, for covers with relief; and
    by how many px it may stand aside, since an arm hides one of two sides.
    A share of 0 means no square there.
    """
    a, step, shares, spread, second = small
    shear = (shear_re, shear_im)
    u, v, theta, half = square[U], square[V], square[THETA], square[HALF]
    _fit(
        image,
        square,
        shear,
        blur,
        half_sigma,
        tight,
        search,
        False,
        least,
        table,
        usual,
        predicted,
        work,
        ends,
        a,
        step,
        shares,
        spread,
    )
    if search == 0 and square[VISIBLE] < DOUBTFUL:
        second[U], second[V], second[THETA], second[HALF] = u, v, theta, half
        _fit(
            image,
            second,
            shear,
            blur,
            half_sigma,
            tight,
            2,
            True,
            least,
            table,
            usual,
            predicted,
            work,
            ends,
            a,
            step,
            shares,
            spread,
        )
        if second[VISIBLE] > square[VISIBLE] + 0.05:
            square[:] = second
    square[THETA] -= round(square[THETA] / (math.pi / 2)) * math.pi / 2
