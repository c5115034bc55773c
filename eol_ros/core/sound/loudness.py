# SPDX-License-Identifier: Apache-2.0
"""Loudness as ITU-R BS.1770-4 defines it: K-weighting, then mean square."""

import numpy as np

from eol_ros.core import elementary

# Goes into the filters with the sound, as a tone of half the sample rate: in silence they would
# decay into subnormal numbers, which take a processor 14 times as long.
TINY = 1e-25


def k_weighting(rate: float) -> np.ndarray:
    """Return the K-weighting filter as second-order sections, shape (2, 6), for any sample rate.

    BS.1770-4 prints coefficients for 48 kHz only. The analogue prototypes behind them (a shelf of
    +4 dB at 1682 Hz, a high-pass at 38 Hz) follow from inverting the bilinear transform, so that
    other rates get the same curve; at 48 kHz the printed figures come out to nine digits.
    """
    k = elementary.tan(np.pi * 1681.974450955533 / rate)
    q, high = 0.7071752369554196, elementary.exp10(3.999843853973347 / 20)
    mid = elementary.power(high, 0.4996667741545416)
    a0 = 1 + k / q + k * k
    shelf = [
        (high + mid * k / q + k * k) / a0,
        2 * (k * k - high) / a0,
        (high - mid * k / q + k * k) / a0,
        1.0,
        2 * (k * k - 1) / a0,
        (1 - k / q + k * k) / a0,
    ]
    k = elementary.tan(np.pi * 38.13547087602444 / rate)
    q = 0.5003270373238773
    a0 = 1 + k / q + k * k
    high_pass = [1.0, -2.0, 1.0, 1.0, 2 * (k * k - 1) / a0, (1 - k / q + k * k) / a0]
    return np.array([shelf, high_pass])


def k_weighted(
    samples: np.ndarray, rate: float, state: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return `samples` (..., n) with K-weighting along the last axis, in double precision.

    Returns also the state of the filters, with which the next samples go on.
    """
    from scipy.signal import sosfilt

    filters = k_weighting(rate)
    heard = np.array(samples, float, order='C')
    heard[..., ::2] += TINY
    heard[..., 1::2] -= TINY
    if state is None:
        state = np.zeros((len(filters), *heard.shape[:-1], 2))
    return sosfilt(filters, heard, zi=state)


def lufs(mean_square: np.ndarray) -> np.ndarray:
    """Convert the mean square of a K-weighted channel to loudness.

    Parameters
    ----------
    mean_square : ndarray
        Of full scale 1.

    Returns
    -------
    ndarray
        LUFS, of the same shape.

    References
    ----------
    ITU-R BS.1770-4, eq. 2.

    Examples
    --------
    >>> lufs(np.array([0.5])).round(2).tolist()
    [-3.7]
    """
    return -0.691 + 10 * elementary.log10(np.maximum(mean_square, 1e-20))
