# SPDX-License-Identifier: Apache-2.0
"""Profiles of light across the sides of a square, and where along each of them its edge stands.

Sides are read along whole pixels, never resampled, so each pixel counts once. Every profile
answers by a matched filter how far its edge lies from where it was expected, against the light
that stands there inside and outside.
"""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.vision import outline
from eol_ros.core.vision.appearance.fit import quantile

REACH_PX = 4.8  # of a profile at least, along the normal, to both sides of its edge
TAPS = 22  # pixels of a profile at 45 degrees
SIDE_LINES = 88  # of one side; a wider one is read on every second line
IDLE = 2  # places before and behind the lines of a side, which are averaged over five
CORNER = 1.4  # blurs left out at each end of a side, where two edges mix
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

LINE = np.dtype(
    [
        ('first', 'f8'), ('t', 'f8'),  # px: outwards to its first pixel, and along the side
        ('valid', 'f8'),  # 1, or 0: shows no edge like the others
        # light inside and outside of its edge, of how many pixels, their squared deviations
        ('inside', 'f8'), ('n_in', 'f8'), ('off_in', 'f8'),
        ('outside', 'f8'), ('n_out', 'f8'), ('off_out', 'f8'),
        ('changes', 'f8'),  # squared, from pixel to pixel inside
        ('offset', 'f8'), ('weight', 'f8'),  # px outwards to its edge; reciprocal variance of that
    ]
)  # fmt: skip
"""One profile, from inside outwards."""


class Sides(NamedTuple):
    """How profiles cross the sides of a square, and what these look like.

    slope: by how many px each pixel is further outside than the one before; lean: px along the side
    for each px outwards; limit: px from the middle of a side, where the edge of another begins;
    blur: of edges, px; soft: of a cover with relief, whose light falls towards its edges; taps:
    pixels of a profile.
    """

    slope: float
    lean: float
    limit: float
    blur: float
    soft: bool
    taps: int


class Light(NamedTuple):
    """Variance of a pixel inside and outside, the parts of them that are texture, and the contrast.

    Texture is alike from pixel to pixel, unlike noise. The contrast is 0 where no edge was found.
    """

    inside: float
    outside: float
    texture_in: float
    texture_out: float
    contrast: float


@njit(cache=True)
def sides_of(theta, half, blur, soft):
    """Return the Sides of a square."""
    lean = outline.lean(theta)
    slope = 1.0 / math.sqrt(1.0 + lean * lean)
    taps = min(2 * int(REACH_PX / slope + 0.5) + 2, TAPS)
    return Sides(slope, lean, half - CORNER * blur, blur, soft, taps)


def workspace() -> tuple[np.ndarray, np.ndarray]:
    """Return room for profiles (4, n) LINE, side by side, and their pixels (4, n, TAPS)."""
    lines = np.zeros((4, SIDE_LINES + 1 + 2 * IDLE), LINE)
    return lines, np.zeros((*lines.shape, TAPS))


@njit(cache=True)
def gather(image, u, v, theta, half, sides, table, lines, light):
    """Fill first, t and valid of all profiles, and their pixels; return how many (4,) there are.

    table: of outline, how far outside of the square the outline of a cover with relief stands.

    All sides cross their rows or columns at the same slant, so that the distance from the side
    grows by the slope from tap to tap, and t by the lean with it. The edge lies within half a
    pixel of the middle.
    """
    lines['valid'][:] = 0.0
    counts, (height, width) = np.zeros(4, np.int64), image.shape
    for side in range(4):
        angle = theta + side * math.pi / 2
        nu, nv = math.cos(angle), -math.sin(angle)
        tu, tv = nv, -nu
        by_row = abs(nu) > abs(nv)  # steep: rows cross it
        fast, slow, c_fast, c_slow = (nu, nv, u, v) if by_row else (nv, nu, v, u)
        t_fast, t_slow = (tu, tv) if by_row else (tv, tu)
        rows, cols = (height, width) if by_row else (width, height)
        middle, span = c_slow + half * slow, sides.limit * abs(t_slow)
        low, high = int(math.ceil(middle - span)), int(math.floor(middle + span))
        step, stride = 1 if fast > 0 else -1, (high - low) // SIDE_LINES + 1
        counts[side] = (high - low) // stride + 1 if high >= low else 0
        reach = step * (sides.taps - 1)
        for i in range(counts[side]):
            line, row = lines[side, IDLE + i], low + i * stride
            along = row - c_slow
            edge = (half - slow * along) / fast  # from the centre
            line.t = edge * t_fast + along * t_slow
            away = outline.outside(table, side, np.float32(line.t))
            if away == outline.NONE:
                continue
            line.t += away * sides.lean
            start = int(math.floor(c_fast + edge + away / fast + 0.5 - reach * 0.5))
            line.first = fast * (start - c_fast - edge) - away
            if min(start, start + reach, row) < 0 or max(start, start + reach) >= cols:
                continue
            if row >= rows:
                continue
            line.valid = 1.0
            for k in range(sides.taps):
                at = start + step * k
                light[side, IDLE + i, k] = image[row, at] if by_row else image[at, row]
    return counts


@njit(cache=True)
def _zones(line, pixels, sides):
    """Set what one profile shows inside and outside of its edge.

    Left out is what lies further along the side than its limit.
    """
    line.n_in = line.n_out = line.changes = inner = outer = in2 = out2 = 0.0
    flat, taps = FLAT * sides.blur, sides.taps
    first, last = pixels[0], pixels[taps - 1]
    for k in range(FLAT_TAPS):
        d = line.first + sides.slope * k
        if d < -flat and abs(line.t + d * sides.lean) <= sides.limit:
            x = pixels[k] - first
            line.n_in, inner, in2 = line.n_in + 1.0, inner + x, in2 + x * x
            line.changes += (pixels[k] - pixels[max(k - 1, 0)]) ** 2
        k = taps - 1 - k
        d = line.first + sides.slope * k
        if d > flat and abs(line.t + d * sides.lean) <= sides.limit:
            x = pixels[k] - last
            line.n_out, outer, out2 = line.n_out + 1.0, outer + x, out2 + x * x
    if min(line.n_in, line.n_out) < 2.0:
        line.valid = 0.0
        return
    inner, outer = inner / line.n_in, outer / line.n_out
    line.inside, line.off_in = first + inner, in2 - inner * inner * line.n_in
    line.outside, line.off_out = last + outer, out2 - outer * outer * line.n_out


@njit(cache=True)
def levels(lines, light, counts, sides):
    """Measure the light inside and outside along every profile, and judge which ones show an edge.

    Sets these, clears valid of profiles that show no edge like the others, and returns a Light.
    """
    steps, outsides = np.empty((2, lines.size))
    soft, n, none = sides.soft, 0, Light(0.0, 0.0, 0.0, 0.0, 0.0)
    for side in range(4):
        for i in range(IDLE, IDLE + counts[side]):
            line = lines[side, i]
            if line.valid:
                _zones(line, light[side, i], sides)
            if line.valid:
                steps[n], outsides[n] = line.inside - line.outside, line.outside
                n += 1
    if n < 8:
        return none
    # the contrast that a quarter of all profiles exceeds: right as long as a quarter is in sight;
    # and the platform's own light about here: where more stands outside, it may be an arm's edge
    contrast, bare = quantile(steps[:n], 0.75), quantile(outsides[:n], 0.25)
    if contrast < MIN_CONTRAST:
        return none
    arm = bare + max((SOFT_ARM if soft else ARM) * contrast, 4.0)
    bare += max((SOFT_OTHER if soft else OTHER) * contrast, 4.0)
    low = (SOFT_LEAST if soft else LEAST) * contrast
    mean = count = 0.0
    for side in range(4):
        whole = lines[side, IDLE : IDLE + counts[side]]
        for part in (whole[: len(whole) // 2], whole[len(whole) // 2 :]):
            dark = (part['valid'] * (part['outside'] <= arm)).sum()
            if dark < HARDLY * part['valid'].sum():  # an arm lies along it
                part['valid'][:] = 0.0
            for line in part:
                step = line.inside - line.outside
                if not low <= step <= 2.0 * contrast or line.outside > bare:
                    line.valid = 0.0
                mean += line.valid * line.inside
                count += line.valid
    if count < 8.0:
        return none
    mean /= count
    in2 = out2 = n_in = n_out = changes = 0.0
    for line in lines.reshape(-1):
        if line.valid == 0.0 or (not soft and abs(line.inside - mean) > 0.5 * contrast):
            line.valid = 0.0
            continue
        in2, n_in, changes = in2 + line.off_in, n_in + line.n_in - 1.0, changes + line.changes
        out2, n_out = out2 + line.off_out, n_out + line.n_out - 1.0
    inner, outer = max(n_in, 1.0), max(n_out, 1.0)
    inside, outside = max(in2 / inner, 0.25), max(out2 / outer, 0.25)
    # the innermost pixel has no neighbour, so there are as many changes as degrees of freedom
    noise = max(0.55 * changes / inner, outside)
    return Light(inside, outside, max(inside - noise, 0.0), 0.0, contrast)


@njit(cache=True)
def _smooth(valid, level, pixels, variance):
    """Draw the levels (4, n) to their mean; return what of their variance is not noise."""
    count = valid.sum()
    if count < 1.0:
        return 0.0
    mean, off = (valid * level).sum() / count, np.zeros(level.shape)
    seen = noise = 0.0
    for side in range(4):
        for i in range(IDLE, level.shape[1] - IDLE):
            if valid[side, i]:
                used = light = n = 0.0
                for k in range(i - 2, i + 3):
                    used += valid[side, k]
                    light += valid[side, k] * level[side, k]
                    n += valid[side, k] * pixels[side, k]
                off[side, i] = light / used - mean
                seen += off[side, i] ** 2
                noise += 1.0 / n
    noise *= 1.25 * variance
    keep = max(1.0 - noise / seen, 0.0) if seen > 0.0 else 0.0
    level[:] = mean + keep * off
    return max(seen - noise, 0.0) / count


@njit(cache=True)
def shrink_levels(lines, light, soft):
    """Replace the level of each profile by one that owes no more to noise than it must.

    Neighbours are averaged over five lines; the result is drawn to the block's mean as far as the
    variation seen can be noise (James and Stein 1961). Common levels cancel between opposite sides.
    soft: of a cover with relief the light outside of each side is drawn to that side's own, see
    OWN. Returns the Light with what differs from line to line as texture: it differs as well from
    the level zone to the edge.
    """
    valid, outside, own = lines['valid'], lines['outside'], np.zeros(4)
    if soft:
        for side in range(4):
            mine = (valid[side] * outside[side]).sum() / max(valid[side].sum(), 1.0)
            own[side] = OWN * (mine - (valid * outside).sum() / max(valid.sum(), 1.0))
        for side in range(4):
            outside[side] -= own[side]
    inner = light.texture_in + _smooth(valid, lines['inside'], lines['n_in'], light.inside)
    outer = light.texture_out + _smooth(valid, outside, lines['n_out'], light.outside)
    for side in range(4):
        outside[side] += own[side]
    return Light(light.inside, light.outside, inner, outer, light.contrast)


@njit(cache=True)
def offsets(lines, pixels, sides, light):
    """Answer for every profile how far its edge lies outside the present square, and how surely.

    One step of maximum likelihood for a Gaussian-blurred step between known levels, each pixel
    weighted by its own variance: noise grows with the share of light from the cover, texture with
    its square, so that a speckled cover is measured by the outer foot of its edge. Pixels further
    than REACH from the edge say nothing of it.
    """
    soft, blur, contrast = sides.soft, sides.blur, light.contrast
    used = min(2 * int(math.ceil(REACH * blur / sides.slope)), sides.taps)
    first = (sides.taps - used) // 2
    more = max(light.inside - light.texture_in, light.outside) - light.outside
    texture = (INSIDE * contrast) ** 2 if soft else ROUGH * light.texture_in
    loose = (SOFT_LEVEL * contrast) ** 2 if soft else light.texture_in
    near, far = SOFT_EDGE if soft else (EDGE, EDGE)
    # how much a pixel on the edge varies: as it was weighed, and by the light of its own profile
    noise = light.outside + 0.5 * more + 0.25 * light.texture_out
    before = after = 0.0
    for side in range(4):
        for n in range(lines.shape[1]):
            line = lines[side, n]
            if line.valid == 0.0:
                continue
            a = b = c = d = e = 0.0
            gap = line.inside - line.outside
            for k in range(first, first + used):
                away, pixel = line.first + sides.slope * k, pixels[side, n, k]
                if abs(line.t + away * sides.lean) >= sides.limit or (soft and pixel >= FULL):
                    continue
                x = away / blur
                bell, cover = math.exp(-0.5 * x * x), 0.5 * math.erfc(x / math.sqrt(2.0))
                rest = pixel - line.outside - gap * cover
                bare = 1.0 - cover
                w = light.outside + cover * (more + cover * texture)
                w = 1.0 / (w + bare * bare * light.texture_out)
                a += w * bell * rest
                b += w * bell * bell
                if abs(x) < far:  # of the level inside
                    w *= cover * min((far * far - x * x) / max(far * far - near * near, 1e-9), 1.0)
                    c += w * bell
                    d += w * cover
                    e += w * rest
            open_ = soft and line.inside >= BRIGHT
            held = d + (OPEN if open_ else 1.0 / max(loose, 1e-3))
            bottom = b - c * c / held + 1e-9
            far_by = (a - c * e / held) / bottom
            # what stands at the edge is the light there, not that further inside
            less = (e - c * far_by) / held if soft else 0.0
            slant = max((gap + less) / (blur * math.sqrt(2 * math.pi)), 1.0)  # grey levels a px
            line.offset, line.weight = far_by / slant, bottom * slant * slant
            if soft:
                own = (SOFT_ROUGH * gap) ** 2
                line.weight *= (noise + 0.25 * texture) / (noise + 0.25 * own)
                before += line.weight
                line.weight /= 1.0 + line.weight * UNEVEN_PX**2
                after += line.weight
    if soft:  # the sum of all weights stays, and so does what they say of the scatter
        lines['weight'][:] *= before / max(after, 1e-9)
