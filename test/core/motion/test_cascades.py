# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.tables import on_tables

from eol_ros.core.motion.cascades import Cascades
from eol_ros.core.motion.slips import START, STOP, SlipEvent
from eol_ros.settings import MotionSettings


def start(slip, block, at):
    return SlipEvent(START, slip, block, at, at, 1e-3, 0.0, 0.0, 0.1)


def stop(slip, block, onset, end, distance=0.01):
    return SlipEvent(STOP, slip, block, end, onset, 1e-3, 0, 0, 0.1, distance, end - onset)


def run(rows):
    """Feed (stamp, events); return what closed, by cascade number."""
    cascades, closed = Cascades(MotionSettings()), []
    for stamp, events in rows:
        closed += cascades.update(stamp, events)[1]
    return closed


def test_neighbours_in_time_are_one_cascade():
    closed = run([
        (1.0, [start(1, 12, 1.0)]),
        (1.1, [start(2, 13, 1.08), start(3, 18, 1.09)]),
        (1.2, [stop(1, 12, 1.0, 1.15)]),
        (1.3, [stop(2, 13, 1.08, 1.25), stop(3, 18, 1.09, 1.28), start(4, 12, 1.29)]),
        (1.5, [stop(4, 12, 1.29, 1.4)]),
        (2.0, []),
    ])  # fmt: skip
    (cascade,) = closed
    assert cascade.nucleus == 12
    assert cascade.blocks == (12, 13, 18)
    assert (cascade.area, cascade.size) == (3, 4)
    assert cascade.onset_s == 1.0
    assert cascade.duration_s == pytest.approx(0.4)
    assert cascade.distance_m == pytest.approx(0.04)


@on_tables
def test_slips_at_once_of_blocks_that_touch_are_one_cascade(table):
    rows, columns = np.divmod(np.arange(table.cells), table.columns)
    first = int(table.ids[1])
    for other in table.ids.tolist():
        cascades = Cascades(MotionSettings(), table)
        numbers, _ = cascades.update(1.0, [start(1, first, 1.0), start(2, other, 1.0)])
        off = abs(rows[other] - rows[first]), abs(columns[other] - columns[first])
        assert (numbers[0] == numbers[1]) == (max(off) <= 1)


def test_far_blocks_and_later_times_are_other_cascades():
    closed = run([
        (1.0, [start(1, 0, 1.0), start(2, 24, 1.0)]),
        (1.2, [stop(1, 0, 1.0, 1.1), stop(2, 24, 1.0, 1.1)]),
        (1.3, [start(3, 0, 1.2)]),
        (1.5, [stop(3, 0, 1.2, 1.4)]),
        (2.0, []),
    ])  # fmt: skip
    assert [(c.nucleus, c.area) for c in closed] == [(0, 1), (24, 1), (0, 1)]


def test_a_bridge_makes_two_cascades_one():
    closed = run([
        (1.0, [start(1, 10, 1.0), start(2, 12, 1.01)]),
        (1.1, [start(3, 11, 1.05)]),
        (1.3, [stop(1, 10, 1, 1.2), stop(2, 12, 1.01, 1.2), stop(3, 11, 1.05, 1.2)]),
        (2.0, []),
    ])  # fmt: skip
    (cascade,) = closed
    assert cascade.cascade == 1
    assert cascade.blocks == (10, 12, 11)


def test_events_are_told_their_cascade():
    cascades = Cascades(MotionSettings())
    assert cascades.update(1.0, [start(1, 0, 1.0), start(2, 1, 1.0), start(3, 24, 1.0)])[0] == [
        1, 1, 2,
    ]  # fmt: skip
    assert cascades.update(1.2, [stop(3, 24, 1.0, 1.1)])[0] == [2]
