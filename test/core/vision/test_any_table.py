# SPDX-License-Identifier: Apache-2.0
"""Tracker and motion on tables of other sizes and shapes, on images of the twin's renderer."""

import numpy as np
import pytest
from support.clutter import Cluttered
from support.paper import turned
from support.tables import LARGE, OBLONG, RING, SMALL, TABLES

from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.states import LOST, TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import MotionSettings, TrackerSettings

PERIOD_S = 1 / 60


class Film:
    """A table as a camera sees it; blocks lie where they are put."""

    def __init__(self, table, clutter='clean', seed=1):
        self.table, self.images = table, 0
        self.camera = Calibration.ideal(table=table)
        self.renderer = Cluttered(clutter, self.camera, seed)
        spread = 0.02 * min(table.pitch_m)
        self.rest = table.rest + np.random.default_rng(seed).normal(0, spread, table.rest.shape)

    def image(self, xy, yaw=0.0, lit=1.0):
        self.images += 1
        n = self.table.cells
        x, y = xy.T.copy()
        return self.renderer.render(
            x, y, np.full(n, yaw), self.images, ir=np.full(n, float(lit))
        ).copy()


@pytest.mark.parametrize('name', [*TABLES, 'large'])
def test_blocks_are_named_from_the_first_image_on_and_followed_as_the_rim_turns(name):
    film = Film({**TABLES, 'large': LARGE}[name])
    table, tracker = film.table, Tracker(TrackerSettings(), film.camera)
    for k in range(30):
        yaw = 0.01 * k
        xy = turned(film.rest, yaw)
        found = tracker.update(k * PERIOD_S, film.image(xy, yaw))
        assert found.state == TRACKING
        np.testing.assert_array_equal(found.seen, table.present)
        assert np.abs(found.world - xy)[table.ids].max() < 3e-4
        assert np.isnan(found.world[~table.present]).all()
        assert np.isnan(found.px[~table.present]).all()
        assert np.abs(found.yaw[table.ids] - yaw).max() < 0.01


@pytest.mark.parametrize('name', TABLES)
def test_metres_come_from_the_blocks_of_any_table(name):
    film = Film(TABLES[name])
    table = film.table
    rest = table.rest + np.random.default_rng(2).normal(0, 5e-4, table.rest.shape)
    tracker = Tracker(TrackerSettings(), None, table)
    for k in range(80):
        found = tracker.update(k * PERIOD_S, film.image(rest))
    assert found.state == TRACKING, found.why
    assert np.abs(found.world - rest)[table.ids].max() < 2e-3
    assert tracker.calibration.table == table


@pytest.mark.parametrize(('table', 'ambiguous'), [(OBLONG, True), (Table(absent=(0,)), False)])
def test_half_a_turn_in_the_dark_is_in_doubt_where_the_table_looks_the_same(table, ambiguous):
    film = Film(table)
    tracker = Tracker(TrackerSettings(), film.camera)
    for k in range(20):
        tracker.update(k * PERIOD_S, film.image(film.rest))
    for k in range(20, 60):
        found = tracker.update(k * PERIOD_S, film.image(film.rest, lit=0.0))
    assert found.state == LOST
    there = turned(film.rest, np.pi)
    for k in range(60, 75):
        found = tracker.update(k * PERIOD_S, film.image(there, np.pi))
    assert found.state == TRACKING and found.symmetry_ambiguous == ambiguous
    if not ambiguous:
        assert np.abs(found.world - there)[table.ids].max() < 3e-4


@pytest.mark.parametrize('table', [RING, SMALL], ids=['ring', 'small'])
def test_a_slip_is_of_its_block_and_cascades_do_not_cross_a_hole(table):
    film = Film(table)
    tracker, motion = Tracker(TrackerSettings(), film.camera), Motion(MotionSettings(), table)
    first = int(table.ids[1])
    across = int(table.ids[-2])  # on the other side: no neighbour
    slips, cascades, xy = [], [], film.rest.copy()
    for k in range(120):
        if 60 <= k < 66:
            xy[[first, across]] += [[0.002, 0.0], [0.0, -0.002]]
        found = tracker.update(k * PERIOD_S, film.image(xy))
        seen = found.seen & (found.state == TRACKING)
        begun, over = motion.update(k * PERIOD_S, *found.world.T, seen, found.sigma_m)
        slips, cascades = [*slips, *begun], [*cascades, *over]
    assert sorted(s.event.block for s in slips if s.event.kind == START) == [first, across]
    assert sorted(c.blocks for c in cascades) == [(first,), (across,)]
