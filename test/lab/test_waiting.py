# SPDX-License-Identifier: Apache-2.0
"""Waiting times whose law is known."""

import numpy as np
import pytest
from scipy import stats

from eol_ros.core.science.powerlaw import FitError
from eol_ros.lab.science.waiting import waiting


def rng(seed=1):
    return np.random.default_rng(seed)


def test_waiting_times_by_chance_in_clusters_and_even():
    chance = waiting(rng(4).exponential(2.0, 500).cumsum(), rng())
    assert chance.mean_s == pytest.approx(2.0, rel=0.15) and chance.p_value > 0.1
    assert 'as by chance' in chance.sentence
    for shape, words in ((0.4, 'in clusters'), (4.0, 'more evenly than by chance')):
        gaps = rng(5).gamma(shape, 1.0, 500)
        onsets = np.r_[0.0, gaps.cumsum()]
        gaps = np.diff(onsets)
        gaps = gaps[gaps > 0]
        found = waiting(onsets, rng())
        assert words in found.sentence and found.p_value < 0.05
        assert found.gamma_shape == pytest.approx(stats.gamma.fit(gaps, floc=0)[0], rel=1e-3)


def test_few_waiting_times_carry_no_law():
    with pytest.raises(FitError, match='9 waiting times are too few'):
        waiting(np.arange(10.0), rng())
