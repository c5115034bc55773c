# SPDX-License-Identifier: Apache-2.0
"""A source begins when its own scene listens, and is not taken in by others who do."""

import time
from types import SimpleNamespace

import pytest

from eol_ros.ros.audience import SETTLE_S, Audience
from eol_ros.ros.topics import TOPICS
from eol_ros.settings import RecorderSettings

pytestmark = pytest.mark.slow


@pytest.fixture
def reader(ros):
    nodes = []

    def reader(name, *topics, namespace='/eol'):
        node = ros.create_node(name, namespace=namespace)
        for topic in topics:
            kind = TOPICS[topic].message_class()
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


def test_lookers_on_are_not_readers_of_the_scene(reader):
    twin = reader('twin')
    nodes = {name: None for name in ('twin', 'tracker', 'motion')}
    twin.scene = SimpleNamespace(nodes=nodes | {'recorder': RecorderSettings(images='none')})
    audience = Audience(twin)
    kept = ['blocks', 'slips', 'cascades']
    assert audience.missing() == ['camera/image_raw', *kept]

    reader('tracker', 'camera/image_raw')
    reader('motion', 'blocks')
    reader('watch', 'camera/image_raw', *kept)
    reader('recorder', *kept, namespace='/other')
    assert until(lambda: audience.missing() == kept)
    time.sleep(2 * SETTLE_S)
    assert audience.missing() == kept and not audience.ready()

    reader('recorder', *kept)
    assert until(audience.ready)
