# SPDX-License-Identifier: Apache-2.0
"""A table without coupling: each block slips as one alone does; and what friction takes of it."""

import numpy as np
import pytest

from eol_ros.core.physics import builders
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.table import Table
from eol_ros.lab import choose

DRIVE = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}


def test_no_block_of_an_uncoupled_table_feels_another():
    scene = builders.table(DRIVE, 12.0, 3, 3, dim1=True)
    apart = choose.simulate(from_mapping(builders.uncoupled(scene, Table(rows=3, columns=3))))
    alone = choose.simulate(from_mapping(builders.single(DRIVE, 12.0)))
    middle = apart.event_block == 4  # one spring, from above; it had none to the rim
    side = apart.event_block == 3  # one along the pull: the same

    np.testing.assert_allclose(apart.event_t[middle], alone.event_t, atol=1e-9)
    np.testing.assert_allclose(apart.event_t[side], alone.event_t, atol=1e-9)
    assert scene['springs_between_blocks']  # the given scene is as it was


@pytest.mark.parametrize(
    'shape', [Table(rows=3, columns=4, gap_y_m=0.05), Table(absent=(6, 7, 8, 24))]
)
def test_a_scene_has_the_springs_of_its_table(shape):
    scene = builders.table(DRIVE, 1.0, shape=shape)
    between, rim = scene['springs_between_blocks'], scene['springs_to_frame']
    told = shape.springs[shape.springs[:, 1] >= 0].tolist()
    assert scene['n'] == shape.count and len(scene['u0']) == shape.count
    assert sorted([int(shape.ids[s['i']]), int(shape.ids[s['j']])] for s in between) == sorted(told)
    assert len(rim) == (shape.springs[:, 1] < 0).sum()
    for spring in [*between, *rim]:  # from the middle of an edge to that of the next, or to the rim
        here, way = shape.rest[shape.ids[spring['i']]], np.array(spring['dir'])
        away = spring['Lnom'] + shape.block_side_m / 2
        end = spring['anchor'] if 'anchor' in spring else (
            shape.rest[shape.ids[spring['j']]] - way * shape.block_side_m / 2)  # fmt: skip
        np.testing.assert_allclose(here + away * way, end, atol=1e-12)
    held = builders.uncoupled(scene, shape)['springs_to_frame']
    assert {s['i'] for s in held} == set(range(shape.count))
