# SPDX-License-Identifier: Apache-2.0
"""The verdict on series whose spectrum is known; `eol bench spectra` counts it over many more."""

import numpy as np
import pytest
from support.known_series import SERIES, ask

from eol_ros.lab.science import one_over_f, spectra

NOT = [name for name, (right, _) in SERIES.items() if right == 'no']
TWIN = 'triggers of the twin', 'sound of the twin'
IS = [name for name, (right, _) in SERIES.items() if right == 'yes']


def seeds(name):
    """Return the seeds of the realisations to test; one for the slowest series."""
    return range(1 if name in ('sum of three relaxations', *TWIN) else 2)


def ask_of(values, others=None, **how):
    """The verdict on values at 20/s, up to 5 Hz."""
    series = one_over_f.Series('x', values, 20.0, 5.0, **how)
    return one_over_f.ask(series, np.random.default_rng(1), others)


@pytest.mark.slow
@pytest.mark.parametrize('name', NOT)
def test_what_only_looks_like_it_is_never_called_so(name):
    """Ten minutes: all are refused outright; sums of two and three relaxations take longer."""
    seconds = {'sum of two relaxations': 1200.0, 'sum of three relaxations': 14400.0}.get(
        name, 600.0
    )
    assert {ask(name, seconds, seed).answer for seed in seeds(name)} == {'no'}


@pytest.mark.slow
@pytest.mark.parametrize('name', IS)
def test_what_is_is_called_so(name):
    """Four hours (events: two): most are, as bench counts; so one of three at least."""
    seconds, first = (7200.0, 1) if name.startswith('events') else (14400.0, 0)
    assert any(ask(name, seconds, seed).answer == 'yes' for seed in range(first, first + 3))


@pytest.mark.slow
@pytest.mark.parametrize('name', NOT)
def test_a_short_series_is_no_reason_to_say_yes(name):
    """160 s are just two decades: it may be undecided."""
    assert 'yes' not in [ask(name, 160.0, seed).answer for seed in seeds(name)]


@pytest.mark.slow
def test_the_sentence_says_band_interval_and_reason():
    assert ask('white', 600.0, 1).sentence.startswith(
        'white: not 1/f from 0.0133 to 5 Hz (2.6 decades): slope '
    )
    assert 'a rhythm of 0.7 Hz stands' in ask('periodic', 600.0, 1).sentence
    said = ask('1/f', 14400.0, 1)
    assert said.answer == 'yes'
    assert '1/f: 1/f from' in said.sentence and 'Lorentzians are worse by' in said.sentence
    found = ask('heavy-tailed intervals', 600.0, 2)
    assert 'the control (shuffled intervals) has a slope of' in found.sentence


def test_a_rate_that_is_one_over_f_only_while_visitors_are_there_is_undecided():
    noise = spectra.coloured_noise(1.0, 12_000, np.random.default_rng(5))
    there = np.linspace(0, 1, 12_000) < 0.5
    found = ask_of(noise * (0.1 + there))

    assert found.answer == 'undecided' and 'not steady' in found.sentence


def test_a_trend_of_three_sigma_is_not_steady():
    """IAAFT surrogates keep the power of a trend: noise of the same slope is what tells."""
    found = ask('1/f and a trend of 3 sigma', 3600.0, 1)

    assert found.stationary_p <= one_over_f.UNEVEN and 'not steady' in found.sentence
    assert ask('1/f', 3600.0, 1).stationary_p > one_over_f.UNEVEN


def test_a_control_that_is_shorter_is_asked_over_its_own_band():
    """The twin's control ends after an hour, and its slope counts all the same."""
    rng = np.random.default_rng(8)
    series, short = (spectra.coloured_noise(1.0, n, rng) for n in (288_000, 72_000))

    assert ask_of(series, {'hands': lambda: short}).controls['hands'][0] > 0.8


def test_two_relaxations_bend_and_a_short_record_does_not_exclude_them():
    found = ask('sum of two relaxations', 3600.0, 1)
    assert found.answer == 'no' and 'two Lorentzians: AIC lower by' in found.sentence
    assert (
        'two Lorentzians (an alternative without 1/f) not excluded' in ask('1/f', 160.0, 1).sentence
    )


@pytest.mark.parametrize(
    ('series', 'times', 'words'),
    [
        (np.arange(2000.0), None, '100 s are too short: two decades below 5 Hz need 160 s'),
        (np.zeros(0), None, '0 s are too short'),
        (np.zeros(12_000), None, 'does not vary'),
        (np.arange(12_000.0), np.arange(18.0), '18 events are too few: 50 are needed'),
    ],
)
def test_what_cannot_be_asked_is_said(series, times, words):
    found = ask_of(series, times_s=times)

    assert found.answer == 'undecided' and words in found.sentence


def test_bouts_at_other_times_are_the_control_of_a_series_that_rests():
    """Flashes by chance, each dying away in 2 s: a Lorentzian. Few of them: no verdict but `no`."""
    rng = np.random.default_rng(6)
    series = np.zeros(12_000)
    for start in rng.integers(0, 11_900, 60):
        series[start : start + 40] += np.exp(-np.arange(40) / 10)
    found = ask_of(series, rest=0.0)

    assert found.answer == 'no' and 'bends' in found.sentence


@pytest.mark.slow
def test_a_control_that_has_the_slope_too_refuses_it():
    """The same hands without coupling are such a control."""
    rng = np.random.default_rng(2)
    series, same = (spectra.coloured_noise(1.0, 288_000, rng) for _ in range(2))
    asked = []

    def given(values):
        return lambda: asked.append(1) or values

    def ask_with(values, found=series):
        return ask_of(found, {'hands': given(values)})

    assert ask_with(rng.normal(size=288_000)).answer == 'yes'
    assert ask_with(np.zeros(288_000)).controls['hands'] == (0.0, 0.0)  # nothing slips: no 1/f
    refused = ask_with(same)
    assert refused.answer == 'no' and 'the control (hands) has a slope of' in refused.sentence
    asked.clear()
    assert ask_with(same, rng.normal(size=288_000)).answer == 'no' and not asked  # not needed


def test_a_record_of_few_gestures_has_no_verdict():
    """Up to ten of the longest gestures the band ends where these bend the spectrum."""
    noise = spectra.coloured_noise(1.0, 20 * 260, np.random.default_rng(5))
    drive_s = one_over_f.GESTURE_S
    short = ask_of(noise[: 20 * 240], drive_s=drive_s)

    assert short.answer == 'undecided' and '240 s are too short' in short.sentence
    assert '(25 s) need 250 s' in short.sentence
    assert ask_of(noise, drive_s=drive_s).spectrum is not None
