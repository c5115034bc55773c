# SPDX-License-Identifier: Apache-2.0
"""Edges in a lamp's glow: whether a square is whole though not all of its sides stand in the dark.

Light beside a side may be an arm's, so such lines do not vote on where a square lies. But a lamp's
glow adds to what stands inside and outside, and falls slowly: the cover's own edge stays where it
is, as high as in the dark. Beside an arm it is lower by the arm's light, under one there is none,
and half beside another cover a square has none there either.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.vision.detect import usual_outline
from eol_ros.core.vision.detect.profile_steps import FULL
from eol_ros.core.vision.detect.profiles import (
    ALL,
    BEGIN,
    COUNT,
    FIRST,
    IN,
    LANES,
    LINES,
    OUT,
    TAP,
    TAPS_USED,
    VALID,
    WEIGHT,
    T,
)

# Blurs from the edge: from the first to the other side of it light falls, but for what it falls
# between the others, where it is a lamp's or a relief's.
NEAR, BESIDE, FAR = 1.2, 2.4, 3.6
AS_HIGH = 0.5, 2.0  # times as in the dark, as far as that is not above what a pixel can hold
BOTH = 0.15  # of the light that it adds outside, what a lamp adds inside at least
# An arm passes for a lamp where it is as bright as the cover, and beside relief, whose light falls
# as well. So share of the lines with a cover's light outside, from which on it may be a lamp's
# beside any cover; and times the least contrast, from which on a flat one is brighter than arms.
LAMP, BRIGHTER = 0.1, 3.0
FEW = 8  # lines
LIT = np.float32(0.5)  # of the weight of a line in the dark
LEAST = 0.6  # of each side's lines, of a square that is whole


@njit(inline='always')
def _light(work, i, at, slope, taps):
    """Return the light of line `i`, `at` px outside of its edge, between its pixels."""
    k = min(max((at - work[FIRST + i]) / slope, np.float32(0.0)), np.float32(taps - 1.001))
    j = int(k)
    one = work[TAP + j * LINES + i]
    return one + (k - j) * (work[TAP + (j + 1) * LINES + i] - one)


@njit(inline='always')
def _height(work, i, slope, taps, near, beside, far):
    """Return by how much light falls over the edge of line `i`, but for what falls beside it."""
    fall = _light(work, i, -near, slope, taps) - _light(work, i, near, slope, taps)
    fall -= _light(work, i, -far, slope, taps) - _light(work, i, -beside, slope, taps)
    return fall - _light(work, i, beside, slope, taps) + _light(work, i, far, slope, taps)


@njit(cache=True, inner=True, error_model='numpy')
def admit(work, ends, sides, u, v, around, usual, shares):
    """Let lines vote that show an edge in light, if with them all of the square is in sight.

    They are judged together over half a side, by the edges of the lines that vote, and have LIT for
    VALID then, and levels as far apart as those: what a lamp adds to one side of the edge more than
    to the other does not move its middle. A block that is known (usual: see usual_outline) has a
    lamp beside it only if it usually has, or if it has come to `u`, `v` since. sides:
    profiles.Sides; around: spread[AROUND]; shares (4,): of each side's lines that agree. Returns
    the share of all lines that are let in.
    """
    if min(min(shares[0], shares[1]), min(shares[2], shares[3])) * around >= LEAST:
        return 0.0  # no side needs it
    taps, slope = ends[TAPS_USED], sides.slope
    near, beside, far = NEAR * sides.blur, BESIDE * sides.blur, FAR * sides.blur
    most = sides.limit - far * abs(sides.lean)  # around the corner stands another edge
    high = inside = outside = voting = 0.0
    for side in range(4):
        begin = ends[BEGIN + side]
        for i in range(begin, begin + ends[COUNT + side]):
            if work[VALID + i] > 0 and abs(work[T + i]) <= most:
                high += _height(work, i, slope, taps, near, beside, far)
                inside += work[IN + i]
                outside += work[OUT + i]
                voting += 1.0
    if voting < FEW:
        return 0.0
    high, inside, outside = high / voting, inside / voting, outside / voting
    apart, most_high = np.float32(0.5 * (inside - outside)), max(inside - outside, 1.0)
    total = agree = 0.0
    for side in range(4):
        begin, n = ends[BEGIN + side], ends[COUNT + side]
        mine = 0.0
        for half in range(2):
            first, last = (begin + n // 2, begin + n) if half else (begin, begin + n // 2)
            lines = height = room = more_in = more_out = 0.0
            for i in range(first, last):
                if work[VALID + i] == 0 and abs(work[T + i]) <= most:
                    height += _height(work, i, slope, taps, near, beside, far)
                    more_in += work[IN + i] - inside
                    more_out += work[OUT + i] - outside
                    room += min((FULL - work[OUT + i]) / most_high, 1.0)
                    lines += 1.0
            lamp = AS_HIGH[0] * high * room < height < AS_HIGH[1] * high * lines
            if lamp and more_in > BOTH * more_out:
                mine += lines
                for i in range(first, last):
                    if work[VALID + i] == 0 and abs(work[T + i]) <= most:
                        middle = np.float32(0.5) * (work[IN + i] + work[OUT + i])
                        work[VALID + i] = LIT
                        work[IN + i], work[OUT + i] = middle + apart, middle - apart
        total += mine
        agree += shares[side] * n
        if (shares[side] + mine / max(n, 1)) * around < LEAST:
            mute(work, ends)
            return 0.0
    every = max(ends[ALL], 1)
    if usual_outline.in_dark(usual, (agree + total) / every * around, u, v):
        mute(work, ends)
        return 0.0
    return total / every


@njit(cache=True, inner=True, error_model='numpy')
def mute(work, ends):
    """Take the vote from all lines that `admit` gave it."""
    for i in range(ends[LANES]):
        if work[VALID + i] == LIT:
            work[VALID + i] = work[WEIGHT + i] = 0.0
