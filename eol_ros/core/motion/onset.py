# SPDX-License-Identifier: Apache-2.0
"""When did a block begin to move: back-extrapolation through the images around the crossing.

A block that lets go is pulled by what friction lost, so its path begins as a/2 (t - t0)^2. The
onset t0 is the posterior mean on a grid, the acceleration a being integrated out under a Gaussian
prior. An image that crosses a threshold says no more than `somewhere in the last period`: its
error has a standard deviation of period / sqrt(12) at the least; this estimate is two to five
times closer.
"""

import numpy as np

ACCELERATION_MPS2 = 2.5  # what Coulomb friction gives: (mu_s - mu_k) g
ACCELERATION_SPREAD = 1.0  # m/s^2, standard deviation of that guess
# Springs relax as the block goes, or pull harder as the rim and its fellows go on: the path departs
# from a parabola by a share of itself that grows with time.
GROWTH_PER_S = 3.0
DOUBT_PER_S = 5.0
GRID = 64


def onset(
    times_s: np.ndarray, path_m: np.ndarray, sigma_m: float, period_s: float
) -> tuple[float, float]:
    """Return onset and its standard deviation, in s, on the clock of `times_s`.

    times_s: (n,) rising. path_m: (n,) displacement from rest along the direction of the slip, the
    first of them still at rest. sigma_m: noise of `path_m`, the error of the rest position
    included.
    """
    low, high = times_s[0] - period_s, times_s[-1]
    for _ in range(2):  # a coarse grid finds the place, a fine one the moment
        t0 = np.linspace(low, high, GRID)
        belief = _belief(t0, times_s, path_m, sigma_m)
        centre = float(belief @ t0)
        step = float(t0[1] - t0[0])
        spread = float(np.sqrt(belief @ (t0 - centre) ** 2))
        reach = 4.0 * spread + 2.0 * step
        low, high = centre - reach, min(centre + reach, times_s[-1])
    return centre, max(spread, step / np.sqrt(12.0))


def _belief(
    t0: np.ndarray, times_s: np.ndarray, path_m: np.ndarray, sigma_m: float
) -> np.ndarray:
    """Posterior of the onset on the grid `t0`, the acceleration integrated out; sums to 1."""
    since = np.maximum(times_s[None, :] - t0[:, None], 0.0)
    shape = 0.5 * since**2 * (1.0 + GROWTH_PER_S * since)
    error = sigma_m**2 + (DOUBT_PER_S * since * path_m) ** 2
    weight = 1.0 / error
    prior = 1.0 / ACCELERATION_SPREAD**2
    information = (shape**2 * weight).sum(1) + prior
    mean = ((shape * weight) @ path_m + prior * ACCELERATION_MPS2) / information
    misfit = (weight * (path_m - mean[:, None] * shape) ** 2 + np.log(error)).sum(1)
    misfit += prior * (mean - ACCELERATION_MPS2) ** 2 + np.log(information)
    misfit[mean <= 0.0] += 50.0
    belief = np.exp(-0.5 * (misfit - misfit.min()))
    return belief / belief.sum()
