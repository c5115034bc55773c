# SPDX-License-Identifier: Apache-2.0
"""From measured noise and a stated rate of false alarms to a threshold in metres.

The two axes of a block at rest carry independent Gaussian noise of variance s^2, so the squared
distance from a known centre exceeds T^2 with probability exp(-T^2 / (2 s^2)) (Rayleigh). With s^2
itself estimated from nu degrees of freedom the tail is that of Hotelling's T^2 in two dimensions,
(1 + T^2 / (nu s^2))^(-nu / 2) (Hotelling, Ann. Math. Stat. 2, 1931), which inverts in closed form.
A Gaussian threshold would alarm tens of times too often while the noise is still being learnt.
"""

import numpy as np

from eol_ros.core import elementary


def exceedance(false_alarms_per_hour: float, tests_per_second: float) -> float:
    """Return the probability allowed to one test so that the hour brings the stated alarms."""
    return min(false_alarms_per_hour / (3600.0 * tests_per_second), 0.5)


def threshold_sigmas(probability: float, freedom: np.ndarray) -> np.ndarray:
    """Return T / s, shape of `freedom`; `freedom` counts the degrees of freedom of s^2."""
    nu = np.maximum(freedom, 1.0)
    # nu (p^(-2/nu) - 1), which keeps 11 of 16 digits if nu is a million.
    return np.sqrt(nu * (elementary.exp(-2.0 * elementary.log(probability) / nu) - 1.0))
