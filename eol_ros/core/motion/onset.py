# SPDX-License-Identifier: Apache-2.0
"""When did a block begin to move: back-extrapolation through the images around the crossing.

A block that lets go is pulled by what friction lost, so its path begins as a/2 (t - t0)^2. The
onset t0 is the posterior mean on a grid, the acceleration a being integrated out under a Gaussian
prior. An image that crosses a threshold says no more than `somewhere in the last period`: its
error has a standard deviation of period / sqrt(12) at the least; this estimate is two to five
times closer. All blocks that begin in one image are answered together, in some 30 array operations.
"""

import math

import numpy as np

from eol_ros.core import elementary

ACCELERATION_MPS2 = 2.5  # what Coulomb friction gives: (mu_s - mu_k) g
ACCELERATION_SPREAD = 0.24  # standard deviation of that guess, as a share of it
# Springs relax as the block goes, or pull harder as the rim and its fellows go on: the path departs
# from a parabola by a share of itself that grows with time.
GROWTH_PER_S = 3.0
DOUBT_PER_S = 5.0
GRID = 48
_UNIT = np.linspace(0.0, 1.0, GRID)
_UNIT2 = _UNIT * _UNIT


def onset(
    times_s: np.ndarray, path_m: np.ndarray, sigma_m: float, period_s: float
) -> tuple[float, float]:
    """Estimate when a block broke loose, between images.

    Parameters
    ----------
    times_s : ndarray
        (n,) rising, in s.
    path_m : ndarray
        (n,) way along the slip in m, the first of them still at rest; NaN where there is none.
    sigma_m : float
        Noise of `path_m`, the error of the rest position included.
    period_s : float
        Between images.

    Returns
    -------
    onset_s, sigma_s : float
        Mean and standard deviation of what the samples leave open, on the clock of `times_s`.

    Examples
    --------
    >>> t = np.arange(20) / 60
    >>> found, sigma = onset(t, 0.8 * np.maximum(t - 0.15, 0) ** 2, 2e-5, 1 / 60)
    >>> round(found, 3), sigma < 2e-3
    (0.15, True)
    """
    found, spread = onsets(
        np.asarray(times_s)[None], np.asarray(path_m)[None], np.array([sigma_m]), period_s
    )
    return float(found[0]), float(spread[0])


def onsets(
    times_s: np.ndarray,
    path_m: np.ndarray,
    sigma_m: np.ndarray,
    period_s: float,
    latest_s: np.ndarray | None = None,
    acceleration_mps2: float = ACCELERATION_MPS2,
) -> tuple[np.ndarray, np.ndarray]:
    """Return onsets and their standard deviations (b,), in s, on the clock of `times_s`.

    times_s: (b, n) rising. path_m: (b, n) displacement from rest along the direction of the slip,
    the first of them still at rest; NaN where there is no sample. sigma_m: (b,) noise of `path_m`,
    the error of the rest position included. latest_s: (b,) stamps of images that show the motion
    beyond doubt, after which no onset lies; the newest ones by default. acceleration_mps2: what a
    block that lets go has on this table.
    """
    absent = np.isnan(path_m)
    path = np.where(absent, 0.0, path_m).T[:, :, None]
    noise2 = np.where(absent, 1e12, (sigma_m * sigma_m)[:, None]).T[:, :, None]
    times, newest = times_s.T[:, :, None], times_s[:, -1:]
    if latest_s is not None:
        newest = np.minimum(newest, latest_s[:, None])
    low, high = np.where(absent, np.inf, times_s).min(1, keepdims=True) - period_s, newest
    for _ in range(2):  # a coarse grid finds the place, a fine one the moment
        width = high - low
        belief = _belief(low + width * _UNIT, times, path, noise2, acceleration_mps2)
        total = np.add.reduce(belief, 1, keepdims=True)
        centre = np.add.reduce(belief * _UNIT, 1, keepdims=True) / total
        square = np.add.reduce(belief * _UNIT2, 1, keepdims=True) / total
        spread = width * np.sqrt(np.maximum(square - centre * centre, 0.0))
        centre = low + width * centre
        step = width / (GRID - 1)
        reach = 4.0 * spread + 2.0 * step
        low, high = centre - reach, np.minimum(centre + reach, newest)
    return centre[:, 0], np.maximum(spread, step / math.sqrt(12.0))[:, 0]


def _belief(
    t0: np.ndarray, times: np.ndarray, path: np.ndarray, noise2: np.ndarray, acceleration: float
) -> np.ndarray:
    """Return the posterior (b, g) of the onset on the grid `t0` (b, g), not normalised.

    The acceleration is integrated out. Samples (n, b, 1) come first, so that sums over them are
    sums of rows. With sums over the samples S.., the misfit at the best acceleration (Sps +
    prior A) / (Sss + prior) is Spp - (Sps + prior A)^2 / (Sss + prior), up to a constant. The
    function divides by the product of all variances and the information, without a logarithm.
    """
    prior = 1.0 / (ACCELERATION_SPREAD * acceleration) ** 2
    since = np.maximum(times - t0, 0.0)
    shape = since * since * (0.5 + 0.5 * GROWTH_PER_S * since)
    doubt = DOUBT_PER_S * since * path
    error = noise2 + doubt * doubt
    seen, form = path / error, shape / error
    information = np.add.reduce(shape * form) + prior
    pull = np.add.reduce(path * form) + prior * acceleration
    misfit = np.add.reduce(path * seen) - pull * pull / information
    misfit += 50.0 * (pull <= 0.0)
    misfit -= np.minimum.reduce(misfit, 1, keepdims=True)
    misfit *= -0.5
    return elementary.exp(misfit) / np.sqrt(np.multiply.reduce(error) * information)
