# SPDX-License-Identifier: Apache-2.0
"""The slower descriptors against librosa, essentia and what is known of made sounds."""

import itertools

import numpy as np
import pytest
from scipy.signal import lfilter

from eol_ros.core.sound import projection, timbre
from eol_ros.core.sound.ice import ice
from eol_ros.core.sound.segments import chop

RATE = 22050
CUTS = chop(4 * RATE, RATE, 0.4)


@pytest.fixture(scope='module')
def sound():
    return ice(4.0, RATE, seed=3).astype(np.float32)


@pytest.fixture(scope='module')
def found(sound):
    return timbre.describe(sound, RATE, CUTS)


def spectrogram(samples):
    """Magnitudes (frames, bins), window by window."""
    window = np.hanning(1025)[:-1]
    starts = range(0, len(samples) - 1023, 256)
    return np.array([np.abs(np.fft.rfft(window * samples[s : s + 1024])) for s in starts])


@pytest.mark.slow
def test_mfcc_are_those_of_librosa(sound, found):
    import librosa

    for i, (first, last) in enumerate(CUTS):
        mel = librosa.feature.melspectrogram(
            y=sound[first:last].astype(float), sr=RATE, n_fft=1024, hop_length=256, center=False,
            n_mels=40,
        )  # fmt: skip
        level = librosa.power_to_db(mel, top_db=None)
        expected = librosa.feature.mfcc(S=level, n_mfcc=13).mean(axis=1)[1:]
        mine = [found[f'mfcc_{k}'][i] for k in range(1, 13)]
        np.testing.assert_allclose(mine, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_harmonic_ratio_is_that_of_librosas_separation(sound, found):
    import librosa

    ratios = []
    for first, last in CUTS:
        steady, struck = librosa.decompose.hpss(spectrogram(sound[first:last].astype(float)).T)
        ratios.append((steady**2).sum() / ((steady**2).sum() + (struck**2).sum()))
    np.testing.assert_allclose(found['harmonic_ratio'], ratios, atol=2e-4)
    assert np.ptp(ratios) > 0.1


def test_flux_is_what_the_spectra_say_one_by_one(sound, found):
    for i in range(3):
        rows = spectrogram(sound[slice(*CUTS[i])].astype(float))
        steps = []
        for a, b in itertools.pairwise(rows / rows.sum(axis=1)[:, None]):
            steps.append(np.abs(a - b).sum() / 2)
        assert found['spectral_flux'][i] == pytest.approx(np.mean(steps), rel=1e-6)


def test_a_click_is_struck_and_a_tone_is_steady_and_does_not_change():
    t = np.arange(RATE) / RATE
    tone, click = np.sin(2 * np.pi * 500 * t), np.zeros(RATE)
    click[RATE // 2] = 1.0
    cuts = np.array([[0, RATE]])
    steady, struck = (timbre.describe(x, RATE, cuts) for x in (tone, click))
    assert steady['harmonic_ratio'][0] > 0.99 and struck['harmonic_ratio'][0] < 0.05
    assert steady['spectral_flux'][0] < 0.01
    jump = np.where(t < 0.5, tone, np.sin(2 * np.pi * 5000 * t))
    assert timbre.describe(jump, RATE, cuts)['spectral_flux'][0] > 5 * steady['spectral_flux'][0]


@pytest.mark.parametrize('rise_s', [0.05, 0.2])
def test_attack_time_of_a_linear_rise_is_its_share_from_20_to_90_percent(rise_s):
    t = np.arange(RATE) / RATE
    noise = np.sign(np.random.default_rng(1).standard_normal(RATE))  # its RMS is exactly its level
    found = timbre.attack_time(noise * np.minimum(t / rise_s, 1), RATE)
    assert found == pytest.approx(0.7 * rise_s, abs=0.006)


@pytest.mark.slow
def test_attack_time_is_that_of_essentia():
    from essentia import standard

    decay = np.exp(-np.arange(RATE) / (0.1 * RATE))
    for pole in (0.9990, 0.9997):
        envelope = lfilter([1 - pole], [1, -pole], decay)
        noise = np.sign(np.random.default_rng(2).standard_normal(RATE)) * envelope
        hop = round(0.0025 * RATE)
        rms = np.array([
            np.sqrt(np.mean(noise[s : s + 4 * hop] ** 2)) for s in range(0, RATE - 4 * hop + 1, hop)
        ])  # fmt: skip
        expected = 10 ** standard.LogAttackTime(sampleRate=RATE / hop)(rms.astype(np.float32))[0]
        assert timbre.attack_time(noise, RATE) == pytest.approx(expected, abs=1.1 * hop / RATE)


def test_loudness_range_of_two_levels_is_what_lies_between():
    t = np.arange(2 * RATE) / RATE
    steps = np.where(t < 1, 0.05, 0.2) * np.sin(2 * np.pi * 997 * t)
    found = timbre.describe(steps, RATE, np.array([[0, 2 * RATE]]))
    assert found['loudness_range_lu'][0] == pytest.approx(20 * np.log10(4), abs=0.05)
    steady = timbre.describe(steps, RATE, np.array([[RATE // 4, RATE]]))
    assert steady['loudness_range_lu'][0] < 0.1


def test_silence_has_no_spectrum_and_short_grains_have_numbers():
    found = timbre.describe(np.zeros(RATE), RATE, np.array([[0, RATE]]))
    assert np.isnan(found['mfcc_1'][0]) and found['attack_time_s'][0] == 0
    short = timbre.describe(np.ones(300) * 0.1, RATE, np.array([[0, 2], [2, 300]]))
    assert all(np.isfinite(values).all() for values in short.values())


@pytest.mark.slow
def test_principal_components_are_those_of_scikit_learn():
    from sklearn import decomposition, preprocessing

    random = np.random.default_rng(4)
    mixed = random.standard_normal((60, 3)) @ random.standard_normal((3, 6))
    names = [f'd{k}' for k in range(6)]
    matrix = projection.standardised(list(mixed.T), names)
    scaled = preprocessing.StandardScaler().fit_transform(mixed)
    np.testing.assert_allclose(matrix, scaled, atol=1e-12)
    expected = decomposition.PCA(2).fit_transform(scaled)
    mine = projection.pca(matrix)
    for k in range(2):
        side = np.sign(mine[:, k] @ expected[:, k])
        np.testing.assert_allclose(mine[:, k], side * expected[:, k], atol=1e-9)


def test_what_is_missing_or_constant_does_not_move_a_map():
    one = np.array([1.0, 2.0, np.nan, 3.0])
    matrix = projection.standardised([one, np.full(4, 7.0), np.full(4, np.nan)], ['a', 'b', 'c'])
    assert matrix.shape == (4, 1) and matrix[2, 0] == 0
    places = projection.pca(matrix)
    assert places.shape == (4, 2) and (places[:, 1] == 0).all()
    assert (projection.pca(np.zeros((3, 0))) == 0).all()


def test_a_long_grain_is_described_in_pieces_as_it_is_at_once(monkeypatch):
    rng = np.random.default_rng(3)
    sound = rng.standard_normal(60_000) * np.sin(np.arange(60_000) / 3e3)
    sound[20_000:24_000] = 0.0
    cuts = np.array([[0, 60_000], [30_000, 59_000], [100, 40_000]])  # overlapping, out of order
    whole = timbre.describe(sound, RATE, cuts)
    monkeypatch.setattr(timbre, 'FRAMES', 7)
    monkeypatch.setattr(timbre, 'PIECE', 5000)
    pieces = timbre.describe(sound, RATE, cuts)
    for name, values in whole.items():
        np.testing.assert_allclose(pieces[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
