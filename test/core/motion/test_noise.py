# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy import stats

from eol_ros.core.motion.noise import exceedance, threshold_sigmas


@pytest.mark.parametrize('freedom', [4, 20, 200, 10000])
def test_false_alarms_come_as_often_as_stated(freedom):
    random = np.random.default_rng(freedom)
    p = 1e-3
    trials = 400_000
    square = (random.normal(size=(trials, 2)) ** 2).sum(1)
    variance = random.chisquare(freedom, trials) / freedom
    alarms = (square > threshold_sigmas(p, np.array(freedom)) ** 2 * variance).sum()
    assert alarms == pytest.approx(p * trials, abs=5 * np.sqrt(p * trials))


def test_with_known_noise_it_is_rayleighs():
    p = exceedance(1.0, 25 * 60)
    assert threshold_sigmas(p, np.array(1e9)) == pytest.approx(stats.rayleigh.isf(p), rel=1e-6)
    assert threshold_sigmas(p, np.array(1e9)) == pytest.approx(5.57, abs=0.01)
