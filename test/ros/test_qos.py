# SPDX-License-Identifier: Apache-2.0
"""Quality of service between our nodes and nodes of others, over real DDS."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from eol_msgs.msg import Slip
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros.errors import ConfigError
from eol_ros.ros import qos
from eol_ros.ros.node import EolNode
from eol_ros.scene import Scene
from eol_ros.settings import MontageSettings
from eol_ros.streams.graph import TOPICS

RELIABLE = QoSProfile(depth=5)
# Prints the number of each slip that it receives, as our subscribers ask for them.
READER = """
from eol_ros.ros import network
network.configure('local')
import rclpy
from eol_msgs.msg import Slip
from eol_ros.ros.topics import QOS
rclpy.init()
node = rclpy.create_node('reader', namespace='eol')
node.create_subscription(Slip, 'slips', lambda slip: print(slip.slip, flush=True), QOS['stream'])
rclpy.spin(node)
"""
pytestmark = pytest.mark.usefixtures('any_stamp')


class Probe(EolNode):
    NAME = 'probe'

    def __init__(self, *overrides):
        super().__init__(
            MontageSettings(), scene=Scene('probe', {}), parameter_overrides=list(overrides)
        )


def test_an_event_of_a_subscription_that_was_destroyed_since_is_none(ros):
    """As if a callback destroys it in the turn of the executor that discovers its peer."""
    probe = Probe()
    made = probe.subscribe('camera/image_raw', print)
    probe.destroy_subscription(made)
    for events in made.event_handlers:
        events._ready_to_take_data = True  # as the executor does for a queued event
    assert [events.take_data() for events in made.event_handlers] == [None, None]
    probe.destroy_node()


@pytest.mark.parametrize('executor', [EventsExecutor, SingleThreadedExecutor])
def test_images_of_a_best_effort_driver_come_and_those_of_a_reliable_one(ros, executor):
    probe, driver = Probe(), Node('driver', namespace='eol')
    images, infos = [], []
    probe.subscribe('camera/image_raw', images.append)
    probe.subscribe('camera/camera_info', infos.append)
    sensor = driver.create_publisher(Image, 'camera/image_raw', qos_profile_sensor_data)
    lens = driver.create_publisher(CameraInfo, 'camera/camera_info', qos_profile_sensor_data)
    with Nodes(probe, driver, executor=executor) as nodes:
        nodes.until(lambda: sensor.get_subscription_count() and lens.get_subscription_count())
        message = Image(height=2, width=3, encoding='mono8', step=3, data=bytes(range(6)))
        sensor.publish(message)
        lens.publish(CameraInfo(width=3, height=2))
        nodes.until(lambda: images and infos)
        assert np.array_equal(images[0].pixels, np.arange(6).reshape(2, 3))
        named = [s.topic_name for s in probe.subscriptions if 'camera' in s.topic_name]
        assert len(named) == 2 and not probe.qos.text
        reliable = driver.create_publisher(Image, 'camera/image_raw', RELIABLE)
        nodes.until(reliable.get_subscription_count)
        reliable.publish(message)
        nodes.until(lambda: len(images) == 2)


def test_a_mismatch_is_a_state_that_names_both_policies_until_it_is_over(ros):
    probe, other = Probe(), Node('stranger', namespace='eol')
    probe.subscribe('wall', lambda message: None)
    probe.publisher('sound_meter')
    kinds = {name: qos.message_class(TOPICS[name].type_name) for name in ('wall', 'sound_meter')}
    with Nodes(probe, other) as nodes:
        probe.health.ok('fine')
        other.create_subscription(kinds['sound_meter'], 'sound_meter', print, RELIABLE)
        nodes.until(lambda: probe.qos.text)
        status = probe.health.status()
        assert (status['level'], status['code']) == (1, 'qos_of_reader')
        assert status['text'] == (
            '/eol/sound_meter: stranger asks for reliable volatile, this node offers best_effort '
            'volatile: it gets no message; fine'
        )
        publisher = other.create_publisher(kinds['wall'], 'wall', RELIABLE)
        nodes.until(lambda: probe.health.status()['level'] == 2)
        assert '/eol/wall: stranger offers reliable volatile' in probe.health.status()['text']
        other.destroy_publisher(publisher)
        nodes.until(lambda: probe.health.status()['level'] == 1)


def test_a_publisher_with_another_definition_of_the_type_is_an_error(ros, monkeypatch):
    probe, other = Probe(), Node('stranger', namespace='eol')
    probe.subscribe('wall', lambda message: None)
    probe.health.ok('fine')
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with Nodes(probe, other) as nodes:
        kind = qos.message_class(TOPICS['wall'].type_name)
        first = other.create_publisher(kind, 'wall', latched)
        nodes.until(lambda: probe.qos._unmatched)
        nodes.until(lambda: not probe.qos._unmatched)  # the same definition
        assert probe.health.status()['level'] == 0
        other.destroy_publisher(first)
        monkeypatch.setattr(qos, 'type_hash', lambda name: 'RIHS01_' + 64 * '0')
        other.create_publisher(kind, 'wall', latched)
        nodes.until(lambda: probe.health.status()['code'] == 'other_type')
        status = probe.health.status()
        assert status['level'] == 2
        assert 'stranger has another definition of eol_msgs/msg/Wall' in status['text']


def test_overrides_are_honoured_or_told(ros):
    best_effort = Parameter('qos_overrides./eol/slips.publisher.reliability', value='best_effort')
    reliable = Parameter(
        'qos_overrides./eol/camera/image_raw.subscription.reliability', value='reliable'
    )
    unused = Parameter('qos_overrides./eol/walls.subscription.depth', value=3)
    probe, driver = Probe(best_effort, reliable, unused), Node('driver', namespace='eol')
    slips = probe.publisher('slips')
    probe.subscribe('camera/image_raw', print)
    assert slips.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert slips.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert qos.PUBLISHER_QOS['stream'].reliability == ReliabilityPolicy.RELIABLE
    assert probe.get_parameter(best_effort.name).value == 'best_effort'
    assert probe.qos.unused() == [unused.name]
    driver.create_publisher(Image, 'camera/image_raw', qos_profile_sensor_data)
    with Nodes(probe, driver) as nodes:
        nodes.until(lambda: 'driver offers best_effort' in probe.qos.text)


@pytest.mark.parametrize(
    ('policy', 'value', 'words'),
    [
        ('reliabilty', 'reliable', 'reliabilty: no such policy. Did you mean reliability'),
        ('reliability', 'sometimes', '/eol/slips.publisher: .*sometimes'),
        ('depth', 'many', '/eol/slips.publisher: .*depth'),
        ('depth', -1, '/eol/slips.publisher: '),
    ],
)
def test_an_override_that_cannot_be_is_refused(ros, policy, value, words):
    with pytest.raises(ConfigError, match=words):
        probe = Probe(Parameter(f'qos_overrides./eol/slips.publisher.{policy}', value=value))
        probe.publisher('slips')


def test_a_parameter_that_is_not_declared_is_a_warning_with_the_nearest_name(ros, capfd):
    probe = Probe(Parameter('perod_s', value=3.0), Parameter('period_s', value=2.0))
    assert probe.settings.period_s == 2.0 and not probe.has_parameter('perod_s')
    assert 'probe has no setting perod_s. Did you mean period_s?' in capfd.readouterr().err


@pytest.mark.slow
def test_a_reader_without_a_processor_for_4_s_loses_no_slip(ros):
    """A dense cascade has 60 slips a second; the machine runs none of the reader's threads."""
    probe = Probe()
    slips = probe.publisher('slips')
    reader = subprocess.Popen([sys.executable, '-c', READER], stdout=subprocess.PIPE, text=True)
    try:
        wait_until(slips.get_subscription_count, 60)
        reader.send_signal(signal.SIGSTOP)
        for slip in range(240):
            slips.publish(Slip(slip=slip))
            time.sleep(1 / 60)
        reader.send_signal(signal.SIGCONT)
        assert [int(reader.stdout.readline()) for _ in range(240)] == list(range(240))
    finally:
        reader.kill()
        reader.communicate()
        probe.destroy_node()
