# SPDX-License-Identifier: Apache-2.0
"""Likelihood ratios against closed forms, general minimisers, and samples of known law."""

import numpy as np
import pytest
from scipy import optimize

from eol_ros.core.science.powerlaw import fit, histogram, sample
from eol_ros.lab.science import alternatives

SUPPORT = np.arange(1, 201.0)


def rng(seed=1):
    return np.random.default_rng(seed)


def drawn(log_weight, count, seed=1):
    weight = np.exp(log_weight - log_weight.max())
    return rng(seed).choice(SUPPORT.astype(int), count, p=weight / weight.sum())


def compared(numbers, x_max=200):
    found = fit(histogram(numbers), 1, x_max)
    return {a.name: a for a in alternatives.compare(numbers, found)}


def likelihood(log_weight, numbers):
    density = log_weight - np.log(np.exp(log_weight - log_weight.max()).sum()) - log_weight.max()
    return density[numbers - 1].sum()


def test_the_exponential_has_its_closed_form():
    """Without an end: geometric, P(k) = (1 - q) q^(k - 1) with q = 1 - 1 / mean."""
    numbers = rng(2).geometric(0.3, 2000)
    power = fit(histogram(numbers), 1)
    q = 1 - 1 / numbers.mean()
    expected = power.log_likelihood - (np.log(1 - q) + (numbers - 1) * np.log(q)).sum()
    found = alternatives.compare(numbers, power)[0]

    assert found.name == 'exponential'
    assert found.log_ratio == pytest.approx(expected, rel=1e-6)
    assert found.verdict == 'better'


@pytest.mark.parametrize(
    ('name', 'log_weight'),
    [
        ('stretched exponential', lambda v: (v[1] - 1) * np.log(SUPPORT) - v[0] * SUPPORT ** v[1]),
        ('log-normal', lambda v: v[0] * np.log(SUPPORT) - v[1] ** 2 * np.log(SUPPORT) ** 2),
        ('cut-off power law', lambda v: -v[0] * np.log(SUPPORT) - v[1] ** 2 * SUPPORT),
    ],
)
def test_each_law_reaches_what_a_general_minimiser_reaches(name, log_weight):
    numbers = drawn(log_weight(np.array([0.6, 0.4])), 3000)
    power = fit(histogram(numbers), 1, 200)
    best = min(
        optimize.minimize(
            lambda v: -likelihood(log_weight(v), numbers), start, method='Nelder-Mead',
            options={'xatol': 1e-9, 'fatol': 1e-9, 'maxiter': 4000},
        ).fun
        for start in ([0.6, 0.4], [1.0, 0.2])
    )  # fmt: skip

    assert compared(numbers)[name].log_ratio == pytest.approx(power.log_likelihood + best, abs=1e-3)


@pytest.mark.parametrize(
    ('name', 'log_weight'),
    [
        ('exponential', -0.2 * SUPPORT),
        ('stretched exponential', -0.5 * np.log(SUPPORT) - 0.8 * SUPPORT**0.5),
        ('log-normal', -0.5 * (np.log(SUPPORT) - 1.5) ** 2),
        ('cut-off power law', -1.2 * np.log(SUPPORT) - 0.05 * SUPPORT),
    ],
)
def test_another_law_is_found_better(name, log_weight):
    assert compared(drawn(log_weight, 3000))[name].verdict == 'better'


def test_a_power_law_excludes_the_exponential_and_is_not_beaten():
    better = 0
    for seed in range(10):
        found = compared(sample(1.6, 1, 200, 2000, rng(seed)))
        assert found['exponential'].verdict == 'worse'
        better += found['cut-off power law'].verdict == 'better'
        assert found['log-normal'].log_ratio <= 0
    assert better <= 3  # one in ten is expected


def test_dependence_makes_a_ratio_less_sure():
    numbers = drawn(-1.2 * np.log(SUPPORT) - 0.02 * SUPPORT, 400)
    runs = np.repeat(numbers, 10)  # ten times the events, and no more to know

    for name in ('exponential', 'cut-off power law'):
        power = fit(histogram(runs), 1, 200)
        heeding = {a.name: a for a in alternatives.compare(runs, power)}[name]
        assert heeding.log_ratio == pytest.approx(10 * compared(numbers)[name].log_ratio)
        assert np.log(heeding.p_value) > 3 * np.log(compared(numbers)[name].p_value)


def test_the_words_name_all_four():
    words = alternatives.sentence(list(compared(sample(1.6, 1, 200, 2000, rng(3))).values()))

    assert all(name in words for name in alternatives.ALTERNATIVES)
    assert words.endswith('worse: exponential')
