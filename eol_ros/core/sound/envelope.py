# SPDX-License-Identifier: Apache-2.0
"""The raised-cosine edges that keep a grain from clicking, and adding it to the mix under them.

Every output sample depends on its own number in the grain alone, never on where a block of output
begins; so a render is the same bit for bit however it is cut into blocks. All of it is vector code
(`lanes.py`): rows and mixes are addresses of float32, with room for one vector behind their end.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.sound.lanes import WIDTH, count_from, fma, keep, least, load, splat, store

# sin(pi y) / 2 for |y| <= 1/2 in odd powers: weighted least squares, error < 2e-9.
S1, S3, S5, S7, S9 = (
    np.float32(half) for half in (1.57079629, -2.58385344, 1.27501569, -0.299022585, 0.03861006)
)
HALF, ONE = np.float32(0.5), np.float32(1.0)


@njit(forceinline=True)
def _edge(x):
    """Return the raised cosine (1 - cos(pi x)) / 2 of lanes in 0..1."""
    y = x - splat(HALF)
    s = y * y
    sine = fma(s, fma(s, fma(s, fma(s, splat(S9), splat(S7)), splat(S5)), splat(S3)), splat(S1))
    return fma(y, sine, splat(HALF))


@njit(forceinline=True)
def _add(address, gain, x):
    store(address, fma(gain, x, load(address)))


@njit(cache=True)
def add_edge(a, b, row, count, first, scale, gain_a, gain_b):
    """Add `count` frames of `row` to `a` and `b` under an edge.

    Its frame k has the gain edge((first + k) * scale): one that rises counts from its begin, one
    that falls from its end, with a `scale` below zero.
    """
    scale, left, right = splat(scale), splat(gain_a), splat(gain_b)
    for k in range(0, count, WIDTH):
        x = load(row + 4 * k) * _edge(count_from(np.int32(first + k)) * scale)
        if k > count - WIDTH:
            x = keep(x, np.int32(count - k))
        _add(a + 4 * k, left, x)
        _add(b + 4 * k, right, x)


@njit(cache=True)
def add_flat(a, b, row, count, gain_a, gain_b):
    """Add `count` frames of `row` to `a` and `b` as they are."""
    left, right = splat(gain_a), splat(gain_b)
    for k in range(0, count, WIDTH):
        x = load(row + 4 * k)
        if k > count - WIDTH:
            x = keep(x, np.int32(count - k))
        _add(a + 4 * k, left, x)
        _add(b + 4 * k, right, x)


@njit(cache=True)
def fade_out(out, row, count, left, frames):
    """Write `count` frames of `row` to `out`, under a falling edge while less than `frames` remain.

    `left` of them remain at the first; `count` is at most `left`.
    """
    scale = splat(np.float32(-1.0) / np.float32(frames))
    for k in range(0, count, WIDTH):
        x = least(count_from(np.int32(k - left)) * scale, splat(ONE))
        store(out + 4 * k, load(row + 4 * k) * _edge(x))
