# SPDX-License-Identifier: Apache-2.0
"""When did a block begin to move: back-extrapolation through the images around the crossing.

A block that lets go is pulled by what friction lost, so its path begins as a/2 (t - t0)^2. The onset
t0 is the posterior mean on a grid, the acceleration a being integrated out under a Gaussian prior.
An image that crosses a threshold says no more than `somewhere in the last period`: its error has a
standard deviation of period / sqrt(12) at the least; this estimate is two to five times closer.
"""

import numpy as np

ACCELERATION_MPS2 = 2.5  # what Coulomb friction gives: (mu_s - mu_k) g
GRID = 96


def onset(
    times_s: np.ndarray, path_m: np.ndarray, sigma_m: float, period_s: float
) -> tuple[float, float]:
    """Return onset and its standard deviation, in s, on the clock of `times_s`.

    times_s: (n,) rising. path_m: (n,) displacement from rest along the direction of the slip, the
    first of them still at rest. sigma_m: noise of `path_m`, the error of the rest position included.
    """
    first = times_s[0] - period_s
    t0 = np.linspace(first, times_s[-1], GRID)
    shape = 0.5 * np.maximum(times_s[None, :] - t0[:, None], 0.0) ** 2
    # The law is only nearly a parabola: let later samples weigh a little less than the noise says.
    weight = 1.0 / (sigma_m**2 + (0.02 * path_m) ** 2)
    prior = 1.0 / ACCELERATION_MPS2**2
    information = shape**2 @ weight + prior
    mean = (shape @ (weight * path_m) + prior * ACCELERATION_MPS2) / information
    misfit = ((path_m[None, :] - mean[:, None] * shape) ** 2) @ weight
    misfit += prior * (mean - ACCELERATION_MPS2) ** 2 + np.log(information)
    misfit[mean <= 0.0] += 50.0
    belief = np.exp(-0.5 * (misfit - misfit.min()))
    belief /= belief.sum()
    centre = float(belief @ t0)
    spread = float(np.sqrt(belief @ (t0 - centre) ** 2))
    return centre, max(spread, (t0[1] - t0[0]) / np.sqrt(12.0))
