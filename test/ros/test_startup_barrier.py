# SPDX-License-Identifier: Apache-2.0
"""A source begins when its own scene listens, and is not taken in by others who do."""

import time
from types import SimpleNamespace

import pytest
from eol_msgs.msg import Blocks
from sensor_msgs.msg import Image

from eol_ros.ros.startup_barrier import SETTLE_S, PeerDiscovery, StartupBarrier
from eol_ros.ros.topics import topic_class
from eol_ros.settings import RecorderSettings

pytestmark = pytest.mark.slow


@pytest.fixture
def reader(ros):
    nodes = []

    def reader(name, *topics, namespace='/eol'):
        node = ros.create_node(name, namespace=namespace)
        for topic in topics:
            kind = topic_class(topic)
            node.create_subscription(kind, f'/eol/{topic}', lambda message: None, 1)
        nodes.append(node)
        return node

    yield reader
    for node in nodes:
        node.destroy_node()


def until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


def scene_of(*names):
    nodes = {name: None for name in names}
    return SimpleNamespace(nodes=nodes | {'recorder': RecorderSettings(images='none')})


def test_a_node_has_met_those_whom_its_scene_names_and_nobody_else_counts(reader):
    tracker = reader('tracker', 'camera/image_raw')
    tracker.scene = scene_of('twin', 'tracker', 'motion')
    tracker.create_publisher(Blocks, 'blocks', 1)
    discovery = PeerDiscovery(tracker)
    assert discovery.missing() == ['blocks', 'camera/image_raw']

    twin = reader('twin')
    twin.create_publisher(Image, 'camera/image_raw', 1)
    reader('motion', 'blocks')
    reader('watch', 'blocks')
    reader('recorder', 'blocks', namespace='/other')
    assert until(lambda: discovery.missing() == ['blocks'])
    time.sleep(0.3)
    assert discovery.missing() == ['blocks'] and not discovery.complete()

    reader('recorder', 'blocks')
    assert until(discovery.complete) and discovery.missing() == []


def test_a_source_begins_when_all_say_that_they_are_ready(reader):
    twin = reader('twin')
    twin.scene = scene_of('twin', 'tracker', 'motion', 'panel')
    barrier = StartupBarrier(twin)
    assert barrier.missing() == ['motion', 'recorder', 'tracker', 'camera/image_raw']

    reader('tracker', 'camera/image_raw', 'ready')
    reader('motion', 'blocks')
    reader('recorder', 'ready')
    assert until(lambda: barrier.missing() == ['motion'])
    time.sleep(2 * SETTLE_S)
    assert not barrier.ready()

    reader('motion_of_another', 'ready')
    reader('motion', 'ready')
    assert until(barrier.ready)


def test_a_source_of_nobody_does_not_wait(reader):
    twin = reader('twin')
    twin.scene = SimpleNamespace(nodes={'twin': None})
    assert StartupBarrier(twin).ready() and PeerDiscovery(twin).complete()
