# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.signal import lfilter

from eol_ros.lab.science import spectra
from eol_ros.lab.science.spectra import SeriesError, slope, spectrum


def rng(seed=1):
    return np.random.default_rng(seed)


def of_noise(beta, seed=1, count=12_000):
    return spectrum(spectra.coloured_noise(beta, count, rng(seed)), 20.0, 8 * 20 / count, 5.0)


@pytest.mark.parametrize('beta', [0.0, 0.5, 1.0, 1.5, 2.0])
def test_the_slope_of_coloured_noise_is_found(beta):
    assert np.mean([slope(of_noise(beta, k)).beta for k in range(8)]) == pytest.approx(
        beta, abs=0.03
    )


@pytest.mark.slow
@pytest.mark.parametrize('beta', [0.0, 1.0, 2.0])
def test_the_interval_covers_what_it_says(beta):
    """Nominal 95 %; of 100 at least 90, which an exact interval misses once in 30."""
    found = [slope(of_noise(beta, k, 6000)) for k in range(100)]

    assert sum(s.low <= beta <= s.high for s in found) >= 90
    assert np.mean([s.high - s.low for s in found]) < 0.5


def test_the_level_is_that_of_the_density():
    """White noise of variance 1 at 20/s: 2 / 20 per Hz, one-sided, so that it sums to 1."""
    found = of_noise(0.0)
    white = spectrum(rng(3).normal(size=200_000), 20.0, 0.01, 9.0)

    assert np.average(white.power, weights=white.weight) == pytest.approx(0.1, rel=0.02)
    assert found.decades == pytest.approx(np.log10(5.0 / (8 * 20 / 12_000)))


def test_an_autoregressive_series_has_its_closed_form():
    """S = 2 s^2 / (rate |1 - a exp(-2 pi i f / rate)|^2)."""
    series = lfilter([1], [1, -0.9], rng(4).normal(size=400_000))
    found = spectrum(series, 20.0, 0.01, 8.0)
    turn = np.exp(-2j * np.pi * found.frequency_hz / 20.0)
    expected = 0.1 / np.abs(1 - 0.9 * turn) ** 2

    off = np.log(found.power / expected) * np.sqrt(found.weight)
    assert np.abs(off).max() < 4


def test_a_mean_over_a_window_is_corrected():
    noise = rng(5).normal(size=600_000)
    means = np.convolve(noise, np.full(40, 1 / 40), 'valid')[::10]  # 0.2 s of 200/s, at 20/s
    found = spectrum(means, 20.0, 0.01, 3.0, window_s=0.2)

    assert abs(slope(found).beta) < 0.05


def test_a_local_whittle_estimate_agrees():
    """Robinson, Ann. Stat. 23 (1995) 1630, on all ordinates: log mean(I f^b) - b mean(log f)."""
    found = of_noise(1.0, 7, 60_000)
    betas = np.linspace(0.5, 1.5, 1001)
    log_f = np.log(found.ordinates_hz)
    objective = [
        np.log(np.mean(found.ordinates * found.ordinates_hz**b)) - b * log_f.mean() for b in betas
    ]

    assert slope(found).beta == pytest.approx(betas[np.argmin(objective)], abs=0.06)


def curve(name, x):
    return {
        'white': np.ones_like(x),
        'power law': x**-1.0,
        'Lorentzian': 1 / (1 + (x / 0.3) ** 2),
        'knee': 1 / (1 + (x / 0.2) ** 1.2),
        'Lorentzian and floor': 1 / (1 + (x / 0.1) ** 2) + 0.02,
        'power law and floor': x**-1.0 + 3.0,
        'power law and Lorentzian': x**-0.8 + 30 / (1 + (x / 0.3) ** 4) ** 0.5,
    }[name]


@pytest.mark.parametrize('name', ['white', 'power law', 'Lorentzian', 'knee',
                                  'Lorentzian and floor', 'power law and floor'])  # fmt: skip
def test_each_shape_is_found_where_it_is(name):
    exact = of_noise(0.0)
    power = curve(name, exact.frequency_hz)
    found = spectra.shapes(spectra.Spectrum(**{**vars(exact), 'power': 7 * power}))
    simplest = min(found.values(), key=lambda shape: shape.aic)

    assert simplest.name == name
    np.testing.assert_allclose(found[name].curve, 7 * power, rtol=2e-3)


@pytest.mark.slow
def test_a_line_stands_out_and_noise_has_none():
    t = np.arange(12_000) / 20.0
    noise = spectra.coloured_noise(1.0, len(t), rng(8))
    noise /= noise.std()
    band = (8 / 600, 5.0)
    line = spectra.rhythm(spectrum(noise + np.sin(2 * np.pi * 0.7 * t), 20.0, *band), 1.0)

    assert line is not None and line[0] == pytest.approx(0.7, abs=1 / 600)
    alone = [spectra.rhythm(of_noise(beta, k), beta) for beta in (0, 1, 2) for k in range(60)]
    assert sum(found is not None for found in alone) <= 1


@pytest.mark.parametrize(
    ('series', 'band', 'words'),
    [
        (np.ones(100), (0.1, 5), '5 s are too short for 0.1 Hz: 80 s'),
        (np.ones(30_000), (0.1, 5), 'does not vary'),
        (np.full(30_000, np.nan), (0.1, 5), 'does not vary'),
        (np.ones(30_000), (0.1, 10), 'no band'),
        (np.ones(30_000), (5, 5), 'no band'),
    ],
)
def test_a_series_without_a_spectrum_is_refused(series, band, words):
    with pytest.raises(SeriesError, match=words):
        spectrum(series, 20.0, *band)
