# SPDX-License-Identifier: Apache-2.0
"""Completeness, b, waiting times and aftershocks of catalogues whose truth is known."""

import math

import numpy as np
import pytest
from scipy import stats

from eol_ros.core.science.powerlaw import FitError
from eol_ros.lab.science import catalogue


def rng(seed=1):
    return np.random.default_rng(seed)


def magnitudes(b, count, seed=1):
    """A Gutenberg-Richter law from 0 on."""
    return rng(seed).exponential(1 / (b * math.log(10)), count)


def test_b_has_its_closed_forms():
    m = np.array([1.0, 1.4, 2.0, 1.2, 0.3])

    assert catalogue.b_value(m, 1.0) == pytest.approx(math.log10(math.e) / 0.4)
    # the positive steps of at least 0.1 are 0.4 and 0.6
    assert catalogue.b_positive(m, 0.1) == pytest.approx(math.log10(math.e) / 0.4)


@pytest.mark.slow
def test_a_law_is_found_again_with_its_error():
    found = [catalogue.magnitude_law(magnitudes(0.8, 2000, k), rng(), repeats=100)
             for k in range(20)]  # fmt: skip

    for f in found:
        assert abs(f.b_value - 0.8) < 4 * f.b_error
        assert abs(f.b_positive - 0.8) < 4 * f.b_positive_error
    assert np.mean([f.b_value for f in found]) == pytest.approx(0.8, abs=0.03)
    assert np.std([f.b_value for f in found]) == pytest.approx(found[0].b_error, rel=0.5)
    assert sum(f.p_value < 0.05 for f in found) <= 4
    assert 'is not ruled out: b = 0.' in found[0].sentence


def test_b_positive_bears_what_goes_unseen_after_great_ones():
    """After a great one small ones are missed for a while (van der Elst 2021): b of greatest
    likelihood comes out too low, b-positive does not."""
    m = magnitudes(1.0, 40_000)
    blind, seen = 0.0, []
    for value in m:
        if value >= blind:
            seen.append(value)
            blind = max(blind, value - 0.5)
        blind = max(0.0, blind - 0.1)
    seen = np.array(seen)

    assert len(seen) > 5000
    assert catalogue.b_value(seen, 0.3) < 0.9
    assert catalogue.b_positive(seen) == pytest.approx(1.0, abs=0.04)


def test_completeness_is_where_all_are_seen():
    m = magnitudes(1.0, 20_000)
    kept = m[rng(2).random(len(m)) < stats.norm.cdf(m, 0.5, 0.1)]

    assert 0.6 <= catalogue.completeness(kept) <= 0.9
    assert catalogue.b_value(kept, catalogue.completeness(kept)) == pytest.approx(1.0, abs=0.05)


def test_what_is_no_gutenberg_richter_law_is_called_so():
    found = catalogue.magnitude_law(rng(3).normal(1.0, 0.2, 1000), rng(), repeats=100)

    assert found.p_value < 0.05 and 'no Gutenberg-Richter law' in found.sentence


def test_waiting_times_by_chance_in_clusters_and_even():
    chance = catalogue.waiting(rng(4).exponential(2.0, 500).cumsum(), rng())
    assert chance.mean_s == pytest.approx(2.0, rel=0.15) and chance.p_value > 0.1
    assert 'as by chance' in chance.sentence
    for shape, words in ((0.4, 'in clusters'), (4.0, 'more evenly than by chance')):
        gaps = rng(5).gamma(shape, 1.0, 500)
        onsets = np.r_[0.0, gaps.cumsum()]
        gaps = np.diff(onsets)
        gaps = gaps[gaps > 0]
        found = catalogue.waiting(onsets, rng())
        assert words in found.sentence and found.p_value < 0.05
        assert found.gamma_shape == pytest.approx(stats.gamma.fit(gaps, floc=0)[0], rel=1e-3)


def omori_catalogue(p, c, seed=6, mains=80, length=60.0, background=0.2, productivity=12.0):
    """Mainshocks a minute apart, each with aftershocks by the inverse of Omori's integral."""
    r = rng(seed)
    onsets, sizes = [], []
    for k in range(mains):
        start = k * length
        onsets.append([start])
        sizes.append([20])
        whole = -math.expm1((1 - p) * math.log1p(length / c)) / (p - 1)
        share = r.random(r.poisson(productivity)) * whole
        after = c * (np.power(1 + (1 - p) * share, 1 / (1 - p)) - 1)
        chance = r.random(r.poisson(background * length)) * length
        onsets.append(start + np.r_[after, chance])
        sizes.append(np.ones(len(after) + len(chance), int))
    return np.concatenate(onsets), np.concatenate(sizes), mains * length


@pytest.mark.slow
def test_omori_is_found_again():
    found = catalogue.omori(*omori_catalogue(p=1.2, c=0.5), mains=80)

    assert found.mains == 80
    assert abs(found.p - 1.2) < 3 * found.p_error and 0.03 < found.p_error < 0.4
    assert found.better > 50 and 'the rate decays with p = 1.' in found.sentence
    assert found.background_hz == pytest.approx(0.2, rel=0.3)
    assert found.per_main == pytest.approx(12.0, rel=0.25)


@pytest.mark.slow
def test_without_aftershocks_there_is_no_omori():
    decays = 0
    for seed in range(4):
        r = rng(seed)
        onsets = np.sort(r.random(600)) * 1000.0
        found = catalogue.omori(onsets, r.integers(1, 26, 600), 1000.0)
        decays += found.better >= catalogue.BETTER
        if found.better < catalogue.BETTER:
            assert 'no decay of the rate' in found.sentence
    assert decays <= 1


def test_a_rate_that_dies_away_exponentially_is_not_called_omori():
    r = rng(8)
    starts = np.arange(60) * 30.0
    after = [s + r.exponential(1.0, 15) for s in starts]
    onsets = np.r_[starts, np.concatenate(after), r.random(300) * 1800]
    sizes = np.r_[np.full(60, 20), np.ones(60 * 15 + 300, int)]
    found = catalogue.omori(onsets, sizes, 1800.0, mains=60)

    assert found.better > 50 and 'faster than by Omori' in found.sentence


@pytest.mark.parametrize(
    ('ask', 'words'),
    [
        (lambda: catalogue.magnitude_law(np.arange(30.0), rng()), '30 magnitudes are too few'),
        (lambda: catalogue.magnitude_law(np.full(300, -np.inf), rng()), '0 magnitudes'),
        (lambda: catalogue.waiting(np.arange(10.0), rng()), '9 waiting times are too few'),
        (lambda: catalogue.omori(np.arange(9.0), np.ones(9), 9.0), '9 cascades'),
        (lambda: catalogue.omori(np.arange(300.0), np.ones(300), 300.0), 'of the greatest size'),
        (
            lambda: catalogue.omori(np.arange(300.0), np.arange(300) % 100 // 99, 300.0),
            '3 mainshocks are too few for a law of aftershocks: 10 are needed',
        ),
    ],
)
def test_what_carries_no_law_says_so(ask, words):
    with pytest.raises(FitError, match=words):
        ask()
