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

REACH_PX = 7.0  # of a profile, along the normal, to both sides of its edge
TAPS = 23  # pixels in the longest profile: 7 px at 45 degrees, to both sides, and the middle
LINES = 96  # profiles of one side; wider blocks are read every second, third ... line
CORNER = 1.4  # blurs left out at each end of a side, where two edges mix
FLAT = 2.1  # blurs from the edge at which light counts as inside or outside
MIN_CONTRAST = 8.0  # grey levels
FIELDS = 9  # of one fitted square
U, V, THETA, HALF, VISIBLE, SIGMA, QUALITY, CONTRAST, LEVEL = range(FIELDS)

# columns of the list of profiles
_T, _SIDE, _OFFSET, _WEIGHT, _IN, _OUT, _VALID = range(7)


def workspace() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return scratch arrays of fit_squares, so that a live image allocates nothing."""
    return (np.zeros((4, TAPS, LINES), np.float32), np.zeros((4, LINES), np.float32),
            np.zeros((4, LINES, 7), np.float32), np.zeros((4, 4), np.int64))


@njit(cache=True, fastmath=True)
def _gather(image, u, v, theta, half, blur, pixels, first, lines, shape):
    """Copy the profiles of all sides into `pixels` (side, tap, line), running outwards.

    first (side, line): d of the first tap; lines (side, line, 7): t and validity filled in;
    shape (side, 0..1): numbers of lines and taps.
    """
    height, width = image.shape
    for side in range(4):
        angle = theta + side * math.pi / 2
        nu, nv = math.cos(angle), -math.sin(angle)
        tu, tv = -math.sin(angle), -math.cos(angle)
        along_row = side % 2 == 0  # sides 0 and 2 are steep: rows cross them
        fast, slow = (nu, nv) if along_row else (nv, nu)
        c_fast, c_slow = (u, v) if along_row else (v, u)
        t_slow = abs(tv if along_row else tu)
        middle = c_slow + half * slow
        span = (half - CORNER * blur) * t_slow
        low = int(math.ceil(middle - span))
        high = int(math.floor(middle + span))
        stride = (high - low) // LINES + 1
        n = (high - low) // stride + 1 if high >= low else 0
        arm = min(int(REACH_PX / abs(fast) + 0.5), TAPS // 2)
        step = 1 if fast > 0 else -1
        shape[side, 0] = n
        shape[side, 1] = 2 * arm + 1
        fast_size, slow_size = (width, height) if along_row else (height, width)
        for i in range(n):
            line = low + i * stride
            edge = c_fast + (half - slow * (line - c_slow)) / fast
            nearest = int(math.floor(edge + 0.5))
            start = nearest - step * arm
            end = nearest + step * arm
            first[side, i] = fast * (start - edge)
            lines[side, i, _SIDE] = side
            if along_row:
                lines[side, i, _T] = (edge - u) * tu + (line - v) * tv
            else:
                lines[side, i, _T] = (line - u) * tu + (edge - v) * tv
            inside = (0 <= line < slow_size and 0 <= start < fast_size and 0 <= end < fast_size)
            lines[side, i, _VALID] = 1.0 if inside else 0.0
            if not inside:
                for k in range(2 * arm + 1):
                    pixels[side, k, i] = 0.0
            elif along_row:
                for k in range(2 * arm + 1):
                    pixels[side, k, i] = image[line, start + step * k]
            else:
                for k in range(2 * arm + 1):
                    pixels[side, k, i] = image[start + step * k, line]


@njit(cache=True, fastmath=True)
def _levels(pixels, first, lines, shape, slopes, flat, spread):
    """Measure the light inside and outside along every profile, and judge which ones show an edge.

    Fills lines[..., _IN], [..., _OUT], clears lines[..., _VALID] of profiles that show none.
    spread (2,): variance of one pixel inside and outside. Returns (contrast, level inside) of the
    whole block.
    """
    histogram = np.zeros(128)
    total = 0.0
    for side in range(4):
        slope = slopes[side]
        for i in range(shape[side, 0]):
            d = first[side, i]
            n_in = n_out = 0.0
            s_in = s_out = 0.0
            for k in range(shape[side, 1]):
                value = pixels[side, k, i]
                if d < -flat:
                    n_in += 1.0
                    s_in += value
                elif d > flat:
                    n_out += 1.0
                    s_out += value
                d += slope
            if n_in < 2.0 or n_out < 2.0:
                lines[side, i, _VALID] = 0.0
                continue
            lines[side, i, _IN] = s_in / n_in
            lines[side, i, _OUT] = s_out / n_out
            if lines[side, i, _VALID] > 0:
                step = lines[side, i, _IN] - lines[side, i, _OUT]
                total += 1.0
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
    mean_in = 0.0
    count = 0.0
    for side in range(4):
        for i in range(shape[side, 0]):
            if lines[side, i, _VALID] > 0:
                step = lines[side, i, _IN] - lines[side, i, _OUT]
                if step < 0.45 * contrast or step > 2.0 * contrast:
                    lines[side, i, _VALID] = 0.0
                else:
                    mean_in += lines[side, i, _IN]
                    count += 1.0
    if count < 8.0:
        return 0.0, 0.0
    mean_in /= count
    # variance of a pixel about the mean of its profile, of valid profiles only
    v_in = v_out = 0.0
    k_in = k_out = 0.0
    for side in range(4):
        slope = slopes[side]
        for i in range(shape[side, 0]):
            if lines[side, i, _VALID] > 0:
                if abs(lines[side, i, _IN] - mean_in) > 0.5 * contrast:
                    lines[side, i, _VALID] = 0.0
                    continue
                d = first[side, i]
                for k in range(shape[side, 1]):
                    if d < -flat:
                        v_in += (pixels[side, k, i] - lines[side, i, _IN]) ** 2
                        k_in += 1.0
                    elif d > flat:
                        v_out += (pixels[side, k, i] - lines[side, i, _OUT]) ** 2
                        k_out += 1.0
                    d += slope
                k_in -= 1.0
                k_out -= 1.0
    spread[0] = max(v_in / max(k_in, 1.0), 0.25)
    spread[1] = max(v_out / max(k_out, 1.0), 0.25)
    return contrast, mean_in


@njit(cache=True, fastmath=True)
def _share_levels(lines, shape, slopes, flat, spread, smooth):
    """Replace the level of each profile by one that owes no more to noise than it must.

    Neighbours are averaged over five lines; the result is drawn to the block's mean as far as the
    variation seen can be noise (James and Stein 1961). Common levels cancel between opposite sides.
    """
    for zone in range(2):
        column = _IN if zone == 0 else _OUT
        mean = 0.0
        count = 0.0
        for side in range(4):
            for i in range(shape[side, 0]):
                if lines[side, i, _VALID] > 0:
                    mean += lines[side, i, column]
                    count += 1.0
        if count < 1.0:
            return
        mean /= count
        seen = 0.0
        expected = 0.0
        for side in range(4):
            n = shape[side, 0]
            taps = max((REACH_PX - flat) / abs(slopes[side]), 1.0)
            for i in range(n):
                if lines[side, i, _VALID] == 0:
                    continue
                total = 0.0
                used = 0.0
                for j in range(max(i - 2, 0), min(i + 3, n)):
                    if lines[side, j, _VALID] > 0:
                        total += lines[side, j, column]
                        used += 1.0
                smooth[side, i] = total / used
                seen += (smooth[side, i] - mean) ** 2
                expected += spread[zone] / (taps * used)
        keep = max(1.0 - 1.25 * expected / seen, 0.0) if seen > 0 else 0.0
        for side in range(4):
            for i in range(shape[side, 0]):
                if lines[side, i, _VALID] > 0:
                    lines[side, i, column] = mean + keep * (smooth[side, i] - mean)


@njit(cache=True, fastmath=True)
def _offsets(pixels, first, lines, shape, slopes, blur, spread, moved, sums):
    """Answer for every profile how far its edge lies outside the present square, and how surely.

    One step of maximum likelihood for a Gaussian-blurred step between known levels, each pixel
    weighted by its own variance. The loop runs over profiles inside and taps outside, so that it
    becomes vector code; exp and erf are the polynomials of Abramowitz and Stegun 7.1.26.
    moved (side, line): how far the present edge has moved since the pixels were gathered.
    """
    scale = np.float32(1.0 / blur)
    v_in, v_out = np.float32(spread[0]), np.float32(spread[1])
    one, half = np.float32(1.0), np.float32(0.5)
    for side in range(4):
        n = shape[side, 0]
        top = sums[0, :n]
        bottom = sums[1, :n]
        start = sums[2, :n]
        inner = sums[3, :n]
        outer = sums[4, :n]
        for i in range(n):
            top[i] = 0.0
            bottom[i] = 0.0
            start[i] = (first[side, i] - moved[side, i]) * scale
            inner[i] = lines[side, i, _IN]
            outer[i] = lines[side, i, _OUT]
        slope = np.float32(slopes[side]) * scale
        for k in range(shape[side, 1]):
            row = pixels[side, k]
            ahead = slope * np.float32(k)
            for i in range(n):
                x = start[i] + ahead
                size = min(abs(x), np.float32(5.0))
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
                cover = one - tail if x < 0 else tail
                rest = row[i] - outer[i] - (inner[i] - outer[i]) * cover
                w = e / (v_out + (v_in - v_out) * cover)
                top[i] += w * rest
                bottom[i] += w * e
        for i in range(n):
            lines[side, i, _WEIGHT] = 0.0
            step = inner[i] - outer[i]
            if lines[side, i, _VALID] > 0 and bottom[i] > 0:
                slant = step * scale * np.float32(0.39894228)  # of the edge, grey levels per px
                lines[side, i, _OFFSET] = top[i] / (bottom[i] * slant)
                lines[side, i, _WEIGHT] = bottom[i] * slant * slant


@njit(cache=True, fastmath=True)
def _search(pixels, first, lines, shape, slopes):
    """Fill the offset of every profile by its steepest step, for a square known only roughly."""
    for side in range(4):
        slope = slopes[side]
        taps = shape[side, 1]
        for i in range(shape[side, 0]):
            lines[side, i, _WEIGHT] = 0.0
            if lines[side, i, _VALID] == 0:
                continue
            best = 0.0
            place = -1
            for k in range(3, taps - 3):
                step = (pixels[side, k - 1, i] + pixels[side, k - 2, i] + pixels[side, k - 3, i]
                        - pixels[side, k + 1, i] - pixels[side, k + 2, i] - pixels[side, k + 3, i])
                if step > best:
                    best = step
                    place = k
            if place < 0 or best < 3 * MIN_CONTRAST:
                continue
            lines[side, i, _OFFSET] = first[side, i] + slope * place
            lines[side, i, _WEIGHT] = 1.0


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


@njit(cache=True, fastmath=True)
def _agree(lines, shape, theta, half_off, half_sigma, wide, tight, rounds, a, b, shares):
    """Find the step (du, dv, dtheta, dhalf) that most profiles agree on.

    Iteratively reweighted least squares of offset = n.dc - t dtheta + dhalf with Tukey's weight, whose
    width falls from `wide` px to six robust standard deviations (not below `tight` px).
    half_off, half_sigma: prior on the half side. `shares` (4,) receives the agreeing share of each
    side. Returns (agreeing profiles, all profiles, variance of a profile in units of its weight);
    b holds the step, a its covariance but for that variance.
    """
    b[:] = 0.0
    nu = np.empty(4)
    nv = np.empty(4)
    weight_sum = 0.0
    weighted = 0
    for side in range(4):
        nu[side] = math.cos(theta + side * math.pi / 2)
        nv[side] = -math.sin(theta + side * math.pi / 2)
        for i in range(shape[side, 0]):
            if lines[side, i, _WEIGHT] > 0:
                weight_sum += lines[side, i, _WEIGHT]
                weighted += 1
    if weighted < 8:
        return 0.0, 1.0, 1.0
    mean_weight = weight_sum / weighted
    width = wide
    variance = 1.0
    good = 0.0
    for r in range(rounds):
        d0, d1, d2, d3 = b[0], b[1], b[2], b[3]
        a[:] = 0.0
        b[:] = 0.0
        good = 0.0
        spread = 0.0
        total = 0.0
        for side in range(4):
            agree = 0.0
            for i in range(shape[side, 0]):
                w = lines[side, i, _WEIGHT]
                if w <= 0:
                    continue
                t = lines[side, i, _T]
                offset = lines[side, i, _OFFSET]
                rest = offset - (nu[side] * d0 + nv[side] * d1 - t * d2 + d3)
                x = rest / width
                if abs(x) >= 1.0:
                    continue
                tukey = (1.0 - x * x) ** 2
                agree += 1.0
                w *= tukey
                spread += w * rest * rest
                total += tukey
                j0, j1 = nu[side], nv[side]
                a[0, 0] += w * j0 * j0
                a[1, 0] += w * j1 * j0
                a[1, 1] += w * j1 * j1
                a[2, 0] -= w * t * j0
                a[2, 1] -= w * t * j1
                a[2, 2] += w * t * t
                a[3, 0] += w * j0
                a[3, 1] += w * j1
                a[3, 2] -= w * t
                a[3, 3] += w
                b[0] += w * j0 * offset
                b[1] += w * j1 * offset
                b[2] -= w * t * offset
                b[3] += w * offset
            good += agree
            shares[side] = agree / max(shape[side, 0], 1)
        if total < 6.0:
            return 0.0, 1.0, 1.0
        variance = max(spread / max(total - 4.0, 1.0), 1e-12)
        # priors in the same units of weight: the half side, and a step that nothing speaks of is 0
        unit = variance
        a[3, 3] += unit / (half_sigma * half_sigma)
        b[3] += half_off * unit / (half_sigma * half_sigma)
        loose = unit / 9.0
        a[0, 0] += loose
        a[1, 1] += loose
        a[2, 2] += unit / 0.04
        for i in range(4):
            for j in range(i):
                a[j, i] = a[i, j]
        _solve4(a, b)
        width = max(min(6.0 * math.sqrt(variance / mean_weight), 0.6 * width), tight)
    every = 0.0
    for side in range(4):
        every += shape[side, 0]
    return good, every, variance


@njit(cache=True, fastmath=True)
def _move(lines, first, shape, step, theta, moved):
    """Note how far every edge moves along its normal under `step`."""
    for side in range(4):
        nu = math.cos(theta + side * math.pi / 2)
        nv = -math.sin(theta + side * math.pi / 2)
        for i in range(shape[side, 0]):
            moved[side, i] += (nu * step[0] + nv * step[1] - lines[side, i, _T] * step[2] + step[3])


@njit(cache=True, fastmath=True)
def fit_squares(image, starts, blur, half_sigma, search, pixels, first, lines, shape, out):
    """Fit squares to `image` (h, w) uint8 from `starts` (n, 4): u, v, theta, expected half side.

    search: rounds of rough search before the fit (0 when the start is good to 2 px; a fit that comes
    out poor then searches once itself). out (n, FIELDS): u, v, theta, half, visible share of the
    edges, sigma px, quality, contrast, level inside. Visible share 0 means no square there.
    """
    a = np.zeros((4, 4))
    step = np.zeros(4)
    shares = np.zeros(4)
    slopes = np.zeros(4)
    spread = np.zeros(2)
    moved = np.zeros((4, LINES), np.float32)
    smooth = np.zeros((4, LINES), np.float32)
    sums = np.zeros((5, LINES), np.float32)
    flat = FLAT * blur
    for s in range(starts.shape[0]):
        for attempt in range(2):
            u, v, theta, half = starts[s, 0], starts[s, 1], starts[s, 2], starts[s, 3]
            expected = half
            searches = search if attempt == 0 else 2
            if attempt == 1 and search > 0:
                break
            for k in range(FIELDS):
                out[s, k] = 0.0
            out[s, U], out[s, V], out[s, THETA], out[s, HALF] = u, v, theta, half
            for r in range(searches):
                _gather(image, u, v, theta, half, blur, pixels, first, lines, shape)
                for side in range(4):
                    slopes[side] = abs(math.cos(theta + side * math.pi / 2)
                                       if side % 2 == 0 else math.sin(theta + side * math.pi / 2))
                _search(pixels, first, lines, shape, slopes)
                good, every, variance = _agree(lines, shape, theta, expected - half,
                                               max(half_sigma, 0.02 * half), 9.0, 1.5, 5,
                                               a, step, shares)
                if good < 0.3 * every:
                    break
                u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
                if theta > math.pi / 4:  # sides keep their rows and columns
                    theta -= math.pi / 2
                elif theta <= -math.pi / 4:
                    theta += math.pi / 2
            good = every = 0.0
            variance = 1.0
            contrast = level = 0.0
            for gather in range(3):
                _gather(image, u, v, theta, half, blur, pixels, first, lines, shape)
                for side in range(4):
                    slopes[side] = abs(math.cos(theta + side * math.pi / 2)
                                       if side % 2 == 0 else math.sin(theta + side * math.pi / 2))
                moved[:] = 0.0
                contrast, level = _levels(pixels, first, lines, shape, slopes, flat, spread)
                good = 0.0
                if contrast < MIN_CONTRAST:
                    break
                _share_levels(lines, shape, slopes, flat, spread, smooth)
                far = 0.0
                for r in range(4):
                    _offsets(pixels, first, lines, shape, slopes, blur, spread, moved, sums)
                    good, every, variance = _agree(
                        lines, shape, theta, expected - half, half_sigma,
                        3.0 if r == 0 and gather == 0 else 1.0, 0.05, 4 if r == 0 else 3,
                        a, step, shares)
                    if good == 0.0:
                        break
                    _move(lines, first, shape, step, theta, moved)
                    u, v, theta, half = u + step[0], v + step[1], theta + step[2], half + step[3]
                    change = max(abs(step[0]) + abs(step[1]), abs(step[2]) * half)
                    far += change
                    if change < 0.03:
                        break
                if good == 0.0 or far < 0.7:
                    break
            if good > 0.0:
                share = good / max(every, 1.0)
                agreeing = max(min(shares[0], shares[2]), 0.0)
                agreeing = min(max(shares[0], shares[2]), max(shares[1], shares[3]))
                sigma = math.sqrt(variance * 0.5 * (a[0, 0] + a[1, 1]))
                out[s, U], out[s, V], out[s, THETA], out[s, HALF] = u, v, theta, half
                out[s, VISIBLE] = share
                out[s, SIGMA] = sigma
                off = (half - expected) / (3.0 * half_sigma + 0.04 * expected)
                out[s, QUALITY] = share * agreeing * math.exp(-0.5 * off * off)
                out[s, CONTRAST] = contrast
                out[s, LEVEL] = level
            if out[s, VISIBLE] > 0.75:
                break
        if out[s, VISIBLE] > 0.0:
            turns = round(out[s, THETA] / (math.pi / 2))
            out[s, THETA] -= turns * math.pi / 2
