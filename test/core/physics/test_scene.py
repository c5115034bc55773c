# SPDX-License-Identifier: Apache-2.0
"""What a scene may say: one clear error for each mistake."""

import copy
import os

import numpy as np
import pytest

from eol_ros.core.physics import builders
from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import ConfigError

PULL = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}


def broken(change):
    scene = copy.deepcopy(builders.table(PULL, 1.0))
    change(scene)
    return scene


MISTAKES = [
    (lambda s: s.pop('mass'), "lacks the key 'mass'"),
    (lambda s: s.update(mass=-1), 'mass is -1 for block 0'),
    (lambda s: s.update(mass=[0.25] * 24), 'mass has 24'),
    (lambda s: s.update(mass=float('nan')), 'mass is nan'),
    (lambda s: s.update(n=2.5), 'n is 2.5'),
    (lambda s: s.update(n=0), 'n is 0'),
    (lambda s: s.update(mu_k=1.2), 'above mu_s'),
    (lambda s: s.update(dim1='yes'), "dim1 is 'yes'"),
    (lambda s: s.update(drive={'kind': 'tug', 'par': []}), "drive kind 'tug'"),
    (lambda s: s.update(drive={'kind': 'constant_velocity', 'par': [1]}), 'wants vx, vy'),
    (lambda s: s.update(drive={'kind': 'poses', 'par': [[0, 0, 0, 0], [0, 1, 0, 0]]}), 'rising'),
    (
        lambda s: s.update(
            drive={'kind': 'poses', 'par': [[0, 0, 0, 0], [0.5, 0, 0, 0], [0.5 + 1e-15, 1, 0, 0]]}
        ),
        'each by 1e-13 of itself',
    ),
    (lambda s: s['springs_between_blocks'][7].update(j=25), 'springs_between_blocks[7].j is 25'),
    (lambda s: s['springs_between_blocks'][7].update(j=0, i=0), 'ties block 0 to itself'),
    (lambda s: s['springs_to_frame'][3].pop('anchor'), "frame[3] lacks the key 'anchor'"),
    (lambda s: s['springs_to_frame'][3].update(k=-4), 'springs_to_frame[3].k is -4'),
    (lambda s: s['u0'].__setitem__(4, [0.0, float('inf')]), 'u0[4, 1] is inf'),
    (lambda s: s.update(v0='fast'), "v0 is 'fast'"),
    (lambda s: s.update(T=-1), 'T is -1'),
    (lambda s: s.update(sprngs=[]), "unknown key 'sprngs'"),
    (lambda s: s.update({'a\nb': 1}), r"unknown key 'a\nb'"),
    (lambda s: s['drive'].update({'a\nb': 1}), r"unknown key 'a\nb'"),
    (lambda s: s['springs_to_frame'][3].update(k=1e200), 'springs_to_frame[3].k is 1e+200'),
    (lambda s: s['u0'].__setitem__(4, [0.0, 1e155]), 'u0[4, 1] is 1e+155'),
    (lambda s: s.update(v0=[[0.0, -1e101]] * 25), 'v0[0, 1] is -1e+101'),
    (lambda s: s.update(mass=1e-101), 'mass is 1e-101 for block 0'),
    (lambda s: s['drive'].update(par=[1e200, 0.0]), 'numbers of at most 1e+50'),
    (lambda s: s['drive'].update(kind=['none']), "drive kind ['none']"),
    (lambda s: s.update(mass=10**400), 'a number of at most 1e+50'),
    (lambda s: s.update(mass=[10**400] * 25), '25 numbers are wanted'),
    (lambda s: s.update(mu_s=['0.9'] * 25), "mu_s is ['0.9', '0.9'"),
    (lambda s: s['drive'].update(par=[10**400, 0.0]), 'drive par is [1000'),
    (lambda s: s['springs_between_blocks'][7].update(dir=[2.0, 0.0]), 'has the length 2: a unit'),
]


@pytest.mark.parametrize('change, words', MISTAKES, ids=[words for _, words in MISTAKES])
def test_each_mistake_has_one_clear_line(change, words):
    with pytest.raises(ConfigError) as caught:
        from_mapping(broken(change))
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)
    assert caught.value.exit_code == os.EX_CONFIG


def test_the_table_of_the_paper():
    scene = from_mapping(builders.table(PULL, 1.0))
    assert len(scene.between.i) == 40
    assert len(scene.to_frame.i) == 20
    springs = np.bincount(np.concatenate([scene.between.i, scene.between.j, scene.to_frame.i]))
    assert np.all(springs == 4)
    assert len(set(scene.to_frame.i.tolist())) == 16
    assert np.abs(scene.to_frame.anchor).max() == pytest.approx(0.48)


def test_poses_do_not_overshoot_at_a_jump():
    rows = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1.001, 0.1, 0, 0], [2, 0.1, 0, 0]])
    x = Drive.through(rows).pose(np.linspace(0, 2, 20001))[:, 0]
    assert x.min() > -0.03 and x.max() < 0.13


def test_poses_go_through_their_rows_smoothly():
    rows = [[0, 0, 0, 0], [1, 0.1, 0, 0.2], [3, 0.1, -0.1, 0], [4, 0, 0, 0.1]]
    drive = from_mapping(builders.table({'kind': 'poses', 'par': rows}, 4.0)).drive
    assert drive.pose(np.array([0.0, 1.0, 3.0, 4.0])) == pytest.approx(np.array(rows)[:, 1:])
    for knot in (1.0, 3.0):
        before = (drive.pose(knot) - drive.pose(knot - 1e-6)) / 1e-6
        after = (drive.pose(knot + 1e-6) - drive.pose(knot)) / 1e-6
        assert before == pytest.approx(after, abs=1e-5)
    assert drive.pose(9.0) == pytest.approx(drive.pose(4.0))
