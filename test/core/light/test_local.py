# SPDX-License-Identifier: Apache-2.0
"""The limit by field of view, against an analyser written from the standard's text."""

import itertools
import math

import numpy as np
import pytest
from support import flash_bound as sight
from support.fields_of_view import RATE_HZ, distinct, fields, most_in_a_second
from support.flashes import render
from support.paper import N_BLOCKS, rest_lattice

from eol_ros.core.light.flash import window_s
from eol_ros.core.light.local import (
    BLOCK_FALLS,
    FIRST,
    HOLD_RATE,
    SQUARE_FALLS,
    LocalField,
    block_falls,
)
from eol_ros.core.table import Table

EYES = [(0.0, 0.0, 0.8), (0.0, -0.9, 0.6), (0.0, -1.0, 1.1), (1.0, -1.0, 0.9)]
FARTHEST = [(0.0, 0.0, 2.2), (0.0, -2.0, 1.5)]  # whose fields hold 0.006 sr
SECONDS = 3.0
WINDOW_S = window_s(Table())


@pytest.fixture(scope='module')
def areas_sr():
    return areas_of(Table())


def areas_of(table):
    """Solid angles by place, (fields, cells); of what a place without a block would have none."""
    areas = [
        fields(table.rest[table.ids], eye, side_m=table.block_side_m) for eye in EYES + FARTHEST
    ]
    found = np.zeros((sum(map(len, areas)), table.cells))
    found[:, table.ids] = np.concatenate(areas)
    return distinct(found)


def random_slips(random, ids=range(N_BLOCKS)):
    """Slips of some blocks, singly and in volleys, up to 60 a second."""
    some = random.permutation(ids)[: random.integers(1, len(ids) + 1)]
    t = np.cumsum(random.exponential(1 / random.uniform(3, 60), 200))
    slips = [(float(s), int(b)) for s, b in zip(t, random.choice(some, 200), strict=True)]
    return slips + [(float(s), int(b)) for s in t[::20] for b in some]


def adversary(period_s, offset, shape=(0, 1, 5, 6)):
    """Three of the four blocks of a square at a time, each left out in its turn."""
    turns = itertools.cycle(itertools.combinations(shape, 3))
    times = np.arange(0.0, SECONDS, period_s)
    return [(float(t), offset + b) for t, blocks in zip(times, turns, strict=False) for b in blocks]


@pytest.mark.parametrize(
    ('table', 'nearer'),
    [
        (Table(), sight.NEARER),
        (Table(block_side_m=0.07, gap_m=0.075, gap_y_m=0.2), sight.NEARER),
        (Table(block_side_m=0.12, gap_m=0.156, platform_m=(3, 3)), sight.NEARER),
        (Table(block_side_m=0.3, gap_m=0.39, gap_y_m=0.8, platform_m=(9, 9)), sight.NEARER),
    ],
)
def test_geometry_bounds_each_field_by_three_flashes(table, nearer):
    assert block_falls(table) == BLOCK_FALLS
    bounds = [
        sight.most_flashes(*sight.covered(view, table, nearer), BLOCK_FALLS, SQUARE_FALLS)
        for view in sight.views(n=5, table=table)
    ]

    assert 3 <= max(bounds) < 4 - 1e-6


@pytest.mark.parametrize(
    ('side_m', 'gap_m'), [(0.03, 0.02), (0.084, 0.089), (0.1, 0.12), (0.2, 0.01)]
)
def test_blocks_that_stand_closer_fall_once_a_second(side_m, gap_m):
    table = Table(block_side_m=side_m, gap_m=gap_m, platform_m=(9, 9))
    assert block_falls(table) == 1
    field = LocalField(0.1, table=table)
    for k in range(3):
        field.slip(0.5 * k, 7)
    held = field.levels(1.5)[7]

    assert field.levels(0.5 + WINDOW_S - 0.01)[7] > 0.9 * held > 0.6
    assert field.lengthened == 1
    whole_sr = 2 * math.pi * (1 - math.cos(math.radians(sight.HALF_FIELD_DEG)))
    assert whole_sr < 4 * sight.FIELD_SR  # so four flashes without a common block do not fit


@pytest.mark.parametrize(
    'table',
    [
        Table(rows=3, columns=4),
        Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18)),
        Table(rows=10, columns=12, block_side_m=0.03, gap_m=0.02),
    ],
)
def test_no_slips_of_another_table_make_a_field_flash_four_times(table):
    random, free, areas_sr = np.random.default_rng(7), 0, areas_of(table)
    storms = [random_slips(random, table.ids) for _ in range(5)]
    storms.append([(t, b) for t in np.arange(0, SECONDS, 0.25) for b in table.ids.tolist()])
    columns = table.columns
    storms.append(adversary(0.25, 0, (0, 1, columns, columns + 1)))
    for decay_s, slips in itertools.product((0.02, 0.1), storms):
        field = LocalField(decay_s, table=table)
        assert most_in_a_second(render(field, slips, SECONDS, RATE_HZ), areas_sr) <= 3
        open_ = render(LocalField(decay_s, limited=False, table=table), slips, SECONDS, RATE_HZ)
        free = max(free, most_in_a_second(open_, areas_sr))
    assert free > 3


def test_the_analyser_counts_a_strobe_of_one_near_block_and_none_of_a_far_one():
    lattice, strobe = rest_lattice(), np.zeros((RATE_HZ, N_BLOCKS))
    strobe[:, 12] = 0.5 + 0.5 * np.sin(2 * np.pi * 6 * np.arange(RATE_HZ) / RATE_HZ)

    assert most_in_a_second(strobe, fields(lattice, (0.0, 0.0, 0.8))) >= 5
    assert most_in_a_second(strobe, fields(lattice, (0.0, 0.0, 1.5))) == 0
    assert most_in_a_second(0.09 * strobe, fields(lattice, (0.0, 0.0, 0.8))) == 0


def test_no_field_from_3_m_on_holds_what_counts():
    lattice = rest_lattice()

    assert all(len(fields(lattice, eye)) for eye in FARTHEST)
    assert not len(fields(lattice, (0.0, 0.0, 3.0)))
    assert not len(fields(lattice, (0.0, -2.4, 1.8)))


def test_a_slip_after_rest_lights_its_block_at_once_whatever_its_neighbours_do():
    field = LocalField(0.1)
    for k in range(30):
        field.slip(k * 0.02, 7)
    field.slip(0.6, 8)

    assert field.levels(0.6)[8] == FIRST
    assert field.levels(0.7)[8] == pytest.approx(FIRST * math.exp(-1))


def test_the_fourth_flash_of_a_block_is_held_for_a_second_after_the_first():
    field = LocalField(0.1)
    for k in range(4):
        field.slip(k * 0.25, 3)
    held = field.levels(0.25 + WINDOW_S)[3]

    assert held == pytest.approx(field.peak * FIRST * math.exp(-HOLD_RATE * 0.5), rel=0.05)
    assert field.levels(0.25 + WINDOW_S + 0.1)[3] == pytest.approx(held * math.exp(-1))
    assert field.lengthened == 1


@pytest.mark.parametrize(('until_s', 'from_s'), [(5.0, 5.0), (0.3, 0.2 + WINDOW_S)])
def test_a_hold_keeps_light_at_least_for_the_period(until_s, from_s):
    field = LocalField(0.1)
    field.slip(0.0, 3)
    field.hold(0.2, until_s)
    held = field.levels(from_s)[3]

    assert held > 0.7 * FIRST * math.exp(-2)
    assert field.levels(from_s + 0.1)[3] == pytest.approx(held * math.exp(-1))


def test_levels_depend_on_neither_looks_nor_the_zero_of_time():
    slips = [(0.0, 1), (0.11, 2), (0.15, 2), (0.5, 24), (0.6, 2), (0.7, 2)]
    seldom, later = LocalField(0.3), LocalField(0.3)
    often = render(LocalField(0.3), slips, 2.0, RATE_HZ)[-1]
    for t, block in slips:
        seldom.slip(t, block)
        later.slip(t, block)
    later.shift(1000.0)

    np.testing.assert_allclose(seldom.levels(239 / RATE_HZ), often, atol=1e-9)
    np.testing.assert_allclose(later.levels(1000 + 239 / RATE_HZ), often, atol=1e-6)


@pytest.mark.parametrize('decay_s', [0.02, 0.1])
def test_no_adversary_makes_a_field_flash_four_times(areas_sr, decay_s):
    free = 0
    for period_s, offset in itertools.product((0.12, 0.24, 0.25, 0.3, 0.334), (0, 6)):
        slips = adversary(period_s, offset)
        assert most_in_a_second(render(LocalField(decay_s), slips, SECONDS, RATE_HZ), areas_sr) <= 3
        open_ = render(LocalField(decay_s, limited=False), slips, SECONDS, RATE_HZ)
        free = max(free, most_in_a_second(open_, areas_sr))
    assert free > 3


@pytest.mark.parametrize('count', [25, pytest.param(1000, marks=pytest.mark.soak)])
def test_no_random_slips_make_a_field_flash_four_times(areas_sr, count):
    random, free = np.random.default_rng(count), 0
    for _ in range(count):
        decay_s, slips = float(random.choice([0.02, 0.1, 0.35])), random_slips(random)
        assert most_in_a_second(render(LocalField(decay_s), slips, SECONDS, RATE_HZ), areas_sr) <= 3
        if not free:
            open_ = render(LocalField(decay_s, limited=False), slips, SECONDS, RATE_HZ)
            free = most_in_a_second(open_, areas_sr)
    assert free > 3
