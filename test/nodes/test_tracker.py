# SPDX-License-Identifier: Apache-2.0
import json
import types
from dataclasses import replace

import cv2
import numpy as np
import pytest
from eol_msgs.msg import Blocks
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from support.paper import BLOCK_SIDE_M, N_BLOCKS, rest_lattice
from support.spinning import Nodes
from support.tables import on_tables

from eol_ros.core.table import Table
from eol_ros.core.vision.appearance import learnt
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.requests import Outcome
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.files.tracker_files import TrackerFiles
from eol_ros.nodes.tracker import TrackerNode
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.requests import request_from_msg, request_to_msg
from eol_ros.ros.stamps import to_ns
from eol_ros.scene import Scene
from eol_ros.settings import TrackerSettings
from eol_ros.streams import calibrations, images
from eol_ros.streams.requests import Asked

START_NS = 1_700_000_000_123_456_789
pytestmark = pytest.mark.usefixtures('any_stamp')


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self, table):
        super().__init__(TrackerSettings(), scene=Scene('probe', {}, table=table))
        self.images = ImagePublisher(self, 'camera/image_raw')
        self.blocks, self.pictures, self.calibrations = [], [], []
        self.subscribe('calibration', self.calibrations.append)
        self.subscribe(
            'blocks', lambda raw: self.blocks.append(deserialize_message(raw, Blocks)), raw=True
        )
        self.subscribe('camera/image_raw/compressed', self.pictures.append)


@pytest.fixture
def graph(ros, table):
    node, probe = (
        TrackerNode(TrackerSettings(), scene=Scene('tracker', {}, table=table)),
        Probe(table),
    )
    with Nodes(node, probe) as nodes:
        nodes.meet()
        nodes.until(probe.images.subscribers)
        yield node, probe, nodes


def pictures(count, table=Table()):
    renderer = Renderer(RenderOptions(), Calibration.ideal(table=table), 3)
    for k in range(count):
        xy = table.rest + [0.0005 * k, 0.0]
        yield renderer.render(xy[:, 0], xy[:, 1], np.full(table.cells, 0.001 * k), k).copy()


@pytest.mark.slow
@on_tables
def test_images_become_blocks_as_offline_to_the_bit(graph, table):
    _node, probe, nodes = graph
    ideal = Calibration.ideal(table=table)
    offline = Tracker(TrackerSettings(), ideal)
    wanted = []
    for k, image in enumerate(pictures(12, table)):
        stamp_ns = START_NS + round(k / 60 * 1e9)
        wanted.append((stamp_ns, offline.update(stamp_ns * 1e-9, image)))
        probe.images.publish(stamp_ns, image)
        nodes.until(lambda k=k: len(probe.blocks) > k)
    nodes.until(lambda: probe.pictures and probe.calibrations)
    assert len(probe.blocks) == 12
    (message,) = probe.calibrations
    loaded = calibrations.to_core(message, table)
    assert (loaded.packed() == ideal.packed()).all() and loaded.table == table
    assert message.digest == ideal.digest
    for k, (message, (stamp_ns, tracked)) in enumerate(zip(probe.blocks, wanted, strict=True)):
        assert to_ns(message.header.stamp) == stamp_ns
        assert (message.state, message.image) == (Blocks.STATE_TRACKING, k)
        assert [b.id for b in message.blocks] == list(range(table.cells))
        assert [b.seen for b in message.blocks] == table.present.tolist()
        rows = np.array([(b.x, b.y, b.u, b.v, b.yaw) for b in message.blocks])
        same = np.column_stack([tracked.world, tracked.px, tracked.yaw])
        assert np.array_equal(rows, same, equal_nan=True)
        off = tracked.world - (table.rest + [0.0005 * k, 0.0])
        assert np.abs(off[table.ids]).max() < 1e-4
    picture = cv2.imdecode(np.array(probe.pictures[0].data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (400, 640)
    assert START_NS <= to_ns(probe.pictures[0].header.stamp) <= wanted[-1][0]


def test_a_request_counts_from_its_stamp_and_an_own_one_once(ros):
    node = TrackerNode(TrackerSettings())
    asked, sent = [], []
    node.tracker.requests.add = lambda *request: asked.append(request)
    node.requests.publisher = types.SimpleNamespace(publish=sent.append)
    ask = Asked('background', 'tracker', from_ns=START_NS, source='replay')
    node.requests.take(request_to_msg(ask, START_NS))
    assert asked == [(START_NS, 'background', b'')] and not sent
    node.requests.reached(START_NS)
    node.set_parameters([Parameter('preview_hz', value=4.0)])  # as ros2 param set does
    assert request_from_msg(sent[0]).values == {'preview_hz': 4.0}
    node.requests.take(sent[0])  # its own words come back
    assert len(asked) == len(sent) == 1

    before, node.images = node.tracker, 5
    node.restart()
    assert node.tracker is not before and node.images == 0
    node.close()
    node.destroy_node()


def test_without_images_nothing_that_needs_them_is_begun(ros, monkeypatch):
    node = TrackerNode(TrackerSettings())
    said = []
    monkeypatch.setattr(node.requests, 'answer', lambda asked, *what: said.append(what))
    ask = request_to_msg(Asked('calibrate', 'tracker'), START_NS)
    node.requests.take(ask)
    assert not said and node.pending.pop('calibrate')  # it has waited for no image for long
    node.health._last_tick_s -= 10
    node.requests.take(ask)
    ((accepted, why),) = said
    assert not accepted and why.startswith('no images for 10 s; ') and not node.pending
    node.close()
    node.destroy_node()


def life(monkeypatch, kept):
    monkeypatch.setenv('EOL_KEPT', json.dumps({'tracker': kept}))
    node = TrackerNode(TrackerSettings())
    told = []
    node.requests.publisher = types.SimpleNamespace(publish=told.append)
    for k, image in enumerate(pictures(3)):
        node.on_image(images.Grey(START_NS + k * 16_666_667, image))
    return node, told


def test_what_was_learned_of_the_covers_outlives_the_node(ros, monkeypatch):
    node, told = life(monkeypatch, {})
    assert not told and not node.health.kept
    for k, image in enumerate(pictures(20), 3):
        node.on_image(images.Grey(START_NS + k * 16_666_667, image))
    node.learnt_s = 0.0  # a minute has passed
    node._learn()
    kept, light = node.health.kept, node.tracker.follower.faces.light.copy()
    assert sorted(kept) == ['covers']
    close(node)

    node, told = life(monkeypatch, kept)
    (asked,) = map(request_from_msg, told)
    # The bag has what this life began with, so that it can be proved.
    assert (asked.kind, asked.from_ns) == ('covers', START_NS)
    covers = learnt.check(asked.data, N_BLOCKS)
    assert (covers['looks'] >= 12).all() and np.allclose(covers['light'], light, rtol=1e-3)
    assert node.tracker.follower.blocks['known'].all()
    assert np.allclose(node.tracker.follower.faces.light, light, rtol=0.02)
    close(node)

    node, told = life(monkeypatch, {'covers': 'dGhpcyBpcyBub3RoaW5n'})
    assert not told and not node.tracker.follower.blocks['known'].any()
    close(node)


def test_covers_that_are_not_those_of_the_calibration_are_told():
    files, tracker = (
        TrackerFiles(TrackerSettings(), Table()),
        Tracker(TrackerSettings(), Calibration.ideal()),
    )
    renderer = Renderer(calibration=tracker.calibration)
    image = renderer.render(*rest_lattice().T, np.zeros(25), 0)
    for k in range(40):
        tracked = tracker.update(k / 60, image)
        files.look(tracker, tracked)
    assert files.words(tracked)[0]

    sides = tracker.sides_px()
    assert sides == pytest.approx(BLOCK_SIDE_M * tracker.calibration.px_per_m(), rel=2e-3)
    tracker.sides_px = lambda: sides * np.linspace(0.98, 1.02, 25)
    for later_s, good in ((30.0, True), (61.0, False)):
        for k in range(20):
            files.look(tracker, tracked._replace(stamp_s=tracked.stamp_s + later_s + k / 60))
        told = files.words(tracked)
        assert told[0] is good
    assert 'the calibration is for other covers' in told[1] and '25 of 25' in told[1]

    tracker.calibration = replace(tracker.calibration, cover_height_m=0.01)
    files.look(tracker, tracked)
    assert files.words(tracked)[0]  # nothing is known of the new one yet


def close(node):
    node.close()
    node.destroy_node()


def test_what_a_replay_learns_again_is_not_written_down(tmp_path):
    settings = TrackerSettings(background=str(tmp_path / 'lamps.png'))
    for keep in (True, False):
        tracker = Tracker(settings, Calibration.ideal())
        tracker.background = BackgroundModel(np.full((800, 1280), 40, np.uint8))
        tracker.outcome = Outcome('darkness', False, 'background learnt')
        tracked = tracker.update(1.0, np.zeros((800, 1280), np.uint8))
        files = TrackerFiles(settings, Table(), keep)
        assert files.news(tracker, tracked.stamp_s) is files.told
        assert files.news(tracker, tracked.stamp_s) is None
        _, text = files.words(tracked)
        assert ('kept in' in text) is keep is (tmp_path / 'lamps.png').exists()
        (tmp_path / 'lamps.png').unlink(missing_ok=True)


def test_covers_that_were_changed_are_said_with_a_code(tmp_path):
    tracker = Tracker(TrackerSettings(), Calibration.ideal())
    for k, image in enumerate(pictures(3)):
        tracked = tracker.update(k / 60, image)
    files = TrackerFiles(TrackerSettings(), Table())
    assert files.words(tracked)[0]
    tracker.follower.changed_s[[3, 8]] = 2 / 60
    good, text = files.words(tracker.update(3 / 60, image))
    assert not good and text == '25 of 25 blocks seen; other covers than before on blocks 3, 8'
    assert text.parts[1] == ['covers', {'blocks': '3, 8'}]
