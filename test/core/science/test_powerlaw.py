# SPDX-License-Identifier: Apache-2.0
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eol_ros.core.science import powerlaw
from eol_ros.core.science.powerlaw import FitError, fit, histogram, sample


def rng(seed=1):
    return np.random.default_rng(seed)


def test_a_fit_by_hand():
    """Three numbers, 1..2 only: P(1) = 1 / (1 + 2^-tau), so tau = log2(n1 / n2)."""
    found = fit(np.array([0, 80, 20]), 1, 2)

    assert found.tau == pytest.approx(math.log2(4))
    assert found.b_value == pytest.approx(1)
    assert found.ks == pytest.approx(0, abs=1e-12)
    assert found.log_likelihood == pytest.approx(80 * math.log(0.8) + 20 * math.log(0.2))
    # Fisher: the variance of log s is 0.8 * 0.2 * log(2)^2
    assert found.error == pytest.approx(1 / math.sqrt(100 * 0.16 * math.log(2) ** 2))


@given(tau=st.floats(0.3, 3.5), seed=st.integers(0, 99), x_min=st.sampled_from([1, 2, 7]))
@settings(max_examples=12, deadline=None)
def test_a_truncated_law_is_found_again(tau, seed, x_min):
    numbers = sample(tau, x_min, 400, 20_000, rng(seed))
    found = fit(histogram(numbers), x_min, 400)

    assert numbers.min() >= x_min and numbers.max() <= 400
    assert abs(found.tau - tau) < 5 * found.error
    assert found.ks < 2.0 / math.sqrt(20_000)


@pytest.mark.slow
def test_bias_and_coverage_of_the_truncated_fit():
    """1e5 events, 100 times: bias below 0.005, the 95 % interval covers 88 % at least."""
    for tau, x_max in ((1.8, 400), (1.25, 1000), (1.5, 25)):
        fits = [
            fit(histogram(sample(tau, 1, x_max, 100_000, rng(k))), 1, x_max) for k in range(100)
        ]
        off = np.array([f.tau - tau for f in fits])
        inside = np.abs(off) < 1.96 * np.array([f.error for f in fits])

        assert abs(off.mean()) < 0.002
        assert inside.mean() >= 0.88


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore')
def test_powerlaw_agrees_where_there_is_no_upper_limit():
    """The package of Alstott, Bullmore and Plenz (PLoS ONE 9 (2014) e85777) as oracle."""
    oracle = pytest.importorskip('powerlaw')
    for tau, x_min in ((2.2, 1), (2.8, 4)):
        numbers = sample(tau, x_min, None, 5000, rng(7))
        ours = fit(histogram(numbers), x_min)
        theirs = oracle.Fit(
            numbers, xmin=x_min, discrete=True, verbose=False, estimate_discrete=False
        )
        assert ours.tau == pytest.approx(theirs.power_law.alpha, abs=2e-3)
        assert ours.error == pytest.approx(theirs.power_law.sigma, rel=0.5)


def test_dependent_events_get_a_wider_error():
    draws = sample(1.8, 1, 400, 5000, rng(6))
    runs = np.repeat(draws, 9)
    alone, together = (fit(histogram(n), 1, 400) for n in (draws, runs))

    assert powerlaw.goodness(draws, [alone], rng()).error == pytest.approx(alone.error, rel=0.2)
    tested = powerlaw.goodness(runs, [together], rng())
    assert tested.error == pytest.approx(3 * together.error, rel=0.2)
    assert tested.effective == pytest.approx(5000, rel=0.2)


def test_the_inefficiency_of_runs_and_of_an_autoregressive_series():
    """Closed forms: runs of m have m; x' = a x + noise has (1 + a) / (1 - a)."""
    noise = rng(3).normal(size=20_000)
    series = np.zeros(20_000)
    for k in range(1, 20_000):
        series[k] = 0.8 * series[k - 1] + noise[k]

    assert powerlaw.inefficiency(noise) == pytest.approx(1, abs=0.1)
    assert powerlaw.inefficiency(np.repeat(noise[:2000], 10)) == pytest.approx(10, rel=0.15)
    assert powerlaw.inefficiency(series) == pytest.approx(9, rel=0.15)
    assert powerlaw.inefficiency(np.ones(100)) == 1


@pytest.mark.slow
def test_true_laws_are_seldom_rejected_also_where_events_hang_together():
    """Nominal 5 %; for independent events, and for those that come in runs, short and long."""
    alone = [sample(1.6, 1, 25, 1000, rng(k)) for k in range(24)]
    for length in (1, 4, 10):
        rejected = covered = tested = 0
        for k, numbers in enumerate(alone):
            runs = np.repeat(numbers, rng(k).geometric(1 / length, 1000))[:1000]
            try:
                law = powerlaw.cascade_law(runs)
            except FitError:
                continue  # too few independent ones
            tested += 1
            rejected += law.rejected
            covered += law.tested.low <= 1.6 <= law.tested.high
        assert tested >= 20 and rejected <= 4 and covered >= tested - 4
    runs = [np.repeat(n, 4)[:1000] for n in alone]
    fits = [powerlaw.candidates(histogram(n), 25) for n in runs]
    naive = [  # for independent events, many of the runs would be rejected
        powerlaw.goodness(rng(1).permutation(n), f, rng(), repeats=100).p_value
        for n, f in zip(runs, fits, strict=True)
    ]
    assert sum(p < powerlaw.REJECTED for p in naive) >= 9


def test_strings_longer_than_the_catalogue_can_tell_get_no_verdict():
    with pytest.raises(FitError, match=r'200 events depend on each other and count as \d+ indep'):
        powerlaw.cascade_law(np.repeat(sample(1.6, 1, 25, 10, rng(2)), 20))


def test_a_law_that_drifts_is_told_with_both_halves():
    """1.4, then 1.8; a law that stays is told to drift in some 5 of 100."""
    halves = [sample(tau, 1, 25, 1500, rng(4)) for tau in (1.4, 1.8)]
    found = powerlaw.cascade_law(np.concatenate(halves))

    assert found.tested.drift_p < 0.001
    assert found.tested.halves == pytest.approx((1.4, 1.8), abs=0.1)
    assert 'it drifts (p ' in found.sentence
    same = [powerlaw.cascade_law(sample(1.6, 1, 25, 1000, rng(k))).tested for k in range(12)]
    assert sum(t.drift_p < 0.05 for t in same) <= 2


@pytest.mark.parametrize('blocks', [12, 64])
def test_a_law_ends_at_all_blocks_of_the_table(blocks):
    areas = sample(1.6, 1, blocks, 2000, rng(1))
    found = powerlaw.cascade_law(areas, blocks)

    assert found.fit.x_max == blocks and not found.rejected
    assert found.fit.tau == pytest.approx(1.6, abs=0.1)
    assert f' to {blocks}, ' in found.sentence
    assert powerlaw.band(areas, rng(2), blocks).shape == (2, blocks)


def test_a_table_of_less_than_ten_blocks_has_no_law():
    with pytest.raises(FitError, match='sizes up to 9 are no decade'):
        powerlaw.cascade_law(sample(1.6, 1, 9, 1000, rng(1)), 9)


def test_other_laws_are_rejected():
    geometric = np.minimum(rng(1).geometric(0.2, 1000), 25)
    bump = sample(1.6, 1, 25, 1000, rng(2))
    bump[rng(3).random(1000) < 0.08] = 25  # cascades of all blocks, as under a plate

    for numbers in (geometric, bump):
        found = powerlaw.cascade_law(numbers)
        assert found.rejected and found.tested.p_value < 0.01
        assert found.sentence.startswith(f'not a power law: KS {found.fit.ks:.2f}, n ')


def test_the_sentence_of_a_law_has_range_error_test_and_sensitivity():
    found = powerlaw.cascade_law(sample(1.6, 1, 25, 1000, rng(1)))

    assert not found.rejected
    assert re.match(
        r'a power law is not ruled out: b = 0\.\d\d \(0\.\d\d to 0\.\d\d\) for areas 1 to 25, '
        r'1\.4 decades \(KS 0\.01, n 1000 as \d+ independent, p 0\.\d+\); '
        r'with other lower ends b is 0\.\d\d to 0\.\d\d',
        found.sentence,
    )
    assert [f.x_min for f in found.others] == [1, 2]
    with pytest.raises(FitError, match='18 cascades are too few for a power law'):
        powerlaw.cascade_law(np.ones(18, int))


@pytest.mark.parametrize(
    ('numbers', 'arguments', 'words'),
    [
        ([2] * 18, {}, 'too few events'),
        ([3] * 500, {}, 'all 500 events have one size'),
        ([1, 2] * 50, {'x_min': 0}, 'begins at 1'),
        ([1, 2] * 50, {'x_min': 5, 'x_max': 5}, 'has a length'),
        ([1] * 2000 + [1000], {'x_max': 1001}, None),
        ([99] * 5000 + [100], {'x_max': 100}, 'no tau between'),
        ([1.5] * 50, {}, 'whole number'),
        ([-1] * 50, {}, 'whole number'),
    ],
)
def test_what_carries_no_fit_is_refused(numbers, arguments, words):
    if words is None:
        assert fit(histogram(np.array(numbers)), **arguments).tau > 5
        return
    with pytest.raises(FitError, match=words):
        fit(histogram(np.array(numbers)), **arguments)


def test_the_band_is_that_of_other_catalogues_of_the_law():
    """Oracle: binomial quantiles of the known law; runs of four spread twice as far."""
    rng = np.random.default_rng(3)
    truth = np.arange(1, 26) ** -1.6
    truth = truth[::-1].cumsum()[::-1] / truth.sum()
    count, starts = 2000, 40
    width = stats.binom(count, truth).ppf(0.975) - stats.binom(count, truth).ppf(0.025)
    covered, ratios, in_runs = [], [], []
    for _ in range(starts):
        areas = powerlaw.sample(1.6, 1, 25, count, rng)
        low, high = powerlaw.band(areas, rng)
        covered.append((low <= count * truth) & (count * truth <= high))
        ratios.append((high - low)[1:12] / width[1:12])
        fours = np.repeat(areas[: count // 4], 4)
        low, high = powerlaw.band(fours, rng)
        in_runs.append((high - low)[1:12] / width[1:12])
    assert 0.85 < np.mean(covered) < 0.99
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.mean(in_runs) == pytest.approx(2.0, abs=0.25)
    with pytest.raises(powerlaw.FitError, match='count as'):
        powerlaw.band(areas[:29], rng)
