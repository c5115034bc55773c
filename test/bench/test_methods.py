# SPDX-License-Identifier: Apache-2.0
"""Curves of methods: what they are made from is told apart rightly."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from support.automaton_rule import by_the_rule

from benchmarks import method_parts, methods
from eol_ros.core.sound.select import Selector
from eol_ros.settings import GrainsSettings


@pytest.mark.parametrize(
    'make, best',
    [
        (lambda seed: methods.board_clock(seed, 150.0), 'least squares of 60'),
        (lambda seed: methods.onsets(seed, 60), 'SciPy curve_fit, 3 images'),
    ],
    ids=['clock', 'onset'],
)
def test_a_curve_has_its_default_a_peer_and_the_deviation_of_its_realisations(
    make, best, monkeypatch
):
    monkeypatch.setitem(methods.RANDOM, 'x', make)
    monkeypatch.setattr(methods, 'REALISATIONS', 3)
    curve = methods.realised('x')
    errors = {label: error for label, _, error, _ in curve.points}
    one = [dict((label, error) for label, _, error in make(seed).points) for seed in range(3)]
    row = methods.markdown({'x': dataclasses.asdict(curve)})

    assert curve.n == 3
    assert all(ms > 0 and deviation > 0 for _, ms, _, deviation in curve.points + curve.peers)
    assert errors[curve.default] == pytest.approx(np.mean([e[curve.default] for e in one]))
    assert errors[curve.default] < max(error for *_, error, _ in curve.peers)
    assert row.count('|') == 9 and f'({curve.default})' in row and f'| {best}: ' in row


def test_the_automaton_in_c_has_the_same_events():
    start = np.random.default_rng(3).integers(0, 10**9, (12, 12))
    exact = by_the_rule(start, 10**9, Fraction(1, 5), 150)
    size, first, topplings = method_parts.Rescan().run(start / 10**9, 0.2, 150)

    assert size.max() > 5
    assert topplings == size.sum() == exact[:, 0].sum()
    assert np.array_equal(first, exact[:, 3])


def test_loops_choose_the_same_grains():
    settings = GrainsSettings(ambience_rate=0.0)
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
