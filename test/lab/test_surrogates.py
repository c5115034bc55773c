# SPDX-License-Identifier: Apache-2.0
import itertools

import numpy as np
import pytest

from eol_ros.lab.science import spectra, surrogates


def rng(seed=1):
    return np.random.default_rng(seed)


def test_counts_are_all_there():
    counts = surrogates.event_counts(np.array([0.0, 0.001, 0.5, 0.99]), 1.0, 50.0)

    assert (len(counts), counts.sum(), counts[0]) == (50, 4, 2)


def test_each_control_of_events_keeps_what_it_says():
    gaps = rng(2).lognormal(0.0, 1.0, 4000)
    times = gaps.cumsum()
    made = {k: surrogates.of_events(k, times, times[-1], rng()) for k in surrogates.CONTROLS}

    assert all(len(t) == 4000 and t[-1] <= times[-1] * 1.0001 for t in made.values())
    shuffled = np.diff(made['shuffled intervals'], prepend=0)
    np.testing.assert_allclose(np.sort(shuffled), np.sort(gaps), atol=1e-9)
    assert np.abs(shuffled - gaps).max() > 1
    for kind, variation in (('random times', 1.0), ('gamma renewal', gaps.std() / gaps.mean())):
        own = np.diff(made[kind])
        assert own.std() / own.mean() == pytest.approx(variation, rel=0.1)
    assert made['gamma renewal'][-1] == pytest.approx(times[-1])


def test_bouts_are_where_it_does_not_rest():
    begin, end = surrogates.bouts(np.array([3, 0, 0, 1, 2, 0, 5.0]), 0.5)

    assert (begin.tolist(), end.tolist()) == ([0, 3, 6], [1, 5, 7])


def test_each_control_of_bouts_keeps_their_course():
    series = np.zeros(6000)
    for k, start in enumerate(rng(3).choice(600, 80, replace=False) * 10):
        series[start : start + 1 + k % 7] = 1 + k % 7
    lengths = np.sort(np.subtract(*surrogates.bouts(series, 0.0)[::-1]))
    gaps = np.sort(np.diff(np.flatnonzero(series)))
    for kind in surrogates.CONTROLS:
        made = surrogates.of_bouts(kind, series, 0.0, rng())
        assert len(made) == len(series) and made.min() == 0
        assert made.sum() == pytest.approx(series.sum(), rel=0.03), kind  # cut at the end, at most
        assert not np.array_equal(made, series)
        if kind == 'shuffled intervals':
            found = np.sort(np.subtract(*surrogates.bouts(made, 0.0)[::-1]))
            np.testing.assert_array_equal(found, lengths)
            assert np.sort(np.diff(np.flatnonzero(made)))[-5:].tolist() == gaps[-5:].tolist()


def test_iaaft_keeps_values_and_spectrum():
    noise = spectra.coloured_noise(1.0, 4096, rng(4))
    series = np.exp(0.5 * noise / noise.std())
    made = surrogates.iaaft(series, rng())

    np.testing.assert_array_equal(np.sort(made), np.sort(series))
    true, own = (np.abs(np.fft.rfft(s)) ** 2 for s in (series, made))
    edges = np.geomspace(1, len(true), 12).astype(int)
    for a, b in itertools.pairwise(np.unique(edges)):
        assert own[a:b].sum() == pytest.approx(true[a:b].sum(), rel=0.03)
    assert abs(np.corrcoef(series, made)[0, 1]) < 0.5


@pytest.mark.slow
def test_stationary_series_are_seldom_called_uneven():
    """Of 12 stationary ones, Gaussian and in bursts, 0.3 are expected; 3 once in 300."""
    uneven = 0
    for k in range(12):
        noise = spectra.coloured_noise(k % 3 / 2, 4096, rng(k))
        series = np.exp(0.5 * noise / noise.std()) if k % 2 else noise
        uneven += surrogates.stationarity(series, rng(k)) <= 0.025

    assert uneven <= 2


def test_visitors_who_come_and_go_are_uneven():
    noise = spectra.coloured_noise(1.0, 8192, rng(5))
    at_work = np.sin(np.arange(8192) / 8192 * 6 * np.pi) > 0

    assert surrogates.stationarity(noise * (0.05 + at_work), rng()) == 1 / 40
