# SPDX-License-Identifier: Apache-2.0
"""Loudness as ITU-R BS.1770-4 defines it: K-weighting, then mean square; and its range."""

import numpy as np

from eol_ros.core import elementary

ABSOLUTE_LUFS = -70.0  # what is quieter is silence
STEP_S = 0.1  # from window to window
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


def windows_lufs(sound: np.ndarray, rate: float, window_s: float) -> np.ndarray:
    """Return the loudness of windows that begin every 0.1 s, (m,) LUFS; channels weigh alike.

    0.4 s is momentary loudness, 3 s short-term (EBU Tech 3341). `sound` is (n, channels).
    """
    step = round(STEP_S * rate)
    count = len(sound) // step
    energy = np.zeros(count)
    for channel in sound.T:  # one at a time: ten minutes in double precision are large
        weighted = k_weighted(channel, rate)[0][: count * step]
        energy += np.square(weighted).reshape(count, step).sum(axis=1)
    total = np.concatenate([[0.0], np.cumsum(energy)])
    width = round(window_s / STEP_S)
    return lufs((total[width:] - total[:-width]) / (width * step))


def integrated_lufs(momentary: np.ndarray) -> float:
    """Return the loudness of a programme from its momentary loudness (m,), every 0.1 s.

    ITU-R BS.1770-4, annex 1: blocks below -70 LUFS are left out, then those 10 LU below the rest.
    """
    return _gated(momentary, 10.0)[0]


def loudness_range(short_term: np.ndarray) -> float:
    """Return the loudness range, LU, from short-term loudness (m,) LUFS.

    EBU Tech 3342: from the 10th to the 95th percentile of what is above -70 LUFS and no more than
    20 LU below the loudness of that.
    """
    kept = _gated(short_term, 20.0)[1]
    if not len(kept):
        return 0.0
    low, high = np.percentile(kept, [10, 95])
    return float(high - low)


def _gated(loudness: np.ndarray, below: float) -> tuple[float, np.ndarray]:
    """Return the mean of what passes both gates, LUFS, and what passes."""
    kept = loudness[loudness >= ABSOLUTE_LUFS]
    if len(kept):
        kept = kept[kept >= _mean(kept) - below]
    return (_mean(kept) if len(kept) else -np.inf), kept


def _mean(loudness: np.ndarray) -> float:
    return float(10 * elementary.log10(np.mean(elementary.exp10(loudness / 10))))
