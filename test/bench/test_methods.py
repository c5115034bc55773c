# SPDX-License-Identifier: Apache-2.0
"""Curves of methods and Lyapunov times: what they are made from is told apart rightly."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from benchmarks import method_parts, methods, parting
from eol_ros.core.physics import presets
from eol_ros.core.physics.automaton.ofc import ExactAutomaton
from eol_ros.core.physics.choose import simulate
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.sound.select import Selector
from eol_ros.settings import GrainsSettings


@pytest.mark.parametrize(
    'make', [lambda: methods.board_clock(150.0), lambda: methods.onsets(60)], ids=['clock', 'onset']
)
def test_a_curve_has_its_default_and_a_peer(make):
    curve = make()
    errors = {label: error for label, _, error in curve.points}
    row = methods.markdown({'x': dataclasses.asdict(curve)})

    assert curve.default in errors
    assert all(ms > 0 and np.isfinite(error) for _, ms, error in curve.points + curve.peers)
    assert errors[curve.default] < max(error for *_, error in curve.peers)
    assert row.count('|') == 11


def test_the_automaton_in_c_has_the_same_events():
    start = np.random.default_rng(3).integers(0, 10**9, (12, 12))
    exact = ExactAutomaton(start, 10**9, Fraction(1, 5)).run(150)
    size, first, topplings = method_parts.Rescan().run(start / 10**9, 0.2, 150)

    assert size.max() > 5
    assert topplings == size.sum() == exact.size.sum()
    assert np.array_equal(first, exact.first)


def test_loops_choose_the_same_grains():
    settings = GrainsSettings(bed_rate=0.0)
    corpus = method_parts._corpus(128)
    selector, loops = Selector(settings, corpus), method_parts.Loops(settings, corpus)
    places, seen = method_parts._walk(60)
    found = 0
    for k in range(60):
        row = selector.update(k / 60, *places[k].T, seen[k], np.zeros(25))
        expected = loops.image(k / 60, places[k].tolist(), seen[k].tolist())
        assert list(zip(row['block'], row['grain'], strict=True)) == expected
        found += len(expected)
    assert found > 20


def test_growth_is_that_of_the_exponential():
    t = np.arange(0, 30, 0.05)
    for lyapunov_s in (0.7, 2.0):
        distance = np.minimum(1e-10 * np.exp(t / lyapunov_s), 0.1)
        assert parting.growth(t, distance) == pytest.approx(lyapunov_s, rel=1e-3)
    assert parting.growth(t, np.full(len(t), 1e-8)) is None
    assert parting.growth(t, np.full(len(t), 1e-10)) is None


def test_events_are_alike_up_to_the_first_that_is_not():
    run = simulate(from_mapping(presets.scene('S1') | {'T': 10.0}))
    found = list(zip(run.event_t, run.event_block, run.event_start, strict=True))
    assert parting.same_events(run, found) == len(found) > 5
    assert parting.same_events(run, found[:4]) == 4
    t, block, start = found[3]
    found[3] = (t, block, 1 - start)
    assert parting.same_events(run, found) == 3


@pytest.mark.slow
def test_neighbours_part_as_the_tangent_says():
    row = parting.row('S3L', 14.0, 2, with_scipy=False)
    assert row['lyapunov_s'] > 0 and row['tangent_off'] < 0.2
    assert abs(1 / row['tangent_s'] - row['exponent_hz']) < 4 * row['exponent_error_hz']
    words = parting.markdown({'rows': [row, parting.row('S4L', 1.0, 1, with_scipy=False)]})
    assert len({line.count('|') for line in words.splitlines()}) == 1
