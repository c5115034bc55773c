# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest
from eol_msgs.msg import Blocks
from rclpy.executors import SingleThreadedExecutor

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.vision.calibration import Calibration
from eol_ros.core.vision.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.nodes.tracker import TrackerNode
from eol_ros.ros.images import ImagePublisher
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
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
