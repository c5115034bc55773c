# SPDX-License-Identifier: Apache-2.0
"""Blocks that rotate: against formulas, SciPy, time steps, the plain event path; their energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support import random_scenes

from eol_ros.core.physics import builders
from eol_ros.core.physics.rotation.taylor import LEVER
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import ConfigError, UsageError
from eol_ros.lab import presets
from eol_ros.lab.choose import choose_path, simulate

NONE = {'kind': 'none'}
SIDE, MASS, MU, G = 0.084, 0.25, 0.65, 9.81


def solve(scene, **options):
    return simulate(from_mapping(scene), **options)


def loose(**rotation):
    more = {'v0': [rotation.pop('v0')]} if 'v0' in rotation else {}
    rotates = {'side': SIDE, **rotation}
    return builders.single(NONE, 2.0, k=0.0, dim1=False, rotation=rotates, **more)


def table(drive, seconds, **more):
    offsets = builders.offsets(25, 0.005, 4)
    return builders.table(drive, seconds, u0=offsets, rotation={'side': SIDE}, **more)


def test_a_spinning_block_slows_at_a_constant_rate():
    run = solve(loose(spin0=[6.0]), sample_s=0.005)
    slowing = MU * G * LEVER * SIDE / (SIDE**2 / 6)
    assert run.event_start.tolist() == [0]
    assert run.event_t[0] == pytest.approx(6.0 / slowing, rel=1e-6)
    assert run.yaw[-1, 0] == pytest.approx(36.0 / (2 * slowing), rel=1e-9)
    rotates = run.t < 0.9 * run.event_t[0]
    assert run.spin[rotates, 0] == pytest.approx(6.0 - slowing * run.t[rotates], rel=1e-12)
    assert np.abs(run.u).max() == 0.0
    assert abs(run.energy.residual_J) < 1e-12


@pytest.mark.parametrize('spin', [0.5, 6.0, 60.0])
def test_sliding_and_rotation_share_the_friction(spin):
    """SciPy on the two speeds alone: friction is normal to the ellipsoid."""
    c = LEVER * SIDE
    mass = np.array([MASS, MASS * SIDE**2 / 6 / c**2])

    def rhs(_, y):
        return -MU * MASS * G * y[:2] / np.hypot(*y[:2]) / mass, y[:2]

    def slow(_, y):
        return np.hypot(*y[:2]) - 1e-5

    slow.terminal = True
    found = solve_ivp(
        lambda t, y: np.concatenate(rhs(t, y)),
        (0, 5),
        [0.4, c * spin, 0, 0],
        'DOP853',
        rtol=1e-12,
        atol=1e-14,
        events=slow,
        dense_output=True,
    )
    run = solve(loose(spin0=[spin], v0=[0.4, 0.0]), tolerance=1e-11)
    assert run.event_t[0] == pytest.approx(found.t[-1], abs=1e-5)
    assert run.u[-1, 0, 0] == pytest.approx(found.y[2, -1], abs=1e-9)
    assert run.yaw[-1, 0] * c == pytest.approx(found.y[3, -1], abs=1e-9)
    assert run.u[-1, 0, 0] > 0.4**2 / (2 * MU * G)  # a rotating block slides further
    assert abs(run.energy.residual_J) < 1e-12


@pytest.mark.parametrize('share', [0.0, 0.5, 0.8])
def test_the_end_of_a_stop_is_not_stepped_through(share):
    """Pulled along by a share of its friction: few steps to rest, and where fine steps put it."""
    pull = {'k': 4.0, 'u0': [[-share * MU * MASS * G / 4.0, 0.0]], 'v0': [[0.02, 0.05]]}
    scene = builders.single(NONE, 0.3, dim1=False, rotation={'side': SIDE, 'spin0': [1.0]}, **pull)
    fine, run = solve(scene, tolerance=1e-12), solve(scene, tolerance=1e-6)
    assert run.event_start.tolist() == [0]
    assert run.event_t == pytest.approx(fine.event_t, abs=1e-6)
    assert run.steps <= 12 < fine.steps
    assert np.abs(run.u[-1] - fine.u[-1]).max() < 1e-10
    assert abs(run.energy.residual_J) < 1e-10


def test_a_pull_aside_turns_the_block():
    """At rest until |(F, T / c)| = F_s: a spring at the middle of an edge, pulled along it."""
    scene = builders.table(
        {'kind': 'constant_velocity', 'par': [0.0, 0.02]}, 10.0, 1, 1, rotation={'side': SIDE}
    )
    scene['springs_to_frame'] = scene['springs_to_frame'][:1]  # the one on the left
    run = solve(scene)
    at_force = 0.9 * MASS * G / np.hypot(1.0, 0.5 / LEVER)
    assert run.event_t[0] == pytest.approx(at_force / 40.0 / 0.02, rel=1e-12)
    assert run.yaw[-1, 0] < -0.2  # pulled up on its left: clockwise
    assert abs(run.energy.residual_J) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize('geometric', [False, True])
def test_the_ledger_closes_and_tolerance_is_met(geometric):
    scene = table(presets.CIRCLE, 6.0, geometric=geometric)
    fine = solve(scene, tolerance=1e-13)
    run = solve(scene, tolerance=1e-9)
    assert run.status == 'ok'
    assert len(run.event_t) > 100
    assert np.abs(run.yaw).max() > 0.05
    assert run.event_block.tolist() == fine.event_block.tolist()
    assert np.abs(run.u - fine.u).max() < 1e-8
    assert np.abs(run.yaw - fine.yaw).max() < 1e-7
    for energy in (run.energy, fine.energy):
        assert abs(energy.residual_J) < 1e-9
        assert energy.friction_J > 0.1


def test_a_mirrored_pull_turns_the_other_way():
    rows = [[t, 0.0, 0.03 * t, 0.02 * t] for t in (0, 2, 4)]
    runs = []
    for side in (1.0, -1.0):
        drive = {'kind': 'poses', 'par': [[t, side * x, y, side * phi] for t, x, y, phi in rows]}
        runs.append(solve(builders.table(drive, 4.0, 3, 3, rotation={'side': SIDE})))
    mirror = np.arange(9).reshape(3, 3)[:, ::-1].ravel()
    assert len(runs[0].event_t) > 10
    assert np.abs(runs[0].yaw + runs[1].yaw[:, mirror]).max() < 1e-7
    assert np.abs(runs[0].u[:, :, 1] - runs[1].u[:, mirror, 1]).max() < 1e-8


def test_a_plate_spring_at_an_arm_holds_the_angle():
    """Two half springs at the arms +-a: torsional stiffness k a^2, a free block swings with it."""
    arm, k = 0.03, 20.0
    scene = builders.plate(
        NONE, 3.0, 1, 1, k_plate=k, mu_s=0.0, mu_k=0.0, rotation={'side': SIDE, 'spin0': [1e-3]}
    )
    arms = [spring['arm'] for spring in scene['springs_to_frame']]
    assert np.abs(arms).max() == SIDE / 2
    for spring in scene['springs_to_frame']:
        spring['arm'] = (np.sign(spring['arm']) * arm).tolist()
    run = solve(scene, sample_s=0.05)
    w = np.sqrt(k * arm**2 / (MASS * SIDE**2 / 6))
    assert run.yaw[:, 0] == pytest.approx(1e-3 / w * np.sin(w * run.t), abs=1e-9)


@pytest.mark.parametrize(
    'change, words',
    [
        ({'rotation': {}}, "lacks the key 'side'"),
        ({'rotation': {'side': -1}}, 'rotation.side is -1'),
        ({'rotation': {'side': 0.1, 'spin0': [1.0, 2.0]}}, 'rotation.spin0 has 2'),
        ({'rotation': {'side': 0.1, 'yaw0': [float('nan')]}}, 'not a finite|nan'),
        ({'rotation': {'side': 0.1, 'speed': 1}}, "unknown key 'speed'"),
        ({'rotation': {'side': 0.1}, 'dim1': True}, 'dim1 false'),
    ],
)
def test_mistakes_are_told(change, words):
    with pytest.raises(ConfigError, match=words):
        from_mapping(builders.single(NONE, 1.0, dim1=False) | change)


def test_arms_want_rotation_and_exact_does_not_turn():
    scene = builders.single(NONE, 1.0, dim1=False)
    scene['springs_to_frame'][0]['arm'] = [0.01, 0.0]
    with pytest.raises(ConfigError, match='has an arm'):
        from_mapping(scene)
    scene['rotation'] = {'side': SIDE}
    assert choose_path(from_mapping(scene)) == 'event'
    with pytest.raises(UsageError, match='exact'):
        solve(scene, path='exact')


@pytest.mark.parametrize('seed', [61, 543])
def test_a_block_that_all_but_stops_under_a_pull_above_friction_goes_on(seed):
    """At 1e-7 m/s it would be taken for one at rest, and end 4e-7 m from where it must."""
    given, _ = random_scenes.draw(seed, rotates=True)
    coarse, fine = (solve(given, tolerance=tolerance) for tolerance in (1e-8, 1e-13))
    motion_m = np.abs(fine.u - fine.u[0]).max()
    assert np.abs(coarse.u - fine.u).max() < 10 * 1e-8 * motion_m
