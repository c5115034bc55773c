# SPDX-License-Identifier: Apache-2.0
"""Times between cascades: by chance, in clusters, or even."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from eol_ros.core.science.powerlaw import REJECTED, TooFew

FEWEST = 50


def _exponential_distance(values: np.ndarray) -> float:
    """KS distance of `values` (n,) from the exponential law of their mean (test of Lilliefors)."""
    chance = 1 - np.exp(-np.sort(values) / values.mean())
    steps = np.arange(len(values) + 1) / len(values)
    return float(max((steps[1:] - chance).max(), (chance - steps[:-1]).max()))


@dataclass(frozen=True)
class Waiting:
    """Times between onsets. variation: standard deviation over mean, 1 for events by chance."""

    mean_s: float
    variation: float
    gamma_shape: float
    p_value: float
    count: int

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        if self.p_value >= REJECTED:
            words = 'as by chance (Poisson not rejected'
        elif self.gamma_shape < 1:
            words = 'in clusters (Poisson rejected'
        else:
            words = 'more evenly than by chance (Poisson rejected'
        return (
            f'waiting times: mean {self.mean_s:.3g} s, {words}, p {self.p_value:.2g}): variation '
            f'{self.variation:.2f}, shape {self.gamma_shape:.2f} of a gamma law, n {self.count}'
        )


def waiting(onsets_s: np.ndarray, rng: np.random.Generator, repeats: int = 200) -> Waiting:
    """Return the law of the times between `onsets_s` (n,); the test is that of Lilliefors.

    Raises FitError with fewer than 50.
    """
    gaps = np.diff(np.sort(onsets_s))
    gaps = gaps[gaps > 0]
    if len(gaps) < FEWEST:
        raise TooFew(len(gaps), 'waiting time', 'a law of them', FEWEST)

    found = _exponential_distance(gaps)
    drawn = rng.exponential(size=(repeats, len(gaps)))
    worse = sum(_exponential_distance(row) >= found for row in drawn)
    mean = float(gaps.mean())
    spread = math.log(mean) - float(np.log(gaps).mean())
    shape = (
        float(optimize.brentq(lambda k: math.log(k) - special.digamma(k) - spread, 1e-3, 1e6))
        if spread > 1e-6
        else math.inf
    )
    return Waiting(mean, float(gaps.std() / mean), shape, (worse + 1) / (repeats + 1), len(gaps))
