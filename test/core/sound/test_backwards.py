# SPDX-License-Identifier: Apache-2.0
"""A grain played backwards is the grain of the sound turned round, bit for bit."""

import numpy as np
import pytest
from support.sound_reference import rendered

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.triggers import TRIGGER
from eol_ros.core.sound.voicing import Voicing, new_mixer
from eol_ros.settings import SoundSettings

RATE = 48000
SOUNDS = [np.random.default_rng(k).standard_normal(n).astype(np.float32) / 8
          for k, n in enumerate((9000, 14000))]  # fmt: skip
FILE, START, DURATION = [0, 1, 1], np.array([0.02, 0.01, 0.2]), np.array([0.1, 0.08, 0.2])


def triggers(rates):
    rows = np.zeros(len(rates), TRIGGER)
    rows['time_s'], rows['grain'] = 0.02 * np.arange(len(rates)), np.arange(len(rates))
    rows['gain'], rows['rate'], rows['block'] = 0.5, rates, np.arange(len(rates))
    rows['attack_s'], rows['release_s'] = 0.01, 0.03
    return rows


def heard(sounds, start, duration, rates, settings):
    bank = Bank(sounds, FILE, start, duration, RATE)
    rows, refused = Voicing(settings).rows(triggers(rates), bank)
    assert not refused.any()
    return rendered(new_mixer(settings), rows, RATE // 2)


@pytest.mark.parametrize('rates', [(1, 1, 1), (0.5, 1.0, 1.7)])
@pytest.mark.parametrize('settings', [SoundSettings(), SoundSettings(rate_scaling=1.0)])
def test_backwards_is_the_sound_turned_round(rates, settings):
    ends = np.array([len(s) for s in SOUNDS])[FILE] / RATE
    lengths = np.minimum(DURATION, ends - START)
    turned = [sound[::-1].copy() for sound in SOUNDS]
    expected = heard(turned, ends - START - lengths, lengths, rates, settings)
    found = heard(SOUNDS, START, DURATION, [-rate for rate in rates], settings)
    assert np.abs(expected).max() > 0.01
    np.testing.assert_array_equal(found, expected)
