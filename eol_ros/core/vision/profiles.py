# SPDX-License-Identifier: Apache-2.0
"""Profiles of light across the sides of a square, and what each of them says.

Sides are read along whole pixels, never resampled, so each pixel counts once. Every profile
answers by a matched filter how far its edge lies from where it was expected, against the light
that stands there inside and outside. For axes and signs see edges.
"""

import math

import numpy as np
from numba import njit

REACH_PX = 4.8  # of a profile at least, along the normal, to both sides of its edge
TAPS = 22  # pixels of a profile at 45 degrees
LINES = 384  # profiles of one square, in whole vectors
SIDE_LINES = 88  # of one side; a wider one is read on every second line
CORNER = 1.4  # blurs left out at each end of a side, where two edges mix
EDGE = 2.4  # blurs from the edge over which the light inside counts as one level
ROUGH = 0.1  # share of the texture's variance that is new from pixel to pixel
UNLIKE = 1.0  # of the variance from line to line, what differs between level zone and edge
OTHER = 0.2  # of the contrast, light that is not the platform's
FLAT = 2.1  # blurs from the edge at which light counts as inside or outside
MIN_CONTRAST = 8.0  # grey levels

# Fields of the profiles, one after the other in one flat array: with distances that the compiler
# knows, it can tell that they do not overlap and turns every loop over profiles into vector code.
# Of two arrays it cannot: it then asks at run time where they lie, and where it is in doubt it goes
# a slower way whose sums have other last bits. No loop here may read one array and write another.
(FIRST, T, NU, NV, VALID, IN, OUT, OFFSET, WEIGHT, _A, _B, _C, _D,
 _E, _F) = (k * LINES for k in range(15))
TAP = 15 * LINES  # then the pixels of the profiles, tap after tap


def workspace() -> tuple[np.ndarray, np.ndarray]:
    """Return scratch arrays of fit_squares, so that a live image allocates nothing."""
    return np.zeros((15 + TAPS) * LINES, np.float32), np.zeros(6, np.int64)


@njit(inline='always')
def padded(n):
    """Return `n` profiles rounded up to whole vectors; the lanes beyond are idle."""
    return min((n + 31) // 32 * 32, LINES)


@njit(cache=True, fastmath=True, error_model='numpy')
def gather(image, u, v, theta, half, blur, shear, work, ends):
    """Copy the profiles of all sides into `work`, from TAP on (tap, line), running outwards.

    shear (2,): how lens and tilt make the square a parallelogram here: a side of normal angle phi
    lies `half Re e` further out and leans by `Im e` on t, with e = shear exp(-2 i phi).

    Fills first (d of the first tap), t, normal and validity of every line; ends (6,): where each
    side begins, the number of lines in all, and of taps. All sides cross their rows or columns at
    the same slant, so that d grows by cos(theta) from tap to tap, and t by -tan(theta) with d.
    """
    height, width = image.shape
    steep = abs(math.cos(theta))
    taps = min(2 * int(REACH_PX / steep + 0.5) + 2, TAPS)
    at = 0
    for side in range(4):
        ends[side] = at
        angle = theta + side * math.pi / 2
        nu, nv = math.cos(angle), -math.sin(angle)
        twice_c, twice_s = nu * nu - nv * nv, -2 * nu * nv  # cos and sin of twice the angle
        out = half * (shear[0] * twice_c + shear[1] * twice_s)
        lean = shear[1] * twice_c - shear[0] * twice_s
        tu, tv = -math.sin(angle), -math.cos(angle)
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
        for i in range(at, at + n):
            line = low + (i - at) * stride
            edge = c_fast + (half - slow * (line - c_slow)) / fast
            start = int(math.floor(edge - step * (taps - 1) * 0.5 + 0.5))
            end = start + step * (taps - 1)
            t = (edge - c_fast) * t_fast + (line - c_slow) * t_slow
            work[FIRST + i] = fast * (start - edge) - out - lean * t
            work[T + i] = t
            work[NU + i] = nu
            work[NV + i] = nv
            inside = (0 <= line < slow_size and 0 <= start < fast_size and 0 <= end < fast_size)
            work[VALID + i] = 1.0 if inside else 0.0
            if not inside:
                for k in range(taps):
                    work[TAP + k * LINES + i] = 0.0
            elif along_row:
                for k in range(taps):
                    work[TAP + k * LINES + i] = image[line, start + step * k]
            else:
                for k in range(taps):
                    work[TAP + k * LINES + i] = image[start + step * k, line]
        at += n
    ends[4] = at
    ends[5] = taps
    for i in range(at, padded(at)):  # idle lanes
        work[FIRST + i] = 0.0
        work[T + i] = 0.0
        work[NU + i] = 0.0
        work[NV + i] = 0.0
        work[VALID + i] = 0.0
        work[IN + i] = 1.0
        work[OUT + i] = 0.0


@njit(cache=True, fastmath=True, error_model='numpy')
def _zones(work, n, taps, slope, lean, limit, flat):
    """Sum each profile's pixels inside and outside: counts to A and C, sums to B and D.

    Sums are of differences to the innermost and the outermost pixel, so that their squares, to
    OFFSET and WEIGHT, keep their digits. To E the squared changes from pixel to pixel inside, to F
    the changes inside and outside. Pixels further than `limit` along the side are left out: around
    the corner stands another edge.
    """
    f_slope, f_lean = np.float32(slope), np.float32(lean)
    f_limit, f_flat = np.float32(limit), np.float32(flat)
    zero, one = np.float32(0.0), np.float32(1.0)
    last = (taps - 1) * LINES
    for i in range(n):
        work[_A + i] = zero
        work[_B + i] = zero
        work[_C + i] = zero
        work[_D + i] = zero
        work[_E + i] = zero
        work[_F + i] = zero
        work[OFFSET + i] = zero
        work[WEIGHT + i] = zero
    # the zones lie beside the middle tap, which stands within a pixel of the edge
    reach = min(max(taps // 2 - int(flat / slope) + 2, 1), taps // 2)
    for k in range(reach):
        ahead = f_slope * np.float32(k)
        at = k * LINES
        before = at - LINES if k > 0 else at
        for i in range(n):
            d = work[FIRST + i] + ahead
            w = one if abs(work[T + i] + d * f_lean) <= f_limit else zero
            w = w if d < -f_flat else zero
            change = w * (work[TAP + at + i] - work[TAP + before + i])
            x = w * (work[TAP + at + i] - work[TAP + i])
            work[_A + i] += w
            work[_B + i] += x
            work[_E + i] += change * change
            work[_F + i] += change
            work[OFFSET + i] += x * x
    for k in range(taps - reach, taps):
        ahead = f_slope * np.float32(k)
        at = k * LINES
        before = at - LINES
        for i in range(n):
            d = work[FIRST + i] + ahead
            w = one if abs(work[T + i] + d * f_lean) <= f_limit else zero
            w = w if d > f_flat else zero
            x = w * (work[TAP + at + i] - work[TAP + last + i])
            work[_C + i] += w
            work[_D + i] += x
            work[_F + i] += w * (work[TAP + at + i] - work[TAP + before + i])
            work[WEIGHT + i] += x * x


@njit(cache=True, fastmath=True, error_model='numpy')
def _quantile(work, n, inner, need):
    """Return the grey level that `need` valid profiles exceed: of IN - OUT, or OUT (inner 0).

    By halving: counting is vector code, a histogram is not.
    """
    low, high = np.float32(0.0), np.float32(256.0)
    one, zero = np.float32(1.0), np.float32(0.0)
    sign = inner + inner - one
    for _ in range(8):
        middle = np.float32(0.5) * (low + high)
        above = zero
        for i in range(n):
            level = inner * work[IN + i] - sign * work[OUT + i]
            above += work[VALID + i] if level > middle else zero
        if above > need:
            low = middle
        else:
            high = middle
    return float(np.float32(0.5) * (low + high))


@njit(cache=True, fastmath=True, error_model='numpy')
def levels(work, ends, slope, lean, limit, flat, spread):
    """Measure the light inside and outside along every profile, and judge which ones show an edge.

    Fills IN and OUT and clears VALID of profiles that show no edge like the others.
    spread (7,): variance of one pixel inside and outside, the parts of them that are texture, which
    unlike noise is alike from pixel to pixel; the fall of light over the width of an edge that the
    flats beside it show, as a share of the contrast; all lines for each one that is not cut short
    by a corner; the share of lines with a cover's light on the wrong side. Returns (contrast, level
    inside) of the block, or zeros.
    """
    n, taps = ends[4], ends[5]
    wide = padded(n)
    last = (taps - 1) * LINES
    _zones(work, wide, taps, slope, lean, limit, flat)
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    total = short = zero
    for i in range(wide):
        a, c = work[_A + i], work[_C + i]
        full = one if a >= two else zero
        full = full if c >= two else zero
        short += (one - full) * work[VALID + i]
        valid = full * work[VALID + i]
        work[VALID + i] = valid
        total += valid
        work[IN + i] = work[TAP + i] + work[_B + i] / (a if a > one else one)
        work[OUT + i] = work[TAP + last + i] + work[_D + i] / (c if c > one else one)
    if total < 8.0:
        return 0.0, 0.0
    # the contrast that a quarter of all profiles exceeds: right as long as a quarter is in sight;
    # and the platform's own light about here: where more stands outside, it may be an arm's edge
    contrast = _quantile(work, wide, one, np.float32(0.25) * total)
    if contrast < MIN_CONTRAST:
        return 0.0, 0.0
    bare = _quantile(work, wide, zero, np.float32(0.75) * total)
    bare = np.float32(bare + max(OTHER * contrast, 4.0))
    low, high = np.float32(0.45 * contrast), np.float32(2.0 * contrast)
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
    near, bright = np.float32(0.5 * contrast), np.float32(mean_in - 0.25 * contrast)
    glare = v_in = v_out = k_in = k_out = changes = trend = zero
    for i in range(wide):
        glow = one if work[OUT + i] > bright else zero
        glare += glow if work[_C + i] >= two else zero
        valid = work[VALID + i] if abs(work[IN + i] - mean_in) <= near else zero
        work[VALID + i] = valid
        off_in, off_out = work[IN + i] - work[TAP + i], work[OUT + i] - work[TAP + last + i]
        v_in += valid * (work[OFFSET + i] - work[_B + i] * off_in)
        v_out += valid * (work[WEIGHT + i] - work[_D + i] * off_out)
        k_in += valid * (work[_A + i] - one)
        changes += valid * work[_E + i]
        trend += valid * work[_F + i]
        k_out += valid * (work[_C + i] - one)
    inner, outer = max(float(k_in), 1.0), max(float(k_out), 1.0)
    spread[0] = max(v_in / inner, 0.25)
    spread[1] = max(v_out / outer, 0.25)
    # the innermost pixel has no neighbour, so there are as many changes as degrees of freedom
    spread[2] = max(spread[0] - max(0.55 * changes / inner, spread[1]), 0.0)
    spread[3] = 0.0
    # a lamp's glow falls on and on, a cover has an edge between two flats
    spread[4] = -trend / (inner + outer) / slope * 2 * flat / contrast
    spread[5] = n / max(n - float(short), 1.0)
    spread[6] = glare / max(n, 1)
    return contrast, mean_in


@njit(cache=True, fastmath=True, error_model='numpy')
def share_levels(work, ends, spread):
    """Replace the level of each profile by one that owes no more to noise than it must.

    Neighbours are averaged over five lines; the result is drawn to the block's mean as far as the
    variation seen can be noise (James and Stein 1961). Common levels cancel between opposite sides.
    """
    n = ends[4]
    for zone in range(2):
        column, taps = (IN, _A) if zone == 0 else (OUT, _C)
        mean = count = 0.0
        for i in range(n):
            mean += work[VALID + i] * work[column + i]
            count += work[VALID + i]
        if count < 1.0:
            return
        mean /= count
        seen = expected = 0.0
        variance = spread[zone]
        for side in range(4):
            begin, end = ends[side], ends[side + 1]
            total = used = pixels = 0.0
            for i in range(begin, min(begin + 2, end)):
                valid = work[VALID + i]
                total += valid * work[column + i]
                pixels += valid * work[taps + i]
                used += valid
            for i in range(begin, end):
                if i + 2 < end:
                    valid = work[VALID + i + 2]
                    total += valid * work[column + i + 2]
                    pixels += valid * work[taps + i + 2]
                    used += valid
                if i - 3 >= begin:
                    valid = work[VALID + i - 3]
                    total -= valid * work[column + i - 3]
                    pixels -= valid * work[taps + i - 3]
                    used -= valid
                if work[VALID + i] > 0:
                    smooth = total / used
                    work[_B + i] = smooth
                    seen += (smooth - mean) ** 2
                    expected += variance / max(pixels, 1.0)
        keep = max(1.0 - 1.25 * expected / seen, 0.0) if seen > 0 else 0.0
        # light that differs from line to line differs as well from the level zone to the edge
        spread[2 + zone] += UNLIKE * max(seen - 1.25 * expected, 0.0) / count
        for i in range(n):
            if work[VALID + i] > 0:
                work[column + i] = mean + keep * (work[_B + i] - mean)


@njit(cache=True, fastmath=True, error_model='numpy')
def offsets(work, ends, slope, lean, limit, blur, spread):
    """Answer for every profile how far its edge lies outside the present square, and how surely.

    One step of maximum likelihood for a Gaussian-blurred step between known levels, each pixel
    weighted by its own variance: noise grows with the share of light from the cover, texture with
    its square, so that a speckled cover is measured by the outer foot of its edge. exp and erf are
    polynomials (Abramowitz and Stegun 7.1.26), so that the loop over profiles becomes vector code.
    """
    n, taps = padded(ends[4]), ends[5]
    scale = np.float32(1.0 / blur)
    v_out = np.float32(spread[1])
    v_more = np.float32(max(spread[0] - spread[2], spread[1]) - spread[1])
    t_in, t_out = np.float32(spread[2]), np.float32(spread[3])
    rough = np.float32(ROUGH) * t_in
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    edge = np.float32(limit)
    f_lean = np.float32(lean)
    for i in range(n):
        for field in (_A, _B, _C, _D, _E):
            work[field + i] = zero
    for k in range(taps):
        ahead = np.float32(slope) * np.float32(k)
        at = k * LINES
        for i in range(n):
            d = work[FIRST + i] + ahead
            x = d * scale
            size = abs(x)
            size = size if size < np.float32(5.0) else np.float32(5.0)
            z = size * size * np.float32(-0.5 / 16.0)
            e = one + z * (one + z * (half + z * (np.float32(1 / 6) + z * (
                np.float32(1 / 24) + z * np.float32(1 / 120)))))
            e = e * e
            e = e * e
            e = e * e
            e = e * e
            t = one / (one + np.float32(0.3275911 * 0.70710678) * size)
            tail = half * e * t * (np.float32(0.254829592) + t * (
                np.float32(-0.284496736) + t * (np.float32(1.421413741) + t * (
                    np.float32(-1.453152027) + t * np.float32(1.061405429)))))
            cover = one - tail if x < zero else tail
            outer = work[OUT + i]
            rest = work[TAP + at + i] - outer - (work[IN + i] - outer) * cover
            bare = one - cover
            w = one / (v_out + cover * (v_more + cover * rough) + bare * bare * t_out)
            w = w if abs(work[T + i] + d * f_lean) < edge else zero
            close = w if size < np.float32(EDGE) else zero
            work[_A + i] += w * e * rest
            work[_B + i] += w * e * e
            work[_C + i] += close * e * cover
            work[_D + i] += close * cover * cover
            work[_E + i] += close * cover * rest
    stiff = one / max(t_in, np.float32(1e-3))
    for i in range(n):
        slant = (work[IN + i] - work[OUT + i]) * scale * np.float32(0.39894228)  # grey per px
        share = work[_C + i] / (work[_D + i] + stiff)
        bottom = work[_B + i] - share * work[_C + i] + np.float32(1e-9)
        safe = slant if slant > one else one
        work[OFFSET + i] = (work[_A + i] - share * work[_E + i]) / (bottom * safe)
        work[WEIGHT + i] = work[VALID + i] * bottom * safe * safe


@njit(cache=True, fastmath=True, error_model='numpy')
def search(work, ends, slope):
    """Fill the offset of every profile by its steepest step, for a square known only roughly."""
    taps = ends[5]
    for i in range(padded(ends[4])):
        work[WEIGHT + i] = 0.0
        work[OFFSET + i] = 0.0
        if work[VALID + i] == 0:
            continue
        best = 0.0
        place = -1
        for k in range(3, taps - 3):
            at = TAP + k * LINES + i
            step = (work[at - LINES] + work[at - 2 * LINES] + work[at - 3 * LINES]
                    - work[at + LINES] - work[at + 2 * LINES] - work[at + 3 * LINES])
            if step > best:
                best = step
                place = k
        if place >= 0 and best > 3 * MIN_CONTRAST:
            work[OFFSET + i] = work[FIRST + i] + slope * place
            work[WEIGHT + i] = 1.0
