# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import sosfilt
from support.sound_reference import score

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.loudness import k_weighting
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.triggers import TRIGGER

FS = 48000
CEILING = 10 ** (-1 / 20)


def sine_bank(hz=220.0, level=0.5, seconds=1.0):
    sine = level * np.sin(2 * np.pi * hz * np.arange(int(seconds * FS)) / FS)
    return Bank([sine.astype('f4')], [0], [0.0], [seconds], FS)


def at(times, **values):
    t = np.zeros(len(times), TRIGGER)
    t['time_s'], t['gain'], t['rate'] = times, 1, 1
    for name, value in values.items():
        t[name] = value
    return t


def test_four_hundred_grains_in_phase_stay_below_the_ceiling():
    mixer = Mixer(FS, gain_db=0, governor_db=0)
    out = render_all(mixer, at(np.full(400, 0.1)), sine_bank(), FS)
    assert 0.85 < np.abs(out).max() <= CEILING
    assert mixer.state['limiter_least'][0] < 0.01


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), gain=st.floats(0.01, 16), count=st.integers(1, 80))
def test_never_above_the_ceiling(seed, gain, count):
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(FS).astype('f4')
    bank = Bank([noise], [0] * 3, [0, 0.2, 0.5], [0.01, 0.1, 0.4], FS)
    t = score(rng, count, 0.2, 3, gain=gain)
    out = render_all(Mixer(FS, gain_db=12), t, bank, FS // 4)
    assert np.abs(out).max() <= CEILING
    assert np.isfinite(out).all()


def test_does_nothing_below_the_ceiling_and_lets_go_after():
    bank = sine_bank(level=0.2)
    soft = at([0.6])
    both = np.concatenate([at(np.full(40, 0.0), attack_s=0.05, release_s=0.5), at([2.5])])
    mixer = Mixer(FS, gain_db=0, governor_db=0)
    alone = render_all(Mixer(FS, gain_db=0, governor_db=0), at([2.5]), bank, 4 * FS)
    out = render_all(mixer, both, bank, 4 * FS)
    assert mixer.state['limiter_least'][0] < 0.2
    assert np.array_equal(out[int(2.45 * FS) :], alone[int(2.45 * FS) :])
    plain = render_all(Mixer(FS, gain_db=0, governor_db=0), soft, bank, FS)
    assert np.abs(plain).max() == pytest.approx(0.2 * 0.5**0.5, rel=0.01)


def test_its_gain_has_no_corner_that_clicks():
    """A burst into a steady tone: the tone's envelope bends over the look-ahead, not at once."""
    t = np.concatenate([at([0.0], gain=0.5), at(np.full(30, 0.4), gain=0.5)])
    out = render_all(Mixer(FS, gain_db=0, governor_db=0), t, sine_bank(hz=50), FS)
    assert np.abs(np.diff(out[:, 0], 2)).max() < 0.004


def test_removes_direct_current():
    bank = Bank([np.full(2 * FS, 0.5, 'f4')], [0], [0.0], [2.0], FS)
    out = render_all(Mixer(FS, gain_db=0), at([0.0]), bank, 2 * FS)
    assert np.abs(out[int(1.0 * FS) : int(1.9 * FS)]).max() < 1e-6


@pytest.mark.slow
def test_governor_holds_the_loudness():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(5 * FS).astype('f4') * 0.2
    bank = Bank([noise], [0], [0.0], [5.0], FS)
    t = at(np.arange(0, 60, 2.5), attack_s=2.5, release_s=2.5)
    mixer = Mixer(FS, gain_db=0, loudness_lufs=-23, governor_db=12)
    out = render_all(mixer, t, bank, 60 * FS, 4096)
    tail = sosfilt(k_weighting(FS), out, axis=0)[-20 * FS :]
    loudness = -0.691 + 10 * np.log10((tail**2).mean(axis=0).sum())
    assert loudness == pytest.approx(-23, abs=0.2)
    assert mixer.state['lufs'][0] + mixer.state['governor_db'][0] == pytest.approx(-23, abs=0.1)


def test_governor_takes_no_more_than_it_may():
    noise = np.random.default_rng(2).standard_normal(5 * FS).astype('f4') * 0.3
    bank = Bank([noise], [0], [0.0], [5.0], FS)
    mixer = Mixer(FS, gain_db=0, loudness_lufs=-60, governor_db=6)
    render_all(mixer, at(np.arange(0, 20, 2.5)), bank, 20 * FS, 4096)
    assert mixer.state['governor_db'][0] == -6
    assert mixer.state['governor'][0] == pytest.approx(10 ** (-6 / 20), abs=1e-6)
