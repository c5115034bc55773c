# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.table import Table, check_same
from eol_ros.errors import ConfigError
from eol_ros.settings import TableSettings

RING = (6, 7, 8, 11, 12, 13, 16, 17, 18)
ODD = Table(rows=3, columns=4, block_side_m=0.06, gap_m=0.05, gap_y_m=0.07)


def test_places_stand_pitch_by_pitch_around_the_middle():
    assert np.allclose(np.diff(ODD.grid(ODD.rest[:, 0]), axis=1), 0.11)
    assert np.allclose(np.diff(ODD.grid(ODD.rest[:, 1]), axis=0), 0.13)
    assert np.allclose(ODD.rest.mean(axis=0), 0)
    assert ODD.rim_m() == pytest.approx((4 * 0.06 + 5 * 0.05, 3 * 0.06 + 4 * 0.07))


@pytest.mark.parametrize('table', [Table(), ODD, Table(absent=RING), Table(rows=15, columns=2)])
def test_springs_are_as_long_as_the_gaps(table):
    ends = table.spring_ends(np.column_stack([table.rest, np.zeros(table.cells)]), np.zeros(3))
    way = ends[:, 1] - ends[:, 0]
    along_x = np.abs(way[:, 0]) > np.abs(way[:, 1])
    assert np.allclose(np.abs(way).max(axis=1), np.where(along_x, *table.gaps_m))
    assert np.allclose(np.abs(way).min(axis=1), 0)
    assert len(table.springs) == len(ends)
    for (first, second), (begin, end) in zip(table.springs, ends, strict=True):
        assert table.present[first]
        half = table.block_side_m / 2
        assert np.hypot(*(begin - table.rest[first])) == pytest.approx(half)
        if second >= 0:
            assert table.present[second]
            assert np.hypot(*(end - table.rest[second])) == pytest.approx(half)


def test_neighbours_are_those_one_pitch_away():
    table = Table(rows=4, columns=6, absent=(8,))
    for block in range(table.cells):
        steps = np.abs(table.rest - table.rest[block]) / table.pitch_m
        for diagonal in (False, True):
            near = steps.max(axis=1) < 1.5 if diagonal else steps.sum(axis=1) < 1.5
            near[block] = near[8] = False
            assert table.neighbours(block, diagonal) == np.flatnonzero(near).tolist()


@pytest.mark.parametrize('table', [Table(), Table(rows=4, columns=6), Table(absent=RING)])
def test_turns_are_those_of_the_lattice_about_its_middle(table):
    for quarters in range(4):
        ids, turn = table.turned(quarters), 1j**quarters
        if quarters not in table.turns:
            continue
        moved = (table.rest[ids] @ [1, 1j]) * turn
        assert np.allclose(moved, table.rest @ [1, 1j])
    assert table.turns == ((0, 2) if table.rows == 4 else (0, 1, 2, 3))
    assert Table(absent=(0,)).turns == (0,)
    assert Table(rows=3, columns=3, gap_y_m=0.1).turns == (0, 2)


def test_what_cannot_stand_together_is_named():
    def wrong(**values):
        return dict(TableSettings(**values).contradictions())

    assert not wrong() and not wrong(absent=RING)
    assert 'among the ids 0 to 8' in wrong(rows=3, columns=3, absent=(9,))['absent']
    assert 'leaves 3 blocks' in wrong(rows=2, columns=2, absent=(0,))['absent']
    assert '1.336 m wide' in wrong(columns=7, platform_m=(1.2, 1.4))['platform_m']
    assert 'two numbers' in wrong(platform_m=(1.4,))['platform_m']
    assert 'no spring to block 12:' in wrong(absent=(7, 11, 13, 17))['absent']
    assert not wrong(absent=(5, 1))  # a corner has those to the rim
    assert '0.001 is below 0.005 m' in wrong(gap_y_m=0.001)['gap_y_m']


def test_a_block_that_turns_takes_the_ends_of_its_own_springs_along():
    table = Table()
    rest = np.column_stack([table.rest, np.zeros(25)])
    turned = rest.copy()
    turned[12, 2] = 0.2
    ends = [table.spring_ends(places, np.zeros(3)) for places in (turned, rest)]
    moved = np.any(ends[0] != ends[1], axis=2)
    assert moved.sum() == 4 and moved[:40].sum() == 4
    assert np.abs(ends[1][40:, 1]).max(axis=1) == pytest.approx([0.48] * 20)  # the rim of 96 cm


@pytest.mark.parametrize(
    ('values', 'told'),
    [
        ([], 'not a mapping'),
        ({'rows': 5.0}, 'rows: 5.0 is not a whole number'),
        ({'rows': True}, 'rows: True'),
        ({'rows': 200}, 'rows: 200'),
        ({'absent': 12}, 'absent: 12 is not a list'),
        ({'absent': [-1]}, 'absent: -1'),
        ({'absent': [30]}, 'absent 30 is not among the ids 0 to 24'),
        ({'gap_m': float('nan')}, 'gap_m: nan'),
        ({'platform_m': [9, 'x']}, "platform_m: 'x'"),
        ({'columns': [4]}, r'columns: \[4\]'),
        ({3: 4}, '3 is not a setting'),
    ],
)
def test_what_is_no_table_is_told(values, told):
    with pytest.raises(ValueError, match=told):
        Table.parsed(values)


def test_how_two_tables_differ_is_said():
    check_same(Table(gap_y_m=0.09), TableSettings(), 'a', 'b', 'go')  # as the message has it
    told = r'^a: its table is not that of b: rows 3, not 5, absent \[12\], not \[\]: go$'
    with pytest.raises(ConfigError, match=told):
        check_same(Table(rows=3, absent=(12,)), Table(), 'a', 'b', 'go')
