# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.sound.channel_test import (
    BURST_S,
    EVERY_S,
    PATIENCE_S,
    PEAK,
    ChannelTest,
)
from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.ring import output_names
from eol_ros.settings import SoundSettings

FS = 48000


def played(channels, block=480, **options):
    """Play a test to its end; return it and all samples, (n, channels)."""
    mixer = Mixer(FS, channels, gain_db=0, governor_db=0, **options)
    test, blocks = ChannelTest(mixer, 0.1, list(map(str, range(channels)))), []
    while not test.look():
        blocks.append(mixer.render(block))
        assert len(blocks) < 10_000
    return test, np.concatenate(blocks)


@pytest.mark.slow
@pytest.mark.parametrize('channels', [1, 2, 5, 16])
def test_each_loudspeaker_sounds_alone_and_in_turn(channels):
    test, samples = played(channels)
    delay = Mixer(FS).look_ahead
    for channel in range(channels):
        begin = round((0.1 + channel * EVERY_S) * FS)
        during = samples[begin : begin + round(BURST_S * FS)]
        peaks = np.abs(during).max(0)
        assert peaks[channel] == pytest.approx(PEAK, rel=0.1)
        others = np.delete(peaks, channel)
        assert others.max(initial=0.0) < 1e-5
        pause = samples[begin + round(BURST_S * FS) + 2 * delay : begin + round(EVERY_S * FS)]
        assert np.abs(pause).max(initial=0.0) < 1e-3  # the filter against DC rings out
        assert test.levels_db[channel] == pytest.approx(20 * np.log10(peaks[channel]), abs=0.1)
    assert test.silent() == []


def test_words_name_the_channels():
    test = ChannelTest(Mixer(FS), 0.0, output_names(SoundSettings()))
    test.levels_db = [-16.4, float('nan')]
    assert test.words() == 'left -16 dBFS, right not measured'
    test = ChannelTest(Mixer(FS, 3), 0.0, output_names(SoundSettings(channels=3)))
    test.levels_db = [-16.4, -120.0, -16.0]
    assert test.silent() == ['channel 2'] and test.words().startswith('channel 1 -16 dBFS, ch')


def test_an_output_that_stands_still_is_given_up():
    mixer = Mixer(FS, 2)
    test = ChannelTest(mixer, 0.1, ('left', 'right'))
    assert test.outcome(1000.0, 'card') is None
    mixer.render(round((0.1 + BURST_S + 0.05) * FS))
    assert test.outcome(1000.5, 'card') is None and len(test.levels_db) == 1
    assert test.outcome(1000.5 + PATIENCE_S, 'card') is None
    good, words = test.outcome(1000.6 + PATIENCE_S, 'card')
    assert not good and words.startswith('card: nothing came from all but left -')
