# SPDX-License-Identifier: Apache-2.0
"""A task of a sweep against the same model run by hand."""

import dataclasses

import numpy as np
import pytest

from eol_ros.core.physics import builders
from eol_ros.core.physics.result import Limits
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.science import powerlaw
from eol_ros.lab import choose
from eol_ros.lab.automaton.ofc import Automaton
from eol_ros.lab.science import sweep
from eol_ros.lab.science.quiescent import cascades

pytestmark = pytest.mark.slow  # numba


def compute(model, **parameters):
    defaults = {f.name: f.default for f in dataclasses.fields(sweep.MODELS[model])}
    return sweep.compute(model, defaults | parameters)


def by_hand(scene, skip):
    run = choose.simulate(from_mapping(scene), ledger=False)
    areas = cascades(run.event_block, run.event_start)[1]
    return run, areas[int(skip * len(areas)) :]


def counted(result):
    pairs = [pair.split(':') for pair in result.areas.split()]
    return np.repeat([int(a) for a, _ in pairs], [int(n) for _, n in pairs])


def test_the_table_of_the_paper_is_what_the_builder_makes():
    found = compute('table', travel_m=4.0, bootstrap=50)
    drive = {'kind': 'constant_velocity', 'par': [0.001, 0.0]}
    scene = builders.table(
        drive, 4000.0, dim1=True, u0=builders.offsets(25, 0.001, 1, along_x=True)
    )
    run, areas = by_hand(scene, 0.5)
    law = powerlaw.fit(powerlaw.histogram(areas), 1, 12)

    assert found.status == 'ok'
    np.testing.assert_array_equal(counted(found), np.sort(areas))
    assert found.nearest_tau == law.tau  # tau is for a law that is not rejected
    assert found.mean_area == areas.mean() and found.system_wide == (areas >= 12.5).mean()
    assert found.rate_hz == pytest.approx(2 * len(areas) / 4000, abs=1 / 4000)
    assert 0 < found.sliding < 1
    assert run.status == 'ok'


def test_springs_friction_and_size_are_those_that_are_asked_for():
    found = compute(
        'plate', rows=3, columns=4, stiffness=30.0, stiffness_ratio=3.0, mu_static=0.8,
        friction_drop=0.5, travel_m=3.0, skip=0.0,
    )  # fmt: skip
    drive = {'kind': 'constant_velocity', 'par': [0.001, 0.0]}
    scene = builders.plate(
        drive, 3000.0, 3, 4, 10.0, 30.0, mu_s=0.8, mu_k=0.4, dim1=True,
        u0=builders.offsets(12, 0.001, 1, along_x=True),
    )  # fmt: skip

    np.testing.assert_array_equal(counted(found), np.sort(by_hand(scene, 0.0)[1]))


def test_the_automaton_is_the_same_however_it_is_cut(monkeypatch):
    whole = compute('ofc', size=12, events=3000, warmup=500, bootstrap=50, seed=3)
    monkeypatch.setattr(sweep, 'EVENTS_AT_ONCE', 701)
    cut = compute('ofc', size=12, events=3000, warmup=500, bootstrap=50, seed=3)
    lattice = Automaton.random(12, 0.2, 3)
    lattice.run(500)
    events = lattice.run(3000, full=True)

    assert whole == cut
    np.testing.assert_array_equal(counted(whole), np.sort(events.area))
    assert whole.slips == events.size.sum()


def test_a_constant_disorder_has_the_deviation_that_is_asked_for():
    factors = sweep._disorder(100_000, 0.2, 1)

    assert factors.std() == pytest.approx(0.2, rel=0.01)
    assert factors.mean() == pytest.approx(1, abs=0.003)


def test_hands_move_a_rim_and_are_stretched_in_time():
    own = np.array(sweep._hands(1, 60.0, 1.0))
    slow = np.array(sweep._hands(1, 120.0, 0.5))

    np.testing.assert_array_equal(own[:, 1:], slow[:, 1:])
    np.testing.assert_allclose(2 * own[:, 0], slow[:, 0])
    assert np.ptp(own[:, 1]) > 0.05
    assert compute('table', drive='hands', speed_mps=0.05, travel_m=2.0).cascades > 0


def test_what_cannot_be_simulated_says_so_in_the_row(monkeypatch):
    little = compute('train', travel_m=0.01)
    monkeypatch.setattr(sweep, 'Limits', lambda: Limits(events=100))
    cut = compute('table')

    assert little.status == 'no cascades' and little.tau is None
    assert cut.status.startswith('stopped at') and cut.cascades is None
