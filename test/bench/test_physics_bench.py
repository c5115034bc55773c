# SPDX-License-Identifier: Apache-2.0
"""The bench of the solvers: SciPy's own event code is an independent witness, and rows are true."""

import numpy as np
import pytest
from support import physics_rotating

from benchmarks import physics
from eol_ros.core.physics import builders
from eol_ros.core.physics.scene import from_mapping
from eol_ros.lab import presets
from eol_ros.lab.choose import simulate


@pytest.mark.parametrize(
    'geometric, seconds',
    [
        pytest.param(True, 0.8, marks=pytest.mark.slow),
        pytest.param(False, 2.0, marks=pytest.mark.soak),
    ],
)
def test_scipy_agrees_on_blocks_that_rotate(geometric, seconds):
    more = {
        'geometric': geometric,
        'u0': builders.offsets(4, 0.005, 4),
        'rotation': {'side': 0.084},
    }
    scene = from_mapping(builders.table(presets.CIRCLE, seconds, 2, 2, **more))
    run = simulate(scene, tolerance=1e-12, ledger=False)
    u, yaw, events = physics_rotating.solve(scene, run.t, 1e-11)
    assert len(events) >= 4
    assert [row[1:] for row in events] == list(zip(run.event_block, run.event_start, strict=True))
    assert np.abs(yaw).max() > 0.01
    assert np.abs(u - run.u).max() < 1e-11
    assert np.abs(yaw - run.yaw).max() < 1e-10


@pytest.mark.slow
def test_own_rows_name_method_time_and_error():
    rows = {row['method']: row for row in physics.own_rows('S1', quick=True)}
    assert rows['exact']['events'] == 64
    assert rows['event 1e-10']['error_m'] < 1e-10
    assert rows['event 1e-06']['error_m'] > rows['event 1e-12']['error_m']
    assert rows['stepping 0.0001']['error_m'] < rows['stepping 0.001']['error_m']
    assert all(row['ms'] > 0 for row in rows.values())


def test_the_order_is_that_of_the_finest_settings_above_the_floor():
    steps = np.array([1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125])
    errors = np.array([9.0, *(steps[1:5] ** 2), 1e-9])
    assert physics._order(steps, errors) == pytest.approx(2.0)
