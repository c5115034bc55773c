# SPDX-License-Identifier: Apache-2.0
"""Stiff springs in the plane, against SciPy and a formula."""

import numpy as np
import pytest
from support import physics_oracles, stepping

from eol_ros.core.physics import builders
from eol_ros.core.physics.numerics import elastic_energy, length_scale
from eol_ros.core.physics.scene import from_mapping
from eol_ros.lab import presets
from eol_ros.lab.choose import simulate

PULL = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
CIRCLE = {'kind': 'circle_and_rotation', 'par': [0.06, 0.9, 0.12, 0.7]}


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'events'), [('S4L', 32), ('S4G', 12)])
def test_equal_friction_in_the_plane(name, events):
    """It starts with no acceleration. Against steps of another method, whose error falls as h."""
    scene = from_mapping(presets.scene(name) | {'mu_s': 0.65, 'mu_k': 0.65, 'T': 1.0})
    run = simulate(scene, ledger=False)
    fine = simulate(scene, tolerance=1e-12)

    assert run.status == fine.status == 'ok'
    assert len(run.event_t) >= events
    assert run.steps < 25 * len(run.event_t)  # a solver that follows each direction takes 300
    assert np.abs(run.u - fine.u).max() < 5e-10
    tight = simulate(scene, tolerance=1e-9, ledger=False)
    assert tight.steps < 30 * len(tight.event_t)
    assert np.abs(tight.u - fine.u).max() < 1e-10
    assert abs(fine.energy.residual_J) < 1e-9
    coarse, stepped = (stepping.solve(scene, run.t, h).u for h in (2e-5, 1e-5))
    assert np.abs(stepped - fine.u).max() < 4e-7
    assert np.abs(2 * stepped - coarse - fine.u).max() < 1e-9  # extrapolated to no step


@pytest.mark.slow
def test_equal_friction_along_a_line_is_the_exact_path():
    """In places: whether a block that comes to rest on its limit stops there is rounding."""
    given = builders.train(PULL, 8.0, n=3, k_plate=20.0, mu_s=0.65, mu_k=0.65)
    exact = simulate(from_mapping(given), path='exact', ledger=False)
    event = simulate(from_mapping(given), path='event', tolerance=1e-11, ledger=False)
    assert len(exact.event_t) > 2
    assert np.abs(exact.u - event.u).max() < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize('geometric', [True, False])
@pytest.mark.parametrize('drive', [PULL, CIRCLE])
def test_stiff_springs_in_the_plane(geometric, drive):
    given = builders.table(
        drive, 0.03, 3, 3, k=1e6, geometric=geometric, u0=builders.offsets(9, 0.005, 3)
    )
    scene = from_mapping(given)
    run = simulate(scene, sample_s=0.003, tolerance=1e-10)
    assert run.status == 'ok'
    assert len(run.event_t) == 9
    assert np.abs(run.u - physics_oracles.sliding_of_scipy(scene, run.t)).max() < 1e-11
    energy = run.energy
    assert abs(energy.residual_J) < 2e-8 * abs(energy.friction_J)


@pytest.mark.slow
def test_blocks_that_slide_together_and_vibrate():
    given = builders.plate(
        CIRCLE, 0.05, 3, 3, k_between=2e6, mass=[0.1, 0.2, 0.3, 0.4, 0.5, 0.4, 0.3, 0.2, 0.1],
        u0=builders.offsets(9, 1e-7, 3), v0=[[0.5, 0.3]] * 9,
    )  # fmt: skip
    scene = from_mapping(given)
    run = simulate(scene, sample_s=0.0047)
    assert run.status == 'ok' and len(run.event_t) == 0
    assert np.abs(run.u - physics_oracles.sliding_of_scipy(scene, run.t)).max() < 1e-12
    together = run.u - run.u.mean(1)[:, None]
    assert np.abs(together[-1]).max() > 1e-8  # what trembles is not smoothed away
    assert abs(run.energy.residual_J) < 1e-11


def soft_and_stiff(seed):
    """Springs of 1e-3 to 1e7 N/m and masses of 1e-3 to 1e3 kg, without friction."""
    random = np.random.default_rng(seed)
    given = builders.train(
        {'kind': 'none'}, 20.0, n=6, mu_s=0.0, mu_k=0.0, mass=10.0 ** random.uniform(-3, 3, 6),
        u0=builders.offsets(6, 0.01, seed, along_x=True),
    )  # fmt: skip
    for spring in [*given['springs_between_blocks'], *given['springs_to_frame']]:
        spring['k'] = 10.0 ** random.uniform(-3, 7)
    return given


@pytest.mark.parametrize('seed', range(4))
def test_modes_keep_soft_springs_beside_stiff_ones(seed):
    """Against mpmath with 40 digits."""
    pytest.importorskip('mpmath')
    scene = from_mapping(soft_and_stiff(seed))
    run = simulate(scene, sample_s=10.0)
    assert run.path == 'exact'
    truth = physics_oracles.modes_of_mpmath(scene, run.t)
    assert np.abs(run.u[-1] - truth[-1]).max() < 1e-7
    assert abs(run.energy.residual_J) < 1e-9 * elastic_energy(scene, scene.u0, 0.0)


def test_a_heavy_block_on_a_soft_spring_beside_a_light_one_on_a_stiff_one():
    given = builders.train(
        {'kind': 'none'}, 100.0, n=2, mu_s=0.0, mu_k=0.0, mass=[1e-3, 1e3], k_plate=1.0,
        k_between=0.0, u0=[[0.0, 0.0], [0.01, 0.0]],
    )  # fmt: skip
    given['springs_to_frame'][0]['k'] = 1e7
    run = simulate(from_mapping(given))
    assert run.u[-1, :, 0] == pytest.approx([0, 0.01 * np.cos(100 * np.sqrt(1e-3))], abs=1e-11)


def test_blocks_that_no_spring_ties_to_the_rim_fly_on():
    given = builders.train(
        {'kind': 'none'}, 10.0, n=3, mu_s=0.0, mu_k=0.0, k_plate=0.0, k_between=1e5,
        v0=[[0.1, 0.0], [0.2, 0.0], [0.3, 0.0]],
    )  # fmt: skip
    run = simulate(from_mapping(given))
    assert run.path == 'exact'
    assert run.u[:, :, 0].mean(axis=1) == pytest.approx(0.2 * run.t, abs=1e-12)


@pytest.mark.parametrize('k_plate', [1e-3, 0.0])
def test_stiff_ties_do_not_hide_a_soft_spring_along_a_line(k_plate):
    """The mean of two blocks that slide one way is one block, however they vibrate.

    A force is known to 2e-16 of that of the stiff spring: 1e-4 of the soft one.
    """
    given = builders.train(
        {'kind': 'none'}, 0.5, n=2, k_plate=k_plate, k_between=1e9, mass=1e-3, mu_s=1e-4,
        mu_k=1e-4, v0=[[0.1, 0.0], [0.1001, 0.0]],
    )  # fmt: skip
    run, w = simulate(from_mapping(given), path='exact'), np.sqrt(k_plate / 1e-3)
    loss, t = 1e-4 * 9.81, run.t
    truth = 0.10005 * t - 0.5 * loss * t**2
    if k_plate:
        truth = 0.10005 / w * np.sin(w * t) - loss / w**2 * (1 - np.cos(w * t))
    assert len(run.event_t) == 0 and run.steps < 1000
    assert np.abs(run.u[:, :, 0].mean(axis=1) - truth).max() < 5e-7


@pytest.mark.slow
def test_a_light_block_between_heavy_ones():
    """It reverses thousands of times before friction stops it, and the others never move."""
    mass = np.full(9, 1e3)
    mass[4] = 1e-5
    aside = [[0.005 * (i == 4), 0.002 * (i == 4)] for i in range(9)]
    given = builders.table({'kind': 'none'}, 0.3, 3, 3, mass=mass, u0=aside)
    scene = from_mapping(given)
    run = simulate(scene, sample_s=0.01, tolerance=1e-10)
    assert run.status == 'ok'

    # along a line, by formula: half periods about +-delta, 2 delta shorter each time
    w, start = np.sqrt(160.0 / 1e-5), np.array([0.005, 0.002])
    delta, size = 0.65 * 9.81 / w**2, np.hypot(*start)
    half = np.floor(run.t * w / np.pi)
    wide = size - (2 * half + 1) * delta
    place = (-1.0) ** half * delta + wide * np.cos(run.t * w)
    assert np.abs(run.u[:, 4] - place[:, None] * start / size).max() < 1e-10
    assert np.all(run.u[:, mass > 1] == 0)


def test_the_tolerance_goes_by_the_lightest_block():
    """By the median mass a table of heavy blocks and a light one allowed errors of metres."""
    mass = [1e3] * 8 + [1e-6]
    scene = from_mapping(builders.table(PULL, 1.0, 3, 3, mass=mass))
    assert length_scale(scene) == pytest.approx(0.9 * 9.81e-6 / 40)
