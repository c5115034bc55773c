# SPDX-License-Identifier: Apache-2.0
"""The reference in 50 digits is right where a formula knows, and refuses what it does not know."""

import numpy as np
import pytest

from benchmarks.digits import SCENES, follow, markdown, table
from benchmarks.physics_oracles import as_one
from eol_ros.core.physics import builders, presets
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import UsageError

ASLANT = {'kind': 'constant_velocity', 'par': [0.3, 0.4]}


def test_a_slip_aslant_is_that_of_the_formula():
    scene = from_mapping(builders.single(ASLANT, 0.58) | {'dim1': False})
    truth = follow(scene)
    assert [event[1:] for event in truth.events] == [(0, 1), (0, 0)]
    begin = float(scene.static_limit[0] / (scene.to_frame.k[0] * 0.5))
    assert truth.events[0][0] == pytest.approx(begin, abs=1e-15)
    assert np.abs(truth.u - as_one(scene, np.array([0.58]))[0]).max() < 1e-15


def test_rows_can_be_printed():
    ours = [{'tolerance': 1e-9, 'error_m': 1e-13, 'same_events': 2, 'events_off_s': 1e-12}] * 4
    row = {'scene': 'S3G', 'stretch_s': 1.0, 'events': 2, 'steps': 3, 'took_s': 4.0, 'ours': ours}
    words = markdown({'rows': [row | {'scipy_error_m': 1e-12}]})
    assert [line.count('|') for line in words.splitlines()] == [10, 10, 10]
    assert '2 events alike' in table({'rows': [row | {'scipy_error_m': 1e-12}]})
    assert set(SCENES) <= set(presets.NAMED)


def test_what_it_does_not_know_is_refused():
    drive = {'kind': 'poses', 'par': [[0, 0, 0, 0], [1, 1, 0, 0]]}
    with pytest.raises(UsageError, match='pulled or circled'):
        follow(from_mapping(builders.single(drive, 1.0)))
