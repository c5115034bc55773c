# SPDX-License-Identifier: Apache-2.0
import gc
import weakref

import numpy as np
import pytest
from support.paper import N_BLOCKS
from support.sound_reference import reference, rendered, score, snr_db

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.mixer import STEAL_S, Mixer
from eol_ros.core.sound.mixer_layout import RING
from eol_ros.core.sound.offline import render_all
from eol_ros.core.sound.pan import pan
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing, new_mixer
from eol_ros.settings import SoundSettings

FS = 48000


def noise_bank(seed=1, grains=40, seconds=2.0):
    rng = np.random.default_rng(seed)
    sounds = [rng.standard_normal(int(seconds * FS)).astype('f4') * 0.1 for _ in range(2)]
    file = rng.integers(0, 2, grains)
    first = rng.integers(0, int((seconds - 0.3) * FS), grains)
    size = rng.integers(int(0.05 * FS), int(0.3 * FS), grains)
    bank = Bank(sounds, file, first / FS, size / FS, FS)
    return bank, sounds, list(zip(file, first, size, strict=True))


def quiet(**options):
    return Mixer(FS, governor_db=0, **{'gain_db': 0, **options})


@pytest.mark.slow
@pytest.mark.parametrize('varied', [False, True])
def test_agrees_with_the_double_precision_reference(varied):
    rng = np.random.default_rng(2)
    bank, sounds, grains = noise_bank()
    rate = rng.uniform(0.5, 2, 60) if varied else 1.0
    triggers = score(rng, 60, 1.0, len(bank), rate=rate)
    mixer = quiet(gain_db=-3)
    out = render_all(mixer, triggers, bank, FS)
    shift = mixer.look_ahead
    wanted = reference(triggers, sounds, grains, FS, FS, 10 ** (-3 / 20), shift)
    assert snr_db(out, wanted) > 120


@pytest.mark.slow
@pytest.mark.parametrize('filter', ['off', 'low-pass'])
def test_block_size_changes_no_bit(filter):
    """With buses, room, sub voice and filters; loud, so that limiter and stealing work."""
    settings = SoundSettings(
        polyphony=20,
        gain_db=12.0,
        loudness_lufs=-40.0,
        filter=filter,
        filter_by='area',
        filter_octaves=3.0,
    )
    rng = np.random.default_rng(3)
    bank, *_ = noise_bank()
    triggers = score(rng, 300, 0.8, len(bank), rate=rng.uniform(0.3, 3, 300), gain=4.0)
    triggers['rate'][::3], triggers['block'] = 1, rng.integers(-1, N_BLOCKS, 300)
    rows, _ = Voicing(settings).rows(triggers, bank)
    outs = []
    for size in (1, 37, 64, 256, 512, 2000):
        mixer = new_mixer(settings)
        mixer.fade(1.0, 0.3, at_once_from=0.0)
        outs.append(rendered(mixer, rows, FS, size))
        assert mixer.state['stolen'][0] > 50
        assert mixer.state['limiter_least'][0] < 0.9
        assert mixer.state['governor_db'][0] < 0
    assert all(np.array_equal(out, outs[0]) for out in outs[1:])


def test_no_click_even_when_voices_are_stolen():
    """The second difference stays below what 2 ms edges on the source itself can make."""
    sine = (0.5 * np.sin(2 * np.pi * 200 * np.arange(FS) / FS)).astype('f4')
    bank = Bank([sine], [0], [0.0], [0.5], FS)
    t = np.zeros(200, TRIGGER)
    t['time_s'] = np.arange(200) * 0.004
    t['gain'], t['rate'] = 0.3, 1
    mixer = quiet(max_voices=8)
    out = render_all(mixer, t, bank, FS)
    assert mixer.state['stolen'][0] > 150
    turn = 2 * np.pi * 200 / FS
    edge = np.pi / (STEAL_S * FS)
    voices = 2 * 8 + 2  # those that sound and those that fade out
    bound = voices * 0.15 * (turn**2 + 2 * turn * edge / 2 + edge**2 / 2)
    assert np.abs(np.diff(out, 2, axis=0)).max() < bound


def test_steals_the_voice_with_least_left():
    bank = Bank([np.ones(FS, 'f4')], [0], [0.0], [1.0], FS)
    t = np.zeros(3, TRIGGER)
    t['time_s'], t['rate'] = [0, 0.1, 0.2], 1
    t['gain'], t['pan'] = [0.3, 0.1, 0.2], [-1, 1, -1]
    mixer = quiet(max_voices=2)
    out = render_all(mixer, t, bank, FS // 2)
    assert mixer.state['stolen'][0] == 1
    assert np.abs(out[int(0.19 * FS), 1]) > 0.001
    assert np.abs(out[int(0.3 * FS) :, 1]).max() < 0.1 * 0.2  # the quiet right one has gone
    assert mixer.state['voices'][0] == 2


def test_a_hundred_thousand_at_once_neither_crash_nor_clip():
    bank, *_ = noise_bank()
    t = score(np.random.default_rng(6), 100_000, 0.001, len(bank), gain=1.0)
    mixer = quiet(max_voices=64)
    out = render_all(mixer, t, bank, 4096)
    s = mixer.state[0]
    assert np.abs(out).max() <= 10 ** (-1 / 20)
    assert s['triggers'] + s['dropped'] >= 100_000  # none is lost in silence
    assert s['stolen'] > 0


def test_a_full_ring_drops_and_counts():
    bank, *_ = noise_bank()
    rows = voice_rows(score(np.random.default_rng(7), RING + 10, 1.0, len(bank)), bank, 2)
    mixer = quiet()
    assert mixer.push(rows) == RING
    assert mixer.state['dropped'][0] == 10


def test_late_triggers_start_at_once_and_count():
    bank, *_ = noise_bank()
    mixer = quiet()
    mixer.render(FS)
    t = score(np.random.default_rng(8), 3, 0.1, len(bank))
    mixer.push(voice_rows(t, bank, 2))
    out = mixer.render(FS // 4)
    assert mixer.state['late'][0] == 3
    assert out[mixer.look_ahead : mixer.look_ahead + 50].any()


def test_a_trigger_of_another_clock_is_dropped():
    bank, *_ = noise_bank()
    mixer = quiet()
    t = score(np.random.default_rng(9), 2, 0.1, len(bank))
    t['time_s'][1] = 1e9
    mixer.push(voice_rows(t, bank, 2))
    mixer.render(FS // 4)
    assert (mixer.state['triggers'][0], mixer.state['dropped'][0]) == (1, 1)


def test_fades_reach_exact_silence_and_come_back():
    bank = Bank([np.sin(np.arange(4 * FS) * 0.1).astype('f4')], [0], [0.0], [4.0], FS)
    t = np.zeros(1, TRIGGER)
    t['gain'], t['rate'] = 0.5, 1
    mixer = quiet()
    mixer.push(voice_rows(t, bank, 2))
    mixer.render(FS)
    mixer.fade(0.0, 0.5)
    out = mixer.render(FS + FS // 2)
    assert np.abs(np.diff(out, 2, axis=0)).max() < 0.01
    assert not out[-1000:].any()
    mixer.fade(1.0, 0.1)
    assert np.abs(mixer.render(FS)[-FS // 2 :]).max() == pytest.approx(0.5 * 0.5**0.5, rel=0.01)


def test_pan_has_equal_power_on_any_number_of_loudspeakers():
    places = np.linspace(-1, 1, 101)
    for channels in (1, 2, 5, 64):
        a, b, left, right = np.array([pan(place, channels) for place in places]).T
        assert np.allclose(left**2 + right**2, 1, atol=1e-6)
        assert a.min() == 0
        assert max(a.max(), (b * (right > 0)).max()) == channels - 1
    wanted = [(0, 1, 1, 0), (1, 2, 1, 0), (1, 2, 0, 1)]
    assert [pan(place, 3) for place in (-1.0, 0.0, 1.0)] == wanted
    assert pan(-3.0, 2) == pan(-1.0, 2)


def test_a_bank_stays_in_memory_for_as_long_as_it_may_be_read():
    """Voices know addresses only: nobody but the mixer may know that they still read there."""
    mixer = Mixer(FS, governor_db=0)
    t = np.zeros(1, TRIGGER)
    t['gain'], t['rate'], t['time_s'] = 0.5, 1, 20.0  # far ahead: it waits
    banks = []
    for _ in range(3):
        bank = Bank([np.ones(FS, 'f4')], [0], [0.0], [0.5], FS)
        banks.append(weakref.ref(bank))
        mixer.play(t, bank)
        mixer.render(64)
        del bank
    another = Bank([np.ones(FS, 'f4')], [0], [0.0], [0.5], FS)
    mixer.render(19 * FS)
    mixer.play(t[:0], another)
    assert all(kept() is not None for kept in banks)
    mixer.render(FS)
    assert mixer.state['voices'][0] == 3 and np.abs(mixer.render(FS // 2)).max() > 0.5
    for _ in range(3):
        mixer.render(20 * FS)
        t['time_s'] += 25
        mixer.play(t, another)
    gc.collect()
    assert all(kept() is None for kept in banks)
