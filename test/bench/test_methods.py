# SPDX-License-Identifier: Apache-2.0
"""Curves of methods and Lyapunov times: what they are made from is told apart rightly."""

import dataclasses

import numpy as np
import pytest

from benchmarks import methods, parting
from eol_ros.core.physics import presets
from eol_ros.core.physics.choose import simulate
from eol_ros.core.physics.scene import from_mapping


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
