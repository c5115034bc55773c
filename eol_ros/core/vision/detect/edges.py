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
from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, exp, hypot, tan
from eol_ros.core.vision.detect import glow, profile_steps, profiles, usual_outline
from eol_ros.core.vision.detect.profiles import (
    _A,
    _B,
    _C,
    ALL,
    AROUND,
    BEGIN,
    COUNT,
    FALL,
    FIRST,
    GLARE,
    LANES,
    NU,
    NV,
    OFFSET,
    TEXTURE_OUT,
    WEIGHT,
    T,
)

# Widths of Tukey's weights, px: where steep edges are searched for, at first and least; in the
# first round about a place, in all others, in one with a known size, at first; and in all, least.
SEARCH_PX, SEARCH_NARROW_PX = 9.0, 1.5
FIRST_PX, WIDE_PX, SIZED_PX, NARROW_PX = 3.0, 1.0, 0.6, 0.05
WIDEST_PX = 1.5  # in the end: else the round end of an arm agrees with a square
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
# Share below which a good start is mistrusted, and the edges are searched for; and one that found
# the block where it was just now: there a search hardly ever finds more.
DOUBTFUL, POOR = 0.65, 0.4
AGAIN_PX = 1.0  # from so near to where a first attempt ended, a second one ends there, too
BETTER = 0.05  # share by which a second attempt must do better than the first
FOUND = 0.3  # share from which steep edges are those of a square
CLOSE = 0.065  # half sides: so near to where a block was just now, or rested, nothing else is
# Of two squares further apart neither is taken, if FOUND of the poorer one agrees, it is known to
# so many px and so many sigmas of the better one, and THREE_SIDES do not agree of that.
EITHER_PX, SURER = 0.4, 2.0
THREE_SIDES = 0.75  # share of an outline of which one side is missing
HOPELESS = 0.1  # share below which no round makes a square of it
# Share of the edge in sight from which a block needs no help, and below it, over how much of the
# share help comes gradually: noise moves the share, and a step there would move the block with it.
WHOLE, GRADUALLY = 0.9, 0.1
# So far from what a calibration says, half a side is not that of a block's own edges; twice as far
# it is surely not.
MISSIZED_PX = 0.4
# Where an arm hides some of a block that is known, it is measured so often, until a step is short.
ROUNDS, NEAR_PX = 2, 0.1
# By how much a stretch of its edge may then differ from what is known, flat covers and with relief.
STRETCH_PX, SOFT_STRETCH_PX = 0.02, 0.05
LAMP_LEADS_PX = 0.3  # by so much a lamp may lead a block of which all edges stand in its glow
ARM_LEADS_PX = 0.2  # by so much an arm may lead a block of which hardly a line is as it was
MORE_THAN_AN_ARM = 0.6  # share of an outline that only a block shows
ANOTHER_PX = 1.5  # so far from where that is, what is usual of a block finds another thing
# A block that was seen just now, and of which so much is found where it was expected, is there to
# so many px, even if what is usual of it tells nothing along one axis.
SHOWN, SHOWN_PX = 0.33, 0.35
# Share of the contrast by which light may fall in the flats beside an edge, and how fast more makes
# a lamp of it. Outside of covers with relief it is 0.12 at most, of lamps hardly ever below 0.2.
FALLING, SOFT_FALLING = (0.15, 2.5), (0.1, 5.0)
TINY = 1e-18  # a pivot below this is none
FIELDS = 13  # of one fitted square
(U, V, THETA, HALF, VISIBLE, SIGMA, QUALITY, CONTRAST, LEVEL, WORST, ALONE, MISFIT, ASIDE) = range(
    FIELDS
)


class Known(NamedTuple):
    """What is known of a square before it is fitted.

    half: of its side, px, good to half_sigma; tight: how well a calibration says it, px, 0 where
    there is none. shear: two numbers, see profiles.gather; blur: of edges, px. least: contrast
    below which no answer is wanted. predicted: a block should be here, so light beside it may be a
    lamp's (see glow); a light that nobody expects may be a lamp alone. u, v: where it is expected,
    px; within `close` px of it nothing else is, as it was seen there just now. home_u, home_v:
    where it rested, NaN for not known. table: see outline; usual: see usual_outline.
    """

    half: float
    half_sigma: float
    tight: float
    shear: tuple[float, float]
    blur: float
    least: float
    predicted: bool
    u: float
    v: float
    close: float
    home_u: float
    home_v: float
    table: np.ndarray
    usual: np.ndarray


class Room(NamedTuple):
    """Scratch of fits.

    work, ends, spread: see profiles; normal (4, 4), step (4,), shares (4,): a, b and shares of
    _agree; second (FIELDS,): of a second attempt.
    """

    work: np.ndarray
    ends: np.ndarray
    normal: np.ndarray
    step: np.ndarray
    shares: np.ndarray
    spread: np.ndarray
    second: np.ndarray


@njit(inline='always')
def room(work, ends):
    """Return scratch for all fits of an image, with that of profiles.workspace."""
    spread, second = np.zeros(profiles.SPREAD), np.zeros(FIELDS)
    return Room(work, ends, np.zeros((4, 4)), np.zeros(4), np.zeros(4), spread, second)


class _Place(NamedTuple):
    u: float
    v: float
    theta: float
    half: float


class _Vote(NamedTuple):
    """Agreeing share of all profiles, variance of one in units of its weight, last width in px."""

    share: float
    variance: float
    width: float


class _Light(NamedTuple):
    """Sides as they were read, contrast of the block, and level inside, grey levels."""

    sides: profiles.Sides
    contrast: float
    level: float


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
def _agree(work, ends, a, b, shares, half_off, half_sigma, wide, narrow, widest, rounds):
    """Find the step (du, dv, dtheta, dhalf) that most profiles agree on.

    Iteratively reweighted least squares of offset = n.dc - t dtheta + dhalf with Tukey's weight,
    whose width falls from `wide` px to six robust standard deviations (but `narrow` to `widest`).
    half_off, half_sigma: prior on the half side. `shares` (4,) receives the agreeing share of
    each side, b (4,) the step, a[0, 0] and a[1, 1] the variances of du and dv but for that of a
    profile.
    """
    n = ends[LANES]
    b[:] = 0.0
    zero, one = np.float32(0.0), np.float32(1.0)
    weight_sum = weighted = zero
    for i in range(n):
        weight_sum += work[WEIGHT + i]
        weighted += one if work[WEIGHT + i] > zero else zero
    if weighted < 8:
        return _Vote(0.0, 1.0, wide)
    mean_weight = weight_sum / weighted
    width = wide
    variance = 1.0
    for r in range(rounds):
        spread, total = _normal_equations(work, n, b, width, a, b)
        if total < 6.0:
            return _Vote(0.0, 1.0, wide)
        variance = max(spread / max(total - 4.0, 1.0), 1e-12)
        # priors in the same units of weight: the half side, and a step that nothing speaks of is 0
        a[3, 3] += variance / (half_sigma * half_sigma)
        b[3] += half_off * variance / (half_sigma * half_sigma)
        a[0, 0] += variance / 9.0
        a[1, 1] += variance / 9.0
        a[2, 2] += variance / 0.04
        _solve(a, b)
        if r < rounds - 1:
            width = max(min(6.0 * math.sqrt(variance / mean_weight), widest), narrow, 0.5 * width)
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
    return _Vote(agree / max(ends[ALL], 1), variance, width)


@njit(inline='always')
def _solve(a, b):
    """Solve a x = b for a symmetric positive `a` (4, 4) of which the lower half is given.

    `b` receives x; a[0, 0] and a[1, 1] receive those of the inverse. By L D L' from the last row to
    the first: what the place needs of the inverse are then the last pivots.
    """
    p3 = 1.0 / max(a[3, 3], TINY)
    l32, l31, l30 = a[3, 2] * p3, a[3, 1] * p3, a[3, 0] * p3
    p2 = 1.0 / max(a[2, 2] - a[3, 2] * l32, TINY)
    c21, c20 = a[2, 1] - a[3, 1] * l32, a[2, 0] - a[3, 0] * l32
    l21, l20 = c21 * p2, c20 * p2
    p1 = 1.0 / max(a[1, 1] - a[3, 1] * l31 - c21 * l21, TINY)
    c10 = a[1, 0] - a[3, 0] * l31 - c20 * l21
    l10 = c10 * p1
    p0 = 1.0 / max(a[0, 0] - a[3, 0] * l30 - c20 * l20 - c10 * l10, TINY)
    y2 = b[2] - l32 * b[3]
    y1 = b[1] - l31 * b[3] - l21 * y2
    y0 = b[0] - l30 * b[3] - l20 * y2 - l10 * y1
    x0 = y0 * p0
    x1 = y1 * p1 - l10 * x0
    x2 = y2 * p2 - l21 * x1 - l20 * x0
    b[3] = b[3] * p3 - l32 * x2 - l31 * x1 - l30 * x0
    b[0], b[1], b[2] = x0, x1, x2
    a[0, 0], a[1, 1] = p0, p1 + l10 * l10 * p0


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


@njit(inline='always')
def _vote(room, half_off, half_sigma, wide, narrow, widest, rounds):
    return _agree(
        room.work, room.ends, room.normal, room.step, room.shares, half_off, half_sigma, wide,
        narrow, widest, rounds,
    )  # fmt: skip


@njit(inline='always')
def _moved(place, step, part):
    """Return `place` moved by `part` of a step."""
    return _Place(
        place.u + part * step[0],
        place.v + part * step[1],
        place.theta + part * step[2],
        place.half + part * step[3],
    )


@njit(inline='always')
def _place_variance(room):
    """Return the variance of what _agree found for the place, in units of a profile's."""
    return 0.5 * (room.normal[0, 0] + room.normal[1, 1])


@njit(inline='always')
def _worst(shares):
    return min(min(shares[0], shares[1]), min(shares[2], shares[3]))


@njit(inline='always')
def _search(image, place, known, searches, room):
    """Look for the steepest edges about `place`; return where they agree, and whether they do."""
    work, ends = room.work, room.ends
    for _ in range(searches):
        u, v, theta, half = place
        profiles.gather(image, u, v, theta, half, known.blur, known.shear, known.table, work, ends)
        profile_steps.search(work, ends, abs(cos(theta)))
        sigma = max(known.half_sigma, 0.02 * half)
        vote = _vote(room, known.half - half, sigma, SEARCH_PX, SEARCH_NARROW_PX, math.inf, 5)
        if vote.share < FOUND:
            return place, False
        u, v, theta, half = _moved(place, room.step, 1.0)
        if theta > math.pi / 4:  # sides keep their rows and columns
            theta -= math.pi / 2
        elif theta <= -math.pi / 4:
            theta += math.pi / 2
        place = _Place(u, v, theta, half)
    return place, True


@njit(inline='always')
def _read(image, place, known, recalled, room):
    """Read the profiles at `place`, and the light along them; a contrast of 0: no square is here.

    recalled: without those whose light is not as usual.
    """
    work, ends, spread = room.work, room.ends, room.spread
    u, v, theta, half = place
    profiles.gather(image, u, v, theta, half, known.blur, known.shear, known.table, work, ends)
    sides = profiles.sides_of(theta, half, known.blur, known.table[0] > 0.0)
    contrast, level = profiles.levels(work, ends, sides, spread)
    if recalled and contrast > 0.0:
        usual_outline.mute_unlike(work, ends, half, contrast, known.usual)
        contrast, level = profiles.levels(work, ends, sides, spread)
    least = 0.0 if recalled else known.least
    if contrast == 0.0 or contrast < least:
        return _Light(sides, 0.0, 0.0)
    if sides.soft:
        profile_steps.saturate_alike(work, ends, sides)
    profiles.shrink_levels(work, ends, spread, sides.soft)
    return _Light(sides, contrast, level)


@njit(inline='always')
def _round(place, light, known, sigma, wide, rounds, recalled, room):
    """Let the profiles as they were read vote by how far their edges lie from `place`; see _agree.

    sigma: px to which the half side is known. recalled: edges are expected where they usually are.
    """
    profile_steps.offsets(room.work, room.ends, light.sides, room.spread, light.contrast)
    half = known.half
    if recalled:
        usual_outline.recall(room.work, room.ends, place.half, known.usual)
        half += known.usual[usual_outline.WIDER]
    widest = WIDEST_PX if usual_outline.trusted(known.usual) else math.inf
    return _vote(room, half - place.half, sigma, wide, NARROW_PX, widest, rounds)


@njit(inline='always')
def _settle(image, place, known, room):
    """Measure the square at `place` until it stays; a share of 0 means no square there."""
    step, settled = room.step, SETTLED_SIGMAS
    if known.table[0] > 0.0:
        settled = SOFT_SETTLED_SIGMAS
    none = vote = _Vote(0.0, 1.0, 0.0)
    light = _Light(profiles.sides_of(place.theta, place.half, known.blur, False), 0.0, 0.0)
    for reading in range(4):
        light = _read(image, place, known, False, room)
        if light.contrast == 0.0:
            return place, none, light
        far = 0.0
        for r in range(4):
            wide, rounds = (FIRST_PX, 4) if r == 0 and reading == 0 else (WIDE_PX, 3)
            vote = _round(place, light, known, known.half_sigma, wide, rounds, False, room)
            if vote.share < HOPELESS:
                return place, none, light
            _follow(room.work, room.ends[LANES], step)
            place = _moved(place, step, 1.0)
            change = max(abs(step[0]) + abs(step[1]), abs(step[2]) * place.half)
            far += change
            sigma = math.sqrt(vote.variance * _place_variance(room))
            if change < SETTLED_PX or (far < SETTLED_MOST_PX and change < settled * sigma):
                break
        if far < 0.2 or (far < 0.7 and vote.share > WHOLE):  # levels were read in the right place
            break
    return place, vote, light


@njit(inline='always')
def _in_glow(place, vote, light, known, around, room):
    """Measure a square once more with its lines in a lamp's glow, if all of it is in sight then.

    Returns its place, the vote, and the share of the lines that were let in.
    """
    work, ends, step, shares = room.work, room.ends, room.step, room.shares
    lit = glow.admit(work, ends, light.sides, place.u, place.v, around, known.usual, shares)
    if lit == 0.0:
        return place, vote, 0.0
    there = place
    for _ in range(ROUNDS):
        vote = _round(there, light, known, known.half_sigma, WIDE_PX, 4, False, room)
        _follow(work, ends[LANES], step)
        there = _moved(there, step, 1.0)
    if vote.share >= HOPELESS and _worst(shares) * around >= glow.LEAST:
        return there, vote, lit
    # they stand elsewhere than the others
    step[0], step[1] = place.u - there.u, place.v - there.v
    step[2], step[3] = place.theta - there.theta, place.half - there.half
    _follow(work, ends[LANES], step)
    glow.mute(work, ends)
    vote = _round(place, light, known, known.half_sigma, WIDE_PX, 3, False, room)
    return place, vote, 0.0


@njit(inline='always')
def _recall(image, place, light, known, by_light, room):
    """Measure a square by what is usual of it, `by_light` without lines that an arm touches."""
    vote = _Vote(0.0, 1.0, 0.0)
    for _ in range(ROUNDS):
        read = _read(image, place, known, by_light, room)
        if read.contrast == 0.0:
            return place, _Vote(0.0, 1.0, 0.0)
        read = _Light(read.sides, light.contrast, light.level)
        vote = _round(place, read, known, known.tight, WIDE_PX, 4, True, room)
        if vote.share < HOPELESS:
            break
        place = _moved(place, room.step, 1.0)
        if abs(room.step[0]) + abs(room.step[1]) < NEAR_PX:  # levels were read in the right place
            break
    return place, vote


@njit(inline='always')
def _by_size(place, vote, light, known, room):
    """Measure a square once more by the size that a calibration gives, if it needs that.

    An arm along one side moves it, or has its edge taken for that side: what is known of the size
    speaks for the side across. Returns its place, the vote, how much of this counts, 0..1, and the
    variance of its place, see _place_variance; a share of 0 means no square there.
    """
    noise = _place_variance(room)
    if known.tight <= 0:
        return place, vote, 1.0, noise
    missized = math.fabs(place.half - known.half) / MISSIZED_PX - 1.0
    part = min(max((WHOLE - vote.share) / GRADUALLY, missized), 1.0)
    if part <= 0.0:
        return place, vote, 1.0, noise
    slope, lean = abs(cos(place.theta)), -tan(place.theta)
    sides = profiles.Sides(slope, lean, light.sides.limit, known.blur, light.sides.soft)
    sized = _Light(sides, light.contrast, light.level)
    vote = _round(place, sized, known, known.tight, SIZED_PX, 4, False, room)
    noise += part * (_place_variance(room) - noise)
    return _moved(place, room.step, part), vote, part, noise


@njit(inline='always')
def _doubt(vote, share, touched, lit, noise, soft, room):
    """Return the variance of a place, px^2, and by how much more it errs than noise explains."""
    scatter = misfit = 1.0
    if touched < 1.0 and not soft:
        scatter = vote.variance * _alike(room.work, room.ends, room.step)
    elif touched < 1.0 and share < WHOLE:
        # what noise alone explains, and how much further an arm may have led it: see MISFIT
        partly = min((WHOLE - share) / GRADUALLY, 1.0)
        alike = max(vote.variance * _alike(room.work, room.ends, room.step), 1.0)
        scatter = 1.0 + partly * (alike - 1.0)
        misfit = 1.0 + (1.0 - touched) * (math.sqrt(scatter) - 1.0)
    scatter *= noise
    if lit > 0.0:
        led = lit * LAMP_LEADS_PX * LAMP_LEADS_PX
        misfit *= math.sqrt(1.0 + led / scatter)
        scatter += led
    return scatter, misfit


@njit(inline='always')
def _as_usual(image, place, light, known, share, scatter, led, touched, aside, off, astray, room):
    """Measure a square by what is usual of it, without the lines that arms touch.

    led: variance of its place if that tells nothing, px^2; off: how far it is from where it was
    expected, px; astray: it was seen there just now, and this is elsewhere. Returns its place, the
    variance of that, and by how much it may stand aside, px; a variance of 0: they are edges of an
    arm, more likely than not.
    """
    work, ends, step, usual = room.work, room.ends, room.step, known.usual
    soft, told = light.sides.soft, share > MORE_THAN_AN_ARM
    there, vote = _recall(image, place, light, known, True, room)
    unlike, unsure = SOFT_STRETCH_PX if soft else STRETCH_PX, 0.0
    # not of flat covers: on glittering sandpaper no stretch stays like itself
    if soft and touched == 1.0 and share < MORE_THAN_AN_ARM:
        doubted = share < MORE_THAN_AN_ARM * usual[usual_outline.SHARE]
        if vote.share < HOPELESS:  # hardly a line has its usual light: by their places alone
            there, vote = _recall(image, place, light, known, False, room)
            doubted, unsure = True, ARM_LEADS_PX * ARM_LEADS_PX
        if doubted and (
            vote.share < HOPELESS
            or usual_outline.evidence(work, ends, there.half, step, vote.width, unlike, usual) < 0.0
        ):
            return place, 0.0, aside
    recalled = np.inf
    if vote.share >= HOPELESS:
        recalled = RUN * usual_outline.mean_weight(work, ends) * unlike * unlike
        recalled += max(vote.variance * _alike(work, ends, step), 1.0 if soft else 0.0)
        recalled = recalled * _place_variance(room) + unsure
    # too little is as it was, and more is in sight than an arm shows, or it is where it was
    another = hypot(there.u - place.u, there.v - place.v) > ANOTHER_PX and not astray
    if vote.share < HOPELESS or (told and (recalled > led or another)):
        scatter += touched * (led - scatter)
    elif off < known.close and share > SHOWN and led < SHOWN_PX**2 < recalled:
        scatter += touched * (SHOWN_PX**2 - scatter)
    else:
        more, sigma = there.half - known.half, math.sqrt(vote.variance * _place_variance(room))
        left = usual_outline.aside(work, ends, there.half, more, step, sigma, True, usual)
        if aside > left:  # the light has told which side an arm hides
            shown = min(aside / usual_outline.NARROW_PX, 1.0) * (1.0 - left / aside)
            touched = max(touched, shown)
        aside += touched * (left - aside)
        place = _Place(
            place.u + touched * (there.u - place.u),
            place.v + touched * (there.v - place.v),
            place.theta + touched * (there.theta - place.theta),
            place.half + touched * (there.half - place.half),
        )
        scatter += touched * (recalled - scatter)
    return place, scatter + aside * aside, aside


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _fit(image, square, place, known, beats, room):
    """Fit one square from `place`; see fit_square. beats: the share that it must exceed."""
    work, ends, step, shares, spread = room.work, room.ends, room.step, room.shares, room.spread
    usual = known.usual
    for k in range(VISIBLE, FIELDS):
        square[k] = 0.0
    place, vote, light = _settle(image, place, known, room)
    if vote.share == 0.0:
        return
    soft = light.sides.soft
    texture, around, glare = spread[TEXTURE_OUT], spread[AROUND], spread[GLARE]
    flat, steep = SOFT_FALLING if soft else FALLING
    sharp = 1.0 - min(max(steep * (spread[FALL] - flat), 0.0), 1.0)
    lit = 0.0
    lamp = glare > glow.LAMP or (not soft and light.contrast > glow.BRIGHTER * known.least)
    # where three sides stand in the dark, these tell better
    if known.predicted and lamp and vote.share < THREE_SIDES:
        place, vote, lit = _in_glow(place, vote, light, known, around, room)
    noise = _place_variance(room)
    free_half, free_share = place.half, vote.share
    touched = aside = 0.0
    off = hypot(place.u - known.u, place.v - known.v)
    astray = off > known.close > 0.0  # as an arm's edge may lead it that is taken for a side
    if not astray:
        usual_outline.outgrow(usual, free_share * around)
    if known.tight > 0 and lit == 0.0:
        touched = usual_outline.touched(usual, free_share * around, texture)
        sigma, more = math.sqrt(vote.variance * noise), free_half - known.half
        aside = usual_outline.aside(work, ends, free_half, more, step, sigma, False, usual)
    if touched < 1.0:
        place, vote, part, noise = _by_size(place, vote, light, known, room)
        if vote.share == 0.0:
            return
        usual_outline.learn(
            work, ends, place.u, place.v, place.half, place.half - known.half, step, part,
            vote.width, free_share * around, texture, aside, lit, usual,
        )  # fmt: skip
    else:
        usual_outline.forget(usual)
    share = min(vote.share * around, 1.0)
    if share <= beats:
        return
    s0, s1 = min(shares[0] * around, 1.0), min(shares[1] * around, 1.0)
    s2, s3 = min(shares[2] * around, 1.0), min(shares[3] * around, 1.0)
    scatter, misfit = _doubt(vote, share, touched, lit, noise, soft, room)
    if touched > 0.0 or aside > 0.0:
        led = max(scatter, vote.variance * noise) + ARM_LEADS_PX * ARM_LEADS_PX
        place, scatter, aside = _as_usual(
            image, place, light, known, share, scatter, led, touched, aside, off, astray, room
        )
        if scatter == 0.0:
            return
    both_ways = min(max(s0, s2), max(s1, s3))
    missized = (free_half - known.half) / (3.0 * known.half_sigma + 0.04 * known.half)
    square[U], square[V], square[THETA], square[HALF] = place
    square[VISIBLE], square[SIGMA], square[MISFIT] = share, math.sqrt(scatter), misfit
    square[QUALITY] = share * both_ways * exp(-0.5 * missized * missized) * sharp
    square[CONTRAST], square[LEVEL], square[ASIDE] = light.contrast, light.level, aside
    square[WORST] = min(min(s0, s1), min(s2, s3))
    # covers do not overlap: light like a cover's just outside says that this is half beside one
    square[ALONE] = 1.0 if share > ALONE_FROM else max(1.0 - 5.0 * glare, 0.0)


@njit(inline='always')
def _search_another(image, place, square, known, room):
    """Search about `place` for edges; return where they agree, and whether `square` is not there.

    From where it is a fit would only find it again.
    """
    for _ in range(2):
        place, found = _search(image, place, known, 1, room)
        turn = place.theta - square[THETA]
        turn -= round(turn / (math.pi / 2)) * math.pi / 2
        far = abs(place.u - square[U]) + abs(place.v - square[V]) + abs(turn) * place.half
        if not found or (square[VISIBLE] > 0.0 and far < AGAIN_PX):
            return place, False
    return place, True


@njit(inline='always')
def from_home(square, home_u, home_v):
    """Return how many half sides a square is from where its block rested; NaN: not known."""
    return hypot(square[U] - home_u, square[V] - home_v) / max(square[HALF], 1.0)


@njit(inline='always')
def near(square, u, v, within, home_u, home_v):
    """Return whether a square is within `within` px of `u`, `v`, and not away from its home.

    home_u, home_v: where the block rested, NaN: not known.
    """
    close = hypot(square[U] - u, square[V] - v) < within
    return close and not from_home(square, home_u, home_v) > CLOSE


@njit(inline='always')
def either(square, other, rested):
    """Return whether a block may as well be at an `other` square, of which less shows.

    rested: it is where the block rested, so that it need not be sure.
    """
    apart = hypot(square[U] - other[U], square[V] - other[V]) > CLOSE * square[HALF]
    most = min(EITHER_PX, SURER * square[SIGMA])
    shows = other[VISIBLE] >= FOUND and (rested or other[SIGMA] < most)
    return shows and apart and square[VISIBLE] < THREE_SIDES


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def fit_square(image, square, known, searches, room):
    """Fit a square to `image` (h, w) uint8 from `square` (FIELDS,): u, v, theta as expected.

    known: Known; room: Room. searches: rounds of rough search before the fit (0 when the start is
    good to 2 px; a block that was predicted and comes out poor is then searched for itself).

    `square` then holds u, v, theta, half, agreeing share of the edges, sigma px, quality, contrast,
    level inside, agreeing share of the worst side, how certainly no other cover's light stands
    beside it, the misfit: sigma over what noise alone would make of it, for covers with relief; and
    by how many px it may stand aside, since an arm hides one of two sides.
    A share of 0 means no square there, a quality of 0 none that is to be believed.
    """
    start = place = _Place(square[U], square[V], square[THETA], known.half)
    if searches > 0:
        place, _ = _search(image, start, known, searches, room)
    _fit(image, square, place, known, 0.0, room)
    lately = near(square, known.u, known.v, known.close, known.home_u, known.home_v)
    doubtful = square[VISIBLE] < (POOR if lately else DOUBTFUL)
    if known.predicted and searches == 0 and doubtful:
        place, another = _search_another(image, start, square, known, room)
        if another:
            beats, second = square[VISIBLE] + BETTER, room.second
            _fit(image, second, place, known, beats, room)
            if second[VISIBLE] > beats:
                if either(second, square, False):
                    square[QUALITY] = 0.0
                else:
                    square[:] = second
    square[THETA] -= round(square[THETA] / (math.pi / 2)) * math.pi / 2
