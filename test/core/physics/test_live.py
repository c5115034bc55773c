# SPDX-License-Identifier: Apache-2.0
"""The live table: slips under moving hands, rest under still ones, a closed energy ledger."""

import dataclasses

import numpy as np
import pytest
from support.paper import (
    BLOCK_MASS_KG,
    BLOCK_SIDE_M,
    N_BLOCKS,
    neighbours,
    rest_lattice,
)

from eol_ros.core.physics import builders
from eol_ros.core.physics.drive import Drive
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin import live
from eol_ros.core.physics.twin.hands import (
    HAND_N,
    VISITORS_YAW_RAD,
    YIELD_S,
    Commands,
    Frame,
    Rim,
    keep_within,
)
from eol_ros.core.physics.twin.live import CLEAR_M, SOFT, Coupling, LiveTable
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.table import Table
from eol_ros.lab.choose import simulate

IMAGE_S = 1 / 60
BESIDE = np.array([(i, j) for i in range(N_BLOCKS) for j in neighbours(i, True) if i < j]).T


def play(seed: int, seconds: float):
    hands = Play(seed)
    table, xy, moving = hands.table, [], []
    for _ in range(int(seconds / IMAGE_S)):
        hands.advance(IMAGE_S)
        xy.append(np.stack([table.x, table.y], axis=1))
        moving.append(table.moving.copy())
    return table, np.array(xy), np.array(moving)


@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.slow)])
def test_slips_within_ten_seconds_and_still_between(seed):
    table, _, moving = play(seed, 16)
    assert table.slips > 20
    assert moving[:600].any(axis=1).sum() > 30
    assert moving.sum(axis=1).max() >= 3, 'no cascade'
    still = ~moving.any(axis=1)
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~still, [True]]))) - 1
    assert runs.max() * IMAGE_S > 1.5


def gap_m(table):
    """The least distance between two blocks, m; less than none where they overlap."""
    (i, j), half = BESIDE, 0.5 * BLOCK_SIDE_M
    dx, dy, yaw = table.x[i] - table.x[j], table.y[i] - table.y[j], table.yaw
    reach = half * (1 + abs(np.cos(yaw[i] - yaw[j])) + abs(np.sin(yaw[i] - yaw[j])))
    apart = [  # squares that overlap do so along the sides of both
        np.maximum(abs(dx * np.cos(t) + dy * np.sin(t)), abs(dy * np.cos(t) - dx * np.sin(t)))
        for t in (yaw[i], yaw[j])
    ]
    return float((np.maximum(*apart) - reach).min())


@pytest.mark.slow
def test_people_rotate_the_rim_all_the_way_round_and_visitors_take_it_back():
    """Blocks go along and stay apart; the rim stays on the platform though its corners reach it."""
    hands = Play(5, coupling=Coupling())
    table, rim = hands.table, hands.rim
    while rim.pose[2] < 2 * np.pi + 1.0:
        for name in ('anna', 'ben'):
            hands.commands.take(hands.time_s, name, (0.1, -0.05, 0.9), 0.5)
        hands.advance(IMAGE_S)
        on = rim.pose.copy()
        keep_within(on, Frame.of(table.table))
        assert on == pytest.approx(rim.pose, abs=1e-12)
        assert gap_m(table) > 0.01
    assert table.faults == 0 and abs(table.energy_residual) < 1e-4
    assert np.abs(table.yaw - rim.pose[2]).max() < 0.5
    while hands.time_s < hands.commands.touched_s + YIELD_S + 60:
        hands.advance(IMAGE_S)
    assert abs(rim.pose[2] - 2 * np.pi) < VISITORS_YAW_RAD + 0.05


@pytest.mark.parametrize('rotate', [True, False])
@pytest.mark.parametrize('more', [{}, {'stiffness': 2000.0, 'block_kg': 0.05}])
def test_equal_friction_meets_no_limit(rotate, more):
    """Blocks then start and stop with next to no acceleration."""
    play = Play(1, coupling=Coupling(mu_static=0.3, mu_kinetic=0.3, rotate=rotate, **more))
    for _ in range(300):
        play.advance(IMAGE_S)
    assert play.table.faults == 0 and abs(play.table.energy_residual) < 1e-6
    assert play.table.slips > 20


@pytest.mark.parametrize('rotate', [True, False])
def test_blocks_move_on_after_a_limit(rotate, monkeypatch):
    """They are late, and stop no sooner."""
    monkeypatch.setattr(live, 'MOST_STEPS', 3)
    play, late = Play(1, coupling=Coupling(rotate=rotate)), 0
    for _ in range(300):
        before = play.table.faults
        play.advance(IMAGE_S)
        if play.table.faults > before:
            assert play.table.trace is None
            late += bool(play.table.velocity.any())
    assert late > 5


def test_what_rests_does_not_creep():
    _, xy, moving = play(2, 12)
    rests = ~moving[1:] & ~moving[:-1]
    jump = np.abs(np.diff(xy, axis=0)).max(axis=2)
    # a block may break and stick between two images; those that never did must not move at all
    assert np.median(jump[rests]) == 0.0
    assert jump.max() < 0.02


@pytest.mark.parametrize('pull', [(5.0, 0.0, 0.0), (5.0, -5.0, 0.0), (0.0, 5.0, 5.0)])
def test_a_rim_that_is_pulled_hard_stops_at_the_blocks_and_comes_back(pull):
    table, rim, commands = LiveTable(1, coupling=SOFT), Rim(), Commands()
    stopped = 0
    for i in range(480):
        way = 1.0 if i < 240 else -1.0
        commands.take(i * IMAGE_S, 'anna', tuple(way * p for p in pull), 1.0)
        rim.advance(IMAGE_S, commands.hands(i * IMAGE_S))
        wanted = rim.pose.copy()
        table.advance(i * IMAGE_S, (i + 1) * IMAGE_S, rim.pose, rim.velocity)
        stopped += bool(np.any(rim.pose != wanted))
        assert np.array_equal(rim.pose, table.rim_pose), 'the hands feel the stop'
        assert table.clearance_m(table.rim_pose) > 0.5 * CLEAR_M
        if i == 239:
            far = table.rim_pose.copy()
    assert stopped > 3
    assert table.slips > 50
    assert np.abs(table.rim_pose - far).max() > 0.1
    assert table.faults == 0
    assert abs(table.energy_residual) < 1e-5


def led(table, rim, velocity, seconds):
    """Lead the rim for some seconds; return its pose after."""
    start = table.seconds
    for i in range(int(seconds / IMAGE_S)):
        rim.advance(IMAGE_S, [np.array(velocity)])
        table.advance(start + i * IMAGE_S, start + (i + 1) * IMAGE_S, rim.pose, rim.velocity)
    table.seconds = start + (i + 1) * IMAGE_S
    return table.rim_pose.copy()


@pytest.mark.parametrize('way', [(0.35, -0.1), (-0.3, 0.3), (0.3, 0.3)])
@pytest.mark.parametrize('yaw', [0.35, -0.35])
def test_a_rim_that_touches_a_block_rotates_and_slides_along_it(way, yaw):
    table, rim = LiveTable(1, coupling=SOFT), Rim()
    table.seconds = 0.0
    touching = led(table, rim, (*way, 0.0), 4.0)
    assert table.clearance_m(touching) < CLEAR_M + 1e-6, 'it has come to the end of its way'
    led_to = led(table, rim, (0.0, 0.0, yaw), 0.6)
    assert abs(led_to[2] - touching[2] - 0.6 * yaw) < 0.06
    assert table.clearance_m(led_to) > CLEAR_M - 1e-6
    along = (-way[1], way[0])
    slid = led(table, rim, (*(0.3 * np.array(along)), 0.0), 0.5)
    assert (slid - led_to)[:2] @ along > 0.01


def test_the_springs_pull_on_the_rim_as_their_energy_falls():
    """Force and moment are the slope of the energy, which is worked out from all springs."""
    table, pose = LiveTable(7), np.array([0.03, -0.02, 0.1])
    table._u[:] = np.random.default_rng(7).normal(0, 0.01, table._u.shape)

    def energy(at):
        table.rim_pose = at
        return table._energy()

    slope = [energy(pose + d) - energy(pose - d) for d in 1e-6 * np.eye(3)]
    assert table.pull(pose) == pytest.approx(-np.array(slope) / 2e-6, abs=1e-5)


def test_a_hand_that_drags_the_table_feels_the_springs():
    play = Play(1)
    loads, strengths = [], []
    for _ in range(120):
        play.commands.take(play.time_s, 'anna', (0.1, 0.0, 0.0), 0.5)
        play.advance(IMAGE_S)
        loads.append(-play.rim.load[0])
        strengths.append(play.rim.hands_n[0])
    assert play.playing == 'people'
    assert loads[0] < 1 and max(loads) > 30
    assert max(strengths) <= HAND_N * (1 + 1e-12)
    assert play.table.slips > 10
    far = play.rim.pose[0]
    for _ in range(120):
        play.advance(IMAGE_S)
    assert play.rim.pose[0] < far - 0.005, 'they draw it back when it is let go'
    assert not play.rim.velocity.any()


def test_blocks_rotate_as_the_solver_of_scenes_has_it():
    """Image by image at the live tolerance, against one run of the whole at a far finer one."""
    seconds, table, rows, rates = 1.5, LiveTable(1), [np.zeros(4)], [np.zeros(3)]
    start = table._u.copy()
    for i in range(round(seconds / IMAGE_S)):
        t = (i + 1) * IMAGE_S
        pose = np.array([0.05 * (1 - np.cos(2 * t)), 0.04 * t * t, 0.12 * np.sin(t) ** 2])
        rate = np.array([0.10 * np.sin(2 * t), 0.08 * t, 0.12 * np.sin(2 * t)])
        table.advance(i * IMAGE_S, t, pose, rate)
        rows.append(np.array([t, *pose]))
        rates.append(rate)
    given, weight = table._scene, BLOCK_MASS_KG * builders.GRAVITY
    scene = from_mapping(
        builders.table(
            {'kind': 'none'}, seconds, k=Coupling().stiffness, mass=BLOCK_MASS_KG, geometric=True,
            mu_s=list(given.static_limit / weight), mu_k=list(given.kinetic_force / weight),
            u0=start.tolist(), rotation={'side': BLOCK_SIDE_M},
        )
    )  # fmt: skip
    drive = Drive.through(np.array(rows), np.array(rates))
    whole = simulate(dataclasses.replace(scene, drive=drive), tolerance=1e-10)
    assert table.slips > 20
    assert table.slips == whole.event_start.sum()
    assert np.abs(np.degrees(table.yaw)).max() > 2
    place = np.stack([table.x, table.y], 1) - rest_lattice()
    assert np.abs(place - whole.u[-1]).max() < 5e-7
    assert np.abs(table.yaw - whole.yaw[-1]).max() < 5e-6


def test_light_blocks_on_stiff_springs_do_not_stop_in_their_motion():
    """At the end of the settings' ranges the solver meets no limit."""
    stiff = Coupling(2000.0, 0.05, 0.0, rotate=False, block_kg=0.05)
    play = Play(1, coupling=stiff)
    for _ in range(600):
        play.advance(1 / 60)
    assert play.table.slips > 20
    assert play.table.faults == 0


RING = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))
TABLES = {
    '3x4': Table(rows=3, columns=4), 'ring': RING,
    'uneven': Table(rows=2, columns=6, block_side_m=0.06, gap_y_m=0.07, absent=(0, 8)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('table', TABLES.values(), ids=TABLES)
@pytest.mark.parametrize('rotate', [True, False])
def test_any_table_slips_under_visitors_and_its_holes_rest(table, rotate):
    play, slipped = Play(1, 4, Coupling(rotate=rotate), table), set()
    live, holes = play.table, ~table.present
    for _ in range(1200):
        play.advance(IMAGE_S)
        if live.trace is not None:
            slipped |= set(live.trace.event_block.tolist())
            assert not live.trace.v[:, holes].any() and not live.trace.u[:, holes].any()
            last = live.trace.u[-1] + table.rest
            assert np.array_equal(last, np.stack([live.x, live.y], axis=1))
    assert live.slips > 10 and live.faults == 0 and abs(live.energy_residual) < 1e-4
    assert slipped and slipped <= set(table.ids.tolist())
    assert len(live.x) == table.cells and live.velocity.shape == (table.cells, 3)
    assert np.array_equal(np.stack([live.x, live.y], axis=1)[holes], table.rest[holes])
    assert not live.moving[holes].any() and not live.velocity[holes].any()


@pytest.mark.parametrize('table', TABLES.values(), ids=TABLES)
def test_the_rim_feels_the_springs_of_any_table(table):
    """Oracle: the ends of all springs to the rim, by `Table.spring_ends`."""
    coupling = Coupling()
    live, pose = LiveTable(3, coupling=coupling, table=table), np.array([0.02, -0.01, 0.1])
    blocks = np.column_stack([live.x, live.y, live.yaw])
    ends = table.spring_ends(blocks, pose)[table.springs[:, 1] < 0]
    way = ends[:, 1] - ends[:, 0]
    held = 1 - coupling.spring_natural_m / np.hypot(*way.T)
    force = -coupling.stiffness * held[:, None] * way
    arm = ends[:, 1] - pose[:2]
    torque = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum()
    assert live.pull(pose) == pytest.approx([*force.sum(axis=0), torque], abs=1e-9)
