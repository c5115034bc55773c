# SPDX-License-Identifier: Apache-2.0
"""Loudness against the test signals of EBU Tech 3341."""

import numpy as np
import pytest
from scipy.signal import sosfilt

from eol_ros.core.sound.loudness import k_weighted, k_weighting, lufs

FS = 48000


@pytest.mark.parametrize('level', [-23, -36])
def test_loudness_of_a_tone_on_both_channels_is_its_level(level):
    """Signals 1 and 2 of EBU Tech 3341: 1 kHz, peaks in dBFS; tolerance 0.1 LU."""
    tone = 10 ** (level / 20) * np.sin(2 * np.pi * 1000 * np.arange(5 * FS) / FS)
    weighted, _ = k_weighted(np.stack([tone, tone]), FS)
    assert lufs((weighted**2).mean(axis=1).sum()) == pytest.approx(level, abs=0.1)


def test_silence_after_a_sound_leaves_no_subnormal_numbers_in_the_filters():
    """They would take a processor 14 times as long, for hours where nobody comes."""
    sound = np.random.default_rng(1).normal(0, 0.1, (2, FS))
    weighted, state = k_weighted(sound, FS)
    wanted = sosfilt(k_weighting(FS), sound)
    assert (weighted == wanted).mean() > 0.999 and np.abs(weighted - wanted).max() < 1e-15
    for _ in range(20):
        weighted, state = k_weighted(np.zeros((2, FS)), FS, state)
        assert (np.abs(state) > np.finfo(float).tiny).all()
    assert np.abs(weighted).max() < 1e-24
