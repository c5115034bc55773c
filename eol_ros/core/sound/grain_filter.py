# SPDX-License-Identifier: Apache-2.0
"""A low-pass or band-pass of each grain for itself, sixteen samples at a time.

The state variable filter with trapezoidal integrators (Zavalishin, "The Art of VA Filter Design",
2012, chapter 4): the analogue 1 / (s^2 + s / Q + 1), or (s / Q) / (s^2 + s / Q + 1), by the
bilinear transform, its cutoff exact. With the states s of the two integrators a sample is

    y = c s + d x,    s' = A s + b x.

A recursion has to wait for itself, sample by sample. So sixteen are made at once: what the states
make of them, c A^k s, and what their own inputs do, the impulse response as a triangular matrix;
and the states go sixteen samples on by A^16. All of these are made once for each grain, in double
precision. Groups begin at fixed samples of the grain, wherever a block of output begins, so that a
render is the same bit for bit however it is cut.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.lanes import added
from eol_ros.core.sound.lanes import WIDTH, convolve, fma, load, splat, store

LEAST_HZ = 20.0
MOST = 0.45  # of the sample rate
# Where in a table of float32, behind a vector of zeros, stand the impulse response; c A^k;
# A^(15 - k) b; the states; the four numbers of A^16.
_RESPONSE = WIDTH
_READ1, _READ2, _FEED1, _FEED2 = 2 * WIDTH, 3 * WIDTH, 4 * WIDTH, 5 * WIDTH
_STATE1, _STATE2, _POWER = 6 * WIDTH, 7 * WIDTH, 8 * WIDTH
TABLE = 9 * WIDTH
_SMALL = np.float32(1e-18)  # a state far below it becomes exactly 0, and never a denormal


def tuned(cutoff_hz: np.ndarray, sample_rate: float) -> np.ndarray:
    """Return the gain (n,) of the integrators for cutoffs (n,), Hz, within what can be."""
    within = np.clip(cutoff_hz, LEAST_HZ, MOST * sample_rate)
    return elementary.tan(math.pi * within / sample_rate)


@njit(cache=True)
def design(table, gain, damping, band):
    """Make the `table` (TABLE,) f4 of a filter at rest; damping: 1 / Q; band: else a low-pass."""
    a1 = 1.0 / (1.0 + gain * (gain + damping))
    a2 = gain * a1
    a3 = gain * a2
    p, q, r, s = 2.0 * a1 - 1.0, -2.0 * a2, 2.0 * a2, 1.0 - 2.0 * a3
    c1, c2, d = a2, 1.0 - a3, a3
    if band:
        c1, c2, d = damping * a1, -damping * a2, damping * a2
    u, v = 2.0 * a2, 2.0 * a3
    e1, e2 = c1, c2
    table[:] = np.float32(0.0)
    table[_RESPONSE] = d
    for k in range(WIDTH):
        if k + 1 < WIDTH:
            table[_RESPONSE + k + 1] = c1 * u + c2 * v
        table[_FEED1 + WIDTH - 1 - k], table[_FEED2 + WIDTH - 1 - k] = u, v
        table[_READ1 + k], table[_READ2 + k] = e1, e2
        u, v = p * u + q * v, r * u + s * v
        e1, e2 = e1 * p + e2 * r, e1 * q + e2 * s
    span = 1
    while span < WIDTH:
        p, q, r, s = p * p + q * r, q * (p + s), r * (p + s), r * q + s * s
        span *= 2
    power = table[_POWER:]
    power[0], power[1], power[2], power[3] = p, q, r, s


@njit(forceinline=True)
def _settled(state):
    return (state + splat(_SMALL)) - splat(_SMALL)


@njit(cache=True)
def run(out, row, count, table):
    """Put `count` samples from address `row` through the filter of `table` to address `out`.

    The first is the first of a group. The states go on by whole groups: samples that are left over
    come again, at the begin of the next call. `out` has room for whole groups, and may be `row`.
    """
    at = table.ctypes.data
    p, q = splat(table[_POWER]), splat(table[_POWER + 1])
    r, s = splat(table[_POWER + 2]), splat(table[_POWER + 3])
    read1, read2 = load(at + 4 * _READ1), load(at + 4 * _READ2)
    feed1, feed2 = load(at + 4 * _FEED1), load(at + 4 * _FEED2)
    state1, state2 = load(at + 4 * _STATE1), load(at + 4 * _STATE2)
    for k in range(0, count, WIDTH):
        x = load(row + 4 * k)
        own = convolve(row + 4 * k, at + 4 * _RESPONSE)
        store(out + 4 * k, fma(read1, state1, fma(read2, state2, own)))
        if k + WIDTH <= count:
            next1 = fma(p, state1, fma(q, state2, splat(added(feed1 * x))))
            state2 = _settled(fma(r, state1, fma(s, state2, splat(added(feed2 * x)))))
            state1 = _settled(next1)
    store(at + 4 * _STATE1, state1)
    store(at + 4 * _STATE2, state2)
