# SPDX-License-Identifier: Apache-2.0
"""A person rotates the rim all the way round: the tracker follows, and after darkness knows all."""

import numpy as np
import pytest

from eol_ros.core.physics.twin.hands import VISITORS_YAW_RAD
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

FPS = 30.0


@pytest.mark.slow
def test_blocks_of_a_rim_that_rotates_all_the_way_round_keep_their_names():
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    tracker, play = Tracker(TrackerSettings(), Calibration.ideal()), Play(5)
    table, dark = play.table, {*range(34, 38), *range(120, 130), *range(180, 183)}
    for index in range(250):
        play.commands.take(play.time_s, 'anna', (0.0, 0.0, 0.9), 0.5)
        play.advance(1 / FPS)
        image = renderer.render(table.x, table.y, table.yaw, index, velocity=table.velocity)
        if index in dark:
            image = np.full_like(image, 12)
        seen = tracker.update(play.time_s, np.ascontiguousarray(image))
        if index in dark or index - 1 in dark:  # one image to find all again
            continue
        assert seen.seen.all(), index
        assert np.abs(seen.world - np.column_stack([table.x, table.y])).max() < 1e-3, index
    assert play.rim.pose[2] > 2 * np.pi > VISITORS_YAW_RAD
    assert 2 * np.pi - 0.5 < seen.yaw.mean() < play.rim.pose[2]  # they went along with it
