# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.science import spectra
from eol_ros.core.science.spectra import SeriesError, Slope, slope


def rng(seed=1):
    return np.random.default_rng(seed)


@pytest.mark.parametrize('beta', [0.0, 0.5, 1.0, 1.5, 2.0])
def test_the_slope_of_coloured_noise_is_found(beta):
    found = [
        slope(spectra.coloured_noise(beta, 30_000, rng(k)), 50.0, rng(), repeats=20).beta
        for k in range(4)
    ]

    assert np.mean(found) == pytest.approx(beta, abs=0.06)


@pytest.mark.slow
def test_the_interval_covers_what_it_says():
    """600 s at 50 Hz, 60 runs: nominal 95 %, at least 85 % found."""
    covered = 0
    for k in range(60):
        found = slope(spectra.coloured_noise(1.0, 30_000, rng(k)), 50.0, rng(), repeats=100)
        covered += found.low <= 1.0 <= found.high

    assert covered >= 51


def test_events_by_chance_are_white():
    times = spectra.poisson_times(20_000, 600.0, rng(2))
    found = slope(spectra.event_counts(times, 600.0), 50.0, rng())

    assert found.low < 0 < found.high
    assert abs(found.beta) < 0.1


def test_shuffled_intervals_keep_the_intervals_and_lose_their_order():
    gaps = 0.02 * np.exp(2 * spectra.coloured_noise(1.0, 8000, rng(3)) / 0.3)
    times = gaps.cumsum()
    shuffled = spectra.shuffled_times(times, rng())

    np.testing.assert_allclose(np.sort(np.diff(shuffled, prepend=0)), np.sort(gaps), atol=1e-9)
    true, lost = (
        slope(spectra.event_counts(t, t[-1], 2.0), 2.0, rng(), low_hz=16 / t[-1])
        for t in (times, shuffled)
    )
    assert true.beta > lost.beta + 0.3


def test_counts_are_all_there():
    counts = spectra.event_counts(np.array([0.0, 0.001, 0.5, 0.99]), 1.0, 50.0)

    assert (len(counts), counts.sum(), counts[0]) == (50, 4, 2)


def test_audio_power_follows_the_envelope_of_a_tone():
    rate = 16_000
    t = np.arange(20 * rate) / rate
    envelope = 1 + 0.8 * np.sin(2 * np.pi * 2.0 * t)
    power = spectra.audio_power(envelope * np.sin(2 * np.pi * 1000 * t), rate)

    assert len(power) == 2000
    middle = slice(200, 1800)
    np.testing.assert_allclose(power[middle], (envelope**2 / 2)[:: rate // 100][middle], atol=0.03)


def test_the_verdict_needs_both_controls():
    nothing = np.empty(0)

    def of(low, high):
        return Slope((low + high) / 2, low, high, 0.9, 30, nothing, nothing)

    assert spectra.is_one_over_f(of(0.8, 1.2), [of(-0.1, 0.1), of(-0.2, 0.2)])
    assert not spectra.is_one_over_f(of(0.8, 1.2), [of(-0.1, 0.1), of(0.4, 0.9)])
    assert not spectra.is_one_over_f(of(0.3, 1.2), [of(-0.1, 0.1), of(-0.2, 0.2)])


@pytest.mark.parametrize(
    ('series', 'words'),
    [
        (np.ones(100), 'too short'),
        (np.ones(30_000), 'does not vary'),
        (np.full(30_000, np.nan), 'does not vary'),
    ],
)
def test_a_series_without_a_spectrum_is_refused(series, words):
    with pytest.raises(SeriesError, match=words):
        slope(series, 50.0, rng())
