# SPDX-License-Identifier: Apache-2.0
"""Latencies of the last minute, and which sound is that of which slip."""

import pytest

from eol_ros.core.latency import Latency
from eol_ros.core.sound.senses import OnsetToSound


def test_the_last_minute_counts_and_no_other_clock():
    latency = Latency()
    assert latency.values(0.0) is None
    for k in range(100):
        latency.add(0.1 * k, 0.001 * (k + 1))
    latency.add(10.0, 1e9)  # the stamp of a camera with a clock of its own
    assert latency.values(10.0) == (51.0, 99.0)
    latency.add(65.0, 0.005)
    assert latency.values(65.0) == (75.0, 100.0)  # those before 5 s are gone
    assert latency.values(200.0) is None


@pytest.mark.parametrize('sound_first', [True, False])
def test_a_slip_is_paired_with_its_first_sound_whichever_comes_first(sound_first):
    pairs = OnsetToSound()
    calls = [lambda: pairs.sounds(7, 10.02, 10.045), lambda: pairs.began(7, 10.02, 10.0)]
    first, second = calls if sound_first else calls[::-1]
    assert first() is None
    assert second() == pytest.approx(0.045)
    assert pairs.sounds(7, 10.05, 10.075) is None  # the next grain of the same slip


def test_sounds_of_other_blocks_and_times_are_not_of_the_slip():
    pairs = OnsetToSound()
    assert pairs.sounds(6, 10.0, 10.025) is None
    assert pairs.sounds(7, 9.0, 9.025) is None
    assert pairs.began(7, 10.02, 10.0) is None
    assert pairs.sounds(7, 10.3, 10.325) is None  # its slip was never heard
    assert pairs.began(7, 10.35, 10.34) == pytest.approx(-0.015)  # of a knock before its onset


def test_a_felt_slip_sounds_before_its_image():
    pairs = OnsetToSound()
    assert pairs.sounds(3, 5.0, 5.0195) is None
    assert pairs.sounds(3, 5.02, 5.045) is None
    assert pairs.began(3, 5.03, 4.999) == pytest.approx(0.0205)
