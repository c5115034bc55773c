# SPDX-License-Identifier: Apache-2.0
"""Noise of each block at rest, and the displacement that it exceeds at a stated rate.

The two axes of a block at rest carry independent Gaussian noise of variance s^2, so the squared
distance from a known centre exceeds T^2 with probability exp(-T^2 / (2 s^2)) (Rayleigh). With s^2
itself estimated from nu degrees of freedom the tail is that of Hotelling's T^2 in two dimensions,
(1 + T^2 / (nu s^2))^(-nu / 2) (Hotelling, Ann. Math. Stat. 2, 1931), which inverts in closed form.
A Gaussian threshold would alarm tens of times too often while the noise is still being learnt.
"""

import numpy as np

from eol_ros.core import elementary

LEARN_S = 20.0  # memory of the noise, s (chosen)
PRIOR_SAMPLES = 10.0  # weight of the tracker's first sigma (chosen)
ROUND_SAMPLES = 300.0  # weight of the assumption that noise is the same both ways (chosen)
MOST = 3.0  # largest noise / sigma, over that of the median block (sigma errs by up to 1.5)
OCCLUDED = 2.0  # inflation of sigma from which an error repeats in the next images (chosen)
FLOOR_M = 1e-6  # least standard deviation of a position, m: no camera measures better

NOISE = np.dtype([
    ('moments', 'f8', 3),  # of the covariance: (xx + yy) / 2, (xx - yy) / 2, xy, m^2
    ('sigma_m', 'f8'),  # reference: mean sigma that the tracker reports for this block
    ('samples', 'f8'),  # that the moments rest on
])  # fmt: skip


def exceedance(false_alarms_per_hour: float, tests_per_second: float) -> float:
    """Return the probability allowed to one test so that the hour brings the stated alarms."""
    return min(false_alarms_per_hour / (3600.0 * tests_per_second), 0.5)


def threshold_sigmas(probability: float, freedom: np.ndarray) -> np.ndarray:
    """Return T / s, shape of `freedom`; `freedom` counts the degrees of freedom of s^2."""
    nu = np.maximum(freedom, 1.0)
    # nu (p^(-2/nu) - 1), which keeps 11 of 16 digits if nu is a million.
    return np.sqrt(nu * (elementary.exp(-2.0 * elementary.log(probability) / nu) - 1.0))


def second_moments(offset: np.ndarray) -> np.ndarray:
    """Return x^2 + y^2, x^2 - y^2 and 2 x y (n, 3) of `offset` (n, 2)."""
    x, y = offset.T
    return np.stack([x * x + y * y, x * x - y * y, 2.0 * x * y], 1)


def _is_known(sigma: np.ndarray) -> np.ndarray:
    """Return which of `sigma` (n,) m are known: NaN, 0 and infinity mean unknown."""
    return (sigma > 0) & (sigma < np.inf)


class NoiseModel:
    """Covariance of the noise of each block, learnt while it rests."""

    def __init__(self, cells: int) -> None:
        self.rows = np.zeros(cells, NOISE)

    @property
    def variance(self) -> np.ndarray:
        """Mean variance (n,) of both axes, m^2."""
        return np.maximum(self.rows['moments'][:, 0], FLOOR_M**2)

    def inflation(self, sigma: np.ndarray | None, seen: np.ndarray) -> np.ndarray:
        """Return `sigma` (n,) m over its reference, >= 1: a block half under an arm has more.

        The first sigma initialises the noise, since a block that moves when first seen is not
        noisy. A smaller sigma initialises it again, until images at rest have more weight.
        """
        if sigma is None:
            return np.ones(len(self.rows))
        rows, samples = self.rows, self.rows['samples']
        known = seen & _is_known(sigma)
        better = (samples < 2 * PRIOR_SAMPLES) & (sigma < rows['sigma_m'])
        new = known & (better | (samples == 0))
        if new.any():
            first = np.maximum(sigma[new], FLOOR_M)
            rows[new] = np.zeros((), NOISE)
            rows['moments'][new, 0], rows['sigma_m'][new] = first**2, first
            rows['samples'][new] = PRIOR_SAMPLES
        late = known & (rows['sigma_m'] == 0)  # its noise was learned without a sigma
        rows['sigma_m'][late] = np.maximum(sigma[late], FLOOR_M)
        reference = np.where(rows['sigma_m'] > 0, rows['sigma_m'], np.inf)
        return np.maximum(np.where(known, sigma, 0.0) / reference, 1.0)

    def distance2(self, moments: np.ndarray) -> np.ndarray:
        """Return Mahalanobis distances squared (n,) (Proc. Natl. Inst. Sci. India 2, 1936), times
        the mean variance. moments: (n, 3) of the offsets."""
        samples = self.rows['samples']
        known = samples / (samples + ROUND_SAMPLES)
        a, b = self.rows['moments'][:, 1:].T * (known / self.variance)
        square, difference, product = moments.T
        return (square - a * difference - b * product) / (1.0 - a * a - b * b)

    def learn(
        self,
        quiet: np.ndarray,
        moments: np.ndarray,
        variance: np.ndarray,
        sigma: np.ndarray | None,
        period_s: float,
    ) -> None:
        """Learn from the offsets of blocks at rest, `quiet` (n,), from their rest positions.

        moments: (n, 3). variance: (n,) of the offsets, in units of the noise.
        """
        if not quiet.any():
            return
        rows, samples = self.rows, self.rows['samples']
        samples[quiet] = np.minimum(samples[quiet] + 1, LEARN_S / max(period_s, 1e-4))
        gain = np.where(quiet, 1.0 / np.maximum(samples, 1.0), 0.0)
        scale = 1.0 / (2.0 * variance)  # two axes
        rows['moments'] += gain[:, None] * (scale[:, None] * moments - rows['moments'])
        known = rows['sigma_m'] > 0
        if sigma is not None and known.any():  # a short occlusion does not change the reference
            sigma = np.where(quiet & _is_known(sigma), sigma, rows['sigma_m'])
            unoccluded = np.minimum(sigma, OCCLUDED * rows['sigma_m'])
            rows['sigma_m'] += gain * (unoccluded - rows['sigma_m'])
            # motion of a block that moves when first seen is not noise
            ratio = rows['moments'][:, 0] / np.where(known, rows['sigma_m'], np.inf) ** 2
            over = ratio / (MOST**2 * np.median(ratio[known]))
            rows['moments'] /= np.maximum(over, 1.0)[:, None]
