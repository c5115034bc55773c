# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from eol_msgs.msg import Block, Blocks, Cascade, Slip
from rclpy.executors import SingleThreadedExecutor

from eol_ros.core.geometry import rest_lattice
from eol_ros.core.motion.slips import SlipDetector
from eol_ros.nodes.motion import MotionNode
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_msg
from eol_ros.scene import Scene
from eol_ros.settings import MotionSettings


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self):
        super().__init__(MotionSettings(), scene=Scene('probe', {}))
        self.blocks = self.publisher('blocks')
        self.slips, self.cascades = [], []
        self.subscribe('slips', self.slips.append)
        self.subscribe('cascades', self.cascades.append)


@pytest.mark.slow
def test_a_slip_goes_through_the_graph(ros, matched):
    node, probe = MotionNode(MotionSettings()), Probe()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(probe)
    for _ in range(600):
        executor.spin_once(timeout_sec=0.05)
        if matched(node, probe):
            break
    random = np.random.default_rng(1)
    start_ns = 1_700_000_000_123_456_789
    for k in range(180):
        t = k / 60
        place = rest_lattice() + random.normal(0, 1e-5, (25, 2))
        place[12, 1] += 1.25 * min(max(t - 1.505, 0), 0.12) ** 2
        message = Blocks(state=Blocks.TRACKING, image=k)
        message.header.stamp = to_msg(start_ns + round(t * 1e9))
        message.header.frame_id = 'table'
        message.blocks = [
            Block(id=i, x=x, y=y, sigma=1e-5, seen=True, visibility=1.0)
            for i, (x, y) in enumerate(place.tolist())
        ]
        probe.blocks.publish(message)
        for _ in range(600):
            executor.spin_once(timeout_sec=0.05)
            if node.health.ticks > k:
                break
    for _ in range(600):
        executor.spin_once(timeout_sec=0.05)
        if probe.cascades and len(probe.slips) == 2:
            break
    start, stop = probe.slips
    assert (start.kind, stop.kind) == (Slip.START, Slip.STOP)
    assert start.block == stop.block == 12
    assert start.slip == stop.slip
    onset_s = start.onset.sec - 1_700_000_000 + start.onset.nanosec * 1e-9
    assert onset_s == pytest.approx(1.505 + 0.123456789, abs=0.006)
    decided = [start_ns + round(k / 60 * 1e9) for k in range(180)]
    assert start.header.stamp.sec * 10**9 + start.header.stamp.nanosec in decided
    assert stop.distance == pytest.approx(0.018, abs=2e-4)
    assert isinstance(probe.cascades[0], Cascade)
    assert list(probe.cascades[0].blocks) == [12]
    assert isinstance(node.motion.detector, SlipDetector)
    assert node.health.status()['values']['slips'] == 1
    node.close()
    node.destroy_node()
    probe.destroy_node()
