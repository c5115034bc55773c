# SPDX-License-Identifier: Apache-2.0
"""The raised-cosine edges that keep a grain from clicking, and adding it to the mix under them.

Every output sample depends on its own number in the grain alone, never on where a block of output
begins; so a render is the same bit for bit however it is cut into blocks.
"""

import numpy as np
from numba import njit

# No reassociation: a sum must not depend on how the compiler unrolls the loop.
FAST = {'contract', 'nnan', 'ninf', 'nsz'}

# sin(pi y) for |y| <= 1/2 in odd powers: weighted least squares, error < 4e-9.
S1, S3, S5, S7, S9 = (
    np.float32(3.14159258),
    np.float32(-5.16770688),
    np.float32(2.55003138),
    np.float32(-0.59804517),
    np.float32(0.07722012),
)
HALF = np.float32(0.5)


@njit(cache=True, fastmath=FAST)
def edge(x):
    """Return the raised cosine (1 - cos(pi x)) / 2, a float32 for x in 0..1."""
    y = x - HALF
    s = y * y
    return HALF + HALF * (y * (S1 + s * (S3 + s * (S5 + s * (S7 + s * S9)))))


@njit(cache=True, fastmath=FAST)
def add_rise(a, b, row, first, frames, gain_a, gain_b):
    """Add `row` (k,) f4 to `a` and `b` under a rising edge of `frames`, from its `first` on."""
    scale = np.float32(1.0) / np.float32(frames)
    for k in range(row.size):
        x = row[k] * edge(np.float32(first + k) * scale)
        a[k] += gain_a * x
        b[k] += gain_b * x


@njit(cache=True, fastmath=FAST)
def add_flat(a, b, row, gain_a, gain_b):
    """Add `row` (k,) f4 to `a` and `b` as it is."""
    for k in range(row.size):
        a[k] += gain_a * row[k]
        b[k] += gain_b * row[k]


@njit(cache=True, fastmath=FAST)
def add_fall(a, b, row, left, frames, gain_a, gain_b):
    """Add `row` (k,) f4 to `a` and `b` under a falling edge of `frames`, of which `left` remain."""
    scale = np.float32(1.0) / np.float32(frames)
    for k in range(row.size):
        x = row[k] * edge(np.float32(left - k) * scale)
        a[k] += gain_a * x
        b[k] += gain_b * x


@njit(cache=True, fastmath=FAST)
def fade_out(out, row, left, frames):
    """Write `row` (k,) f4 to `out` under a falling edge of `frames`; nothing is left after it."""
    for k in range(row.size):
        x = np.float32(max(left - k, 0)) / np.float32(frames)
        out[k] = row[k] * edge(min(x, np.float32(1.0))) if left > k else np.float32(0.0)
