# SPDX-License-Identifier: Apache-2.0
"""What each block's edges look like in full view, by which it is measured when an arm hides some.

Light that falls towards an edge, a wall in sight, or the printed land make one side of a cover seem
to lie a tenth of a pixel further out than the next, and all of them further in. While all are in
sight that cancels. When an arm hides some, the others must be taken for what they are, or the block
seems to go with those that are left. And the edge of an arm beside a side makes it seem to lie
further in, up to a pixel, long before so much light stands there that it could be no platform: what
usually stands there tells. Both are learnt for each stretch of each side, of blocks in full view.
An arm as dark as the platform has an edge like a cover's. It takes a strip of one side, so that the
block is less wide than usual and seems to stand aside by half of the strip, nobody knows which way.
"""

import math

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import exp, log
from eol_ros.core.vision.detect.profiles import (
    _F,
    BEGIN,
    COUNT,
    IN,
    LANES,
    NU,
    NV,
    OFFSET,
    OUT,
    VALID,
    WEIGHT,
    T,
)  # fmt: skip

STRETCHES = 8  # of a side
# One row for each block: of all stretches the edge in px outside of the square, and the light
# inside and outside; by how many px its half side is more than expected; how unlike those lights
# are from line to line, squared, how unlike the edge of a stretch is from time to time, px^2, and
# how unlike the light outside is all along; how often it was learnt, of what
# share of the edge, and what share of it stood in a lamp's glow; how many right angles lie from
# theta to its own x axis, -1: it is not known which block it is; whether to learn; whether an arm
# led it away from where it rested; where in the image it was learnt, px, beside a lamp at first.
EDGE, INSIDE, OUTSIDE = (k * 4 * STRETCHES for k in range(3))
WIDER = 12 * STRETCHES
(ROUGH_IN, ROUGH_OUT, ROUGH_EDGE, TEXTURE, TIMES, SHARE, GLOW, QUARTER, LEARNS, LED, PLACE) = range(
    WIDER + 1, WIDER + 12
)
SIZE = WIDER + 13
IN_VIEW = 0.96  # of the share that is usual, from which on a block is in full view
FORGETS = 0.001  # of the usual share each time: what stands before a block for ever is usual, too
# Grey levels^2, and times as much as is usual: an arm stands beside a block about which the light
# varies by more.
TOUCHED = 2.0, 2.0
GRADUALLY = 0.04  # of the share, and for light up to twice as much
ENOUGH, MOST = 8.0, 60.0  # times after which it is believed, and over which it is averaged
GLOWS = 0.05  # of its edge, from which on a lamp stands beside a block that is known
LEAVES_PX = 3.0  # what was learnt beside a lamp, or of the dark, holds only so far
MOSTLY = 0.7  # of its edge: of a block that never showed so much, an arm's may have been learnt
EACH = 8  # images in which a block is learnt once, when it is known
# Grey levels, share of the contrast, and times the roughness by which the light of a line may
# differ from what is usual there, outside and inside; how many lines beside it are left out, too.
UNLIKE_OUT, UNLIKE_IN = (4.0, 0.03, 3.0), (6.0, 0.15, 3.0)
BESIDE = 2
# By how much less wide, half of it in px, a block may seem by noise alone; which cannot be, if all
# four sides together are not further in by ALL_IN_PX. Edges further off are none of its own: an arm
# puts an edge further in, and none further out but by leading the whole outline.
NARROW_PX, NARROW_SIGMAS, ALL_IN_PX = 0.05, 3.0, 0.02
IN_PX, OUT_PX = -1.5, 5.0
ELSEWHERE = 0.1  # of the stretches of a block, beside an arm
ARM_PX = 0.5  # by which stretches of an arm's edge lie off a square that was fitted to them, RMS
SLOWLY = 0.01  # is learnt of a block that seems less wide: as it may for ever, out of focus
_SPAN = 128  # grey levels, and hundredths


def rows(blocks: int) -> np.ndarray:
    """Return rows (blocks + 1, SIZE) f4 of which nothing is known, the last for no block."""
    found = np.zeros((blocks + 1, SIZE), np.float32)
    found[:, QUARTER] = -1.0
    return found


@njit(inline='always')
def trusted(usual):
    """Return whether enough is known of a block."""
    return usual[QUARTER] >= 0 and usual[TIMES] >= ENOUGH and usual[SHARE] >= MOSTLY


@njit(inline='always')
def _left(usual, u, v):
    return abs(usual[PLACE] - u) + abs(usual[PLACE + 1] - v) > LEAVES_PX


@njit(inline='always')
def follow(usual, u, v):
    """Forget what was learnt of a block beside a lamp that it leaves, for `u`, `v` px."""
    if usual[GLOW] >= GLOWS and _left(usual, u, v):
        usual[TIMES] = usual[SHARE] = usual[GLOW] = 0.0


@njit(inline='always')
def outgrow(usual, share):
    """Forget what was learnt of a block if more of its edge than ever agrees, `share`."""
    if usual[TIMES] > 0 and share > usual[SHARE] / IN_VIEW:
        usual[TIMES] = 0.0


@njit(inline='always')
def in_dark(usual, share, u, v):
    """Return whether a block at `u`, `v` is known to have no lamp beside it.

    share: what of it is in view, if lines in a lamp's glow are.
    """
    known = trusted(usual) and not _left(usual, u, v)
    return known and usual[GLOW] < GLOWS and share <= usual[SHARE] / IN_VIEW


@njit(inline='always')
def touched(usual, share, texture):
    """Return how surely an arm stands over or beside a block that is known, 0..1.

    share: of its edge that agrees. texture: how unlike the light outside is from line to line,
    squared. What is between comes gradually: noise moves both, and must not move the block.
    """
    if not trusted(usual):
        return 0.0
    missing = (IN_VIEW * usual[SHARE] - share) / GRADUALLY
    most = TOUCHED[0] + TOUCHED[1] * usual[TEXTURE]
    return min(max(missing, texture / most - 1.0, 0.0), 1.0)


@njit(inline='always')
def forget(usual):
    """Ask for a little less than was seen before."""
    if usual[LEARNS] > 0:
        usual[SHARE] *= 1.0 - FORGETS


@njit(inline='always')
def _first(side, usual):
    return (side + 4 - int(usual[QUARTER])) % 4 * STRETCHES


@njit(inline='always')
def _stretch(t, per_px):
    k = int(t * per_px + np.float32(0.5 * STRETCHES))
    return min(max(k, 0), STRETCHES - 1)


@njit(cache=True, inner=True, error_model='numpy')
def recall(work, ends, half, usual):
    """Take off every OFFSET how far outside of the square its edge usually is."""
    per_px = np.float32(0.5 * STRETCHES / half)
    for side in range(4):
        first, at = EDGE + _first(side, usual), ends[BEGIN + side]
        for i in range(at, at + ends[COUNT + side]):
            work[OFFSET + i] -= usual[first + _stretch(work[T + i], per_px)]


@njit(cache=True, inner=True, error_model='numpy')
def aside(work, ends, half, more, step, sigma, recalled, usual):
    """Return by how many px a block may stand aside, as it is less wide than usual.

    Or wider, once its lines are taken for what they usually are: then two sides contradict another.

    half: its side after the `step` (4,) of a fit, and by how much it is `more` than expected.
    sigma: of its place, px.
    recalled: whether the fit was of what differs from the usual.
    """
    wider = more - usual[WIDER]
    if not trusted(usual) or (wider > -ALL_IN_PX and not recalled):
        return 0.0
    per_px = np.float32(0.5 * STRETCHES / half)
    d0, d1, d2, d3 = step[0], step[1], step[2], step[3]
    most = 0.0
    for axis in range(2):
        joint = 0.0
        seen = 0
        for side in range(axis, 4, 2):
            first, at = EDGE + _first(side, usual), ends[BEGIN + side]
            weight = total = 0.0
            for i in range(at, at + ends[COUNT + side]):
                rest = work[OFFSET + i] - (
                    work[NU + i] * d0 + work[NV + i] * d1 - work[T + i] * d2 + d3
                )
                if not recalled:
                    rest -= usual[first + _stretch(work[T + i], per_px)]
                if work[WEIGHT + i] > 0 and IN_PX < rest < OUT_PX:
                    weight += work[WEIGHT + i]
                    total += work[WEIGHT + i] * rest
            if weight > 0.0:
                joint += total / weight
                seen += 1
        if seen == 2:
            by = wider + 0.5 * joint
            by = abs(by) if recalled else -by  # light about a block makes it look wider, too
            most = max(most, by - max(NARROW_PX, NARROW_SIGMAS * sigma))
    return most


@njit(cache=True, inner=True, error_model='numpy')
def mean_weight(work, ends):
    """Return the mean WEIGHT of lines that have one."""
    total = count = 0.0
    for i in range(ends[LANES]):
        total += work[WEIGHT + i]
        count += 1.0 if work[WEIGHT + i] > 0 else 0.0
    return total / max(count, 1.0)


@njit(cache=True, inner=True, error_model='numpy')
def evidence(work, ends, half, step, width, unlike, usual):
    """Return how much the lines say that they are edges of this block and not of an arm, nats.

    Stretches of the block lie where they usually do, but for `unlike` px, or what was seen of it,
    and for some that stand ELSEWHERE; those of an arm, which is round, lie off by ARM_PX as well.
    How unlike the lines of one stretch are is noise, and says neither.

    half: its side after the `step` (4,) of a fit of what differs from the usual; width: of Tukey's
    weights, px.
    """
    per_px = np.float32(0.5 * STRETCHES / half)
    d0, d1, d2, d3 = step[0], step[1], step[2], step[3]
    places, weights = np.zeros(4 * STRETCHES), np.zeros(4 * STRETCHES)
    square = lines = 0.0
    seen = 0
    for side in range(4):
        first, i = _first(side, usual), ends[BEGIN + side]
        end = i + ends[COUNT + side]
        while i < end:
            k = _stretch(work[T + i], per_px)
            weight = place = 0.0
            while i < end and _stretch(work[T + i], per_px) == k:
                rest = work[OFFSET + i] - (
                    work[NU + i] * d0 + work[NV + i] * d1 - work[T + i] * d2 + d3
                )
                if work[WEIGHT + i] > 0 and abs(rest) < width:
                    weight += work[WEIGHT + i]
                    place += work[WEIGHT + i] * rest
                    square += work[WEIGHT + i] * rest * rest
                    lines += 1.0
                i += 1
            if weight > 0.0 and usual[INSIDE + first + k] > 0:  # it was seen before
                places[seen], weights[seen] = place / weight, weight
                square -= place * place / weight
                seen += 1
    noise = max(square / max(lines - seen, 1.0), 1.0)  # of a line, in units of its weight
    apart = max(unlike * unlike, usual[ROUGH_EDGE])
    told = 0.0
    for k in range(seen):
        usually = apart + noise / weights[k]
        arm = usually + ARM_PX * ARM_PX
        more = 0.5 * (log(arm / usually) - places[k] ** 2 * (1.0 / usually - 1.0 / arm))
        told += log(ELSEWHERE + (1.0 - ELSEWHERE) * exp(more))
    return told


@njit(cache=True, inner=True, error_model='numpy')
def mute_unlike(work, ends, half, contrast, usual):
    """Clear VALID of lines whose levels are not as usual, and of those beside them.

    What the light of all does in common, exposure, flashes and lamps, is none of it.
    """
    per_px = np.float32(0.5 * STRETCHES / half)
    darker, gains = np.zeros(_SPAN), np.zeros(2 * _SPAN)
    total = 0.0
    for side in range(4):
        first, at = _first(side, usual), ends[BEGIN + side]
        for i in range(at, at + ends[COUNT + side]):
            if work[VALID + i] > 0:
                k = first + _stretch(work[T + i], per_px)
                off = work[OUT + i] - usual[OUTSIDE + k] + 0.5 * _SPAN
                darker[min(max(int(off), 0), _SPAN - 1)] += 1
                step = max(usual[INSIDE + k] - usual[OUTSIDE + k], 1.0)
                gain = (work[IN + i] - work[OUT + i]) / step * (0.5 * _SPAN)
                gains[min(max(int(gain), 0), 2 * _SPAN - 1)] += 1
                total += 1
    # a quarter of the lines is darker outside; a quarter is brighter by more than that
    shift, count = 0, 0.0
    while shift < _SPAN - 1 and count + darker[shift] < 0.25 * total:
        count += darker[shift]
        shift += 1
    more, count = 2 * _SPAN - 1, 0.0
    while more > 0 and count + gains[more] < 0.25 * total:
        count += gains[more]
        more -= 1
    shade, gain = shift + 0.5 - 0.5 * _SPAN, (more + 0.5) / (0.5 * _SPAN)
    most = max(UNLIKE_OUT[0], UNLIKE_OUT[1] * contrast) + UNLIKE_OUT[2] * math.sqrt(
        usual[ROUGH_OUT]
    )
    least = max(UNLIKE_IN[0], UNLIKE_IN[1] * contrast) + UNLIKE_IN[2] * math.sqrt(usual[ROUGH_IN])
    for side in range(4):
        first, at = _first(side, usual), ends[BEGIN + side]
        end = at + ends[COUNT + side]
        for i in range(at, end):
            k = first + _stretch(work[T + i], per_px)
            out = work[OUT + i] - usual[OUTSIDE + k] - shade
            step = (usual[INSIDE + k] - usual[OUTSIDE + k]) * gain
            bad = out > most or abs(work[IN + i] - work[OUT + i] - step) > least + most
            work[_F + i] = 1.0 if bad and work[VALID + i] > 0 else 0.0
        for i in range(at, end):
            for j in range(max(i - BESIDE, at), min(i + BESIDE + 1, end)):
                if work[_F + j] > 0:
                    work[VALID + i] = 0.0


@njit(cache=True, inner=True, error_model='numpy')
def learn(work, ends, u, v, half, more, step, part, width, share, texture, aside, lit, usual):
    """Learn from a fit, if it is of a block in full view.

    u, v: where it is, px. half: its side, with `part` of the last `step` (4,) of the fit; by `more`
    it is over what was expected. width: of Tukey's weights, px. share: of the edge that agrees;
    texture: see touched.
    aside: by so many px it may stand aside. lit: share of the edge in a lamp's glow.
    It must have been fitted as if nothing were known of it, so that what is learnt cannot drift
    with what was learnt before.
    """
    if usual[QUARTER] < 0 or (usual[LEARNS] == 0 and usual[TIMES] >= ENOUGH):
        return
    forget(usual)
    if share < IN_VIEW * usual[SHARE] or touched(usual, share, texture) > 0.0:
        return
    usual[TIMES] = min(usual[TIMES] + 1.0, MOST)
    usual[SHARE] = max(usual[SHARE], min(share, 1.0))
    gain = SLOWLY if aside > 0.0 else 1.0 / usual[TIMES]
    per_px = np.float32(0.5 * STRETCHES / half)
    d0, d1, d2, d3 = part * step[0], part * step[1], part * step[2], part * step[3]
    rough_in = rough_out = rough_edge = lines = stretches = 0.0
    for side in range(4):
        first, i = _first(side, usual), ends[BEGIN + side]
        end = i + ends[COUNT + side]
        while i < end:
            k = _stretch(work[T + i], per_px)
            weight = edge = n = light = dark = light2 = dark2 = 0.0
            while i < end and _stretch(work[T + i], per_px) == k:
                rest = work[OFFSET + i] - (
                    work[NU + i] * d0 + work[NV + i] * d1 - work[T + i] * d2 + d3
                )
                w = max(1.0 - (rest / width) ** 2, 0.0)
                w *= work[WEIGHT + i] * w
                if w > 0.0:
                    weight += w
                    edge += w * rest
                    n += 1.0
                    light += work[IN + i]
                    dark += work[OUT + i]
                    light2 += work[IN + i] ** 2
                    dark2 += work[OUT + i] ** 2
                i += 1
            if n > 0.0:
                at = first + k
                rough_edge += (edge / weight - usual[EDGE + at]) ** 2
                stretches += 1.0
                usual[EDGE + at] += gain * (edge / weight - usual[EDGE + at])
                usual[INSIDE + at] += gain * (light / n - usual[INSIDE + at])
                usual[OUTSIDE + at] += gain * (dark / n - usual[OUTSIDE + at])
                rough_in += light2 - light * light / n
                rough_out += dark2 - dark * dark / n
                lines += n
    usual[GLOW] += gain * (lit - usual[GLOW])
    if usual[GLOW] < GLOWS or usual[TIMES] == 1.0:  # beside a lamp: where that began
        usual[PLACE], usual[PLACE + 1] = u, v
    usual[TEXTURE] += gain * (texture - usual[TEXTURE])
    usual[WIDER] += gain * (more - usual[WIDER])
    if usual[TIMES] > 1:
        usual[ROUGH_EDGE] += gain * (rough_edge / max(stretches, 1.0) - usual[ROUGH_EDGE])
    usual[ROUGH_IN] += gain * (rough_in / max(lines, 1.0) - usual[ROUGH_IN])
    usual[ROUGH_OUT] += gain * (rough_out / max(lines, 1.0) - usual[ROUGH_OUT])
