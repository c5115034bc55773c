# SPDX-License-Identifier: Apache-2.0
"""Nothing is compiled while the work runs: a first image must not wait for a compiler."""

import numpy as np
import pytest
from numba.core import event

from eol_ros.core.physics.twin.play import Play
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow


class Compiled(event.Listener):
    """Names of what numba compiled or loaded."""

    def __init__(self):
        self.names = []

    def on_start(self, happening):
        self.names.append(str(happening.data['dispatcher']))

    def on_end(self, happening):
        pass


def film(seconds, fps=60.0, hole=()):
    """Yield (stamp_s, read-only image) as a node gets them, with images of nothing in `hole`."""
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 5)
    play = Play(5)
    table = play.table
    for index in range(round(seconds * fps)):
        play.advance(1 / fps)
        image = renderer.render(table.x, table.y, table.yaw, index, velocity=table.velocity)
        if index in hole:
            image = np.full_like(image, 12)
        elif index % 120 > 100:
            image = image.copy()
            image[200:500, 300:700] = 14  # an arm
        yield 1.7e9 + play.time_s, np.frombuffer(image.tobytes(), np.uint8).reshape(image.shape)


def test_the_tracker_compiles_nothing_live():
    images = list(film(4.5, hole=range(200, 230)))
    tracker = Tracker(TrackerSettings(), Calibration.ideal())
    tracker.warm_up()
    compiled = Compiled()
    event.register('numba:compile', compiled)
    try:
        for stamp_s, image in images:
            tracker.update(stamp_s, image)
    finally:
        event.unregister('numba:compile', compiled)

    assert compiled.names == []
