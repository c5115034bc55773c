# SPDX-License-Identifier: Apache-2.0
"""Hands: alive, seeded, and never off the platform."""

import numpy as np
import pytest

from eol_ros.core.geometry import PLATFORM_SIDE_M, RIM_REACH_M, RIM_SIDE_M
from eol_ros.core.physics.twin.hands import YAW_LIMIT_RAD, Commands, Rim, Visitors, reach_m

STEP_S = 1 / 60


def run(
    seed: int, seconds: float, commands: Commands | None = None
) -> tuple[np.ndarray, np.ndarray]:
    visitors, rim, commands = Visitors(seed), Rim(), commands or Commands()
    poses, rates = [], []
    for i in range(int(seconds / STEP_S)):
        t = (i + 1) * STEP_S
        rim.advance(STEP_S, visitors.velocity(t, rim.pose), commands.velocity(t))
        poses.append(rim.pose.copy())
        rates.append(rim.velocity.copy())
    return np.array(poses), np.array(rates)


def corners(pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    square = RIM_SIDE_M / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return square @ np.array([[c, s], [-s, c]]) + pose[:2]


@pytest.mark.parametrize('seed', range(5))
def test_rim_never_leaves_the_platform(seed):
    poses, _ = run(seed, 60)
    assert max(np.abs(corners(p)).max() for p in poses) <= PLATFORM_SIDE_M / 2 + 1e-12
    assert np.abs(poses[:, 2]).max() <= YAW_LIMIT_RAD


def test_motion_is_smooth_and_pauses_are_still():
    poses, rates = run(3, 60)
    assert np.abs(np.diff(rates[:, :2], axis=0)).max() / STEP_S < 2.5
    still = np.all(rates == 0, axis=1)
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~still, [True]]))) - 1
    assert runs.max() * STEP_S > 2.0
    assert np.abs(poses).max(axis=0).min() > 0.05


def test_same_seed_same_hands():
    assert np.array_equal(run(4, 20)[0], run(4, 20)[0])
    assert not np.array_equal(run(4, 20)[0], run(5, 20)[0])


def test_commands_add_up_newest_of_each_source_counts_and_expires():
    commands = Commands()
    commands.take(0.0, 'anna', (0.1, 0.0, 0.0), 0.5)
    commands.take(0.1, 'anna', (0.2, 0.0, 0.0), 0.5)
    commands.take(0.1, 'ben', (0.05, 0.02, 0.1), 0.2)
    assert commands.velocity(0.2) == pytest.approx([0.25, 0.02, 0.1])
    assert commands.velocity(0.4) == pytest.approx([0.2, 0, 0])
    assert commands.velocity(0.61) == pytest.approx([0, 0, 0])


def test_a_command_that_is_not_a_number_is_dropped_and_hold_is_bounded():
    commands = Commands()
    commands.take(0.0, 'anna', (np.nan, 0.0, 0.0), 0.5)
    commands.take(0.0, 'ben', (0.1, 0.0, 0.0), 1e9)
    assert commands.velocity(0.9) == pytest.approx([0.1, 0, 0])
    assert not np.any(commands.velocity(1.01))


def test_a_hard_command_ends_at_the_edge():
    commands, rim = Commands(), Rim()
    for i in range(600):
        commands.take(i * STEP_S, 'anna', (5.0, -5.0, 50.0), 1.0)
        rim.advance(STEP_S, np.zeros(3), commands.velocity(i * STEP_S))
    reach = reach_m(YAW_LIMIT_RAD)
    assert rim.pose == pytest.approx([reach, -reach, YAW_LIMIT_RAD])
    assert not np.any(rim.velocity)
    assert reach_m(0.0) == pytest.approx(RIM_REACH_M)
