# SPDX-License-Identifier: Apache-2.0
"""A square measured by its edges: every image row or column that crosses a side is one profile.

Sides are read along whole pixels, never resampled, so each pixel counts once. A profile answers by a
matched filter where its edge lies against local light inside and outside; all profiles of a block
then agree, with Tukey weights (Beaton and Tukey 1974), on centre, angle and half side. An intensity
centroid is pulled by texture, LED cores and flashes; an edge is not.

Image axes: u right, v down. A block at angle theta has its x axis at (cos, -sin), its y axis at
(-sin, -cos). Side k has the outward normal of angle theta + k 90 degrees; `t` runs along it,
counter-clockwise, `d` is the distance to it, positive outside.
"""

import math

import numpy as np
from numba import njit

REACH_PX = 6.5  # of a profile at least, along the normal, to both sides of its edge
TAPS = 22  # pixels of a profile at 45 degrees
LINES = 384  # profiles of one square, padded to whole vectors; a wide one is read on every second line
SIDE_LINES = 88
CORNER = 1.4  # blurs left out at each end of a side, where two edges mix
EDGE = 2.4  # blurs from the edge over which the light inside counts as one level
ROUGH = 0.1  # share of the texture's variance that is new from pixel to pixel
UNLIKE = 1.0  # of the variance from line to line, what differs between level zone and edge
FLAT = 2.1  # blurs from the edge at which light counts as inside or outside
MIN_CONTRAST = 8.0  # grey levels
SETTLED_PX = 0.03  # a last step below this leaves no error that counts
FIELDS = 10  # of one fitted square
U, V, THETA, HALF, VISIBLE, SIGMA, QUALITY, CONTRAST, LEVEL, WORST = range(FIELDS)

# Fields of the profiles, one after the other in one flat array: with distances that the compiler
# knows, it can tell that they do not overlap and turns every loop over profiles into vector code.
(_FIRST, _T, _NU, _NV, _VALID, _IN, _OUT, _OFFSET, _WEIGHT, _A, _B, _C, _D,
 _E, _F) = (k * LINES for k in range(15))


def workspace() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return scratch arrays of fit_squares, so that a live image allocates nothing."""
    return (np.zeros(TAPS * LINES, np.float32), np.zeros(15 * LINES, np.float32),
            np.zeros(6, np.int64))


@njit(cache=True, fastmath=True, error_model='numpy')
def _gather(image, u, v, theta, half, blur, pixels, work, ends):
    """Copy the profiles of all sides into `pixels` (tap, line), running outwards.

    Fills first (d of the first tap), t, normal and validity of every line; ends (6,): where each side
    begins, the number of lines in all, and of taps. All sides cross their rows or columns at the same
    slant, so that d grows by cos(theta) from tap to tap, and t by -tan(theta) with d.
    """
    height, width = image.shape
    steep = abs(math.cos(theta))
    taps = min(2 * int(REACH_PX / steep + 0.5) + 2, TAPS)
    at = 0
    for side in range(4):
        ends[side] = at
        angle = theta + side * math.pi / 2
        nu, nv = math.cos(angle), -math.sin(angle)
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
            work[_FIRST + i] = fast * (start - edge)
            work[_T + i] = (edge - c_fast) * t_fast + (line - c_slow) * t_slow
            work[_NU + i] = nu
            work[_NV + i] = nv
            inside = (0 <= line < slow_size and 0 <= start < fast_size and 0 <= end < fast_size)
            work[_VALID + i] = 1.0 if inside else 0.0
            if not inside:
                for k in range(taps):
                    pixels[k * LINES + i] = 0.0
            elif along_row:
                for k in range(taps):
                    pixels[k * LINES + i] = image[line, start + step * k]
            else:
                for k in range(taps):
                    pixels[k * LINES + i] = image[start + step * k, line]
        at += n
    ends[4] = at
    ends[5] = taps
    for i in range(at, _padded(at)):  # idle lanes
        work[_FIRST + i] = 0.0
        work[_T + i] = 0.0
        work[_NU + i] = 0.0
        work[_NV + i] = 0.0
        work[_VALID + i] = 0.0
        work[_IN + i] = 1.0
        work[_OUT + i] = 0.0


@njit(inline='always')
def _padded(n):
    return min((n + 31) // 32 * 32, LINES)


@njit(cache=True, fastmath=True, error_model='numpy')
def _zones(pixels, work, n, taps, slope, lean, limit, flat, squares):
    """Sum each profile's pixels inside and outside: counts to A and C, sums to B and D.

    With `squares`, sums of squared distances to the levels in IN and OUT instead; to E the squared
    changes from pixel to pixel inside, to F the changes inside and outside. Pixels further than
    `limit` along the side are left out: around the corner stands another edge.
    """
    f_slope, f_lean = np.float32(slope), np.float32(lean)
    f_limit, f_flat = np.float32(limit), np.float32(flat)
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(n):
        work[_A + i] = zero
        work[_B + i] = zero
        work[_C + i] = zero
        work[_D + i] = zero
        work[_E + i] = zero
        work[_F + i] = zero
    for k in range(taps):
        ahead = f_slope * np.float32(k)
        at = k * LINES
        if squares:
            before = at - LINES if k > 0 else at
            for i in range(n):
                d = work[_FIRST + i] + ahead
                change = pixels[at + i] - pixels[before + i]
                near = one if abs(work[_T + i] + d * f_lean) <= f_limit else zero
                x_in, x_out = pixels[at + i] - work[_IN + i], pixels[at + i] - work[_OUT + i]
                w_in = near if d < -f_flat else zero
                w_out = near if d > f_flat else zero
                work[_A + i] += w_in
                work[_B + i] += w_in * x_in * x_in
                work[_C + i] += w_out
                work[_D + i] += w_out * x_out * x_out
                work[_E + i] += w_in * change * change
                work[_F + i] += (w_in + w_out) * change
        else:
            for i in range(n):
                d = work[_FIRST + i] + ahead
                near = one if abs(work[_T + i] + d * f_lean) <= f_limit else zero
                w_in = near if d < -f_flat else zero
                w_out = near if d > f_flat else zero
                work[_A + i] += w_in
                work[_B + i] += w_in * pixels[at + i]
                work[_C + i] += w_out
                work[_D + i] += w_out * pixels[at + i]


@njit(cache=True, fastmath=True, error_model='numpy')
def _levels(pixels, work, ends, slope, lean, limit, flat, spread, histogram):
    """Measure the light inside and outside along every profile, and judge which ones show an edge.

    Fills IN and OUT and clears VALID of profiles that show no edge like the others.
    spread (5,): variance of one pixel inside and outside, the parts of them that are texture, which
    unlike noise is alike from pixel to pixel, and the fall of light over the width of an edge that the
    flats beside it show, as a share of the contrast. Returns (contrast, level inside) of the
    whole block, or zeros where there is none.
    """
    n, taps = ends[4], ends[5]
    padded = _padded(n)
    _zones(pixels, work, padded, taps, slope, lean, limit, flat, False)
    histogram[:] = 0.0
    total = 0.0
    for i in range(n):
        if work[_A + i] < 2 or work[_C + i] < 2:
            work[_VALID + i] = 0.0
            continue
        work[_IN + i] = work[_B + i] / work[_A + i]
        work[_OUT + i] = work[_D + i] / work[_C + i]
        if work[_VALID + i] > 0:
            total += 1.0
            step = work[_IN + i] - work[_OUT + i]
            if step > 0:
                histogram[min(int(step / 2), 127)] += 1.0
    if total < 8.0:
        return 0.0, 0.0
    # the contrast that a quarter of all profiles exceeds: right as long as a quarter is in sight
    need = total * 0.25
    place = 127
    while place > 0 and need > histogram[place]:
        need -= histogram[place]
        place -= 1
    contrast = 2.0 * place + 1.0
    if contrast < MIN_CONTRAST:
        return 0.0, 0.0
    mean_in = 0.0
    count = 0.0
    for i in range(n):
        step = work[_IN + i] - work[_OUT + i]
        if step < 0.45 * contrast or step > 2.0 * contrast:
            work[_VALID + i] = 0.0
        mean_in += work[_VALID + i] * work[_IN + i]
        count += work[_VALID + i]
    if count < 8.0:
        return 0.0, 0.0
    mean_in /= count
    for i in range(n):
        if abs(work[_IN + i] - mean_in) > 0.5 * contrast:
            work[_VALID + i] = 0.0
    _zones(pixels, work, padded, taps, slope, lean, limit, flat, True)
    v_in = v_out = k_in = k_out = changes = trend = 0.0
    for i in range(n):
        valid = work[_VALID + i]
        v_in += valid * work[_B + i]
        v_out += valid * work[_D + i]
        k_in += valid * (work[_A + i] - 1)
        changes += valid * work[_E + i]
        trend += valid * work[_F + i]
        k_out += valid * (work[_C + i] - 1)
    spread[0] = max(v_in / max(k_in, 1.0), 0.25)
    spread[1] = max(v_out / max(k_out, 1.0), 0.25)
    # the innermost pixel has no neighbour, so there are as many changes as degrees of freedom
    spread[2] = max(spread[0] - max(0.55 * changes / max(k_in, 1.0), spread[1]), 0.0)
    spread[3] = 0.0
    # a lamp's glow falls on and on, a cover has an edge between two flats
    spread[4] = -trend / max(k_in + k_out, 1.0) / slope * 2 * flat / contrast
    return contrast, mean_in


@njit(cache=True, fastmath=True, error_model='numpy')
def _share_levels(work, ends, spread):
    """Replace the level of each profile by one that owes no more to noise than it must.

    Neighbours are averaged over five lines; the result is drawn to the block's mean as far as the
    variation seen can be noise (James and Stein 1961). Common levels cancel between opposite sides.
    """
    n = ends[4]
    for zone in range(2):
        column, taps = (_IN, _A) if zone == 0 else (_OUT, _C)
        mean = count = 0.0
        for i in range(n):
            mean += work[_VALID + i] * work[column + i]
            count += work[_VALID + i]
        if count < 1.0:
            return
        mean /= count
        seen = expected = 0.0
        for side in range(4):
            begin, end = ends[side], ends[side + 1]
            total = used = pixels = 0.0
            for i in range(begin, min(begin + 2, end)):
                valid = work[_VALID + i]
                total += valid * work[column + i]
                pixels += valid * work[taps + i]
                used += valid
            for i in range(begin, end):
                if i + 2 < end:
                    valid = work[_VALID + i + 2]
                    total += valid * work[column + i + 2]
                    pixels += valid * work[taps + i + 2]
                    used += valid
                if i - 3 >= begin:
                    valid = work[_VALID + i - 3]
                    total -= valid * work[column + i - 3]
                    pixels -= valid * work[taps + i - 3]
                    used -= valid
                if work[_VALID + i] > 0:
                    smooth = total / used
                    work[_B + i] = smooth
                    seen += (smooth - mean) ** 2
                    expected += spread[zone] / max(pixels, 1.0)
        keep = max(1.0 - 1.25 * expected / seen, 0.0) if seen > 0 else 0.0
        # light that differs from line to line differs as well from the level zone to the edge
        spread[2 + zone] += UNLIKE * max(seen - 1.25 * expected, 0.0) / count
        for i in range(n):
            if work[_VALID + i] > 0:
                work[column + i] = mean + keep * (work[_B + i] - mean)


@njit(cache=True, fastmath=True, error_model='numpy')
def _offsets(pixels, work, ends, slope, lean, limit, blur, spread):
    """Answer for every profile how far its edge lies outside the present square, and how surely.

    One step of maximum likelihood for a Gaussian-blurred step between known levels, each pixel
    weighted by its own variance: noise grows with the share of light from the cover, texture with its
    square, so that a speckled cover is measured by the outer foot of its edge. exp and erf are polynomials (Abramowitz and Stegun 7.1.26), so that
    the loop over profiles becomes vector code.
    """
    n, taps = _padded(ends[4]), ends[5]
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
            d = work[_FIRST + i] + ahead
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
            outer = work[_OUT + i]
            rest = pixels[at + i] - outer - (work[_IN + i] - outer) * cover
            bare = one - cover
            w = one / (v_out + cover * (v_more + cover * rough) + bare * bare * t_out)
            w = w if abs(work[_T + i] + d * f_lean) < edge else zero
            close = w if size < np.float32(EDGE) else zero
            work[_A + i] += w * e * rest
            work[_B + i] += w * e * e
            work[_C + i] += close * e * cover
            work[_D + i] += close * cover * cover
            work[_E + i] += close * cover * rest
    stiff = one / max(t_in, np.float32(1e-3))
    for i in range(n):
        slant = (work[_IN + i] - work[_OUT + i]) * scale * np.float32(0.39894228)  # grey per px
        share = work[_C + i] / (work[_D + i] + stiff)
        bottom = work[_B + i] - share * work[_C + i] + np.float32(1e-9)
        safe = slant if slant > one else one
        work[_OFFSET + i] = (work[_A + i] - share * work[_E + i]) / (bottom * safe)
        work[_WEIGHT + i] = work[_VALID + i] * bottom * safe * safe


@njit(cache=True, fastmath=True, error_model='numpy')
def _search(pixels, work, ends, slope):
    """Fill the offset of every profile by its steepest step, for a square known only roughly."""
    taps = ends[5]
    for i in range(_padded(ends[4])):
        work[_WEIGHT + i] = 0.0
        work[_OFFSET + i] = 0.0
        if work[_VALID + i] == 0:
            continue
        best = 0.0
        place = -1
        for k in range(3, taps - 3):
            at = k * LINES + i
            step = (pixels[at - LINES] + pixels[at - 2 * LINES] + pixels[at - 3 * LINES]
                    - pixels[at + LINES] - pixels[at + 2 * LINES] - pixels[at + 3 * LINES])
            if step > best:
                best = step
                place = k
        if place >= 0 and best > 3 * MIN_CONTRAST:
            work[_OFFSET + i] = work[_FIRST + i] + slope * place
            work[_WEIGHT + i] = 1.0


@njit(cache=True, fastmath=True, error_model='numpy')
def _normal_equations(work, n, step, width, a, b):
    """Fill the lower half of `a` and `b` with Tukey weights about `step`; return (sum of weighted
    squared rests, sum of Tukey weights)."""
    zero, one = np.float32(0.0), np.float32(1.0)
    d0, d1, d2, d3 = (np.float32(step[0]), np.float32(step[1]), np.float32(step[2]),
                      np.float32(step[3]))
    per_width = np.float32(1.0 / width)
    a00 = a10 = a11 = a20 = a21 = a22 = a30 = a31 = a32 = a33 = zero
    b0 = b1 = b2 = b3 = spread = total = zero
    for i in range(n):
        j0, j1, t = work[_NU + i], work[_NV + i], work[_T + i]
        offset = work[_OFFSET + i]
        rest = offset - (j0 * d0 + j1 * d1 - t * d2 + d3)
        x = rest * per_width
        tukey = one - x * x
        tukey = tukey if tukey > zero else zero
        tukey = tukey if work[_WEIGHT + i] > zero else zero
        tukey = tukey * tukey
        w = work[_WEIGHT + i] * tukey
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


@njit(cache=True, fastmath=True, error_model='numpy')
def _agree(work, ends, half_off, half_sigma, wide, tight, rounds, a, b, shares):
    """Find the step (du, dv, dtheta, dhalf) that most profiles agree on.

    Iteratively reweighted least squares of offset = n.dc - t dtheta + dhalf with Tukey's weight, whose
    width falls from `wide` px to six robust standard deviations (not below `tight` px).
    half_off, half_sigma: prior on the half side. `shares` (4,) receives the agreeing share of each
    side. Returns (agreeing share of all profiles, variance of a profile in units of its weight);
    b holds the step, a its covariance but for that variance.
    """
    n = ends[4]
    padded = _padded(n)
    b[:] = 0.0
    weight_sum = weighted = 0.0
    for i in range(n):
        weight_sum += work[_WEIGHT + i]
        weighted += 1.0 if work[_WEIGHT + i] > 0 else 0.0
    if weighted < 8:
        return 0.0, 1.0
    mean_weight = weight_sum / weighted
    width = wide
    variance = 1.0
    for r in range(rounds):
        spread, total = _normal_equations(work, padded, b, width, a, b)
        if total < 6.0:
            return 0.0, 1.0
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
    for side in range(4):
        mine = 0.0
        for i in range(ends[side], ends[side + 1]):
            rest = work[_OFFSET + i] - (work[_NU + i] * b[0] + work[_NV + i] * b[1]
                                        - work[_T + i] * b[2] + b[3])
            mine += 1.0 if work[_WEIGHT + i] > 0 and abs(rest) < width else 0.0
        agree += mine
        shares[side] = mine / max(ends[side + 1] - ends[side], 1)
    return agree / max(n, 1), variance


@njit(cache=True, fastmath=True, error_model='numpy')
def _follow(work, n, step):
    """Count all distances from the edges where they are after `step`."""
    s0, s1, s2, s3 = (np.float32(step[0]), np.float32(step[1]), np.float32(step[2]),
                      np.float32(step[3]))
    for i in range(n):
        work[_FIRST + i] -= work[_NU + i] * s0 + work[_NV + i] * s1 - work[_T + i] * s2 + s3


@njit(cache=True)
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


@njit(cache=True, fastmath=True, error_model='numpy')
def _fit(image, square, expected, half_sigma, searches, blur, pixels, work, ends, a, step, shares,
         spread, histogram):
    """Fit one square from `square` (FIELDS,): u, v, theta, half; fill in the other fields."""
    u, v, theta, half = square[U], square[V], square[THETA], square[HALF]
    for _ in range(searches):
        _gather(image, u, v, theta, half, blur, pixels, work, ends)
        _search(pixels, work, ends, abs(math.cos(theta)))
        share, variance = _agree(work, ends, expected - half, max(half_sigma, 0.02 * half),
                                 9.0, 1.5, 5, a, step, shares)
        if share < 0.3:
            break
        u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
        if theta > math.pi / 4:  # sides keep their rows and columns
            theta -= math.pi / 2
        elif theta <= -math.pi / 4:
            theta += math.pi / 2
    for k in range(VISIBLE, FIELDS):
        square[k] = 0.0
    share = 0.0
    variance = 1.0
    contrast = level = 0.0
    for gather in range(3):
        _gather(image, u, v, theta, half, blur, pixels, work, ends)
        slope, lean = abs(math.cos(theta)), -math.tan(theta)
        limit = half - CORNER * blur
        contrast, level = _levels(pixels, work, ends, slope, lean, limit, FLAT * blur, spread,
                                  histogram)
        share = 0.0
        if contrast == 0.0:
            return
        _share_levels(work, ends, spread)
        far = 0.0
        for r in range(4):
            _offsets(pixels, work, ends, slope, lean, limit, blur, spread)
            first = r == 0 and gather == 0
            share, variance = _agree(work, ends, expected - half, half_sigma, 3.0 if first else 1.0,
                                     0.05, 4 if first else 3, a, step, shares)
            if share == 0.0:
                return
            _follow(work, ends[4], step)
            u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
            change = max(abs(step[0]) + abs(step[1]), abs(step[2]) * half)
            far += change
            if change < SETTLED_PX:
                break
        if far < 0.7:
            break
    square[U], square[V], square[THETA], square[HALF] = u, v, theta, half
    square[VISIBLE] = share
    square[SIGMA] = math.sqrt(variance * 0.5 * (a[0, 0] + a[1, 1]))
    both_ways = min(max(shares[0], shares[2]), max(shares[1], shares[3]))
    off = (half - expected) / (3.0 * half_sigma + 0.04 * expected)
    sharp = 1.0 - min(max(2.5 * (spread[4] - 0.15), 0.0), 1.0)
    square[QUALITY] = share * both_ways * math.exp(-0.5 * off * off) * sharp
    square[WORST] = min(min(shares[0], shares[1]), min(shares[2], shares[3]))
    square[CONTRAST] = contrast
    square[LEVEL] = level


@njit(cache=True)
def keep_apart(fits, order, kept, n, least_visible, least_worst, least_quality):
    """Append to `kept` those of `fits` that are good enough and stand on their own ground.

    order: the fits, best first; n: squares kept so far. Returns their new number.
    """
    for i in order:
        if (n == len(kept) or not fits[i, VISIBLE] >= least_visible
                or not fits[i, WORST] >= least_worst or not fits[i, QUALITY] >= least_quality):
            continue
        free = True
        for j in range(n):
            du, dv = kept[j, U] - fits[i, U], kept[j, V] - fits[i, V]
            if du * du + dv * dv < (1.4 * fits[i, HALF]) ** 2:
                free = False
                break
        if free:
            kept[n] = fits[i]
            n += 1
    return n


@njit(cache=True, fastmath=True, error_model='numpy')
def fit_squares(image, starts, blur, half_sigma, search, pixels, work, ends, out):
    """Fit squares to `image` (h, w) uint8 from `starts` (n, 4): u, v, theta, expected half side.

    search: rounds of rough search before the fit (0 when the start is good to 2 px; a fit that comes
    out poor then searches once itself). out (n, FIELDS): u, v, theta, half, agreeing share of the
    edges, sigma px, quality, contrast, level inside, agreeing share of the worst side. A share of 0 means no square there.
    """
    a = np.zeros((4, 4))
    step = np.zeros(4)
    shares = np.zeros(4)
    spread = np.zeros(5)
    histogram = np.zeros(128)
    second = np.zeros(FIELDS)
    for s in range(starts.shape[0]):
        square = out[s]
        square[:4] = starts[s]
        _fit(image, square, starts[s, 3], half_sigma, search, blur, pixels, work, ends, a, step,
             shares, spread, histogram)
        if search == 0 and square[VISIBLE] < 0.75:
            second[:4] = starts[s]
            _fit(image, second, starts[s, 3], half_sigma, 2, blur, pixels, work, ends, a, step,
                 shares, spread, histogram)
            if second[VISIBLE] > square[VISIBLE] + 0.05:
                square[:] = second
        square[THETA] -= round(square[THETA] / (math.pi / 2)) * math.pi / 2
