# SPDX-License-Identifier: Apache-2.0
"""The sub voice: the moment of a cascade as one slow wave, for a subwoofer or a shaker.

The moment rate of Brune's source is M0 w^2 t e^(-w t) with w = 2 pi f_c (J. Geophys. Res. 75 (1970)
4997, eq. 36 far from the source). That envelope on a tone of the corner's order of frequency is one
pulse of the voice. Each block that joins the cascade gives a pulse of the moment reached so far:
M0 ~ A D ~ A^(3/2), as slip grows with the radius (Kanamori, Anderson, Bull. Seism. Soc. Am. 65
(1975) 1073), and its frequency goes as the corner's, A^(-1/2).
"""

import functools

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.triggers import TRIGGER

PULSE_HZ = 40.0  # of the pulse in memory; others are the same, read at another rate
RISE = 2.0  # periods to the top of its envelope
PERIODS = 20.0  # then it is 47 dB below its top, and its edge ends it
EDGE_S = 0.25  # of that pulse


def pulse(sample_rate: float) -> np.ndarray:
    """Return the pulse at PULSE_HZ, (n,) f4, of a peak near 1."""
    periods = np.arange(round(PERIODS / PULSE_HZ * sample_rate)) * PULSE_HZ / sample_rate
    swell = periods / RISE * elementary.exp(1 - periods / RISE)
    return (swell * elementary.sin(2 * np.pi * periods)).astype(np.float32)


@functools.cache  # voices know addresses only: it stays for as long as the process does
def pulse_bank(sample_rate: float) -> Bank:
    """Return the bank whose only grain is the pulse; the same for the same rate."""
    return Bank([pulse(sample_rate)], [0], [0.0], [PERIODS / PULSE_HZ], sample_rate)


def frequencies_hz(area: np.ndarray, low_hz: float, high_hz: float) -> np.ndarray:
    """Return the frequency for areas (n,): `high_hz` at 1, as A^-1/2, but not below `low_hz`.

    Examples
    --------
    >>> frequencies_hz(np.array([1, 4, 25]), 18.0, 60.0).tolist()
    [60.0, 30.0, 18.0]
    """
    return np.maximum(low_hz, high_hz / np.sqrt(area))


def moments(area: np.ndarray, blocks: int) -> np.ndarray:
    """Return the moment of areas (n,), 1 for all `blocks` of the table.

    Examples
    --------
    >>> moments(np.array([4, 25]), 25).round(3).tolist()
    [0.064, 1.0]
    """
    share = np.asarray(area, float) / blocks
    return share * np.sqrt(share)


def pulses(
    triggers: np.ndarray, area: np.ndarray, low_hz: float, high_hz: float, blocks: int
) -> np.ndarray:
    """Return the pulses (n,) TRIGGER of grains at which a cascade grows to `area` (n,)."""
    out = np.zeros(len(triggers), TRIGGER)
    out['time_s'], out['pan'], out['block'] = triggers['time_s'], triggers['pan'], triggers['block']
    out['rate'] = frequencies_hz(area, low_hz, high_hz) / PULSE_HZ
    out['gain'] = moments(area, blocks)
    out['release_s'] = EDGE_S / out['rate']
    return out
