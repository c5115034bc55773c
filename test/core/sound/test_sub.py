# SPDX-License-Identifier: Apache-2.0
"""The sub voice: its pulse against the formula, and what a growing cascade makes of it."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from support.quiet_settings import SOUND
from support.sound_reference import spreading

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.sub import PULSE_HZ, RISE, pulse, pulse_bank
from eol_ros.core.sound.voicing import Voicing
from eol_ros.core.table import Table

FS = 48000
SUB = replace(SOUND, sub_db=0.0)


def silent(count, columns=5):
    """A cascade of grains that are not heard: their bank is gone when the sub voice sounds."""
    t = spreading(count, begin_s=0.0, columns=columns)
    t['gain'] = 0.0
    return t


def bank():
    return Bank([np.zeros(FS, 'f4')], [0], [0.0], [0.5], FS)


def heard(rows, seconds=2.0, channels=2):
    mixer = Mixer(FS, channels, gain_db=0, governor_db=0, ceiling_db=0)
    return np.concatenate(list(play(mixer, rows, int(seconds * FS))))


def test_the_pulse_is_a_moment_rate_on_a_tone():
    t = np.arange(len(pulse(FS))) / FS
    wanted = (t * PULSE_HZ / RISE) * np.exp(1 - t * PULSE_HZ / RISE)
    assert np.abs(pulse(FS) - wanted * np.sin(2 * np.pi * PULSE_HZ * t)).max() < 1e-6
    assert 0.9 < np.abs(pulse(FS)).max() <= 1


@pytest.mark.parametrize(
    ('area', 'hz', 'table'),
    [
        (1, 60.0, Table()),
        (4, 30.0, Table()),
        (9, 20.0, Table()),
        (25, 18.0, Table()),
        (9, 20.0, Table(rows=3, columns=4)),
    ],
)
def test_frequency_and_level_of_an_area(area, hz, table):
    rows, _ = Voicing(SUB, table).rows(silent(area, table.columns), bank())
    last = rows[-1:].copy()
    last['time_s'] = 0.0
    out = heard(last)[:, 0].astype(float)
    spectrum = np.abs(np.fft.rfft(out, 16 * FS))
    assert np.argmax(spectrum) / 16 == pytest.approx(hz, rel=0.03)
    peak = np.abs(out).max()
    assert peak == pytest.approx((area / table.count) ** 1.5 * np.sqrt(0.5), rel=0.15)


def test_an_output_of_its_own():
    settings = replace(SUB, channels=3, sub_output=True)
    rows, _ = Voicing(settings).rows(silent(25), bank())
    out = heard(rows, channels=3)
    assert np.abs(out[:, 2]).max() > 0.5 and not out[:, :2].any()
    both = heard(Voicing(SUB).rows(silent(25), bank())[0])
    assert both.any(axis=0).all()


def test_the_pulse_stays_in_memory_when_its_maker_is_gone():
    """Voices know addresses only."""
    kept = weakref.ref(pulse_bank(FS))
    rows, _ = Voicing(SUB).rows(silent(1), bank())
    gc.collect()
    assert kept() is not None
    assert rows['source'][-1] == kept().address[0]
