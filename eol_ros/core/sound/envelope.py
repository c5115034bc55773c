# SPDX-License-Identifier: Apache-2.0
"""Reading one grain: its samples, and the raised-cosine edges that keep it from clicking.

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


@njit(cache=True, fastmath=FAST)
def read_linear(out, source, position, rate, first):
    """Read `source` (n,) f4 at position + rate * (first + k), straight lines between samples."""
    for k in range(out.size):
        p = position + rate * (first + k)
        i = np.int32(p)
        f = np.float32(p - i)
        j = np.uint64(np.uint32(i))
        a = source[j]
        out[k] = a + f * (source[j + np.uint64(1)] - a)


@njit(cache=True, fastmath=FAST)
def read_cubic(out, source, position, rate, first):
    """Read like `read_linear` with the cubic through four samples (Catmull and Rom 1974)."""
    for k in range(out.size):
        p = position + rate * (first + k)
        i = np.int32(p)
        f = np.float32(p - i)
        j = np.uint64(np.uint32(i))
        a, b = source[j - np.uint64(1)], source[j]
        c, d = source[j + np.uint64(1)], source[j + np.uint64(2)]
        c1 = HALF * (c - a)
        c2 = a - np.float32(2.5) * b + np.float32(2.0) * c - HALF * d
        c3 = HALF * (d - a) + np.float32(1.5) * (b - c)
        out[k] = ((c3 * f + c2) * f + c1) * f + b
