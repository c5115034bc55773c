# SPDX-License-Identifier: Apache-2.0
"""A measured value with its standard error, and the intervals that follow from both."""

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy import special

MOST_VALUES = 12  # of which all subsets are used, 4095


class Estimate(NamedTuple):
    """`value` with the standard error `sigma`, which is known with `dof` degrees of freedom."""

    value: float
    sigma: float
    dof: float = math.inf

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval that holds the true value with probability `level` (Student's t)."""
        above = 0.5 + 0.5 * level
        known = math.isinf(self.dof)
        half = self.sigma * float(
            special.ndtri(above) if known else special.stdtrit(self.dof, above)
        )
        return self.value - half, self.value + half

    def widened(self, sigma: float) -> 'Estimate':
        """Return it with a further error of standard deviation `sigma`, which is independent.

        Degrees of freedom by Welch and Satterthwaite, for `sigma` is taken for known (BIPM JCGM
        100:2008, G.4.1).
        """
        both = math.hypot(self.sigma, sigma)
        dof = self.dof * (both / self.sigma) ** 4 if self.sigma > 0 else math.inf
        return Estimate(self.value, both, dof)


class SampleMean(NamedTuple):
    """The mean of independent `values` (n,), each drawn symmetrically about the true one.

    They need neither be normal nor scatter alike. `further` is the standard deviation of an
    independent, normal error that all of them share.
    """

    values: np.ndarray
    further: float = 0.0

    @property
    def value(self) -> float:
        """The mean."""
        return float(np.mean(self.values))

    @property
    def sigma(self) -> float:
        """The standard error of the mean, with what is shared."""
        return math.hypot(np.std(self.values, ddof=1) / math.sqrt(len(self.values)), self.further)

    def interval(self, level: float) -> tuple[float, float]:
        """Return the interval that holds the true value with probability `level`, or a little more.

        The means of the 2^n - 1 subsets of the values part the line into 2^n intervals, and the
        true value is in each with the same probability (Hartigan, J. Am. Stat. Assoc. 64, 1303,
        1969); so as many are left out at both ends as `level` allows. So it is with subsets of them
        drawn at random, which are used of more than MOST_VALUES. Raises ValueError where that is
        none, below six values for 95 %.
        """
        n = len(self.values)
        subsets, sizes = _subsets(n)
        means = np.sort(subsets @ self.values / sizes)
        out = math.floor(0.5 * (1 - level) * (len(means) + 1))
        if not out:
            raise ValueError(f'{n} values have no interval of {100 * level:g} %')
        value = self.value
        shared = self.further * float(special.ndtri(0.5 + 0.5 * level))
        low, high = value - float(means[out - 1]), float(means[-out]) - value
        return value - math.hypot(low, shared), value + math.hypot(high, shared)

    def widened(self, sigma: float) -> 'SampleMean':
        """Return it with a further shared error of standard deviation `sigma`."""
        return SampleMean(self.values, math.hypot(self.further, sigma))


@functools.cache
def _subsets(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which of `n` values are in each subset that is not empty (2^n - 1, n), and how many.

    As floats, for the product with the values. Of more than MOST_VALUES some subsets are drawn, as
    many as those have.
    """
    if n <= MOST_VALUES:
        subsets = (np.arange(1, 2**n)[:, None] >> np.arange(n) & 1).astype(float)
    else:
        drawn = np.random.default_rng(n).integers(0, 2, (2**MOST_VALUES, n))
        drawn = np.unique(drawn, axis=0)
        subsets = drawn[drawn.any(axis=1)].astype(float)
    return subsets, subsets.sum(axis=1)
