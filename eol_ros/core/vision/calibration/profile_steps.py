# SPDX-License-Identifier: Apache-2.0
"""Where along its profile each edge stands, and how surely: see profiles for what they are."""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.vision.calibration.profiles import (
    _A,
    _B,
    _C,
    _D,
    _E,
    FIRST,
    IN,
    LANES,
    LINES,
    OFFSET,
    OUT,
    TAP,
    TAPS_USED,
    TEXTURE_IN,
    TEXTURE_OUT,
    VALID,
    VARIANCE_IN,
    VARIANCE_OUT,
    WEIGHT,
    T,
)

# Blurs from the edge over which the light inside counts as one level: all pixels up to there. Light
# that falls towards the edge makes the level one of just these pixels, and what is cut off sharply
# jumps from pixel to pixel as a block moves: on covers with relief their weight falls to nothing.
EDGE, SOFT_EDGE = 2.4, (1.6, 3.0)
# Blurs from the edge up to which all pixels are weighed: of the next a hundredth is left.
REACH = 3.0
# Saturated pixels say nothing, and beside them nobody knows the light: its variance is 50^2. So a
# flash does not move the edges of a cover with relief, which shines more on some sides than others.
FULL, OPEN = 254.0, 1.0 / 50.0**2
BRIGHT = 0.9 * FULL  # light inside above this may be saturated at the edge
ROUGH = 0.1  # share of the texture's variance that is new from pixel to pixel
# On covers with relief the light inside falls and rises by more than that: from pixel to pixel by
# SOFT_ROUGH of the contrast of its profile. But where pixels inside weigh more, the edge is found
# further inside; so they weigh as if they differed by INSIDE of the block's contrast, and the level
# zone from the edge by SOFT_LEVEL, alike on all sides, though one be half as bright.
SOFT_ROUGH, INSIDE, SOFT_LEVEL = 0.043, 0.03, 0.2
# By how much the light of a cover with relief moves the edges of its profiles, px RMS, whatever the
# noise. Else the half of a side that is half as bright would count half, and the block would follow
# what the other half's edges have of their own.
UNEVEN_PX = 0.12

# Half the error function of x / sqrt 2, divided by x, in powers of x^2, to 3e-5 for x up to 3.5.
_E0, _E1, _E2, _E3, _E4, _E5, _E6 = (
    np.float32(c)
    for c in (
        0.39881779,
        -0.066072165,
        0.0095619575,
        -0.0010034452,
        7.0793111e-05,
        -2.947819e-06,
        5.3879177e-08,
    )
)


@njit(inline='always')
def _says(pixel, away, along, outer, gap, across):
    """Return what one pixel adds to the sums of its profile; see offsets."""
    f_limit, f_lean, full, scale, v_out, v_more, texture, t_out, reach, sharp = across
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    most = np.float32(3.5)
    x = away * scale
    x = x if x < most else most
    x = x if x > -most else -most
    q = x * x
    z = q * np.float32(-0.5 / 8.0)
    bell = one + z * (
        one
        + z * (half + z * (np.float32(1 / 6) + z * (np.float32(1 / 24) + z * np.float32(1 / 120))))
    )
    bell *= bell
    bell *= bell
    bell *= bell
    cover = half - x * (_E0 + q * (_E1 + q * (_E2 + q * (_E3 + q * (_E4 + q * (_E5 + q * _E6))))))
    bare = one - cover
    rest = pixel - outer - gap * cover
    w = one / (v_out + cover * (v_more + cover * texture) + bare * bare * t_out)
    w = w if abs(along + away * f_lean) < f_limit else zero
    w = w if pixel < full else zero
    close = (reach - q) * sharp
    close = close if close < one else one
    close = w * (close if close > zero else zero)
    w *= bell
    close *= cover
    return w * rest, w * bell, close * bell, close * cover, close * rest


@njit(cache=True, inner=True, fastmath=True, error_model='numpy')
def offsets(work, ends, sides, spread, contrast):
    """Answer for every profile how far its edge lies outside the present square, and how surely.

    One step of maximum likelihood for a Gaussian-blurred step between known levels, each pixel
    weighted by its own variance: noise grows with the share of light from the cover, texture with
    its square, so that a speckled cover is measured by the outer foot of its edge. Bell and its
    integral are polynomials, so that the loop over profiles becomes vector code. Pixels further
    than REACH from the edge say nothing of it. contrast: of the block, grey levels.
    """
    slope, lean, limit, blur, soft = sides
    n, taps = ends[LANES], ends[TAPS_USED]
    used = min(2 * int(math.ceil(REACH * blur / slope)), taps)
    first = (taps - used) // 2
    scale = np.float32(1.0 / blur)
    v_out = np.float32(spread[VARIANCE_OUT])
    v_in = max(spread[VARIANCE_IN] - spread[TEXTURE_IN], spread[VARIANCE_OUT])
    v_more = np.float32(v_in - spread[VARIANCE_OUT])
    t_in, t_out = np.float32(spread[TEXTURE_IN]), np.float32(spread[TEXTURE_OUT])
    texture = np.float32((INSIDE * contrast) ** 2) if soft else np.float32(ROUGH) * t_in
    zero, one = np.float32(0.0), np.float32(1.0)
    f_limit, f_lean, f_slope = np.float32(limit), np.float32(lean), np.float32(slope)
    reach, sharp, falls = np.float32(EDGE * EDGE), np.float32(1e9), zero
    full = bright = np.float32(1e9)
    if soft:
        falls, full, bright = one, np.float32(FULL), np.float32(BRIGHT)
        reach = np.float32(SOFT_EDGE[1] ** 2)
        sharp = np.float32(1.0 / (SOFT_EDGE[1] ** 2 - SOFT_EDGE[0] ** 2))
    loose = np.float32((SOFT_LEVEL * contrast) ** 2) if soft else t_in
    stiff = one / max(loose, np.float32(1e-3))
    # how much a pixel on the edge varies: as it was weighed, and by the light of its own profile
    noise = v_out + np.float32(0.5) * v_more + np.float32(0.25) * t_out
    weighed, own = noise + np.float32(0.25) * texture, np.float32(0.25 * SOFT_ROUGH**2)
    for i in range(n):
        work[_A + i] = zero
        work[_B + i] = zero
        work[_C + i] = zero
        work[_D + i] = zero
        work[_E + i] = zero
    pixels = work[TAP + first * LINES :]
    start = f_slope * np.float32(first)
    across = f_limit, f_lean, full, scale, v_out, v_more, texture, t_out, reach, sharp
    for pair in range(used // 2):  # two at once: sums are read and written half as often
        one_at, other_at = 2 * pair * LINES, (2 * pair + 1) * LINES
        one_ahead = start + f_slope * np.float32(2 * pair)
        other_ahead = start + f_slope * np.float32(2 * pair + 1)
        for i in range(n):
            first, along, outer = work[FIRST + i], work[T + i], work[OUT + i]
            gap = work[IN + i] - outer
            a0, b0, c0, d0, e0 = _says(
                pixels[one_at + i], first + one_ahead, along, outer, gap, across
            )
            a1, b1, c1, d1, e1 = _says(
                pixels[other_at + i], first + other_ahead, along, outer, gap, across
            )
            work[_A + i] += a0 + a1
            work[_B + i] += b0 + b1
            work[_C + i] += c0 + c1
            work[_D + i] += d0 + d1
            work[_E + i] += e0 + e1
    for i in range(n):
        gap = work[IN + i] - work[OUT + i]
        held = work[_D + i] + (stiff if work[IN + i] < bright else np.float32(OPEN))
        share = work[_C + i] / held
        bottom = work[_B + i] - share * work[_C + i] + np.float32(1e-9)
        far = (work[_A + i] - share * work[_E + i]) / bottom
        # what stands at the edge is the light there, not that further inside
        less = falls * (work[_E + i] - work[_C + i] * far) / held
        slant = (work[IN + i] + less - work[OUT + i]) * scale * np.float32(0.39894228)  # grey / px
        safe = slant if slant > one else one
        work[OFFSET + i] = far / safe
        right = weighed / (noise + own * gap * gap) if soft else one
        work[WEIGHT + i] = work[VALID + i] * bottom * safe * safe * right
    if soft:
        _even(work, n)


@njit(inline='always')
def _even(work, n):
    """Make profiles weigh alike as far as it is not noise that moves their edges.

    The sum of all weights stays, and so does what they say of the scatter.
    """
    off, before, after = np.float32(UNEVEN_PX**2), np.float32(0.0), np.float32(0.0)
    for i in range(n):
        weight = work[WEIGHT + i]
        even = weight / (np.float32(1.0) + weight * off)
        before += weight
        after += even
        work[WEIGHT + i] = even
    scale = before / max(after, np.float32(1e-9))
    for i in range(n):
        work[WEIGHT + i] *= scale
