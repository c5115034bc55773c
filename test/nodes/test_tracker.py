# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest
from eol_msgs.msg import Blocks, Control
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.background.model import ClutterMap
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.devices.files.tracker_files import TrackerFiles
from eol_ros.nodes.tracker import TrackerNode
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_msg, to_ns
from eol_ros.scene import Scene
from eol_ros.settings import TrackerSettings

START_NS = 1_700_000_000_123_456_789


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self):
        super().__init__(TrackerSettings(), scene=Scene('probe', {}))
        self.images = ImagePublisher(self, 'camera/image_raw')
        self.blocks, self.pictures = [], []
        self.subscribe('blocks', self.blocks.append)
        self.subscribe('camera/image/compressed', self.pictures.append)


def pictures(count):
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 3)
    rest = rest_lattice()
    for k in range(count):
        xy = rest + [0.0005 * k, 0.0]
        yield renderer.render(xy[:, 0], xy[:, 1], np.full(25, 0.001 * k), k).copy()


@pytest.mark.slow
def test_images_become_blocks_as_offline_to_the_bit(ros, matched):
    node, probe = TrackerNode(TrackerSettings()), Probe()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(probe)
    for _ in range(600):
        executor.spin_once(timeout_sec=0.05)
        if probe.images.subscribers() and matched(node, probe):
            break
    offline = Tracker(TrackerSettings(), Calibration.ideal())
    wanted = []
    for k, image in enumerate(pictures(12)):
        stamp_ns = START_NS + round(k / 60 * 1e9)
        wanted.append((stamp_ns, offline.update(stamp_ns * 1e-9, image)))
        probe.images.publish(stamp_ns, image)
        for _ in range(600):
            executor.spin_once(timeout_sec=0.05)
            if len(probe.blocks) > k:
                break
    for _ in range(600):
        if probe.pictures:
            break
        executor.spin_once(timeout_sec=0.05)
    assert len(probe.blocks) == 12
    for k, (message, (stamp_ns, tracked)) in enumerate(zip(probe.blocks, wanted)):
        assert to_ns(message.header.stamp) == stamp_ns
        assert (message.state, message.image) == (Blocks.TRACKING, k)
        assert [b.id for b in message.blocks] == list(range(25))
        assert all(b.seen for b in message.blocks)
        assert [(b.x, b.y) for b in message.blocks] == [tuple(w) for w in tracked.world.tolist()]
        assert [(b.u, b.v) for b in message.blocks] == [tuple(p) for p in tracked.px.tolist()]
        assert [b.yaw for b in message.blocks] == tracked.yaw.tolist()
        assert np.allclose(tracked.world, rest_lattice() + [0.0005 * k, 0.0], atol=1e-4)
    picture = cv2.imdecode(np.array(probe.pictures[0].data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (400, 640)
    assert START_NS <= to_ns(probe.pictures[0].header.stamp) <= wanted[-1][0]
    node.close()
    node.destroy_node()
    probe.destroy_node()


def heard(source, key, value, stamp_ns):
    message = Control(source=source, target='tracker', command='set', key=key, value=value)
    message.header.stamp = to_msg(stamp_ns)
    return message


@pytest.mark.parametrize('sim_time', [True, False])
def test_only_behind_a_replay_a_tracker_heeds_what_a_tracker_said(ros, sim_time):
    node = TrackerNode(
        TrackerSettings(), parameter_overrides=[Parameter('use_sim_time', value=sim_time)]
    )
    asked = []
    node.tracker.requests.add = lambda *request: asked.append(request)
    node.on_control(heard('tracker', 'threshold', '30.0', START_NS))
    assert asked == ([(START_NS, 'threshold', '30.0')] if sim_time else [])
    asked.clear()

    node.ask('threshold', '40.0', START_NS)
    assert asked == [(START_NS, 'threshold', '40.0')]
    node.on_control(heard('tracker', 'threshold', '40.0', START_NS))  # its own words
    assert len(asked) == 1

    before, node.images = node.tracker, 5
    node.restart()
    assert node.tracker is not before and node.images == 0
    node.close()
    node.destroy_node()


def test_what_a_replay_learns_again_is_not_written_down(tmp_path):
    settings = TrackerSettings(background=str(tmp_path / 'lamps.png'))
    for keep in (True, False):
        tracker = Tracker(settings, Calibration.ideal())
        tracker.finder.clutter = ClutterMap(np.full((800, 1280), 40, np.uint8))
        tracker.outcome = 'lamps learnt'
        tracked = tracker.update(1.0, np.zeros((800, 1280), np.uint8))
        _, text = TrackerFiles(settings, keep).words(tracker, tracked)
        assert ('kept in' in text) is keep is (tmp_path / 'lamps.png').exists()
        (tmp_path / 'lamps.png').unlink(missing_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize('jump_s', [-3600, 3600])
def test_blocks_go_on_when_the_clock_is_set(ros, matched, jump_s):
    node, probe = TrackerNode(TrackerSettings()), Probe()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(probe)
    for _ in range(200):
        executor.spin_once(timeout_sec=0.05)
        if probe.images.subscribers() and matched(node, probe):
            break
    node.ask('dark', str(START_NS + 10**9), START_NS + 10**9)  # due in a time that never comes
    for k, image in enumerate(pictures(40)):
        stamp_ns = START_NS + round((k / 60 + (k >= 20) * jump_s) * 1e9)
        probe.images.publish(stamp_ns, image)
        for _ in range(200):
            executor.spin_once(timeout_sec=0.05)
            if len(probe.blocks) > k:
                break
    states = [message.state for message in probe.blocks]
    assert states[19] == states[-1] == Blocks.TRACKING
    assert all(block.seen for block in probe.blocks[-1].blocks)
    assert [message.image for message in probe.blocks[20:23]] == [0, 1, 2]  # from the beginning
    values = node.health.values
    assert values['time_jumps'] == 1 and values['missing'] == 0
    node.close()
    for one in (node, probe):
        one.destroy_node()
    executor.shutdown()
