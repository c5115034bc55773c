# SPDX-License-Identifier: Apache-2.0
"""Butterworth filters as second-order sections, with the same bits on every machine.

`scipy.signal.butter` designs the same filters, but with NumPy's complex exponentials and tangents,
whose last bits depend on the processor. Here: bilinear transform of the analogue prototype with
prewarped frequencies (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1).
"""

import math

import numpy as np

from eol_ros.core import elementary


def low_pass(corner_hz: float, rate: float) -> np.ndarray:
    """Return a first-order low-pass, (1, 6): b0 b1 b2 a0 a1 a2."""
    k = _warped(corner_hz, rate)
    gain = k / (1.0 + k)
    return np.array([[gain, gain, 0.0, 1.0, (k - 1.0) / (k + 1.0), 0.0]])


def high_pass(corner_hz: float, rate: float) -> np.ndarray:
    """Return a second-order high-pass, (1, 6)."""
    k = _warped(corner_hz, rate)
    a0 = 1.0 + math.sqrt(2.0) * k + k * k
    a1, a2 = 2.0 * (k * k - 1.0), 1.0 - math.sqrt(2.0) * k + k * k
    return np.array([[1.0 / a0, -2.0 / a0, 1.0 / a0, 1.0, a1 / a0, a2 / a0]])


def band_pass(low_hz: float, high_hz: float, rate: float) -> np.ndarray:
    """Return a band-pass with second-order slopes, (2, 6)."""
    low, high = _warped(low_hz, rate), _warped(high_hz, rate)
    width, square = high - low, low * high
    # A pole p of the low-pass becomes the roots of s^2 - p width s + square.
    half = width / math.sqrt(8.0)  # p width / 2 = half (-1 + i)
    real, imag = -square, -2.0 * half * half  # of (p width / 2)^2 - square
    size = math.sqrt(real * real + imag * imag)
    root_real = math.sqrt(0.5 * (size + real)) if size + real > 0.0 else 0.0
    root_imag = -math.sqrt(0.5 * (size - real))
    return np.array(
        [_section(width, -half + sign * root_real, half + sign * root_imag) for sign in (1.0, -1.0)]
    )


def _section(width: float, real: float, imag: float) -> list[float]:
    """Return width s / ((s - pole) (s - its conjugate)) after the bilinear transform."""
    square = real * real + imag * imag
    a0 = 1.0 - 2.0 * real + square
    return [
        width / a0,
        0.0,
        -width / a0,
        1.0,
        2.0 * (square - 1.0) / a0,
        (1.0 + 2.0 * real + square) / a0,
    ]


def _warped(hz: float, rate: float) -> float:
    return float(elementary.tan(math.pi * hz / rate))
