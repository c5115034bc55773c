# SPDX-License-Identifier: Apache-2.0
"""Descriptors against formulas computed by hand, and against essentia."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import get_window, sosfilt
from support import needs

from eol_ros.core.sound import segments
from eol_ros.core.sound.descriptors import HOP, YIN_FRAME, YIN_SPAN, analyse, yin
from eol_ros.core.sound.loudness import k_weighting, lufs

SAMPLES = Path('/usr/share/sonic-pi/samples')
RECORDINGS = 'ambi_choir', 'bass_drop_c', 'drum_cymbal_closed', 'loop_amen', 'misc_crow'


def one(samples, rate, **options):
    grains, silent = analyse(
        np.asarray(samples, np.float32), rate, np.array([[0, len(samples)]]), **options
    )
    return grains[0], bool(silent[0])


def tone(hz, rate=48000, seconds=0.5, level=0.5):
    return level * np.sin(2 * np.pi * hz * np.arange(round(seconds * rate)) / rate)


@pytest.mark.parametrize('hz', [82.4, 220, 440, 1234.5, 3000])
def test_a_tone_has_its_pitch_and_is_periodic(hz):
    grain, silent = one(tone(hz), 48000)
    assert not silent
    assert grain['pitch_hz'] == pytest.approx(hz, rel=2e-3)
    assert grain['periodicity_mean'] > 0.99
    assert grain['rms_db'] == pytest.approx(20 * np.log10(0.5 / np.sqrt(2)), abs=0.05)
    assert grain['flatness'] < 1e-3


def test_white_noise_is_flat_aperiodic_and_centred():
    noise = 0.1 * np.random.default_rng(1).standard_normal(96000)
    grain, _ = one(noise, 48000)
    assert grain['centroid_mean_hz'] == pytest.approx(12000, rel=0.02)
    assert grain['rolloff95_hz'] == pytest.approx(0.95 * 24000, rel=0.01)
    assert 0.5 < grain['flatness'] < 0.6  # exp(-Euler's constant) = 0.561 for an exponential law
    assert grain['periodicity_mean'] < 0.3 and np.isnan(grain['pitch_hz'])


def test_silence_is_silent_and_faint_sound_can_be():
    grain, silent = one(np.zeros(9600), 48000)
    assert silent and np.isnan(grain['centroid_mean_hz']) and grain['periodicity_mean'] == 0
    faint = 1e-4 * np.random.default_rng(1).standard_normal(9600)
    assert one(faint, 48000)[1] is True
    assert one(faint, 48000, silence_db=-90)[1] is False


@pytest.mark.parametrize('n', [2, 500, 1023, 1024, 1500, 2047, 2048, 2049])
def test_short_grains_have_numbers_too(n):
    grain, silent = one(tone(2000, seconds=1)[5 : 5 + n] + 0.1, 48000)
    assert not silent
    for name in ('centroid_mean_hz', 'periodicity_mean', 'flatness', 'rolloff95_hz', 'rms_db'):
        assert np.isfinite(grain[name]), name


@pytest.mark.parametrize('n', [700, 12000])  # shorter than a frame, and longer
def test_a_grain_does_not_hear_its_neighbours(n):
    random = np.random.default_rng(2)
    quiet = 0.01 * random.standard_normal(n)
    loud = np.concatenate([0.9 * random.standard_normal(12000), quiet, np.ones(12000)])
    alone, _ = analyse(quiet.astype(np.float32), 48000, np.array([[0, n]]))
    among, _ = analyse(loud.astype(np.float32), 48000, np.array([[12000, 12000 + n]]))
    for name in ('centroid_mean_hz', 'periodicity_mean', 'flatness', 'rolloff95_hz', 'rms_db'):
        assert among[name][0] == pytest.approx(alone[name][0], rel=1e-9), name


def naive_yin(frame, rate):
    """de Cheveigne & Kawahara, equations 6 and 8, summed as they are printed."""
    lags = np.arange(YIN_FRAME - YIN_SPAN + 1)
    d = np.array([((frame[:YIN_SPAN] - frame[t : t + YIN_SPAN]) ** 2).sum() for t in lags])
    normal = np.ones(len(lags))
    for t in lags[1:]:
        normal[t] = d[t] * t / d[1 : t + 1].sum()
    first, last = max(2, int(rate / 4000)), min(1023, int(np.ceil(rate / 40)))
    dips = [
        t
        for t in range(first, last + 1)
        if normal[t] <= normal[t - 1] and (t == 1023 or normal[t] <= normal[t + 1])
    ]
    if not dips:
        return 0.0, None
    t = next((t for t in dips if normal[t] < 0.15), min(dips, key=lambda t: normal[t]))
    a, b, c = normal[t - 1 : t + 2]
    shift = 0.5 * (a - c) / (a - 2 * b + c) if a - 2 * b + c > 0 else 0.0
    shift = min(max(shift, -1), 1)
    return min(max(1 - (b - 0.25 * (a - c) * shift), 0), 1), t + shift


@pytest.mark.parametrize('rate', [16000, 44100])
def test_yin_by_transform_is_yin_by_sum(rate):
    random = np.random.default_rng(4)
    frames = random.standard_normal((5, YIN_FRAME))
    frames[0] = tone(333, 44100)[:YIN_FRAME]
    frames[1] = 1e-3 * frames[1] + tone(97, 44100)[:YIN_FRAME]
    frames[2] = np.cumsum(frames[2])
    frames[4] = np.linspace(-1, 1, YIN_FRAME)  # no dip at all
    frames[3] = np.sign(tone(250, 44100)[:YIN_FRAME]) + 0.3 * frames[3]
    periodicity, lag = yin(frames, rate)
    for found, at, (expected, expected_at) in zip(
        periodicity, lag, [naive_yin(frame, rate) for frame in frames], strict=True
    ):
        assert found == pytest.approx(expected, abs=1e-9)
        assert expected_at is None or at == pytest.approx(expected_at, abs=1e-6)


# ITU-R BS.1770-4, tables 1 and 2: b0 b1 b2 a1 a2 at 48 kHz.
SHELF = (1.53512485958697, -2.69169618940638, 1.19839281085285, -1.69065929318241, 0.73248077421585)
HIGH_PASS = (1.0, -2.0, 1.0, -1.99004745483398, 0.99007225036621)


def test_k_weighting_is_the_printed_one():
    sections = k_weighting(48000)
    for section, printed in zip(sections, (SHELF, HIGH_PASS), strict=True):
        np.testing.assert_allclose(np.delete(section, 3), printed, rtol=1e-8)


@pytest.mark.parametrize('rate', [44100, 96000])
def test_loudness_of_the_reference_tone(rate):
    """BS.1770: 997 Hz at full scale in one channel is -3.01 LUFS, at any rate."""
    grain, _ = one(tone(997, rate, 2.0, level=1.0), rate)
    assert grain['loudness_lufs'] == pytest.approx(-3.01, abs=0.03)


@pytest.fixture(scope='module', params=RECORDINGS)
def recording(request):
    from eol_ros.devices.audio.audio_file import read_mono

    needs.system('sonic-pi-samples')
    sound = read_mono(SAMPLES / f'{request.param}.flac')
    sound.samples.flags.writeable = False
    cuts = segments.chop(len(sound.samples), sound.rate, 0.25)
    cuts = cuts[cuts[:, 1] - cuts[:, 0] >= YIN_FRAME]
    if not len(cuts):
        cuts = np.array([[0, len(sound.samples)]])
    return sound.samples, sound.rate, cuts, *analyse(sound.samples, sound.rate, cuts)


@pytest.fixture(scope='module')
def essentia():
    return pytest.importorskip('essentia.standard', reason='oracle: pip install essentia')


@pytest.mark.slow
def test_spectrum_of_real_recordings_as_essentia_has_it(recording, essentia):
    samples, rate, cuts, grains, silent = recording
    centroid, flatness = essentia.Centroid(range=rate / 2), essentia.Flatness()
    rolloff = essentia.RollOff(cutoff=0.95, sampleRate=rate)  # of the squares of its input
    window = get_window('hann', 1024)
    for (a, b), grain in zip(cuts[~silent], grains[~silent], strict=True):
        frames = np.lib.stride_tricks.sliding_window_view(samples[a:b], 1024)[::256] * window
        magnitude = np.abs(np.fft.rfft(frames)).astype(np.float32)
        if (magnitude.sum(axis=1) < 1e-10).any():
            continue  # the definition skips empty frames
        for name, measure, shown, most in (
            ('centroid_mean_hz', centroid, magnitude, 1e-4),
            ('flatness', flatness, np.maximum(magnitude**2, 1e-10), 1e-3),
            ('rolloff95_hz', rolloff, np.sqrt(magnitude), 1e-3),
        ):
            expected = np.mean([measure(frame) for frame in shown])
            assert grain[name] == pytest.approx(expected, rel=most), name


@pytest.mark.slow
def test_periodicity_of_real_recordings_as_essentia_has_it(recording, essentia):
    samples, rate, cuts, grains, silent = recording
    pitch_yin = essentia.PitchYin(
        frameSize=YIN_FRAME, sampleRate=rate, minFrequency=40, maxFrequency=4000, tolerance=0.15
    )
    theirs, ours = [], []
    for (a, b), grain in list(zip(cuts[~silent], grains[~silent], strict=True))[:8]:
        part = samples[a:b]
        frames = [part[i : i + YIN_FRAME].copy() for i in range(0, len(part) - YIN_FRAME + 1, HOP)]
        if frames:
            theirs.append(np.mean([pitch_yin(frame)[1] for frame in frames]))
            ours.append(grain['periodicity_mean'])
    if not theirs:
        return  # shorter than one frame of 2048 samples: nothing to compare
    assert np.abs(np.subtract(ours, theirs)).mean() <= 0.02
    if len(ours) >= 5:
        assert np.corrcoef(ours, theirs)[0, 1] >= 0.98


def test_levels_of_a_long_recording_are_those_of_its_pieces():
    """Loudness and RMS go through the recording in pieces of 2^20 samples."""
    random = np.random.default_rng(9)
    n = (1 << 20) + 60_000
    samples = (random.standard_normal(n) * (1 + np.arange(n) / n)).astype(np.float32)
    cuts = np.array([[0, 1000], [(1 << 20) - 30_000, (1 << 20) + 30_000], [n - 5000, n]])
    grains, _ = analyse(samples, 48000, cuts)
    weighted = sosfilt(k_weighting(48000), samples.astype(float))
    for (a, b), grain in zip(cuts, grains, strict=True):
        assert grain['rms_db'] == pytest.approx(
            10 * np.log10((samples[a:b].astype(float) ** 2).mean()), abs=1e-6
        )
        assert grain['loudness_lufs'] == pytest.approx(lufs((weighted[a:b] ** 2).mean()), abs=1e-6)
