# SPDX-License-Identifier: Apache-2.0
"""The replay node over real DDS: the recorded bytes come out again, in order, at their time."""

import struct
import time

import pytest
from eol_msgs.msg import Blocks, Slip
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from eol_ros.devices.bag_file import BagTopic
from eol_ros.devices.bag_writer import BagWriter
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.nodes.replay import ReplayNode
from eol_ros.ros.definitions import describe
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
from eol_ros.settings import MotionSettings, ReplaySettings

T0 = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


class Taker(EolNode):
    """Keeps what comes, with its time."""

    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.got, self.at, self.clock = {'blocks': [], 'slips': []}, [], []
        self.subscribe('blocks', self.on_blocks, raw=True)
        self.subscribe('slips', self.got['slips'].append, raw=True)
        self.create_subscription(Clock, '/clock', self.clock.append, 10)

    def on_blocks(self, raw):
        self.got['blocks'].append(raw)
        self.at.append(time.monotonic())


@pytest.fixture
def bag(tmp_path):
    """A bag of 100 blocks at 100 a second, and 20 slips."""
    topics = [BagTopic(f'/eol/{t}', **describe(t)) for t in ('blocks', 'slips', 'camera/image_raw')]
    writer = BagWriter(tmp_path / 'run', topics, {})
    sent = {'blocks': [], 'slips': []}
    for i in range(100):
        now = T0 + i * STEP_NS
        sent['blocks'].append(bytes(serialize_message(Blocks(image=i))))
        writer.write('/eol/blocks', sent['blocks'][-1], now, now)
        if i % 5 == 0:
            sent['slips'].append(bytes(serialize_message(Slip(slip=i))))
            writer.write('/eol/slips', sent['slips'][-1], now, now)
    writer.close()
    return tmp_path / 'run', sent


def play(taker, path, **settings):
    node = ReplayNode(ReplaySettings(bag=str(path), wait_s=10.0, **settings))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(taker)
    end = time.monotonic() + 20.0
    while time.monotonic() < end and node.state != 'over':
        executor.spin_once(timeout_sec=0.01)
    state, settle = node.state, time.monotonic() + 0.3
    while time.monotonic() < settle:
        executor.spin_once(timeout_sec=0.01)
    node.close()
    executor.remove_node(node)
    node.destroy_node()
    executor.shutdown(timeout_sec=1.0)
    assert state == 'over'
    return node


@pytest.mark.slow
def test_the_recorded_bytes_come_at_their_time(ros, bag):
    path, sent = bag
    taker = Taker()
    play(taker, path, topics=('blocks', 'slips'), rate=2.0, clock=True)
    assert taker.got == sent
    assert taker.at[-1] - taker.at[0] >= 0.49  # 0.99 s recorded, at twice the speed
    times = [to_ns(message.clock) for message in taker.clock]
    assert times == sorted(times)
    assert set(times) <= {T0 + i * STEP_NS for i in range(100)}
    taker.destroy_node()


@pytest.mark.slow
def test_without_pictures_the_blocks_are_played(ros, bag):
    path, sent = bag
    taker = Taker()
    node = play(taker, path, fast=True, start_s=0.5)
    assert node.names == ['/eol/blocks']
    assert taker.got == {'blocks': sent['blocks'][50:], 'slips': []}
    taker.destroy_node()


def test_what_cannot_be_played_is_said(ros, tmp_path, bag):
    with pytest.raises(ConfigError, match='name a bag folder'):
        ReplayNode(ReplaySettings())
    with pytest.raises(DeviceMissing, match='no such bag'):
        ReplayNode(ReplaySettings(bag=str(tmp_path / 'absent')))
    with pytest.raises(ConfigError, match='no topic wall in this bag'):
        ReplayNode(ReplaySettings(bag=str(bag[0]), topics=('wall',)))
    topic = BagTopic('/eol/blocks', **{**describe('blocks'), 'type_hash': 'RIHS01_' + 'a' * 64})
    writer = BagWriter(tmp_path / 'other', [topic], {})
    writer.write('/eol/blocks', struct.pack('<I', 256), T0, T0)
    writer.close()
    with pytest.raises(ConfigError, match='another definition of eol_msgs/msg/Blocks'):
        ReplayNode(ReplaySettings(bag=str(tmp_path / 'other')))
