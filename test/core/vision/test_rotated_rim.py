# SPDX-License-Identifier: Apache-2.0
"""A person rotates the rim as far as it goes: the tracker follows, and after darkness knows all."""

import numpy as np

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.physics.twin.hands import VISITORS_YAW_RAD, YAW_LIMIT_RAD
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

FPS = 30.0


def test_blocks_of_a_rim_rotated_to_its_limit_keep_their_names():
    renderer = Renderer(RenderOptions(rate_hz=FPS), Calibration.ideal(), 5)
    tracker, play = Tracker(TrackerSettings(), Calibration.ideal()), Play(5)
    table, dark = play.table, range(34, 38)
    for index in range(48):
        play.commands.take(play.time_s, 'anna', (0.0, 0.0, 0.9), 0.5)
        play.advance(1 / FPS)
        image = renderer.render(table.x, table.y, table.yaw, index, velocity=table.velocity)
        if index in dark:
            image = np.full_like(image, 12)
        seen = tracker.update(play.time_s, np.ascontiguousarray(image))
        if index in dark or index == dark.stop:  # one image to find all again
            continue
        assert seen.seen.all(), index
        assert np.abs(seen.world - np.column_stack([table.x, table.y])).max() < 1e-3, index
    assert play.rim.pose[2] == YAW_LIMIT_RAD > VISITORS_YAW_RAD
    lattice = np.linalg.lstsq(*_from_middle(table), rcond=None)[0]
    assert np.degrees(np.arctan2(lattice[1], lattice[0])) > 14  # they went along with it


def _from_middle(table):
    x, y = (rest_lattice() - rest_lattice().mean(axis=0)).T
    here = np.stack([table.x - table.x.mean(), table.y - table.y.mean()])
    return np.stack([np.concatenate([x, y]), np.concatenate([-y, x])], axis=1), here.ravel()
