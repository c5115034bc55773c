# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.tables import on_tables

from eol_ros.core.motion.cascades import Cascades
from eol_ros.core.motion.slips import START, STOP, SlipEvent
from eol_ros.settings import MotionSettings


def start(slip, block, at):
    return SlipEvent(START, slip, block, at, at, 1e-3, 0.0, 0.0, 0.1)


def stop(slip, block, onset, end):
    return SlipEvent(STOP, slip, block, end, onset, 1e-3, 0, 0, 0.1, 0.01, end - onset)


def run(*slips):
    """Feed slips (block, onset_s, end_s) as they begin and end; return what closed, by number."""
    cascades, closed = Cascades(MotionSettings()), []
    events = [start(k, block, onset) for k, (block, onset, _) in enumerate(slips)]
    events += [stop(k, *slip) for k, slip in enumerate(slips)]
    for stamp in np.arange(1.05, 2.0, 0.1):
        due = [event for event in events if stamp - 0.1 < event.stamp_s <= stamp]
        due.sort(key=lambda event: event.stamp_s)
        closed += cascades.update(stamp, due)[1]
    return closed


def test_neighbours_in_time_are_one_cascade():
    (cascade,) = run((12, 1.0, 1.14), (13, 1.08, 1.24), (18, 1.09, 1.28), (12, 1.29, 1.4))
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
    closed = run((0, 1.0, 1.1), (24, 1.0, 1.1), (0, 1.2, 1.4))
    assert [(c.nucleus, c.area) for c in closed] == [(0, 1), (24, 1), (0, 1)]


def test_a_bridge_makes_two_cascades_one():
    (cascade,) = run((10, 1.0, 1.2), (12, 1.01, 1.2), (11, 1.06, 1.2))
    assert cascade.cascade == 1
    assert cascade.blocks == (10, 12, 11)


def test_events_are_told_their_cascade():
    cascades = Cascades(MotionSettings())
    assert cascades.update(1.0, [start(1, 0, 1.0), start(2, 1, 1.0), start(3, 24, 1.0)])[0] == [
        1, 1, 2,
    ]  # fmt: skip
    assert cascades.update(1.2, [stop(3, 24, 1.0, 1.1)])[0] == [2]
