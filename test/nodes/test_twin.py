# SPDX-License-Identifier: Apache-2.0
"""The twin over real DDS: images on time, truth that fits them, a rim that obeys."""

from dataclasses import replace

import numpy as np
import pytest
from eol_msgs.msg import RimCommand
from support.paper import BLOCK_SIDE_M, rest_lattice
from support.relief.land import outlines
from support.spinning import Nodes

from assets.covers.mesh import CoverShape
from eol_ros.core.table import Table
from eol_ros.core.terrain import landscape
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.board import block
from eol_ros.devices.files import calibration_file
from eol_ros.devices.files.tracker_files import calibration_of
from eol_ros.devices.files.twin_camera import twin_camera
from eol_ros.errors import ConfigError
from eol_ros.nodes.twin import TwinNode
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
from eol_ros.scene import Scene
from eol_ros.settings import PanelSettings, TableSettings, TrackerSettings, TwinSettings
from eol_ros.streams.images import TYPE, Codec
from eol_ros.streams.requests import Asked

CODEC = Codec(definition(TYPE))


class Probe(EolNode):
    NAME = 'panel'

    def __init__(self):
        super().__init__(PanelSettings())
        self.images, self.truths, self.infos = {}, {}, []
        self.subscribe('camera/image_raw', self.on_image, raw=True)
        self.subscribe('camera/camera_info', self.infos.append)
        self.subscribe('truth', self.on_truth)
        self.command = self.publisher('rim_command')

    def on_image(self, raw):
        stamp, pixels = CODEC.read(raw)
        self.images[stamp] = pixels.copy() if len(self.images) < 40 else None

    def on_truth(self, truth):
        self.truths[truth.header.stamp.sec * 10**9 + truth.header.stamp.nanosec] = truth


@pytest.fixture
def graph(ros):
    probe, twin = Probe(), TwinNode(TwinSettings(hands='nobody', fps=30.0))
    with Nodes(probe, twin) as nodes:
        yield probe, twin, nodes.until


@pytest.mark.slow
def test_images_on_the_grid_with_the_truth_in_them(graph):
    probe, twin, until = graph
    until(lambda: min(map(len, (probe.truths, probe.images, probe.infos))) >= 15)
    stamps = sorted(probe.images)
    steps = np.diff(stamps) / (1e9 / twin.settings.fps)
    assert np.abs(steps - np.round(steps)).max() < 1e-3
    both = sorted(set(probe.truths) & set(probe.images))
    assert len(both) >= 10
    truth, image = probe.truths[both[0]], probe.images[both[0]]
    calibration = Calibration.ideal()
    centres = calibration.to_pixels(np.column_stack([truth.x, truth.y]))
    half = int(0.3 * BLOCK_SIDE_M * 545)
    for u, v in np.rint(centres).astype(int):
        assert image[v - half : v + half, u - half : u + half].mean() > 100
    assert np.median(image) < 60
    assert {to_ns(info.header.stamp) for info in probe.infos} <= set(probe.images)
    assert len(probe.infos) > 10
    assert probe.infos[0].k == pytest.approx(calibration.camera_matrix.ravel())


@pytest.mark.slow
def test_a_table_in_a_mirror_is_tracked_as_it_stands(ros):
    twin = TwinNode(TwinSettings(hands='nobody', mirror=True))
    settings = TrackerSettings(mirror=True)
    tracker = Tracker(settings, calibration_of(settings, Table()))
    try:
        for image in range(24):
            twin.on_rim_command(RimCommand(source='test', vx=0.2, yaw_rate=0.4, hold=0.3))
            twin.step(1 / 60)
            truth = (moment := twin.moment()).truth
            twin.render(image, [moment])
            tracked = tracker.update(image / 60, twin.image)
            apart = tracked.world - np.column_stack([truth.x, truth.y])
            assert tracked.seen.all() and np.abs(apart).max() < 1e-4
            assert np.abs(tracked.yaw - truth.yaw).max() < 3e-3
    finally:
        twin.close()
        twin.destroy_node()
    moved = np.column_stack([truth.x, truth.y]) - rest_lattice()
    assert moved[:, 0].max() > 0.01


@pytest.fixture
def printed(tmp_path):
    """A calibration file of a camera above covers with relief, for images of 640 x 400."""
    land = outlines(landscape(1, cells=16), CoverShape(), 1.0, 16)
    camera = replace(Calibration.ideal(640, 400), cover_height_m=0.013, covers=land)
    calibration_file.save(tmp_path / 'c.yaml', camera)
    return str(tmp_path / 'c.yaml')


@pytest.mark.slow
def test_a_twin_above_printed_covers_sees_their_relief(ros, printed):
    probe = Probe()
    settings = TwinSettings(hands='nobody', fps=30.0, width=640, height=400, calibration=printed)
    twin = TwinNode(settings)
    with Nodes(probe, twin) as nodes:
        nodes.until(lambda: min(map(len, (probe.truths, probe.images))) >= 8)
    camera = calibration_file.load(printed)
    known = Tracker(TrackerSettings(), camera)
    flat = Tracker(TrackerSettings(), replace(camera, covers=None))
    for stamp in sorted(set(probe.truths) & set(probe.images))[:8]:
        truth = np.column_stack([probe.truths[stamp].x, probe.truths[stamp].y])
        off = [
            np.abs((tracked.world - truth)[tracked.seen]).max()
            for tracked in (t.update(stamp * 1e-9, probe.images[stamp]) for t in (known, flat))
        ]

    assert off[0] < 4e-4 and off[1] > 3 * off[0]


def test_a_calibration_of_other_images_is_refused(printed):
    with pytest.raises(ConfigError, match=r'is for images of 640x400, the twin draws 1280x800'):
        twin_camera(TwinSettings(calibration=printed))


@pytest.mark.slow
def test_a_commanded_rim_drags_the_blocks(graph):
    probe, _, until = graph
    until(lambda: len(probe.truths) >= 3)
    still = probe.truths[min(probe.truths)]
    assert still.rim_x == 0.0

    def pull():
        command = RimCommand(source='test', vx=0.25, hold=0.3)
        probe.command.publish(command)
        newest = probe.truths[max(probe.truths)]
        return newest.slips > 0 and newest.rim_x > 0.1

    until(pull)
    last = probe.truths[max(probe.truths)]
    assert np.mean(last.x) > np.mean(still.x)
    assert abs(last.energy_residual) < 1e-5


@pytest.mark.skipif(
    not block.compiled(), reason='in a checkout: python setup.py build_ext --inplace'
)
def test_a_block_that_lights_itself_shines_in_the_images(ros):
    twin = TwinNode(TwinSettings(hands='nobody', noise='none'))
    table = twin.play.table
    try:
        for _ in range(600):
            before = twin.image.astype(int)
            twin.play.commands.take(twin.play.time_s, 'test', (0.25, 0.0, 0.0), 0.3)
            twin.step(1 / 60)
            twin.render(0, [twin.moment()])
            if twin.blocks.lit:
                break
        lit = sorted({b for _, b in twin.blocks.lit})
        u, v = np.rint(
            Calibration.ideal(1280, 800).to_pixels(np.column_stack([table.x, table.y]))
        ).T
        brighter = (twin.image - before)[v.astype(int), u.astype(int)]
    finally:
        twin.close()
        twin.destroy_node()
    assert lit
    assert brighter[lit].min() > 30
    assert np.abs(np.delete(brighter, lit)).max() < 10


@pytest.mark.slow
def test_visitors_let_go_at_the_first_touch_of_a_person(ros):
    twin = TwinNode(TwinSettings(fps=30.0, accelerometer=False))

    def play(seconds):
        ways = []
        for _ in range(round(30 * seconds)):
            before = twin.play.rim.pose.copy()
            twin.step(1 / 30)
            twin.render(0, [twin.moment()])
            ways.append(np.abs(twin.play.rim.pose - before).max())
        return np.array(ways)

    assert play(2.0).max() > 1e-3
    assert twin.play.playing == 'visitors'
    twin.on_rim_command(RimCommand(source='anna', vx=0.02, hold=0.25))
    play(2.0)
    assert twin.play.playing == 'people'
    assert play(17.5).max() < 1e-12, 'nobody touches it, and nobody is to'
    assert twin.play.playing == 'people'
    assert play(3.0).max() > 1e-3
    assert twin.play.playing == 'visitors'
    twin.close()
    twin.destroy_node()


@pytest.mark.slow
@pytest.mark.parametrize('absent', [(0, 12, 24), (6, 7, 8, 11, 12, 13, 16, 17, 18)])
def test_holes_of_the_table_stay_empty_and_dark(ros, absent):
    scene = Scene('test', {}, table=TableSettings(absent=absent))
    twin = TwinNode(TwinSettings(noise='none'), scene=scene)
    table = twin.table
    try:
        mask = (1 << table.cells) - 1 - (1 << 1)  # block 1 is dark
        twin.on_infrared(Asked('infrared', 'twin', {'mask': f'{mask:x}'}))
        for _ in range(120):  # less than from a block to a hole
            twin.play.commands.take(twin.play.time_s, 'test', (0.06, 0.0, 0.0), 0.3)
            twin.step(1 / 60)
        moment = twin.moment()
        twin.render(0, [moment])
    finally:
        twin.close()
        twin.destroy_node()
    truth = np.column_stack([moment.truth.x, moment.truth.y])
    assert moment.truth.slips > 3 and len(moment.truth.moving) == table.cells
    assert np.array_equal(truth[list(absent)], table.rest[list(absent)])
    u, v = np.rint(twin_camera(twin.settings, table).to_pixels(truth)).astype(int).T
    lit = table.present.copy()
    lit[1] = False
    assert np.array_equal(twin.image[v, u] > 100, lit)
