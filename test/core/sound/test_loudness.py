# SPDX-License-Identifier: Apache-2.0
"""Loudness and its range against the test signals of EBU Tech 3341 and 3342."""

import numpy as np
import pytest
from scipy.signal import sosfilt

from eol_ros.core.sound.loudness import (
    integrated_lufs,
    k_weighted,
    k_weighting,
    loudness_range,
    windows_lufs,
)

FS = 48000


def tone(levels_db, span_s):
    """1 kHz on both channels, one level after the other, peaks in dBFS."""
    second = np.sin(2 * np.pi * 1000 * np.arange(FS) / FS)
    sine = np.outer(np.repeat(10 ** (np.array(levels_db) / 20), span_s), second).ravel()
    return np.stack([sine, sine], axis=1)


@pytest.mark.parametrize(
    ('levels_db', 'wanted'),
    [
        ((-20, -30), 10),
        ((-20, -15), 5),
        ((-40, -20), 20),
        pytest.param((-50, -35, -20, -35, -50), 15, marks=pytest.mark.slow),
    ],
)
def test_range_of_the_signals_of_ebu_tech_3342(levels_db, wanted):
    """Table 1, signals 1 to 4: each level for 20 s, tolerance 1 LU."""
    short = windows_lufs(tone(levels_db, 20), FS, 3.0)
    assert loudness_range(short) == pytest.approx(wanted, abs=1)


def test_loudness_of_the_signals_of_ebu_tech_3341():
    """Signals 1 and 3: a tone at -23 dBFS, and one between two of -36: tolerance 0.1 LU."""
    assert windows_lufs(tone((-23,), 5), FS, 3.0) == pytest.approx(-23, abs=0.1)
    momentary = windows_lufs(tone((-36,), 10), FS, 0.4).tolist()
    momentary += windows_lufs(tone((-23,), 60), FS, 0.4).tolist()
    assert integrated_lufs(np.array(momentary)) == pytest.approx(-23, abs=0.1)


def test_silence_has_no_loudness_and_no_range():
    silent = windows_lufs(np.zeros((5 * FS, 2)), FS, 0.4)
    assert integrated_lufs(silent) == -np.inf and loudness_range(silent) == 0


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
