# SPDX-License-Identifier: Apache-2.0
"""Buses: grains that are to be filtered alike are summed first and filtered once.

The rows of `m.mix` are the loudspeakers of the mix, then those of bus 1, of bus 2 ... A bus goes
into the mix through two equal one-pole low-passes, whose spectrum 1 / (1 + (f / f_c)^2) is that of
Brune's source (J. Geophys. Res. 75 (1970) 4997), and through a one-pole high-pass, which is
what remains of a one-pole low-pass. A bus on which nothing sounds costs nothing.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit

TAIL = 1e-9  # -180 dBFS: below it the tail of a low-pass is cut to zero


def pole(corner_hz: np.ndarray, sample_rate: float) -> np.ndarray:
    """Return the pole of a one-pole low-pass (impulse invariance) of corners (n,), Hz."""
    return elementary.exp(-2 * math.pi * np.asarray(corner_hz, np.float64) / sample_rate)


@njit(cache=True)
def _pass(row, state, pole, high):
    """Put `row` (n,) f4 through two one-pole low-passes and a high-pass, in place."""
    a, b, c, share, rest = state[0], state[1], state[2], 1.0 - pole, 1.0 - high
    for k in range(row.size):
        x = np.float64(row[k])
        a = share * x + pole * a
        b = share * a + pole * b
        c = rest * b + high * c
        if x == 0.0 and abs(a) + abs(b) + abs(c) < TAIL:
            a = b = c = 0.0
        row[k] = np.float32(b - c)
    state[0], state[1], state[2] = a, b, c


@njit(cache=True)
def _add(row, out, gain):
    for k in range(row.size):
        out[k] += gain * row[k]


@njit(cache=True)
def blend(m, n):
    """Add the first `n` frames of every bus to the mix, and clear the buses.

    Where there is a room, each bus goes into `m.room.send` by its share.
    """
    s = m.state[0]
    channels = m.delay.shape[0]
    for c in range(channels if s.room_tail else 0):
        if m.summed[c]:
            _add(m.mix[c, :n], m.room.send[c % 2, :n], m.room.wets[0])
            m.summed[c] = 0
    for bus in range(1, s.buses + 1):
        for c in range(channels):
            i = channels * bus + c
            if m.summed[i] or m.passes[i].any():
                row = m.mix[i, :n]
                _pass(row, m.passes[i], m.poles[bus], m.highs[bus])
                if s.room_tail:
                    _add(row, m.room.send[c % 2, :n], m.room.wets[bus])
                _add(row, m.mix[c, :n], np.float32(1.0))
                row[:] = np.float32(0.0)
                m.summed[i] = 0
