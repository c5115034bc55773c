# SPDX-License-Identifier: Apache-2.0
"""A source begins when its own scene listens, and is not taken in by others who do."""

from types import SimpleNamespace

import pytest
from eol_msgs.msg import Blocks
from sensor_msgs.msg import Image
from support.waiting import wait_until

from eol_ros.ros.startup_barrier import (
    AGAIN_PATIENCE_S,
    PATIENCE_S,
    SETTLE_S,
    PeerDiscovery,
    StartupBarrier,
    endpoints_of,
)
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


class Clock:
    """Seconds that pass when told so."""

    now_s = 0.0

    def __call__(self):
        return self.now_s


def scene_of(*names):
    nodes = {name: None for name in names}
    return SimpleNamespace(nodes=nodes | {'recorder': RecorderSettings(images='none')})


def test_a_node_has_met_those_whom_its_scene_names_and_nobody_else_counts(reader):
    tracker = reader('tracker', 'camera/image_raw')
    tracker.scene = scene_of('twin', 'tracker', 'motion')
    tracker.create_publisher(Blocks, 'blocks', 1)
    discovery = PeerDiscovery(tracker, clock := Clock())
    assert discovery.missing() == ['blocks', 'camera/image_raw']

    twin = reader('twin')
    twin.create_publisher(Image, 'camera/image_raw', 1)
    reader('motion', 'blocks')
    reader('watch', 'blocks')
    reader('recorder', 'blocks', namespace='/other')
    seen = tracker.get_subscriptions_info_by_topic
    wait_until(lambda: discovery.missing() == ['blocks'] and len(seen('/eol/blocks')) == 3)
    clock.now_s += PATIENCE_S
    assert discovery.missing() == ['blocks'] and not discovery.complete()
    clock.now_s += 0.1  # a node that does not come holds up no other
    assert discovery.complete()
    clock.now_s = 0.0

    reader('recorder', 'blocks')
    assert wait_until(discovery.complete) and discovery.missing() == []


def test_who_is_started_again_while_the_others_run_waits_less(ros, monkeypatch):
    """Once twin and tracker were not brought together, and the twin waited for it for 15 s."""
    node = ros.create_node('twin', namespace='/eol')
    node.scene = scene_of('twin', 'tracker')
    begun = []
    for again, wait_s in (('', PATIENCE_S), ('1', AGAIN_PATIENCE_S)):
        monkeypatch.setenv('EOL_AGAIN', again)
        barrier = StartupBarrier(node, clock := Clock())
        clock.now_s = wait_s
        begun += [barrier.ready(), barrier.complete()]
        clock.now_s += 0.1
        begun += [barrier.ready(), barrier.complete()]
    assert begun == [False, False, True, True] * 2
    node.destroy_node()


def test_a_source_begins_when_all_say_that_they_are_ready(reader):
    twin = reader('twin')
    twin.scene = scene_of('twin', 'tracker', 'motion', 'panel')
    barrier = StartupBarrier(twin, clock := Clock())
    assert barrier.missing() == ['motion', 'recorder', 'tracker', 'camera/image_raw']

    reader('tracker', 'camera/image_raw', 'ready')
    reader('motion', 'blocks')
    reader('recorder', 'ready')
    wait_until(lambda: barrier.missing() == ['motion'])
    clock.now_s += 2 * SETTLE_S
    assert not barrier.ready()

    reader('motion_of_another', 'ready')
    reader('motion', 'ready')
    wait_until(lambda: not barrier.missing())
    assert not barrier.ready()
    clock.now_s += SETTLE_S / 2
    assert not barrier.ready()
    clock.now_s += SETTLE_S
    assert barrier.ready()


@pytest.mark.parametrize('topic', ['camera/image_raw', 'camera/camera_info'])
def test_a_recorder_is_waited_for_where_it_takes_pictures(topic):
    for images, waits in (('all', True), ('around_slips', True), ('preview', False)):
        nodes = {'twin': None, 'recorder': RecorderSettings(images=images)}
        publishers, subscribers = endpoints_of(SimpleNamespace(nodes=nodes), topic)
        assert (publishers, subscribers) == (({'twin'}, {'recorder'}) if waits else (set(), set()))


def test_a_source_of_nobody_does_not_wait(reader):
    twin = reader('twin')
    twin.scene = SimpleNamespace(nodes={'twin': None})
    assert StartupBarrier(twin).ready() and PeerDiscovery(twin).complete()
