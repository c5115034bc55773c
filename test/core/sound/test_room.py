# SPDX-License-Identifier: Apache-2.0
"""The room: its decay against the formula of its lines, its energy, its bits and its sleep."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from support.sound_reference import rendered

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.room import HIGH_HZ, TAIL_DB, coefficients, delays
from eol_ros.core.sound.triggers import TRIGGER

FS = 48000


def room(decay_s, high_s, **options):
    mixer = Mixer(
        FS, governor_db=0,
        **{'gain_db': 0, 'buses': 1, 'room_s': decay_s, 'room_high_s': high_s, **options},
    )  # fmt: skip
    mixer.set_wets(np.array([1.0, 0.5]))
    return mixer


def click(channels=2, gain=0.5, first=0):
    """A click at 0.01 s; its voice keeps reading zeros."""
    sound = np.zeros(FS, 'f4')
    sound[480] = 0.9
    bank = Bank([sound], [0], [0.0], [0.5], FS)
    t = np.zeros(1, TRIGGER)
    t['gain'], t['rate'] = gain, 1.0
    return voice_rows(t, bank, channels, np.array([first])), bank


def rt60(x, hz):
    """Return the decay by 60 dB about `hz`: a line through Schroeder's integral, -5 to -35 dB."""
    wide = 1.2 if hz < 1000 else 1.06  # many modes, and one decay
    band = butter(4, np.array([hz / wide, hz * wide]) / (FS / 2), 'band', output='sos')
    energy = np.square(sosfiltfilt(band, x, axis=0)).sum(axis=1)
    level = 10 * np.log10(np.cumsum(energy[::-1])[::-1] / energy.sum() + 1e-30)
    used = np.flatnonzero((level < -5) & (level > -35))
    return -60 / (np.polyfit(used / FS, level[used], 1)[0])


def decay_at(hz, decay_s, high_s):
    """Return the time of a decay by 60 dB at `hz` (n,), s: the mean over the lines."""
    keep, pole = coefficients(FS, decay_s, high_s).astype(float)[:2]
    turn = np.exp(-2j * np.pi * np.asarray(hz, float)[:, None] / FS)
    gain = keep / np.abs(1 - pole * turn)
    d = delays(FS)
    return d.sum() / (FS * -np.log10(gain).sum(axis=1) / 3)


@pytest.mark.slow
@pytest.mark.parametrize(('decay_s', 'high_s'), [(3.0, 1.0), (6.0, 1.5)])
def test_it_decays_as_its_lines_say(decay_s, high_s):
    rows, _bank = click()
    out = rendered(room(decay_s, high_s), rows, int(1.2 * decay_s * FS)).astype(float)
    out[: FS // 10] = 0
    for hz in (125.0, 500.0, 2000.0, HIGH_HZ):
        wanted = float(decay_at([hz], decay_s, high_s)[0])
        assert rt60(out, hz) == pytest.approx(wanted, rel=0.06), hz
    ends = decay_at([0.1, HIGH_HZ], decay_s, high_s)
    assert ends == pytest.approx([decay_s, high_s], rel=0.01)


def test_noise_comes_out_as_loud_as_it_went_in_and_not_twice_the_same():
    rng = np.random.default_rng(1)
    bank = Bank([0.05 * rng.standard_normal(20 * FS).astype('f4')], [0], [0.0], [20.0], FS)
    t = np.zeros(1, TRIGGER)
    t['gain'], t['rate'] = 0.5, 1.0
    rows = voice_rows(t, bank, 2)
    dry = rendered(Mixer(FS, gain_db=0, governor_db=0), rows, 12 * FS)[6 * FS :]
    wet = rendered(room(2.0, 2.0), rows, 12 * FS)[6 * FS :] - dry
    level_db = 10 * np.log10((wet**2).mean(axis=0) / (dry**2).mean(axis=0))
    assert np.abs(level_db).max() < 1.0
    assert abs(np.corrcoef(wet.T)[0, 1]) < 0.2


@pytest.mark.slow
def test_block_size_changes_no_bit_though_it_falls_asleep_between():
    sound = np.zeros(FS, 'f4')
    sound[480:500] = 0.5
    bank = Bank([sound], [0], [0.0], [0.2], FS)
    t = np.zeros(3, TRIGGER)
    t['gain'], t['rate'] = 0.5, 1.0
    t['time_s'] = 0.0, 0.1 * TAIL_DB / 60 + 0.0301, 1.0  # the second as it is about to sleep
    rows = voice_rows(t, bank, 2, np.array([0, 2, 0]))
    outs = [rendered(room(0.1, 0.1), rows, 2 * FS, size) for size in (1, 63, 64, 500, 2000)]
    assert all(np.array_equal(out, outs[0]) for out in outs[1:])


def test_it_ends_in_exact_silence():
    rows, _bank = click()
    mixer = room(0.3, 0.1)
    out = rendered(mixer, rows, 2 * FS)
    assert np.abs(out[int(0.2 * FS) : int(0.3 * FS)]).max() > 1e-6
    assert not out[int(1.2 * FS) :].any()
    assert not mixer.memory.room.lines.any()
