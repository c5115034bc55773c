# SPDX-License-Identifier: Apache-2.0
"""What keys and controllers mean: lines to changes of live settings."""

import pytest

from eol_ros.core.sound.midi import Change, Cue, Event, Mapping, Morph, Recall, event_of
from eol_ros.errors import EolError
from eol_ros.ros.presets import midi_mapping
from eol_ros.settings import GrainsSettings, SoundSettings

KINDS = {'grains': GrainsSettings, 'sound': SoundSettings}


def said(line, value, channel=1):
    source, place, *_ = line.split()
    number = int(place.rpartition(':')[2])
    return Mapping([line], KINDS).actions(Event(source, channel, number, value))


def test_bytes_are_read_as_the_standard_has_them():
    assert event_of([0xB2, 74, 5]) == Event('cc', 3, 74, 5)
    assert event_of([0x90, 60, 100]) == Event('note', 1, 60, 100)
    assert event_of([0x90, 60, 0]) == event_of([0x80, 60, 64]) == Event('note', 1, 60, 0)
    assert event_of([0xCF, 9]) == Event('program', 16, 9, 127)
    for other in ([], [0xF8], [0xE0, 0, 64], [0xB0, 1], [0xD0, 3]):
        assert event_of(other) is None


def test_a_controller_goes_through_a_range():
    line = 'cc 74 sound.gain_db -40 0'
    values = [said(line, v)[0].value for v in range(128)]
    assert values[0] == -40 and values[-1] == 0
    assert values == sorted(values) and values[64] == pytest.approx(-40 + 40 * 64 / 127)
    octaves = [said('cc 1 sound.filter_hz 100 6400', v)[0].value for v in (0, 127)]
    assert octaves == [100, 6400]
    middle = said('cc 1 sound.filter_hz 100 6400', 63)[0].value
    assert middle == pytest.approx(100 * 64 ** (63 / 127))  # frequencies by their logarithm
    assert said('cc 2 grains.radius', 127) == [Change('grains', 'radius', 1.0)]
    down = [said('cc 3 grains.k 9 1', v)[0].value for v in (0, 64, 127)]
    assert down == [9, 5, 1] and all(type(v) is int for v in down)


def test_choices_come_one_after_the_other_and_switches_are_on_or_off():
    modes = [said('cc 3 grains.mode', v)[0].value for v in (0, 30, 60, 90, 127)]
    assert modes == ['fence', 'bow', 'beat', 'chain', 'continue']
    assert [said('cc 3 grains.rearm_at_rest', v)[0].value for v in (63, 64)] == [False, True]
    assert [said('note 3 grains.rearm_at_rest', v)[0].value for v in (0, 9)] == [False, True]
    two = [said('cc 3 grains.mode bow chain', v)[0].value for v in (0, 127)]
    assert two == ['bow', 'chain']


def test_a_key_sets_a_value_or_how_hard_it_was_struck():
    assert said('note 36 grains.mode chain', 100) == [Change('grains', 'mode', 'chain')]
    assert said('note 36 grains.mode chain', 0) == []
    assert said('note 36 grains.gain 0 2', 127) == [Change('grains', 'gain', 2.0)]
    assert said('note 36 grains.gain 0 2', 0) == []
    assert said('note 1 grains.weights ice 0.5', 1) == [Change('grains', 'weights', ('ice 0.5',))]


def test_channels_presets_and_morphs():
    assert said('cc 2:7 sound.gain_db -9', 127, channel=1) == []
    assert said('cc 2:7 sound.gain_db -9', 127, channel=2) == [Change('sound', 'gain_db', -9.0)]
    assert said('program 5 recall storm', 127) == [Recall('storm')]
    assert said('note 5 cue evening', 90) == [Cue('evening')]
    assert said('note 5 cue evening', 0) == []
    assert said('note 5 recall storm', 0) == [] == said('cc 5 recall storm', 63)
    assert said('cc 1 morph calm storm', 0) == [Morph('calm', 'storm', 0.0)]
    assert said('cc 1 morph calm storm', 127) == [Morph('calm', 'storm', 1.0)]


@pytest.mark.parametrize(
    ('line', 'words'),
    [
        ('knob 3 sound.gain_db', 'begin with cc, note or program'),
        ('cc 128 sound.gain_db', 'begin with cc'),
        ('cc 17:3 sound.gain_db', 'begin with cc'),
        ('cc x sound.gain_db', 'begin with cc'),
        ('cc 3 sound.channels', 'no live setting sound.channels'),
        ('cc 3 motion.rest_s', 'no live setting motion.rest_s'),
        ('cc 3 sound.gain_db loud', 'is a number'),
        ('cc 3 sound.gain_db 0 1 2', 'LEAST MOST'),
        ('cc 3 sound.gain_db nan', 'LEAST MOST'),
        ('cc 3 grains.seed', 'LEAST MOST'),
        ('cc 3 grains.rearm_at_rest perhaps', 'is on or off'),
        ('note 3 grains.sound', 'say what sound becomes'),
        ('note 3 morph calm storm', 'say recall'),
        ('program 3 recall', 'say recall'),
        ('note 3 cue', 'say recall PRESET, cue CUE'),
        ('program 3 sound.gain_db -9 0', 'a program has no range'),
        ('cc 3 sound.gain_db -9 99', '99 is out of range'),
        ('note 3 grains.mode fences', 'Did you mean fence'),
        ('note 3 recall ../etc', 'name the preset'),
    ],
)
def test_a_line_that_means_nothing_is_refused_and_quoted(line, words):
    with pytest.raises(EolError, match=words):
        midi_mapping([line])
