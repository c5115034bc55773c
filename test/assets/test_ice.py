# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.stats import spearmanr

from assets.ice import ice, main
from eol_ros.core.sound import segments
from eol_ros.core.sound.descriptors import analyse
from eol_ros.devices.corpus import corpus_build


@pytest.mark.slow
def test_the_shipped_ice_recording_is_reproducible(tmp_path, monkeypatch):
    made = tmp_path / 'made.flac'
    monkeypatch.setattr(sys, 'argv', ['ice', str(made)])
    assert main() == 0
    shipped = Path(corpus_build.__file__).with_name('ice.flac')
    np.testing.assert_array_equal(
        *(soundfile.read(file, dtype='int16')[0] for file in (made, shipped))
    )


def test_another_seed_is_another_sound():
    assert np.abs(ice(4.0, 24000, seed=7) - ice(4.0, 24000, seed=8)).max() > 0.1


@pytest.mark.slow
def test_grains_spread_over_the_space():
    sound = ice(60.0, 48000, 1)
    cuts = segments.chop(len(sound), 48000, 0.25)
    grains, silent = analyse(sound, 48000, cuts)
    assert not silent.any()
    centroid, periodicity = grains['centroid_mean_hz'], grains['periodicity_mean']
    low, high = np.percentile(centroid, [10, 90])
    assert high / low >= 4
    low, high = np.percentile(periodicity, [10, 90])
    assert high - low >= 0.4
    assert abs(spearmanr(centroid, periodicity)[0]) <= 0.6


def combs(sound, rate=48000, size=16384):
    """Return the share of spans of 0.34 s whose log spectrum to 4 kHz repeats every 40 to 280 Hz.

    By the largest amplitude of its spectrum, in units of what noise has in the mean.
    """
    found = []
    for begin in range(0, len(sound) - size, size // 2):
        span = sound[begin : begin + size] * np.hanning(size)
        level = np.log(np.abs(np.fft.rfft(span))[: size * 4000 // rate] ** 2 + 1e-12)
        ripple = (level - np.convolve(level, np.ones(61) / 61, 'same'))[30:-30]
        ripple *= np.hanning(len(ripple))
        period_hz = len(ripple) * rate / size / np.maximum(np.arange(len(ripple) // 2 + 1), 1)
        depth = np.abs(np.fft.rfft(ripple)) / np.sqrt(np.sum(ripple**2))
        found.append(depth[(period_hz > 40) & (period_hz < 280)].max())
    return np.mean(np.array(found) > 6.0)


@pytest.mark.slow
def test_no_comb_of_harmonics_stands_in_its_spectrum():
    noise = np.random.default_rng(1).standard_normal(20 * 48000)
    assert combs(noise) == 0
    harmonics = 0.1 * noise
    harmonics[::400] += 10.0  # of 120 Hz
    assert combs(harmonics) == 1
    assert combs(ice(60.0)) < 0.03
