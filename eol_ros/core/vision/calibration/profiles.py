# SPDX-License-Identifier: Apache-2.0
"""Profiles of light across the sides of a square, and what each of them says.

Sides are read along whole pixels, never resampled, so each pixel counts once. Every profile
answers by a matched filter how far its edge lies from where it was expected, against the light
that stands there inside and outside.
"""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin, tan
from eol_ros.core.vision import outline

REACH_PX = 4.8  # of a profile at least, along the normal, to both sides of its edge
TAPS = 22  # pixels of a profile at 45 degrees
LINES = 384  # profiles of one square
VECTOR = 16  # lanes; each side begins with a new vector, and two lanes at least stay idle behind it
SIDE_LINES = 88  # of one side; a wider one is read on every second line
CORNER = 1.4  # blurs left out at each end of a side, where two edges mix
UNLIKE = 1.0  # of the variance from line to line, what differs between level zone and edge
OTHER, SOFT_OTHER = 0.1, 0.2  # of the contrast, light that is not the platform's
# And of an arm along half a side, of which it leaves hardly a line dark: grains are not so dense.
ARM, SOFT_ARM, HARDLY = 0.05, 0.1, 0.1
# Of the contrast that a quarter of all profiles exceeds, what each must have: half a cover with
# relief may be half as bright as the other, and light falls towards its corners to two thirds.
LEAST, SOFT_LEAST = 0.45, 0.3
# Beside a wall half as bright the sandpaper is 2 to 3 grey levels darker: of what tells the light
# outside of one side from that of all, what is believed. One would cost a tenth more noise.
OWN = 0.85
FLAT = 2.1  # blurs from the edge at which light counts as inside or outside
FLAT_TAPS = 6  # pixels at each end of a profile, among which are all that lie so far away
MIN_CONTRAST = 8.0  # grey levels

# Fields of the profiles, one after the other in one flat array: with distances that the compiler
# knows, it can tell that they do not overlap and turns every loop over profiles into vector code.
# Of two arrays it cannot: it then asks at run time where they lie, and where it is in doubt it goes
# a slower way whose sums have other last bits. No loop here may read one array and write another.
FIELDS = 13
(FIRST, T, VALID, IN, OUT, OFFSET, WEIGHT, _A, _B, _C, _D, _E, _F) = (
    k * LINES for k in range(FIELDS)
)
TAP = FIELDS * LINES  # then the pixels of the profiles, tap after tap

# `ends` holds where each side begins, all lanes, taps and lines of each side; then where in the
# image the lines of one side begin.
BEGIN, LANES, TAPS_USED, COUNT, PLACES = 0, 4, 5, 6, 10

# `spread` holds what levels finds of all profiles together: the variance of one pixel inside and
# outside, and the parts of them that are texture, which unlike noise is alike from pixel to pixel.
VARIANCE_IN, VARIANCE_OUT, TEXTURE_IN, TEXTURE_OUT = range(4)
SPREAD = 4


class Sides(NamedTuple):
    """How profiles cross the sides of a square, and what these look like.

    slope: by how many px each pixel is further outside than the one before; lean: px along the side
    for each px outwards; limit: px from the middle of a side, where the edge of another begins;
    blur: of edges, px; soft: of a cover with relief, whose light falls towards its edges.
    """

    slope: float
    lean: float
    limit: float
    blur: float
    soft: bool


@njit(inline='always')
def sides_of(theta, half, blur, soft):
    """Return the Sides of a square that `gather` has read."""
    return Sides(
        abs(cos(theta)),
        -tan(theta),
        half - CORNER * blur,
        blur,
        soft,
    )


def workspace() -> tuple[np.ndarray, np.ndarray]:
    """Return scratch arrays: `work` and `ends`."""
    ends = np.zeros(PLACES + SIDE_LINES + 1, np.int64)
    return np.zeros((FIELDS + TAPS) * LINES, np.float32), ends


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def gather(image, u, v, theta, half, blur, table, work, ends):
    """Copy the profiles of all sides into `work`, from TAP on (tap, line), running outwards.

    table: of outline, how far outside of the square the outline of a cover with relief stands.

    Fills first (d of the first tap), t, normal and validity of every line, and ends (see
    BEGIN). All sides cross their rows or columns at the same slant, so that d grows by cos(theta)
    from tap to tap, and t by -tan(theta) with d. The edge lies within half a pixel of the middle.
    """
    height, width = image.shape
    flat, places = image.reshape(height * width), ends[PLACES:]
    steep = abs(cos(theta))
    taps = min(2 * int(REACH_PX / steep + 0.5) + 2, TAPS)
    at = 0
    for side in range(4):
        angle = theta + side * math.pi / 2
        nu, nv = cos(angle), -sin(angle)
        tu, tv = -sin(angle), -cos(angle)
        along_row = side % 2 == 0  # sides 0 and 2 are steep: rows cross them
        fast, slow = (nu, nv) if along_row else (nv, nu)
        c_fast, c_slow = (u, v) if along_row else (v, u)
        t_fast, t_slow = (tu, tv) if along_row else (tv, tu)
        middle = c_slow + half * slow
        span = (half - CORNER * blur) * abs(t_slow)
        low = int(math.ceil(middle - span))
        high = int(math.floor(middle + span))
        stride = (high - low) // SIDE_LINES + 1
        n = (high - low) // stride + 1 if high >= low else 0
        step = 1 if fast > 0 else -1
        fast_size, slow_size = (width, height) if along_row else (height, width)
        ends[BEGIN + side], ends[COUNT + side] = at, n
        whole = (n + 2 + VECTOR - 1) // VECTOR * VECTOR
        # places along the line are counted from a whole pixel near the centre: float32 is enough
        base = math.floor(c_fast)
        f_middle, f_low = np.float32(c_fast - base), np.float32(low - c_slow)
        f_stride, f_half, f_slow = np.float32(stride), np.float32(half), np.float32(slow)
        f_fast, per_fast = np.float32(fast), np.float32(1.0 / fast)
        f_tf, f_ts = np.float32(t_fast), np.float32(t_slow)
        back = np.float32(0.5 - step * (taps - 1) * 0.5)
        # first pixels between these lie in the image with all that follow, and lines between those
        reach = step * (taps - 1)
        least = np.float32(max(0, -reach) - base)
        most = np.float32(fast_size - 1 - max(0, reach) - base)
        from_line = np.float32(max(-low, 0)) / f_stride
        to_line = np.float32(slow_size - 1 - low) / f_stride
        zero, one = np.float32(0.0), np.float32(1.0)
        last = np.float32(n - 1)
        lines = work[at:]  # indices that are plainly not negative: else each would be tested
        for i in range(whole):
            line = np.float32(i)
            along = f_low + line * f_stride
            edge = (f_half - f_slow * along) * per_fast  # from the centre
            t = edge * f_tf + along * f_ts
            start = np.floor(f_middle + edge + back)
            valid = one if start >= least else zero
            valid = valid if start <= most else zero
            valid = valid if line >= from_line else zero
            valid = valid if line <= to_line else zero
            valid = valid if line <= last else zero
            lines[VALID + i] = valid
            lines[FIRST + i] = f_fast * (start - f_middle - edge)
            lines[T + i] = t
            lines[_F + i] = start
        if table[0] > zero:
            tilt = np.float32(-tan(theta))
            for i in range(n):
                line = np.float32(i)
                along = f_low + line * f_stride
                edge = (f_half - f_slow * along) * per_fast
                t = lines[T + i]
                away = outline.outside(table, side, t)
                if away == outline.NONE:
                    lines[VALID + i] = zero
                    continue
                t += away * tilt
                start = np.floor(f_middle + edge + away * per_fast + back)
                inside = start >= least and start <= most and line >= from_line
                lines[VALID + i] = one if inside and line <= to_line else zero
                lines[FIRST + i] = f_fast * (start - f_middle - edge) - away
                lines[T + i] = t
                lines[_F + i] = start
        # Now the pixels, tap after tap: one line after the other would write far apart. By unsigned
        # indices: signed ones would be tested for being negative.
        ahead = step if along_row else step * width
        anywhere = 0 if step > 0 else height * width - 1
        for i in range(n):
            row, pixel = low + i * stride, int(lines[_F + i]) + int(base)
            place = row * width + pixel if along_row else pixel * width + row
            places[i] = place if lines[VALID + i] > zero else anywhere
        for k in range(taps):
            pixels, further = lines[TAP + k * LINES :], np.uint64(k * ahead)
            for i in range(n):
                pixels[i] = flat[np.uint64(places[i]) + further]
        for i in range(n):
            if lines[VALID + i] == zero:
                for k in range(taps):
                    lines[TAP + k * LINES + i] = zero
        at += whole
    ends[LANES], ends[TAPS_USED] = at, taps


# What these take are values, not places in `work`: where a number that is known while compiling
# is part of an index, loops over them do not become vector code.
@njit(inline='always')
def _inside(pixel, before, first, away, t, cut, sums):
    """Add `pixel`, `away` from its edge and after `before`, to sums of differences to `first`."""
    one, zero = np.float32(1.0), np.float32(0.0)
    lean, limit, flat = cut
    w = one if abs(t + away * lean) <= limit else zero
    w = w if away < -flat else zero
    change = w * (pixel - before)
    x = w * (pixel - first)
    n, light, rough, square = sums
    return n + w, light + x, rough + change * change, square + x * x


@njit(inline='always')
def _outside(pixel, last, away, t, cut, sums):
    """As _inside, of differences to `last`."""
    one, zero = np.float32(1.0), np.float32(0.0)
    lean, limit, flat = cut
    w = one if abs(t + away * lean) <= limit else zero
    w = w if away > flat else zero
    x = w * (pixel - last)
    n, light, square = sums
    return n + w, light + x, square + x * x


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _zones(work, n, taps, sides):
    """Sum each profile's pixels inside and outside: counts to A and C, sums to B and D.

    Sums are of differences to the innermost and the outermost pixel, so that their squares, to
    OFFSET and WEIGHT, keep their digits. To E the squared changes from pixel to pixel inside.
    Left out is what lies further along the side than its limit.
    """
    f_slope, f_lean = np.float32(sides.slope), np.float32(sides.lean)
    f_limit, f_flat = np.float32(sides.limit), np.float32(FLAT * sides.blur)
    zero = np.float32(0.0)
    # all FLAT_TAPS pixels in one go: sums stay in registers, and loops over profiles vector code
    cut = f_lean, f_limit, f_flat
    d1, d2, d3 = f_slope, f_slope * np.float32(2), f_slope * np.float32(3)
    d4, d5 = f_slope * np.float32(4), f_slope * np.float32(5)
    for i in range(n):
        d, t, sums = work[FIRST + i], work[T + i], (zero, zero, zero, zero)
        p0, p1, p2 = work[TAP + i], work[TAP + LINES + i], work[TAP + 2 * LINES + i]
        p3, p4 = work[TAP + 3 * LINES + i], work[TAP + 4 * LINES + i]
        p5 = work[TAP + 5 * LINES + i]
        sums = _inside(p0, p0, p0, d, t, cut, sums)
        sums = _inside(p1, p0, p0, d + d1, t, cut, sums)
        sums = _inside(p2, p1, p0, d + d2, t, cut, sums)
        sums = _inside(p3, p2, p0, d + d3, t, cut, sums)
        sums = _inside(p4, p3, p0, d + d4, t, cut, sums)
        sums = _inside(p5, p4, p0, d + d5, t, cut, sums)
        work[_A + i], work[_B + i], work[_E + i], work[OFFSET + i] = sums
    outside = work[TAP + (taps - FLAT_TAPS) * LINES :]
    start = f_slope * np.float32(taps - FLAT_TAPS)
    d0, d1, d2, d3, d4, d5 = start, start + d1, start + d2, start + d3, start + d4, start + d5
    for i in range(n):
        d, t, beyond = work[FIRST + i], work[T + i], (zero, zero, zero)
        p0, p1, p2 = outside[i], outside[LINES + i], outside[2 * LINES + i]
        p3, p4, p5 = outside[3 * LINES + i], outside[4 * LINES + i], outside[5 * LINES + i]
        beyond = _outside(p0, p5, d + d0, t, cut, beyond)
        beyond = _outside(p1, p5, d + d1, t, cut, beyond)
        beyond = _outside(p2, p5, d + d2, t, cut, beyond)
        beyond = _outside(p3, p5, d + d3, t, cut, beyond)
        beyond = _outside(p4, p5, d + d4, t, cut, beyond)
        beyond = _outside(p5, p5, d + d5, t, cut, beyond)
        work[_C + i], work[_D + i], work[WEIGHT + i] = beyond


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _quantiles(work, n, contrasts, bares):
    """Return the grey levels that so many valid profiles exceed: of IN - OUT, and of OUT.

    By quartering 0..256 four times: counting is vector code, a histogram is not.
    """
    zero, two, three = np.float32(0.0), np.float32(2.0), np.float32(3.0)
    step = np.float32(64.0)
    low = base = zero
    for _ in range(4):
        a1, a2, a3 = low + step, low + two * step, low + three * step
        b1, b2, b3 = base + step, base + two * step, base + three * step
        n1 = n2 = n3 = m1 = m2 = m3 = zero
        for i in range(n):
            valid, outer = work[VALID + i], work[OUT + i]
            contrast = work[IN + i] - outer
            n1 += valid if contrast > a1 else zero
            n2 += valid if contrast > a2 else zero
            n3 += valid if contrast > a3 else zero
            m1 += valid if outer > b1 else zero
            m2 += valid if outer > b2 else zero
            m3 += valid if outer > b3 else zero
        low += (
            (step if n1 > contrasts else zero)
            + (step if n2 > contrasts else zero)
            + (step if n3 > contrasts else zero)
        )
        base += (
            (step if m1 > bares else zero)
            + (step if m2 > bares else zero)
            + (step if m3 > bares else zero)
        )
        step *= np.float32(0.25)
    return float(low + two * step), float(base + two * step)


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def _mute_covered(work, ends, dark):
    """Clear VALID of each half of a side beside which hardly a line is as dark as `dark`."""
    zero, one = np.float32(0.0), np.float32(1.0)
    for half in range(8):
        begin, n = ends[BEGIN + half // 2], ends[COUNT + half // 2]
        first, last = (0, n // 2) if half % 2 == 0 else (n // 2, n)
        lines = work[begin + first :]
        valid = bare = zero
        for i in range(last - first):
            valid += lines[VALID + i]
            bare += lines[VALID + i] if lines[OUT + i] <= dark else zero
        keep = one if bare >= np.float32(HARDLY) * valid else zero
        for i in range(last - first):
            lines[VALID + i] *= keep


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def levels(work, ends, sides, spread):
    """Measure the light inside and outside along every profile, and judge which ones show an edge.

    Fills IN, OUT and `spread` (SPREAD,), and clears VALID of profiles that show no edge like the
    others. Returns (contrast, level inside) of the block, or zeros.
    """
    soft = sides.soft
    wide, taps = ends[LANES], ends[TAPS_USED]
    outermost = work[TAP + (taps - 1) * LINES :]
    _zones(work, wide, taps, sides)
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    total = zero
    for i in range(wide):
        a, c = work[_A + i], work[_C + i]
        full = one if a >= two else zero
        full = full if c >= two else zero
        valid = full * work[VALID + i]
        work[VALID + i] = valid
        total += valid
        work[IN + i] = work[TAP + i] + work[_B + i] / (a if a > one else one)
        work[OUT + i] = outermost[i] + work[_D + i] / (c if c > one else one)
    if total < 8.0:
        return 0.0, 0.0
    # the contrast that a quarter of all profiles exceeds: right as long as a quarter is in sight;
    # and the platform's own light about here: where more stands outside, it may be an arm's edge
    contrast, bare = _quantiles(work, wide, np.float32(0.25) * total, np.float32(0.75) * total)
    if contrast < MIN_CONTRAST:
        return 0.0, 0.0
    _mute_covered(work, ends, np.float32(bare + max((SOFT_ARM if soft else ARM) * contrast, 4.0)))
    bare = np.float32(bare + max((SOFT_OTHER if soft else OTHER) * contrast, 4.0))
    low, high = np.float32((SOFT_LEAST if soft else LEAST) * contrast), np.float32(2.0 * contrast)
    mean_in = count = zero
    for i in range(wide):
        step = work[IN + i] - work[OUT + i]
        valid = work[VALID + i] if step >= low else zero
        valid = valid if step <= high else zero
        valid = valid if work[OUT + i] <= bare else zero
        work[VALID + i] = valid
        mean_in += valid * work[IN + i]
        count += valid
    if count < 8.0:
        return 0.0, 0.0
    mean_in /= count
    near = np.float32(1e9 if soft else 0.5 * contrast)
    v_in = v_out = k_in = k_out = changes = zero
    for i in range(wide):
        valid = work[VALID + i] if abs(work[IN + i] - mean_in) <= near else zero
        work[VALID + i] = valid
    for i in range(wide):  # apart from what is written: `outermost` might be part of that
        valid = work[VALID + i]
        off_in, off_out = work[IN + i] - work[TAP + i], work[OUT + i] - outermost[i]
        v_in += valid * (work[OFFSET + i] - work[_B + i] * off_in)
        v_out += valid * (work[WEIGHT + i] - work[_D + i] * off_out)
        k_in += valid * (work[_A + i] - one)
        changes += valid * work[_E + i]
        k_out += valid * (work[_C + i] - one)
    inner, outer = max(float(k_in), 1.0), max(float(k_out), 1.0)
    spread[VARIANCE_IN] = max(v_in / inner, 0.25)
    spread[VARIANCE_OUT] = max(v_out / outer, 0.25)
    # the innermost pixel has no neighbour, so there are as many changes as degrees of freedom
    noise = max(0.55 * changes / inner, spread[VARIANCE_OUT])
    spread[TEXTURE_IN] = max(spread[VARIANCE_IN] - noise, 0.0)
    spread[TEXTURE_OUT] = 0.0
    return contrast, mean_in


@njit(inline='always')
def _smooth(work, n, column, taps, variance):
    """Draw the levels in `column` to their mean; return what of their variance is not noise."""
    zero, one = np.float32(0.0), np.float32(1.0)
    total = count = zero
    for i in range(n):
        total += work[VALID + i] * work[column + i]
        count += work[VALID + i]
    if count < one:
        return 0.0
    mean = total / count
    seen = noise = zero
    for i in range(n):
        v0, v1, v2, v3, v4 = (
            work[VALID + i - 2],
            work[VALID + i - 1],
            work[VALID + i],
            work[VALID + i + 1],
            work[VALID + i + 2],
        )
        used = v0 + v1 + v2 + v3 + v4
        light = (
            v0 * work[column + i - 2]
            + v1 * work[column + i - 1]
            + v2 * work[column + i]
            + v3 * work[column + i + 1]
            + v4 * work[column + i + 2]
        )
        pixels = (
            v0 * work[taps + i - 2]
            + v1 * work[taps + i - 1]
            + v2 * work[taps + i]
            + v3 * work[taps + i + 1]
            + v4 * work[taps + i + 2]
        )
        off = light / (used if used > one else one) - mean
        off = off if v2 > zero else zero
        work[_B + i] = off
        seen += off * off
        noise += v2 / (pixels if pixels > one else one)
    noise *= np.float32(1.25 * variance)
    keep = max(one - noise / seen, zero) if seen > zero else zero
    for i in range(n):
        level = mean + keep * work[_B + i]
        work[column + i] = level if work[VALID + i] > zero else work[column + i]
    return max(seen - noise, zero) / count


@njit(inline='always')
def _beside_sides(work, ends):
    """Fill _F with what of the light outside of each side is its own."""
    total = light = np.float32(0.0)
    for side in range(4):
        lines = work[ends[BEGIN + side] :]
        mine = count = np.float32(0.0)
        for i in range(ends[COUNT + side]):
            mine += lines[VALID + i] * lines[OUT + i]
            count += lines[VALID + i]
        light += mine
        total += count
        mine /= max(count, np.float32(1.0))
        for i in range(ends[COUNT + side]):
            lines[_F + i] = np.float32(OWN) * mine
    light *= np.float32(OWN) / max(total, np.float32(1.0))
    for i in range(ends[LANES]):
        work[_F + i] -= light


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def shrink_levels(work, ends, spread, soft):
    """Replace the level of each profile by one that owes no more to noise than it must.

    Neighbours are averaged over five lines; the result is drawn to the block's mean as far as the
    variation seen can be noise (James and Stein 1961). Common levels cancel between opposite sides.
    soft: of a cover with relief the light outside of each side is drawn to that side's own, see
    OWN.
    """
    n = ends[LANES]
    work[VALID - 2] = work[VALID - 1] = 0.0  # what stands before the first line
    if soft:
        _beside_sides(work, ends)
        for i in range(n):
            work[OUT + i] -= work[_F + i]
    # light that differs from line to line differs as well from the level zone to the edge
    spread[TEXTURE_IN] += UNLIKE * _smooth(work, n, IN, _A, spread[VARIANCE_IN])
    spread[TEXTURE_OUT] += UNLIKE * _smooth(work, n, OUT, _C, spread[VARIANCE_OUT])
    if soft:
        for i in range(n):
            work[OUT + i] += work[_F + i]
