# SPDX-License-Identifier: Apache-2.0
"""The automaton against its rule in exact arithmetic, event for event."""

from fractions import Fraction

import numpy as np
import pytest
from support.automaton_rule import by_the_rule

from eol_ros.core.science import powerlaw
from eol_ros.errors import ConfigError
from eol_ros.lab.automaton.ofc import Automaton

pytestmark = pytest.mark.slow  # numba compiles, unless it has before


def table(events):
    return np.stack(events, axis=1)


def test_a_lattice_of_equals_is_one_event():
    """More equals than the queue has capacity for."""
    events = Automaton(np.full((40, 40), 0.5), 0.2).run(50, full=True)
    assert (events.area[0], events.first[0]) == (1600, 0)


@pytest.mark.parametrize(
    ('levels', 'side', 'seed', 'alpha', 'count'),
    [
        # coarse stress and alpha a power of two: 50 bits hold the first events exactly
        (1024, 20, 2, '1/4', 40),
        (1024, 20, 2, '1/8', 40),
        (10**15, 10, 3, '1/5', 400),
    ],
)
def test_fixed_point_follows_the_rule_until_it_rounds_a_tie(levels, side, seed, alpha, count):
    start = np.random.default_rng(seed).integers(0, levels, (side, side))
    expected = by_the_rule(start, levels, Fraction(alpha), count)
    found = Automaton(start / levels, float(Fraction(alpha))).run(count, full=True)

    np.testing.assert_array_equal(table(found), expected)


def by_full_scan(stress, alpha, count):
    """The rule in fixed point on the whole lattice, layer by layer: rows of Events, the stress."""
    share, value, rows = round(alpha * 2**32), (stress * 2**50).astype(np.int64), []
    for _ in range(count):
        value += 2**50 - value.max()
        layers = []
        while (over := value >= 2**50).any():
            layers.append(over)
            gift = np.where(over, (value >> 32) * share + ((value % 2**32) * share >> 32), 0)
            value[over] = 0
            value[1:] += gift[:-1]
            value[:-1] += gift[1:]
            value[:, 1:] += gift[:, :-1]
            value[:, :-1] += gift[:, 1:]
        area = np.logical_or.reduce(layers).sum()
        rows.append((np.sum(layers), area, len(layers), layers[0].argmax()))
    return np.array(rows), value / 2**50


@pytest.mark.parametrize(
    ('side', 'alpha', 'count'),
    [
        (16, 0.2, 4000),
        (35, 0.25, 500),
        (50, 0.15, 4000),
        (5, 0.25, 4000),
        (3, 0.0, 12_000),  # drives by more than fits into the integers at once
        (1, 0.2, 300),
        (90, 0.2, 1500),
    ],
)
def test_the_bucket_finds_what_a_full_scan_finds(side, alpha, count):
    expected, rest = by_full_scan(np.random.default_rng(3).random((side, side)), alpha, count)
    automaton = Automaton.random(side, alpha, 3)
    found = [table(automaton.run(n, full=True)) for n in (1, 255, count - 256)]

    np.testing.assert_array_equal(np.vstack(found), expected)
    np.testing.assert_array_equal(automaton.stress, rest)


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: Automaton.random(0, 0.2, 1), 'lattice size 0'),
        (lambda: Automaton.random(8, 0.26, 1), 'alpha 0.26 is not between'),
        (lambda: Automaton.random(8, -0.1, 1), 'alpha -0.1'),
        (lambda: Automaton(np.ones((3, 3)), 0.2), 'below its threshold'),
        (lambda: Automaton(np.full((3, 3), np.nan), 0.2), 'below its threshold'),
        (lambda: Automaton(np.zeros((3, 4)), 0.2), 'square'),
    ],
)
def test_impossible_lattices_are_refused(make, words):
    with pytest.raises(ConfigError, match=words):
        make()


@pytest.mark.parametrize(
    ('alpha', 'warmup', 'tau'),
    [(0.10, 3_000_000, 2.54), (0.15, 4_000_000, 2.15), (0.20, 2_000_000, 1.83)],
)
def test_the_law_of_sizes_steepens_as_less_is_passed_on(alpha, warmup, tau):
    """L 35, sizes 2..200: values of a full scan in floating point (Olami et al. 1992, fig. 3)."""
    automaton = Automaton.random(35, alpha, 1)
    automaton.run(warmup)
    counts = powerlaw.histogram(automaton.run(1_000_000).size)

    assert powerlaw.fit(counts, 2, 200).tau == pytest.approx(tau, abs=0.06)
