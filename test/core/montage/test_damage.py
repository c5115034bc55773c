# SPDX-License-Identifier: Apache-2.0
"""The damage on the walls: greater with the cascade, healed by calm."""

import pytest

from eol_ros.core.montage.damage import CASCADES, Damage


def ruptured(area, heal_s=100.0):
    damage = Damage(heal_s)
    for block in range(area):
        damage.slip(block, 7, 10.0)
        damage.slip(block, 7, 10.0)  # a second slip of a block makes no cascade larger
    return damage


def test_the_greater_the_cascade_the_further_the_picture():
    degrees = [ruptured(area).degree(4, 10.0) for area in range(1, 26)]
    assert degrees[0] == 0 and degrees[-1] == 3
    assert degrees == sorted(degrees)
    assert [degrees.count(k) for k in range(4)] == [2, 2, 7, 14]  # 25 ** (k / 4): 2.2, 5, 11.2
    assert ruptured(25).degree(1, 10.0) == 0  # a picture that comes in no degrees


def test_all_blocks_of_a_small_table_break_the_walls():
    damage = Damage(100.0, blocks=12)
    for block in range(12):
        damage.slip(block, 7, 10.0)
    assert damage.level(10.0) == 1.0


def test_it_grows_while_the_cascade_runs_and_small_ones_do_not_mend_it():
    damage = Damage(100.0)
    seen = []
    for block in range(25):
        damage.slip(block, 1, 0.0)
        seen.append(damage.level(0.0))
    assert seen == sorted(seen) and seen[-1] == pytest.approx(1.0)
    damage.slip(3, 2, 10.0)
    assert damage.level(10.0) == pytest.approx(0.9)


def test_calm_heals_it_in_the_time_given():
    damage = ruptured(25)
    assert [damage.degree(4, 10.0 + t) for t in (0, 24, 26, 49, 51, 74, 76, 100, 1e6)] == [
        3, 3, 2, 2, 1, 1, 0, 0, 0,
    ]  # fmt: skip
    assert damage.level(1e6) == 0.0
    assert ruptured(25).level(5.0) == 1.0  # a clock that was set back heals nothing


def test_many_cascades_are_forgotten_oldest_first():
    damage = Damage(1.0)
    for cascade in range(CASCADES + 1):
        damage.slip(0, cascade, 0.0)
    damage.slip(1, CASCADES, 50.0)
    assert damage.level(50.0) > 0
    damage.slip(1, 0, 100.0)  # of its first block nothing is known any more
    assert damage.level(100.0) == 0.0
