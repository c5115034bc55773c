# SPDX-License-Identifier: Apache-2.0
"""The room: a feedback delay network of sixteen lines, fed by the buses.

J.-M. Jot, A. Chaigne, "Digital delay networks for designing artificial reverberators", 90th AES
Convention (1991), preprint 3030: each line of d samples has the gain 10^(-3 d / (f_s T)), so that
all of them decay by 60 dB in the same T, and a one-pole low-pass that makes it a shorter time for
high frequencies. The lines are mixed by a Hadamard matrix, which keeps energy. Each loudspeaker
hears another row of it: its sound is as dense, but not the same.

A vector holds one sample of all lines (`lanes.py`), so the bits are those of `lanes`. The room
falls asleep, with exact zeros, when what it last heard has decayed by TAIL_DB.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.sound.lanes import WIDTH, butterfly, fma, load, splat, store

LINES = WIDTH
SHORTEST_S, LONGEST_S = 0.031, 0.097
HIGH_HZ = 4000.0  # where the shorter decay is reached
SPAN = 64  # samples of all lines that are turned about in one go; the shortest line is longer
TAIL_DB = 140.0
_QUARTER = np.float32(1 / math.sqrt(LINES))


def delays(sample_rate: float) -> np.ndarray:
    """Return the length of each line, (LINES,) samples: primes, each longer by the same factor.

    Examples
    --------
    >>> delays(48000)[[0, -1]].tolist()
    [1489, 4657]
    """
    wanted = (
        sample_rate
        * SHORTEST_S
        * elementary.power(LONGEST_S / SHORTEST_S, np.linspace(0, 1, LINES))
    )
    return np.array([_prime(round(n)) for n in wanted], np.int64)


def _prime(n: int) -> int:
    while any(n % k == 0 for k in range(2, math.isqrt(n) + 1)):
        n += 1
    return n


def coefficients(sample_rate: float, decay_s: float, high_s: float) -> np.ndarray:
    """Return what `reverberate` multiplies by, (4, LINES) f4.

    Rows 0 and 1: z = row 0 * x + row 1 * z is gain and low-pass of each line. Rows 2 and 3: how
    much each line takes of the two inputs; scaled such that what comes out is as loud as what goes
    in, whatever the decay. decay_s, high_s: time in which low frequencies, and HIGH_HZ, decay by
    60 dB.
    """
    d = delays(sample_rate)
    gain = elementary.exp10(-3 * d / (sample_rate * decay_s))
    ratio = elementary.exp10(-3 * d / sample_rate * (1 / min(high_s, decay_s) - 1 / decay_s))
    # (1 - p) / |1 - p e^(-i w)| = ratio at w, a quadratic in the pole p
    turn = elementary.cos(2 * math.pi * min(HIGH_HZ, 0.4 * sample_rate) / sample_rate)
    a, b = 1 - ratio**2, 1 - ratio**2 * turn
    pole = a / (b + np.sqrt(b**2 - a**2))
    # The lines hold what enters them over what they lose, and what is heard is what they keep.
    level = math.sqrt(float(np.mean(1 - gain**2) / np.mean(gain**2)))
    inputs = np.zeros((2, LINES))
    inputs[0, ::2] = inputs[1, 1::2] = level
    inputs[:, 2::4] *= -1
    return np.concatenate([[gain * (1 - pole), pole], inputs]).astype(np.float32)


@njit(cache=True)
def _asleep(m, frame):
    """Whether the room has decayed by `frame`; if it just has, clear it."""
    s = m.state[0]
    if frame < s.room_until:
        return False
    if s.room_awake:
        m.room.lines[:] = np.float32(0.0)
        m.room.damping[:] = np.float32(0.0)
        s.room_awake = 0
    return True


@njit(cache=True)
def _last(row, n):
    """Return the number of the last of `n` samples that is not zero, -1 if all are."""
    for k in range(n - 1, -1, -1):
        if row[k] != 0.0:
            return k
    return -1


@njit(cache=True)
def _mix_lines(delayed, entering, a, b, coefficients, damping, n):
    """Damp what comes out of the lines, mix it, add the inputs; all are addresses of float32.

    delayed, entering: (n, LINES). `delayed` becomes what the loudspeakers hear.
    """
    keep, pole = load(coefficients), load(coefficients + 4 * LINES)
    left, right = load(coefficients + 8 * LINES), load(coefficients + 12 * LINES)
    z, quarter = load(damping), splat(_QUARTER)
    for k in range(n):
        at = 4 * LINES * k
        z = fma(pole, z, keep * load(delayed + at))
        x = butterfly(butterfly(butterfly(butterfly(z, 8), 4), 2), 1) * quarter
        store(delayed + at, x)
        store(entering + at, fma(left, splat(a[k]), fma(right, splat(b[k]), x)))
    store(damping, z)


@njit(cache=True)
def reverberate(m, n):
    """Add what the room makes of the first `n` frames of `m.room.send` to the mix, and clear it."""
    s = m.state[0]
    size = m.room.lines.shape[1]
    at = 0
    while at < n:
        frame = s.frame + at
        count = min(n - at, SPAN)
        asleep = _asleep(m, frame)
        if not asleep:
            count = min(count, s.room_until - frame)
        a, b = m.room.send[0, at : at + count], m.room.send[1, at : at + count]
        heard = max(_last(a, count), _last(b, count))
        if heard >= 0:
            s.room_until = frame + heard + 1 + s.room_tail
            s.room_awake = 1
        elif asleep:
            at += count
            continue
        for i in range(LINES):
            row, first = m.room.lines[i], frame - m.room.delays[i]
            for k in range(count):
                m.room.turned[0, k, i] = row[(first + k) & (size - 1)]
        _mix_lines(
            m.room.turned[0].ctypes.data,
            m.room.turned[1].ctypes.data,
            a,
            b,
            m.room.coefficients.ctypes.data,
            m.room.damping.ctypes.data,
            count,
        )
        for i in range(LINES):
            row = m.room.lines[i]
            for k in range(count):
                row[(frame + k) & (size - 1)] = m.room.turned[1, k, i]
        for c in range(s.channels):
            row, line = m.mix[c], 1 + c % (LINES - 1)
            for k in range(count):
                row[at + k] += m.room.turned[0, k, line]
        at += count
    m.room.send[:, :n] = np.float32(0.0)
