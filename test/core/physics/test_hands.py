# SPDX-License-Identifier: Apache-2.0
"""Hands: alive, seeded, and never off the platform."""

import numpy as np
import pytest
from support.checkout import ROOT
from support.paper import PLATFORM_SIDE_M, RIM_BAR_M, RIM_REACH_M, RIM_SIDE_M

from eol_ros.core.physics.twin.hands import (
    HAND_N,
    HAND_NSPM,
    MAX_YAW_RATE_RADPS,
    RIM_KG,
    ROLLING,
    VISITORS_YAW_RAD,
    YIELD_S,
    Commands,
    Frame,
    Rim,
    Visitors,
    reach_m,
    resists,
)
from eol_ros.core.table import Table

STEP_S = 1 / 60
ROLLING_N = ROLLING * RIM_KG * 9.81


def run(
    seed: int, seconds: float, commands: Commands | None = None
) -> tuple[np.ndarray, np.ndarray]:
    visitors, rim, commands = Visitors(seed), Rim(), commands or Commands()
    poses, rates = [], []
    for i in range(int(seconds / STEP_S)):
        t = (i + 1) * STEP_S
        rim.advance(STEP_S, visitors.hands(t, rim.pose) + commands.hands(t))
        poses.append(rim.pose.copy())
        rates.append(rim.velocity.copy())
    return np.array(poses), np.array(rates)


def corners(pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    square = (RIM_SIDE_M / 2 + RIM_BAR_M) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return square @ np.array([[c, s], [-s, c]]) + pose[:2]


@pytest.mark.parametrize(
    'seed', [0, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, 5))]
)
def test_rim_never_leaves_the_platform(seed):
    poses, _ = run(seed, 60)
    assert max(np.abs(corners(p)).max() for p in poses) <= PLATFORM_SIDE_M / 2 + 1e-12
    assert np.abs(poses[:, 2]).max() <= VISITORS_YAW_RAD + 0.1  # here no spring holds it


def test_hands_let_go_at_a_touch_and_come_back_later():
    visitors, pose = Visitors(3), np.zeros(3)
    before = [visitors.hands(t, pose) for t in np.arange(0, 1, STEP_S)][-1]
    assert np.hypot(*before[0][:2]) > 0.01
    for t in np.arange(1, 4, STEP_S):  # somebody's hand is on the rim for three seconds
        visitors.let_go(t, YIELD_S)
        assert visitors.hands(t, pose) == []
    for t in np.arange(4, 3.98 + YIELD_S, STEP_S):
        assert visitors.away(t)
        assert visitors.hands(t, pose) == []
    assert not visitors.away(4 + YIELD_S)
    after = [visitors.hands(4 + YIELD_S + s, pose) for s in np.arange(0, 2, STEP_S)]
    assert np.hypot(*after[1][0][:2]) < 0.01, 'they begin gently'
    assert np.hypot(*after[-1][0][:2]) > 0.01


def test_a_source_is_one_hand_its_newest_command_counts_and_expires():
    commands = Commands()
    commands.take(0.0, 'anna', (0.1, 0.0, 0.0), 0.5)
    commands.take(0.1, 'anna', (0.2, 0.0, 0.0), 0.5)
    commands.take(0.1, 'ben', (0.05, 0.02, 0.1), 0.2)
    assert np.array_equal(commands.hands(0.2), [[0.2, 0, 0], [0.05, 0.02, 0.1]])
    assert np.array_equal(commands.hands(0.4), [[0.2, 0, 0]])
    commands.take(0.4, 'ben', (0.0, 0.0, 0.0), 0.2)
    assert np.array_equal(commands.hands(0.5), [[0.2, 0, 0]])
    assert commands.hands(0.61) == []


def test_a_command_that_is_not_a_number_is_dropped_and_hold_is_bounded():
    commands = Commands()
    commands.take(0.0, 'anna', (np.nan, 0.0, 0.0), 0.5)
    commands.take(0.0, 'ben', (0.1, 0.0, 0.0), 1e9)
    assert np.array_equal(commands.hands(0.9), [[0.1, 0, 0]])
    assert commands.hands(1.01) == []


def pulled(hands, seconds=1.0, springs=None, stiffness=0.0):
    rim = Rim(springs, stiffness)
    for _ in range(round(seconds / STEP_S)):
        rim.advance(STEP_S, [np.array(hand, float) for hand in hands])
    return rim


def test_hands_that_agree_go_at_their_common_speed_and_others_stand_against_each_other():
    one, two = pulled([(0.05, 0, 0)]), pulled([(0.05, 0, 0), (0.05, 0, 0)])
    assert one.velocity[0] == pytest.approx(0.05 - ROLLING_N / HAND_NSPM)
    assert two.velocity[0] == pytest.approx(0.05 - ROLLING_N / (2 * HAND_NSPM))
    against = pulled([(0.2, 0, 0), (-0.2, 0, 0)])
    assert np.abs(against.pose).max() == 0.0
    assert against.hands_n == pytest.approx([HAND_N, HAND_N])
    outnumbered = pulled([(0.2, 0, 0), (0.2, 0, 0), (-0.2, 0, 0)], 0.3)
    assert outnumbered.pose[0] > 0.03
    couple = pulled([(0.1, 0, 0.4), (-0.1, 0, 0.4)], 0.3)
    assert abs(couple.pose[0]) < 1e-12 and couple.pose[2] > 0.05


def test_springs_and_casters_hold_what_a_hand_pulls():
    """Against the balance of forces worked out here: springs of 600 N/m in all, one hand."""

    def springs(pose):
        return -600.0 * pose

    held = pulled([(0.5, 0, 0)], 10.0, springs, 45.0)
    assert held.velocity[0] == pytest.approx(0.0, abs=1e-9)
    assert held.hands_n == pytest.approx([HAND_N])
    assert 600 * held.pose[0] == pytest.approx(HAND_N, abs=ROLLING_N)  # casters hold as well
    for _ in range(600):  # let go: it rolls back and comes to rest where the casters hold it
        held.advance(STEP_S, [])
    assert not held.velocity.any()
    assert abs(600 * held.pose[0]) <= ROLLING_N


@pytest.mark.parametrize('step_s', [1 / 240, 1 / 60, 0.1])
def test_a_free_rim_rolls_as_far_as_its_speed_carries_it(step_s):
    """Under rolling friction alone: v^2 / (2 F / m), for steps of any length."""
    rim = Rim()
    rim.velocity = np.array([0.2, 0.0, 0.0])
    for _ in range(round(2 / step_s)):
        rim.advance(step_s, [])
    assert not rim.velocity.any()
    assert rim.pose[0] == pytest.approx(0.2**2 * RIM_KG / (2 * ROLLING_N), rel=0.5 * step_s / 0.1)


@pytest.mark.parametrize('yaw_rate', [0.0, 50.0])
def test_a_hard_command_ends_at_the_edge(yaw_rate):
    commands, rim = Commands(), Rim()
    for i in range(600):
        commands.take(i * STEP_S, 'anna', (5.0, -5.0, yaw_rate), 1.0)
        rim.advance(STEP_S, commands.hands(i * STEP_S))
        assert np.abs(corners(rim.pose)).max() <= PLATFORM_SIDE_M / 2 + 1e-12
    if yaw_rate:  # it goes round and round, and its corners along the edge
        assert rim.pose[2] == pytest.approx(600 * STEP_S * MAX_YAW_RATE_RADPS, rel=0.02)
    else:
        assert rim.pose == pytest.approx([RIM_REACH_M, -RIM_REACH_M, 0.0])
        assert not rim.velocity.any()
    assert reach_m(0.0, Frame.of(Table())) == pytest.approx([RIM_REACH_M, RIM_REACH_M])


OBLONG = Table(rows=2, columns=9, gap_y_m=0.03, platform_m=(2.2, 1.0))  # does not fit at any yaw


@pytest.mark.parametrize('table', [OBLONG, Table(rows=4, columns=4, platform_m=(1.0, 1.4))])
def test_an_oblong_rim_never_leaves_its_platform(table):
    size = np.array(table.rim_m()) / 2 + table.rim_width_m
    visitors, commands, rim = Visitors(2, table), Commands(), Rim(table=table)
    away = np.zeros(2)
    for i in range(1800):
        if i > 900:
            commands.take(i * STEP_S, 'anna', (2.0, -2.0, 3.0), 1.0)
        rim.advance(STEP_S, visitors.hands(i * STEP_S, rim.pose) + commands.hands(i * STEP_S))
        c, s = np.abs([np.cos(rim.pose[2]), np.sin(rim.pose[2])])
        reach = np.abs(rim.pose[:2]) + np.array([[c, s], [s, c]]) @ size
        assert (reach <= np.array(table.platform_m) / 2 + 1e-9).all()
        away = np.maximum(away, np.abs(rim.pose[:2]))
    assert (away > 0.5 * np.array(table.reach_m)).all() or table is OBLONG
    assert rim.pose[2] > 0.1  # it was rotated as far as the platform lets it


def test_the_table_resists_as_its_springs_do():
    """Oracle: energy of springs (natural length 2/3 of the gap) in small motions of the rim."""
    ring = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))
    for table in (Table(), Table(rows=3, columns=6, gap_y_m=0.05, platform_m=(2.0, 2.0)), ring):
        at_rest = np.column_stack([table.rest, np.zeros(table.cells)])
        long = np.where(np.abs(np.diff(table.spring_ends(at_rest, np.zeros(3)), axis=1))[:, 0, 0]
                        > 1e-9, *table.gaps_m)[table.springs[:, 1] < 0]  # fmt: skip

        def energy(pose, table=table, at_rest=at_rest, long=long):
            ends = table.spring_ends(at_rest, pose)[table.springs[:, 1] < 0]
            length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
            return 0.5 * np.sum((length - long * 2 / 3) ** 2)

        step, found = 1e-3, []
        for unit, lever in zip(np.eye(3), (1, 1, Frame.of(table).gyration_m), strict=True):
            both = energy(step * unit) + energy(-step * unit) - 2 * energy(0 * unit)
            found.append(both / step**2 / lever**2)
        assert resists(table) == pytest.approx(found, rel=1e-3, abs=0.51)


def test_the_rim_has_the_inertia_of_a_plate():
    """In the twin and in the page."""
    table = Table(rows=2, columns=15, gap_y_m=0.2, platform_m=(3.2, 2.0))
    width, depth = table.rim_m()
    assert Frame.of(table).gyration_m ** 2 == pytest.approx((width**2 + depth**2) / 12)
    page = (ROOT / 'eol_ros' / 'web' / 'static' / 'hands.js').read_text()
    assert 'RHO = Math.hypot(...RIM_M) / Math.sqrt(12)' in page
