# SPDX-License-Identifier: Apache-2.0
"""Loudness as ITU-R BS.1770-4 defines it: K-weighting, then mean square."""

import numpy as np


def k_weighting(rate: float) -> np.ndarray:
    """Return the K-weighting filter as second-order sections, shape (2, 6), for any sample rate.

    BS.1770-4 prints coefficients for 48 kHz only. The analogue prototypes behind them (a shelf of
    +4 dB at 1682 Hz, a high-pass at 38 Hz) follow from inverting the bilinear transform, so that
    other rates get the same curve; at 48 kHz the printed figures come out to nine digits.
    """
    k = np.tan(np.pi * 1681.974450955533 / rate)
    q, high = 0.7071752369554196, 10 ** (3.999843853973347 / 20)
    mid = high**0.4996667741545416
    a0 = 1 + k / q + k * k
    shelf = [
        (high + mid * k / q + k * k) / a0,
        2 * (k * k - high) / a0,
        (high - mid * k / q + k * k) / a0,
        1.0,
        2 * (k * k - 1) / a0,
        (1 - k / q + k * k) / a0,
    ]
    k = np.tan(np.pi * 38.13547087602444 / rate)
    q = 0.5003270373238773
    a0 = 1 + k / q + k * k
    high_pass = [1.0, -2.0, 1.0, 1.0, 2 * (k * k - 1) / a0, (1 - k / q + k * k) / a0]
    return np.array([shelf, high_pass])


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
    return -0.691 + 10 * np.log10(np.maximum(mean_square, 1e-20))
