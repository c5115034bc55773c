# SPDX-License-Identifier: Apache-2.0
"""The live table: slips under moving hands, rest under still ones, closed energy books."""

import numpy as np
import pytest

from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS
from eol_ros.core.physics.hands import Rim, Visitors
from eol_ros.core.physics.live import LiveTable

IMAGE_S = 1 / 60


def play(seed: int, seconds: float):
    table, visitors, rim = LiveTable(seed), Visitors(seed), Rim()
    xy, moving = [], []
    for i in range(int(seconds / IMAGE_S)):
        rim.advance(IMAGE_S, visitors.velocity((i + 1) * IMAGE_S, rim.pose), np.zeros(3))
        table.advance(i * IMAGE_S, (i + 1) * IMAGE_S, rim.pose, rim.velocity)
        xy.append(np.stack([table.x, table.y], axis=1))
        moving.append(table.moving.copy())
    return table, np.array(xy), np.array(moving)


@pytest.mark.parametrize('seed', [0, 1])
def test_slips_within_ten_seconds_and_still_between(seed):
    table, _, moving = play(seed, 16)
    assert table.slips > 20
    assert moving[:600].any(axis=1).sum() > 30
    assert moving.sum(axis=1).max() >= 3, 'no cascade'
    still = ~moving.any(axis=1)
    runs = np.diff(np.flatnonzero(np.concatenate([[True], ~still, [True]]))) - 1
    assert runs.max() * IMAGE_S > 1.5


def test_what_rests_does_not_creep():
    _, xy, moving = play(2, 12)
    rests = ~moving[1:] & ~moving[:-1]
    jump = np.abs(np.diff(xy, axis=0)).max(axis=2)
    # a block may break and stick between two images; those that never did must not move at all
    assert np.median(jump[rests]) == 0.0
    assert jump.max() < 0.02


def test_energy_ledger_closes():
    table, _, _ = play(1, 12)
    assert abs(table.energy_residual) < 1e-5


def test_blocks_stay_apart_and_in_order():
    _, xy, _ = play(3, 16)
    grid = xy.reshape(-1, 5, 5, 2)
    assert np.diff(grid[..., 0], axis=2).min() > BLOCK_SIDE_M
    assert np.diff(grid[..., 1], axis=1).min() > BLOCK_SIDE_M


def test_same_seed_same_table():
    first, a, _ = play(5, 4)
    _, b, _ = play(5, 4)
    assert np.array_equal(a, b)
    assert first.yaw.shape == (N_BLOCKS,)
