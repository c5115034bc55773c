# SPDX-License-Identifier: Apache-2.0
"""A callback that is slower than its messages delays nothing else in its process for long."""

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import Image
from std_msgs.msg import Empty
from support.spinning import Nodes

from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.settings import MontageSettings
from eol_ros.streams.graph import QOS, TOPICS

DEPTH = QOS[TOPICS['camera/image_raw'].qos].depth
CALLS = 5 * DEPTH


class Slow(EolNode):
    """While it handles an image, three more come, and one beat on another topic."""

    NAME = 'montage'

    def __init__(self):
        super().__init__(MontageSettings())
        self.images = self.publisher('camera/image_raw')
        self.beats = self.create_publisher(Empty, 'beats', 2 * CALLS)
        self.handled, self.beaten, self.waited = [], 0, []
        self.subscribe('camera/image_raw', self.on_image, slow=True)
        self.create_subscription(Empty, 'beats', self.on_beat, 2 * CALLS)

    def send(self):
        message = Image(height=1, width=1, step=1, encoding='mono8', data=[0])
        message.header.stamp = to_msg(now_ns())
        self.images.publish(message)

    def on_image(self, image):
        self.handled.append(image.stamp_ns)
        if len(self.handled) <= CALLS:
            for _ in range(3):
                self.send()
            self.beats.publish(Empty())

    def on_beat(self, _beat):
        self.waited.append(len(self.handled) - 1 - self.beaten)
        self.beaten += 1


@pytest.mark.parametrize('executor', [EventsExecutor, SingleThreadedExecutor])
def test_other_topics_do_not_wait_behind_images_that_were_dropped(ros, executor):
    with Nodes(slow := Slow(), executor=executor) as nodes:
        nodes.meet()
        slow.send()
        nodes.until(lambda: slow.beaten == CALLS)
    assert (
        max(slow.waited) <= 4
    )  # images handled meanwhile; more and more, were each handled at once
    assert slow.handled == sorted(slow.handled)
    assert len(slow.handled) <= CALLS + DEPTH + 4  # of three times as many


def test_a_node_catches_up_at_once(ros):
    with Nodes(slow := Slow(), executor=EventsExecutor) as nodes:
        nodes.meet()
        slow.send()
        nodes.until(lambda: len(slow.handled) == DEPTH)
        before = len(slow.handled)
        slow.catch_up()
        assert len(slow.handled) > before + 2
