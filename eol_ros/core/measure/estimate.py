# SPDX-License-Identifier: Apache-2.0
"""A measured value with its standard error, and the intervals that follow from both."""

import math
from typing import NamedTuple

import numpy as np
from scipy import special


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


def mean(values: np.ndarray) -> Estimate:
    """Return the mean of two or more independent `values` (n,)."""
    n = len(values)
    return Estimate(float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(n), n - 1)
