# SPDX-License-Identifier: Apache-2.0
"""Curves of methods: what they are made from is told apart rightly."""

from fractions import Fraction

import numpy as np
from support.automaton_rule import by_the_rule

from benchmarks import method_parts
from eol_ros.core.sound.select import Selector
from eol_ros.settings import GrainsSettings


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
