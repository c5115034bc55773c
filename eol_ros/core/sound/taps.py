# SPDX-License-Identifier: Apache-2.0
"""Reading a sound between its samples."""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.sound.lanes import WIDTH, around, fma, fractions, splat, store

POINT = 32  # bits behind the point of a place: multiples of any float32 from 2^-8 on are exact
UNIT = 1 << POINT
_ZERO, _HALF, _TWO = np.float32(0.0), np.float32(0.5), np.float32(2.0)


@njit(forceinline=True)
def _cubic(taps, f):
    """The cubic through b and c with the slopes of their neighbours (Catmull and Rom 1974)."""
    a, b, c, d = taps
    half = splat(_HALF)
    rise, fall = c - a, b - c
    c3 = fma(half, rise + (d - b), splat(_TWO) * fall)
    c2 = splat(_ZERO) - (fma(half, rise, fall) + c3)
    return fma(f, fma(f, fma(f, c3, c2), half * rise), b)


@njit(cache=True)
def read(out, source, rate, first, count):
    """Write the sound at address `source` at the places rate * (first + k), k < count, to `out`.

    `out` is an address of float32, with room for `count` rounded up to whole vectors. As many
    samples are read behind the last place, at `rate`, and two more; and one before the first.
    """
    step = np.int64(rate * UNIT)
    place = step * first
    for k in range(0, 4 * count, 4 * WIDTH):
        low = place & (UNIT - 1)
        taps, f = around(source + 4 * (place >> POINT), low, step), fractions(low, step)
        store(out + k, _cubic(taps, f))
        place += WIDTH * step
