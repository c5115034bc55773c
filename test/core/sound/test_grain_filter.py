# SPDX-License-Identifier: Apache-2.0
"""The filter of single grains: against SciPy in double precision, and in the mixer."""

from dataclasses import replace

import numpy as np
import pytest
from support.paper import N_BLOCKS
from support.quiet_settings import SOUND
from support.sound_reference import filtered, rendered, score, snr_db

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.grain_filter import TABLE, design, run, tuned
from eol_ros.core.sound.lanes import WIDTH
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing, new_mixer

FS = 48000
FILTERS = tuple(
    (hz, q, band)
    for hz in (20, 100, 500, 2000, 9000, 21600)
    for q in (0.5, 0.7071, 20)
    for band in (False, True)
)
OFF = replace(SOUND, gain_db=0.0, governor_db=0.0)
LOW = replace(OFF, filter='low-pass', filter_hz=900.0, filter_q=4.0)


def through_filter(x, hz, q, band):
    """`x` (n,) f4 through the mixer's filter of a grain."""
    table, out = np.empty(TABLE, np.float32), np.empty(len(x) + WIDTH, np.float32)
    padded = np.concatenate([x, np.zeros(WIDTH, np.float32)])
    design(table, float(tuned(np.array([hz]), FS)[0]), 1 / q, int(band))
    run(out.ctypes.data, padded.ctypes.data, len(x), table)
    return out[: len(x)]


@pytest.mark.parametrize('case', FILTERS, ids=str)
def test_agrees_with_scipy(case):
    x = np.random.default_rng(1).standard_normal(8000).astype(np.float32) * np.float32(0.1)
    error_db = -snr_db(through_filter(x, *case), filtered(x, *case, FS))
    assert error_db < (-125 if case[0] >= 100 else -110)


def heard(settings, triggers, bank):
    rows, refused = Voicing(settings).rows(triggers, bank)
    assert not refused.any()
    return rendered(new_mixer(settings), rows)


def triggers_of(count, seed=3):
    rng = np.random.default_rng(seed)
    found = score(rng, count, 0.7, 30, rate=rng.uniform(0.3, 3, count), gain=0.1)
    found['rate'][::3] = 1
    found['block'] = rng.integers(0, N_BLOCKS, count)
    return found


def noise_bank(seed=4, **more):
    rng = np.random.default_rng(seed)
    sound = [rng.standard_normal(FS).astype('f4') * 0.1]
    return Bank(sound, np.zeros(30, int), np.linspace(0, 0.7, 30), np.full(30, 0.25), FS, **more)


@pytest.mark.parametrize('band', [False, True])
def test_a_grain_sounds_as_if_its_sound_had_been_filtered_before(band):
    x = np.random.default_rng(5).standard_normal(FS).astype('f4') * 0.1
    first, size = 5000, 12000
    there = x.astype(float)
    there[first + 1 : first + size] = filtered(x[first + 1 : first + size], 900.0, 4.0, band, FS)
    t = np.zeros(1, TRIGGER)
    t['gain'], t['rate'], t['time_s'] = 0.5, 1.0, 0.01
    made = replace(LOW, filter='band-pass' if band else 'low-pass')
    cut = ([0], [first / FS], [size / FS], FS)
    found = heard(made, t, Bank([x], *cut))
    assert snr_db(found, heard(OFF, t, Bank([there.astype('f4')], *cut)).astype(float)) > 115


def test_off_is_as_if_there_were_none():
    off = replace(LOW, filter='off', filter_by='area', filter_octaves=4.0)
    plain = heard(OFF, triggers_of(60), noise_bank())
    assert np.array_equal(heard(off, triggers_of(60), noise_bank()), plain)
    assert not Voicing(off).rows(triggers_of(60), noise_bank())[0]['tuning'].any()
    assert not np.array_equal(heard(LOW, triggers_of(60), noise_bank()), plain)


def cutoffs(settings, triggers, bank):
    rows, _ = Voicing(settings).rows(triggers, bank)
    return np.arctan(rows['tuning']) * FS / np.pi


def test_a_larger_cascade_moves_the_cutoff():
    t = np.zeros(N_BLOCKS, TRIGGER)
    t['block'], t['gain'], t['rate'] = np.arange(N_BLOCKS), 1.0, 1.0
    t['time_s'] = 0.01 * np.arange(N_BLOCKS)
    by = replace(LOW, filter_by='area', filter_octaves=-2.0)
    found = cutoffs(by, t, noise_bank())
    assert found[0] == pytest.approx(900.0) and found[-1] == pytest.approx(225.0)
    assert (np.diff(found) < 0).all()


def test_a_descriptor_moves_the_cutoff_by_its_rank():
    loud = np.random.default_rng(6).permutation(30).astype(float)
    bank = noise_bank(descriptors={'loudness_lufs': loud})
    t = np.zeros(30, TRIGGER)
    t['grain'], t['gain'], t['rate'] = np.arange(30), 1.0, 1.0
    by = replace(LOW, filter_by='loudness_lufs', filter_octaves=3.0)
    assert cutoffs(by, t, bank) == pytest.approx(900.0 * 2 ** (3 * loud / 29))
    assert cutoffs(by, t, bank.placed(np.zeros((30, 2)))) == pytest.approx(900.0)  # it has none
