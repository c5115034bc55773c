# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.stats import spearmanr

from eol_ros.core.sound import segments
from eol_ros.core.sound.descriptors import analyse
from eol_ros.core.sound.ice import ice


def test_same_arguments_same_sound():
    first = ice(4.0, 24000, seed=7)
    assert first.dtype == np.float32 and len(first) == 96000
    np.testing.assert_array_equal(first, ice(4.0, 24000, seed=7))
    assert np.abs(first - ice(4.0, 24000, seed=8)).max() > 0.1


@pytest.mark.parametrize('rate', [8000, 44100])
def test_starts_and_ends_in_silence_below_full_scale(rate):
    sound = ice(3.0, rate, seed=2)
    assert np.isfinite(sound).all()
    assert np.abs(sound).max() <= 0.8
    assert sound[0] == 0 and abs(sound[-1]) < 1e-6
    assert abs(sound.mean()) < 0.01 * np.sqrt((sound**2).mean()) + 1e-4  # no lean to one side


@pytest.mark.slow
@pytest.mark.parametrize(('seed', 'grain_s'), [(1, 0.25), (1, 0.1), (2, 0.25)])
def test_grains_spread_over_the_space(seed, grain_s):
    sound = ice(40.0, 48000, seed)
    cuts = segments.chop(len(sound), 48000, grain_s)
    grains, silent = analyse(sound, 48000, cuts)
    assert not silent.any()
    centroid, periodicity = grains['centroid_mean_hz'], grains['periodicity_mean']
    low, high = np.percentile(centroid, [10, 90])
    assert high / low >= 4
    low, high = np.percentile(periodicity, [10, 90])
    assert high - low >= 0.4
    assert abs(spearmanr(centroid, periodicity)[0]) <= 0.6
