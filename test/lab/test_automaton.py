# SPDX-License-Identifier: Apache-2.0
"""The automaton against its rule written out in fractions, event for event."""

from fractions import Fraction

import numpy as np
import pytest

from eol_ros.core.science import powerlaw
from eol_ros.errors import ConfigError
from eol_ros.lab.automaton.ofc import Automaton, ExactAutomaton

pytestmark = pytest.mark.slow  # numba compiles, unless it has before


def by_the_rule(stress, alpha, count):
    """The rule, line by line, in Fraction. Returns rows of Events, and the stress at the end."""
    side = len(stress)
    f = {(i, j): Fraction(stress[i, j]) for i in range(side) for j in range(side)}
    rows = []
    for _ in range(count):
        top = max(f.values())
        for site in f:
            f[site] += 1 - top
        sizes, areas, layers, first = 0, set(), 0, None
        while layer := [s for s in sorted(f) if f[s] >= 1]:
            first = layer[0] if first is None else first
            old = {s: f[s] for s in layer}
            for s in layer:
                f[s] = Fraction(0)
            for (i, j), v in old.items():
                for near in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                    if near in f:
                        f[near] += alpha * v
            sizes += len(layer)
            areas |= set(layer)
            layers += 1
        rows.append((sizes, len(areas), layers, first[0] * side + first[1]))
    return np.array(rows), np.array([[f[i, j] for j in range(side)] for i in range(side)])


def table(events):
    return np.stack(events, axis=1)


@pytest.mark.parametrize(
    ('side', 'alpha', 'count', 'seed', 'levels'),
    [
        (8, Fraction(1, 5), 400, 1, 100_000),
        (6, Fraction(1, 4), 150, 2, 100_000),
        (7, Fraction(3, 20), 300, 3, 100_000),
        (5, Fraction(2, 9), 300, 4, 100_000),
        (1, Fraction(1, 5), 5, 5, 100_000),
        (2, Fraction(0), 12, 6, 100_000),
        (10, Fraction(1, 10), 600, 7, 100_000),
        (6, Fraction(1, 5), 100, 8, 4),  # many equal sites
    ],
)
def test_exact_arithmetic_is_the_rule_event_for_event(side, alpha, count, seed, levels):
    start = np.random.default_rng(seed).integers(0, levels, (side, side))
    expected, rest = by_the_rule(start * Fraction(1, levels), alpha, count)
    automaton = ExactAutomaton(start, levels, alpha)
    cut = count // 3  # in two runs
    found = np.vstack([table(automaton.run(cut)), table(automaton.run(count - cut))])

    np.testing.assert_array_equal(found, expected)
    assert (automaton.stress == rest).all()


def test_a_lattice_of_equals_is_one_event():
    """More equals than the queue has capacity for."""
    events = Automaton(np.full((40, 40), 0.5), 0.2).run(50, full=True)
    assert (events.area[0], events.first[0]) == (1600, 0)


@pytest.mark.parametrize(
    ('start', 'alpha', 'count'),
    [
        # coarse stress and alpha a power of two: 50 bits hold the first events exactly
        (np.random.default_rng(2).integers(0, 1024, (20, 20)) / 1024, '1/4', 40),
        (np.random.default_rng(2).integers(0, 1024, (20, 20)) / 1024, '1/8', 40),
        (np.random.default_rng(3).random((10, 10)), '1/5', 400),
    ],
)
def test_fixed_point_follows_the_rule_until_it_rounds_a_tie(start, alpha, count):
    expected, _ = by_the_rule(start, Fraction(alpha), count)
    found = Automaton(start, float(Fraction(alpha))).run(count, full=True)

    np.testing.assert_array_equal(table(found), expected)


def by_full_scan(stress, alpha, count):
    """The rule in fixed point on the whole lattice, layer by layer. As `by_the_rule`."""
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
        (lambda: ExactAutomaton(np.zeros((3, 3)), 10, Fraction(1, 5)), 'whole numbers'),
        (lambda: ExactAutomaton(np.full((3, 3), 10), 10, Fraction(1, 5)), 'lie in 0..9'),
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
