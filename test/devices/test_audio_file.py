# SPDX-License-Identifier: Apache-2.0
"""Sound files of every kind, good and bad."""

import numpy as np
import pytest
import soundfile

from eol_ros.devices.audio import audio_file
from eol_ros.errors import ConfigError, DeviceMissing


def tone(rate, seconds=0.5, channels=1):
    mono = 0.5 * np.sin(2 * np.pi * 440 * np.arange(round(seconds * rate)) / rate)
    return np.repeat(mono[:, None], channels, axis=1)


@pytest.mark.parametrize(
    ('name', 'subtype', 'rate', 'channels', 'tolerance'),
    [
        ('a.wav', 'PCM_U8', 44100, 1, 1 / 128),
        ('a.wav', 'PCM_16', 48000, 2, 1e-4),
        ('a.wav', 'FLOAT', 192000, 1, 1e-6),
        ('a.wav', 'PCM_24', 96000, 12, 1e-6),
        ('a.flac', 'PCM_16', 22050, 8, 1e-4),
        ('a.aiff', 'PCM_24', 8000, 1, 1e-6),
        ('a.ogg', 'VORBIS', 44100, 2, 0.05),
        ('a.mp3', 'MPEG_LAYER_III', 44100, 1, 0.05),
    ],
)
def test_any_format_rate_and_channels(tmp_path, name, subtype, rate, channels, tolerance):
    path = tmp_path / name
    wave = tone(rate, channels=channels)
    audio_file.write(path, wave, rate, subtype)
    sound = audio_file.read_mono(path)
    assert (sound.rate, sound.channels, sound.notes) == (rate, channels, ())
    assert sound.samples.dtype == np.float32 and sound.samples.ndim == 1
    if subtype == 'MPEG_LAYER_III':  # shifts in time
        assert np.sqrt((sound.samples**2).mean()) == pytest.approx(0.5 / np.sqrt(2), rel=0.05)
    else:
        np.testing.assert_allclose(sound.samples, wave[:, 0], atol=tolerance)


def test_channels_are_averaged(tmp_path):
    wave = np.stack([np.full(4800, 0.5), np.full(4800, -0.25), np.full(4800, 0.5)], axis=1)
    audio_file.write(tmp_path / 'a.wav', wave, 48000, 'FLOAT')
    np.testing.assert_allclose(audio_file.read_mono(tmp_path / 'a.wav').samples, 0.25, atol=1e-6)


def test_another_rate_is_the_same_sound(tmp_path):
    audio_file.write(tmp_path / 'a.wav', tone(44100, 1.0), 44100, 'FLOAT')
    sound = audio_file.read_mono(tmp_path / 'a.wav', rate=48000)
    assert sound.rate == 48000 and sound.duration_s == pytest.approx(1.0, abs=1e-4)
    middle = slice(4800, -4800)
    np.testing.assert_allclose(sound.samples[middle], tone(48000, 1.0)[middle, 0], atol=1e-3)


def test_absent_file_and_folder(tmp_path):
    for path in (tmp_path / 'no.wav', tmp_path):
        with pytest.raises(DeviceMissing, match='no such sound file'):
            audio_file.read_mono(path)


@pytest.mark.parametrize('count', [0, 1, 100])
def test_too_short_for_a_grain(tmp_path, count):
    soundfile.write(tmp_path / 'a.wav', np.zeros(count), 48000)
    with pytest.raises(ConfigError, match=f'{count} samples at 48000 Hz are too short'):
        audio_file.read_mono(tmp_path / 'a.wav')


@pytest.mark.parametrize('name', ['a.wav', 'a.flac'])
def test_a_file_that_breaks_off_is_used_as_far_as_it_goes(tmp_path, name):
    random = np.random.default_rng(1)
    whole = tmp_path / name
    audio_file.write(whole, 0.1 * random.standard_normal(96000), 48000, 'PCM_16')
    cut = tmp_path / f'cut-{name}'
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    sound = audio_file.read_mono(cut)
    assert 0.5 < sound.duration_s < 1.1
    n = len(sound.samples) - 5000  # the last packet of a cut FLAC may be spoilt
    np.testing.assert_array_equal(sound.samples[:n], audio_file.read_mono(whole).samples[:n])
    if name == 'a.flac':
        assert 'breaks off after' in sound.notes[0]


def test_a_place_that_cannot_be_written(tmp_path):
    with pytest.raises(ConfigError, match='cannot write'):
        audio_file.write(tmp_path / 'no' / 'a.wav', np.zeros(10), 48000)
    with pytest.raises(ConfigError, match='cannot write'):
        audio_file.write(tmp_path / 'a.nonsense', np.zeros(10), 48000)


@pytest.mark.slow
def test_a_minute_of_vorbis_can_be_written(tmp_path):
    """Handed over in one piece it ends the process (libsndfile 1.2)."""
    samples = np.random.default_rng(1).uniform(-0.1, 0.1, 60 * 44100).astype('f4')
    audio_file.write(tmp_path / 'x.ogg', samples, 44100)
    assert audio_file.read_mono(tmp_path / 'x.ogg').duration_s == pytest.approx(60, abs=0.01)


def test_the_outline_of_a_stretch_is_its_least_and_greatest_samples(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    samples = rng.uniform(-1, 1, (8000, 2))
    audio_file.write(tmp_path / 'x.wav', samples, 8000, 'DOUBLE')
    found = audio_file.outline(tmp_path / 'x.wav', 0.25, 0.5, 10)
    parts = samples.mean(axis=1)[2000:6000].reshape(10, 400)
    assert np.allclose(found, np.stack([parts.min(axis=1), parts.max(axis=1)], 1), atol=1e-6)
    monkeypatch.setattr(audio_file, 'BLOCK', 100)  # of a part that is longer, its begin
    found = audio_file.outline(tmp_path / 'x.wav', 0.25, 0.5, 10)
    begins = parts[:, :100]
    assert np.allclose(found, np.stack([begins.min(axis=1), begins.max(axis=1)], 1), atol=1e-6)
    assert not audio_file.outline(tmp_path / 'x.wav', 5.0, 1.0, 4).any()  # behind its end
    assert not audio_file.outline(tmp_path / 'x.wav', 0.9, 0.2, 2)[1].any()
    (tmp_path / 'x.wav').write_bytes(b'')
    with pytest.raises(ConfigError, match='not a sound'):
        audio_file.outline(tmp_path / 'x.wav', 0.0, 1.0, 4)
    with pytest.raises(DeviceMissing):
        audio_file.outline(tmp_path / 'y.wav', 0.0, 1.0, 4)
