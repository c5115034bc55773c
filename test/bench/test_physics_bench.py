# SPDX-License-Identifier: Apache-2.0
"""The bench of the solvers: SciPy's own event code is an independent witness, and rows are true."""

import numpy as np
import pytest
from support import physics_rotating

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
