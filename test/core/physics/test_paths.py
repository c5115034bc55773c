# SPDX-License-Identifier: Apache-2.0
"""The solvers against formulas, against each other, and against an independent event code."""

import numpy as np
import pytest
from scipy.optimize import brentq
from support import physics_oracles, scipy_solver, stepping

from eol_ros.core.physics import builders
from eol_ros.core.physics.numerics import (
    elastic_energy,
    keep_ledger,
    kinetic_energy,
    usual_size,
)
from eol_ros.core.physics.result import Limits
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.table import Table
from eol_ros.lab import presets
from eol_ros.lab.choose import simulate
from eol_ros.settings import TwinSettings

PULL = {'kind': 'constant_velocity', 'par': [0.02, 0.0]}
NONE = {'kind': 'none'}


def solve(scene, **options):
    return simulate(from_mapping(scene), **options)


def single_by_formula(k=40.0, m=0.25, speed=0.02, mu_s=0.9, mu_k=0.65, g=9.81):
    w = np.sqrt(k / m)
    static, kinetic = mu_s * m * g, mu_k * m * g
    slip = 2 / w * (np.pi - np.arctan((static - kinetic) * w / (k * speed)))
    drop = 2 * (static - kinetic)
    return static / (k * speed), slip, drop / (k * speed) + slip


@pytest.mark.parametrize('path, error_s', [('exact', 1e-12), ('event', 1e-10)])
@pytest.mark.parametrize('speed', [1e-4, 0.02, 0.3])
def test_single_block_keeps_its_clock(path, error_s, speed):
    first, slip, period = single_by_formula(speed=speed)
    drive = {'kind': 'constant_velocity', 'par': [speed, 0.0]}
    run = solve(
        builders.single(drive, first + 31 * period + 1.01 * slip), path=path, sample_s=period
    )
    starts, stops = run.event_t[::2], run.event_t[1::2]
    assert len(run.event_t) == 64
    late = error_s * max(1.0, 0.02 / speed)  # a place is known, and the rim passes it slowly
    assert starts == pytest.approx(first + period * np.arange(32), abs=late * 32)
    assert stops - starts == pytest.approx(np.full(32, slip), abs=late)
    if speed == 0.02:
        assert first == pytest.approx(2.7590625)
        assert period == pytest.approx(1.797429612610788, abs=1e-14)


def test_single_block_against_fifty_digits():
    """An oracle of its own kind: mpmath solves each phase by root finding in 50 digits."""
    mp = pytest.importorskip('mpmath').mp.clone()
    mp.dps = 50
    m, k, g, speed = mp.mpf('0.25'), mp.mpf(40), mp.mpf('9.81'), mp.mpf('0.02')
    static, kinetic = mp.mpf('0.9') * m * g, mp.mpf('0.65') * m * g
    w, place, t, expected = mp.sqrt(k / m), mp.mpf(0), mp.mpf(0), []
    while t < 20:
        t = (static / k + place) / speed
        expected.append(t)
        start = place

        def velocity(s, t=t, start=start):  # m x'' = k (V (t + s) - x) - kinetic, from rest
            lag = speed * t - kinetic / k - start
            return speed + w * lag * mp.sin(w * s) - speed * mp.cos(w * s)

        stop = mp.findroot(velocity, (mp.pi / w, mp.mpf('1.3') * mp.pi / w), 'anderson', tol=1e-60)
        lag = speed * t - kinetic / k - start
        place += speed * stop + lag * (1 - mp.cos(w * stop)) - speed / w * mp.sin(w * stop)
        t += stop
        expected.append(t)
    run = solve(builders.single(PULL, float(expected[-1]) + 0.1))
    assert len(run.event_t) == len(expected) >= 20
    assert [
        float(abs(mp.mpf(float(a)) - b)) for a, b in zip(run.event_t, expected, strict=True)
    ] == (pytest.approx([0.0] * len(expected), abs=2e-14))
    assert run.u[-1, 0, 0] == pytest.approx(float(place), abs=1e-15)


@pytest.mark.slow
def test_a_day_of_one_block_does_not_drift():
    first, _, period = single_by_formula()
    run = solve(builders.single(PULL, 1e5), sample_s=1e4)
    starts = run.event_t[::2]
    late = starts - (first + period * np.arange(len(starts)))
    assert len(run.event_t) == 111268
    assert np.abs(late).max() * 0.02 < 1e-9


def test_symmetric_train_is_one_block():
    for k_between, most in ((0.0, 1e-13), (40.0, 1e-13), (4e5, 1e-11)):
        two = solve(builders.train(PULL, 20.0, n=2, k_plate=40.0, k_between=k_between))
        one = solve(builders.single(PULL, 20.0))
        assert np.abs(two.u[:, 0] - one.u[:, 0]).max() <= most
        assert np.abs(two.u[:, 0] - two.u[:, 1]).max() <= most
        assert len(two.event_t) == 2 * len(one.event_t)


@pytest.mark.parametrize('build', [builders.table, builders.plate])
def test_mirror_symmetry_of_simultaneous_breaks(build):
    run = solve(build(PULL, 10.0))
    u = run.u[:, :, 0].reshape(-1, 5, 5)
    assert np.abs(u - u[:, ::-1]).max() <= 1e-12
    assert len(run.event_t) > 50
    if build is builders.plate:  # without offsets every block of the plate moves as one
        assert np.ptp(run.u[:, :, 0], axis=1).max() <= 1e-12
        assert len(run.event_t) % 50 == 0


@pytest.mark.parametrize('name', list(presets.NAMED))
def test_the_energy_ledger_closes(name):
    run = solve(presets.scene(name))
    assert run.status == 'ok'
    assert len(run.event_t) >= 10
    energy = run.energy
    assert abs(energy.residual_J) <= 1e-9 * max(1.0, abs(energy.work_J))
    assert energy.friction_J > 0


@pytest.mark.parametrize('mu_k', [0.0, 0.2])
def test_the_ledger_closes_where_springs_leave_the_line_of_a_rail(mu_k):
    """The rim works against them aside, too."""
    scene = builders.table(
        presets.CIRCLE, 4.0, 2, 2, geometric=True, dim1=True, mu_s=0.4, mu_k=mu_k
    )
    run = solve(scene)
    assert len(run.event_t) > 10
    assert not run.u[:, :, 1].any()
    assert abs(run.energy.residual_J) < 1e-9


@pytest.mark.parametrize('rotation', [None, {'side': 0.084}], ids=['plain', 'rotation'])
def test_the_ledger_closes_where_blocks_are_too_heavy_to_move(rotation):
    """Friction holds a stretch of 1e29 m there; the rim still goes round a circle of 0.2 m."""
    drive = {'kind': 'circle_and_rotation', 'par': [0.2, 6.0, 1.5, 7.0]}
    run = solve(builders.table(drive, 2.0, geometric=True, mass=1e30, rotation=rotation))
    assert run.status == 'ok' and not run.u.any()
    assert run.energy.work_J > 100
    assert abs(run.energy.residual_J) < 1e-8


def scaled(scene, s):
    """The same scene with all lengths and g `s` times as large: displacements are, too."""
    springs = {
        key: [
            row | {name: row[name] * s for name in ('L0', 'Lnom')}
            | ({'anchor': [x * s for x in row['anchor']]} if 'anchor' in row else {})
            for row in scene[key]
        ]
        for key in ('springs_between_blocks', 'springs_to_frame')
    }  # fmt: skip
    lengths = {'circle_and_rotation': [s, 1, 1, 1], 'constant_velocity': s, 'poses': [1, s, s, 1]}
    drive = scene['drive']
    drive = drive | {'par': np.multiply(drive['par'], lengths[drive['kind']]).tolist()}
    u0 = (np.array(scene['u0']) * s).tolist()
    if scene.get('rotation'):
        springs['rotation'] = {'side': scene['rotation']['side'] * s}
    return scene | springs | {'drive': drive, 'g': scene['g'] * s, 'u0': u0}


@pytest.mark.parametrize('geometric', [True, False], ids=['geometric', 'linear'])
@pytest.mark.parametrize(
    ('mass', 'size', 'error'),
    [(1e30, 2.0**-20, 0.0), (1e30, 2.0**20, 0.0), (0.25, 2.0**-10, 1e-10), (0.25, 2.0**10, 1e-10)],
)
def test_a_scene_of_another_size_moves_alike(mass, size, error, geometric):
    """Down to the bit where nothing moves: no length counts as one metre in a step's error."""
    drive = {'kind': 'circle_and_rotation', 'par': [0.05, 1.5, 0.12, 1.1]}
    scene = builders.table(
        drive, 2.0, 3, 3, geometric=geometric, mass=mass, u0=builders.offsets(9, 5e-3, 1)
    )
    usual, other = solve(scene), solve(scaled(scene, size))
    assert len(usual.event_t) == len(other.event_t) and (len(usual.event_t) > 20) == (mass < 1)
    assert np.abs(other.u / size - usual.u).max() <= error * np.abs(usual.u).max()
    if mass > 1:
        assert usual.steps == other.steps
        assert vars(other.energy) == {key: x * size**2 for key, x in vars(usual.energy).items()}


@pytest.mark.parametrize('size', [2.0**-40, 2.0**-20, 2.0**40])
@pytest.mark.parametrize(
    ('geometric', 'rotation', 'kind', 'par'),
    [
        (True, None, 'circle_and_rotation', [0.05, 1.5, 0.12, 1.1]),
        (False, None, 'poses', [[0, 0, 0, 0], [1, 0.05, 0.02, 0.2], [2, 0.1, 0, -0.2]]),
        (True, {'side': 0.084}, 'constant_velocity', [0.03, 0.02]),
        (False, {'side': 0.084}, 'circle_and_rotation', [0.05, 1.5, 0.12, 1.1]),
    ],
)
def test_a_million_times_the_size_changes_no_bit(size, geometric, rotation, kind, par):
    """Speeds that count as zero are proportional to the speeds of the slips."""
    scene = builders.table(
        {'kind': kind, 'par': par}, 2.0, 3, 3, geometric=geometric, rotation=rotation,
        u0=builders.offsets(9, 5e-3, 1),
    )  # fmt: skip
    usual, other = solve(scene), solve(scaled(scene, size))
    assert other.notes == [] and len(usual.event_t) > 20
    for name, factor in (('event_t', 1), ('event_block', 1), ('u', size), ('v', size)):
        assert np.array_equal(getattr(other, name), getattr(usual, name) * factor), name
    assert vars(other.energy) == {key: x * size**2 for key, x in vars(usual.energy).items()}
    if rotation:
        assert np.array_equal(other.yaw, usual.yaw) and np.array_equal(other.spin, usual.spin)


def test_one_block_with_little_friction_does_not_change_the_unit_of_length():
    scene = builders.table(NONE, 1.0, 3, 3)
    scene |= {name: [1e-9, *[scene[name]] * 8] for name in ('mu_s', 'mu_k')}
    assert usual_size(from_mapping(scene))[1] == 1.0


def test_a_large_ledger_residual_adds_a_note():
    scene = from_mapping(builders.single(PULL, 4.0))
    run = simulate(scene)
    booked = np.array([run.energy.work_J, run.energy.friction_J])
    for off_J, notes in ((5e-5, 0), (2e-4, 1)):
        keep_ledger(run, scene, run.u[-1], run.v[-1], booked + [off_J, 0.0])
        assert run.energy.residual_J == pytest.approx(off_J, rel=1e-6)
        assert sum('energy ledger misses' in note for note in run.notes) == notes


@pytest.mark.parametrize('speed', [5e-324, 1e-300, 1e-30])
def test_a_rim_may_be_as_slow_as_numbers_are(speed):
    slow = {'kind': 'constant_velocity', 'par': [speed, 0.0]}
    run, rests = (solve(builders.train(drive, 3.0, n=3)) for drive in (slow, NONE))
    assert run.status == 'ok'
    assert np.abs(run.u - rests.u).max() < 1e-25


def test_no_friction_keeps_its_energy_for_ever():
    offsets = builders.offsets(25, 0.01, 1, along_x=True)
    scene = from_mapping(builders.table(NONE, 1e8, mu_s=0.0, mu_k=0.0, u0=offsets, dim1=True))
    run = simulate(scene, sample_s=1e6)
    energy = [
        elastic_energy(scene, u, 0) + kinetic_energy(scene, v)
        for u, v in zip(run.u, run.v, strict=True)
    ]
    assert run.path == 'exact' and run.steps < 50
    assert np.abs(np.array(energy) / energy[0] - 1).max() <= 1e-14


def test_no_friction_driven_agrees_with_event_path():
    offsets = builders.offsets(25, 0.01, 1, along_x=True)
    scene = builders.table(PULL, 3.0, mu_s=0.0, mu_k=0.0, u0=offsets)
    exact, event = solve(scene), solve(scene, path='event', tolerance=1e-12)
    assert (exact.path, event.path) == ('exact', 'event')
    assert np.abs(exact.u - event.u).max() < 1e-11
    assert abs(exact.energy.residual_J) < 1e-12


@pytest.mark.parametrize(
    'scene',
    [
        builders.table(NONE, 1e5, u0=builders.offsets(25, 0.001, 1)),
        builders.table(PULL, 1e5, mu_s=1e9, mu_k=1e9),
    ],
)
def test_what_cannot_move_is_not_worked_out(scene):
    run = solve(scene, sample_s=1e4)
    assert run.steps == 1
    assert len(run.event_t) == 0
    assert np.array_equal(run.u[-1], run.u[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    'name, seconds',
    [
        ('S3L', 4.5), ('S3G', 2.2), ('S4G', 0.9),
        ({'kind': 'circle_and_rotation', 'par': [0.1, 1.5, 0.2, 1.0]}, 4.0),
        ({'kind': 'poses', 'par': [[0, 0, 0, 0], [1, 0.08, 0.02, 0.1], [4, 0.2, 0, -0.2]]}, 4.0),
    ],
)  # fmt: skip
def test_scipy_event_code_agrees(name, seconds):
    """A name is that of a preset, a drive that of a train of five blocks."""
    if isinstance(name, str):
        values = presets.scene(name)
    else:
        values = builders.train(name, seconds, u0=builders.offsets(5, 0.005, 2, along_x=True))
    scene = from_mapping(values | {'T': seconds})
    run = simulate(scene, tolerance=1e-13)
    u, events = scipy_solver.scipy_run(
        scene, run.t, 3e-13, physics_oracles.CAPTURE_MPS, physics_oracles.ARM_S
    )
    assert len(events) >= 6
    assert [row[1:] for row in events] == list(zip(run.event_block, run.event_start, strict=True))
    assert run.event_t == pytest.approx([row[0] for row in events], abs=1e-7)
    assert np.abs(u - run.u).max() < 1e-9


@pytest.mark.parametrize('geometric', [False, True])
def test_numbers_of_any_size_end_with_a_status(geometric):
    """Forces that overflow left an index unset; `make soak` checks all indices."""
    random = np.random.default_rng(5)
    for _ in range(40):
        drawn = 10.0 ** random.uniform(-50, 50, 4)
        scene = builders.table(
            {'kind': 'constant_velocity', 'par': [0.02, 0.01 * drawn[0]]}, 1.0, 2, 2, k=drawn[1],
            mass=drawn[2], geometric=geometric, u0=random.uniform(-1, 1, (4, 2)) * drawn[3],
            rotation=random.choice([None, {'side': Table().block_side_m}]),
        )  # fmt: skip
        run = solve(scene, sample_s=0.25, limits=Limits(events=500, steps=500))
        assert run.status != 'ok' or np.isfinite(run.energy.residual_J)
        assert np.isfinite(run.u).all() and np.isfinite(run.v).all()
        assert 0 <= run.t_reached <= 1


@pytest.mark.parametrize('rotates', [False, True], ids=['plain', 'rotation'])
@pytest.mark.parametrize('path, error_s', [('exact', 1e-14), ('event', 1e-9)])
@pytest.mark.parametrize('v0, stops', [(0.5, 1), (0.9, 0)])
def test_a_block_with_static_friction_alone_stops_where_it_turns_back(
    path, error_s, rotates, v0, stops
):
    """It stops at a quarter period, if the spring then pulls by less than static friction."""
    if path != 'event' and rotates:
        return
    scene = builders.single(NONE, 1.0, mu_s=0.9, mu_k=0.0, v0=[[0.6 * v0, 0.8 * v0]], dim1=False)
    if path == 'exact':
        scene |= {'dim1': True, 'v0': [[v0, 0.0]]}
    if rotates:
        scene['rotation'] = {'side': Table().block_side_m}
        scene['springs_to_frame'][0]['arm'] = [0.0, 0.0]
    run, w = solve(scene, path=path), np.sqrt(40.0 / 0.25)
    assert run.status == 'ok' and len(run.event_t) == stops
    reach = np.hypot(*run.u[-1, 0])
    if stops:
        assert run.event_t[0] == pytest.approx(np.pi / 2 / w, abs=error_s)
        assert reach == pytest.approx(v0 / w, abs=3 * v0 * error_s * w * error_s + 1e-9)
    else:  # v0 / w stretches the spring to more than 0.9 m g
        assert reach == pytest.approx(abs(v0 / w * np.sin(w)), abs=5 * error_s)


def test_blocks_with_static_friction_alone_are_the_same_on_all_paths():
    scene = builders.train(PULL, 6.0, n=3, mu_k=0.0, u0=builders.offsets(3, 0.005, 2, along_x=True))
    exact, event = (solve(scene, path=path) for path in ('exact', 'event'))
    steps = stepping.solve(from_mapping(scene), exact.t, 1e-5)
    assert (exact.event_start == 0).sum() == 5
    assert exact.event_block.tolist() == event.event_block.tolist() == steps.event_block.tolist()
    assert np.abs(exact.u - event.u).max() < 1e-10
    assert np.abs(exact.u - steps.u).max() < 5e-5


AWAY = {'kind': 'poses', 'par': [[0, 1, 0, 0], [1, 1, 0, 0]]}


def test_springs_that_pass_zero_head_on_keep_the_ledger_and_are_told():
    run = solve(builders.table(AWAY, 3.0, geometric=True), limits=Limits(steps=20_000))
    assert run.status == 'ok'
    assert abs(run.energy.residual_J) < 1e-4
    assert any('passed length zero' in note for note in run.notes)
    aside = builders.table(AWAY, 3.0, geometric=True, u0=builders.offsets(25, 0.005, 2))
    assert not solve(aside, limits=Limits(steps=20_000)).notes


@pytest.mark.slow
@pytest.mark.parametrize('tolerance, error_m', [(1e-9, 1e-7), (1e-11, 1e-9), (1e-13, 1e-9)])
@pytest.mark.parametrize('scene', ['head-on', 'near miss'])
def test_springs_through_length_zero_are_those_of_scipy(scene, tolerance, error_m):
    """Near misses, too."""
    if scene == 'head-on':
        given, seconds = builders.table(AWAY, 0.3, geometric=True), 0.3
    else:
        u0 = [[x + (i == 12), y] for i, (x, y) in enumerate(builders.offsets(25, 0.005, 2))]
        given, seconds = builders.table({'kind': 'none'}, 0.6, geometric=True, u0=u0), 0.6
    run = solve(given, sample_s=seconds / 10, tolerance=tolerance)
    truth = physics_oracles.events_of_scipy(from_mapping(given), run.t)
    assert np.abs(run.u - truth).max() < error_m


def test_a_block_breaks_as_the_formula_says_after_a_spring_of_the_rim_has_passed_it():
    """At rest all the while: the left spring, first pulled, then pushed, ends on its right."""
    speed, k, spread, natural = 0.02, 40.0, 0.09, 0.06
    scene = builders.table(
        {'kind': 'constant_velocity', 'par': [speed, 0.0]}, 12.0, 1, 1, geometric=True,
        mu_s=5.7, mu_k=4.0,
    )  # fmt: skip
    limit = 5.7 * TwinSettings.block_kg * builders.GRAVITY

    def beyond(t):
        x = speed * t
        along = k * (2 * x - 2 * natural)  # both springs along x, the left one beyond zero
        return along + 2 * k * x * (1 - natural / np.hypot(spread, x)) - limit

    run = solve(scene)
    assert run.event_t[0] == pytest.approx(
        brentq(beyond, spread / speed, 12.0, xtol=1e-14), abs=1e-9
    )


def test_zero_length_springs_are_linear_whatever_the_scene_says():
    offsets = builders.offsets(9, 0.005, 1)
    linear = builders.plate(PULL, 8.0, 3, 3, k_between=0.0, u0=offsets)
    geometric = linear | {'geometric': True}
    a, b = solve(linear, path='event'), solve(geometric)
    assert len(a.event_t) >= 18
    assert a.event_block.tolist() == b.event_block.tolist()
    assert np.abs(a.u - b.u).max() < 1e-9


def test_what_is_cut_short_has_true_places_and_energies():
    """A long run keeps its places local; a limit met on the way must not show that."""
    for limits in (Limits(steps=3000), Limits(events=2000)):
        run = solve(builders.single(PULL, 1e5), limits=limits, sample_s=1e4)
        assert run.status != 'ok'
        assert run.t_reached > 1000
        assert abs(run.energy.residual_J) < 1e-8


def test_a_run_that_ends_early_says_what_it_has_and_what_would_let_it_go_on():
    """Samples that it did not reach were zeros: blocks at home."""
    for name in ('S3L', 'S3G'):
        given = presets.scene(name)
        whole = solve(given)
        run = solve(given, limits=Limits(steps=300))
        assert 0.5 < run.t_reached < 9
        assert len(run.t) == len(run.u) == len(run.v) == int(run.t_reached / 0.1) + 1
        assert np.array_equal(run.u, whole.u[: len(run.u)])
        assert run.notes[-1].startswith(f'step limit at {run.t_reached:.6g} of 10 s: more than 300')
        assert 'more than 12 events' in solve(given, limits=Limits(events=12)).notes[-1]
    rotating = presets.scene('S4G') | {'rotation': {'side': 0.084}}
    run = solve(rotating, limits=Limits(steps=300))
    assert len(run.t) == len(run.u) == len(run.yaw) == len(run.spin) < 101
    assert solve(presets.scene('S3L')).notes == []


@pytest.mark.parametrize('rotation', [None, {'side': 0.084}])
def test_samples_within_a_stop_show_the_way_and_not_its_end(rotation):
    """The last 3 ms of a stop are one step in closed form."""
    v0, slowing = np.array([0.09, 0.12]), builders.MU_KINETIC * builders.GRAVITY
    stop_s = 0.15 / slowing
    free = {'springs_to_frame': [], 'dim1': False, 'v0': [v0.tolist()], 'rotation': rotation}
    scene = from_mapping(builders.single(PULL, stop_s - 1e-4, **free))
    usual = from_mapping(builders.table(PULL, 1.0)).lattice
    for mine, other in zip(scene.lattice, usual, strict=True):  # else kernels are compiled again
        assert np.asarray(mine).dtype == np.asarray(other).dtype
    run = simulate(scene, sample_s=1e-4)
    way = np.outer(run.t - 0.5 * run.t**2 * slowing / 0.15, v0)
    assert np.abs(run.u[:, 0] - way).max() < 1e-13
    assert len(run.event_t) == 0  # it has yet to stop


def test_a_speed_too_small_to_have_a_direction_is_none():
    for speed in (1e-300, 1e-160, 1e-15):
        plain = builders.table(PULL, 0.5, geometric=True, v0=[[speed, speed]] * 25)
        run, rests = solve(plain), solve(plain | {'v0': 'zero'})
        np.testing.assert_array_equal(run.u, rests.u)


@pytest.mark.parametrize('way', [(1.0, 0.0), (1.0, 0.5)])
def test_a_block_that_flies_stops_where_it_must(way):
    run = solve(builders.single(NONE, 5.0, k=0.0, dim1=way[1] == 0.0, v0=[way]))
    speed, brake = np.hypot(*way), 0.65 * 9.81
    assert run.event_t[0] == pytest.approx(speed / brake, rel=1e-9)
    assert run.u[-1, 0] == pytest.approx(np.array(way) * speed / (2 * brake), rel=1e-9)
