# SPDX-License-Identifier: Apache-2.0
"""Nodes behind a replay: their time is that of /clock, and they notice when it goes back."""

import time

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support.spinning import Nodes

from eol_ros.errors import ConfigError
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_msg
from eol_ros.ros.topics import CLOCK, CLOCK_QOS
from eol_ros.settings import MotionSettings

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
SIM = [Parameter('use_sim_time', value=True)]


class Plain(EolNode):
    NAME = 'motion'

    def __init__(self, **kwargs):
        super().__init__(MotionSettings(), **kwargs)
        self.restarts = self.ticks = 0
        self.create_timer(0.01, self.tick)

    def tick(self):
        self.ticks += 1

    def restart(self):
        self.restarts += 1


class Mapping(Plain):
    MAPS_TIME = True


class Rig(Nodes):
    def __init__(self, ros, executor, kind):
        super().__init__(executor=executor)
        self.node = self.add(kind(parameter_overrides=SIM))
        self.source = ros.create_node('source')
        self.clock = self.source.create_publisher(Clock, CLOCK, CLOCK_QOS)
        self.until(lambda: self.clock.get_subscription_count() >= 1 + kind.MAPS_TIME)

    def tell(self, recorded_ns):
        self.clock.publish(Clock(clock=to_msg(recorded_ns)))
        self.until(lambda: self.node.get_clock().now().nanoseconds == recorded_ns)
        self.turn()

    def close(self):
        super().close()
        self.source.destroy_node()


@pytest.fixture(
    params=[(EventsExecutor, Plain), (EventsExecutor, Mapping), (SingleThreadedExecutor, Mapping)]
)
def rig(ros, request):
    with Rig(ros, *request.param) as made:
        yield made


def test_time_is_what_the_clock_tells_and_timers_go_on_where_it_stands(rig):
    assert rig.node.now_ns() == 0
    rig.tell(T0)
    assert abs(rig.node.now_ns() - T0) < 100 * MS
    ticks = rig.node.ticks
    rig.until(lambda: rig.node.ticks > ticks + 5)


def test_a_jump_back_is_told_once_and_a_jump_ahead_is_not(rig):
    rig.tell(T0)
    rig.tell(T0 + 10**12)
    assert rig.node.restarts == 0
    rig.tell(T0)
    rig.until(lambda: rig.node.restarts == 1)
    rig.tell(T0 + 10 * MS)
    assert rig.node.restarts == 1


def test_a_moment_is_mapped_to_when_it_was_played(ros):
    rig = Rig(ros, EventsExecutor, Mapping)
    played = {}
    for k in range(30):
        time.sleep(0.01)
        played[T0 + k * 5 * MS] = time.time_ns()  # at half the speed
        rig.tell(T0 + k * 5 * MS)
    for stamp, when in list(played.items())[-10:]:
        assert abs(rig.node.wall_ns(stamp) - when) < 1000 * MS  # how near, is core's to show
    before = time.time_ns()
    assert rig.node.wall_ns(T0 + 10**10) >= before  # of the round before: now
    rig.close()


def test_without_it_time_is_system_time(ros):
    node = Mapping()
    assert abs(node.now_ns() - time.time_ns()) < 100 * MS
    assert (node.wall_ns(T0), node.recorded_ns(T0)) == (T0, T0)
    node.destroy_node()


def test_use_sim_time_is_true_or_false_and_is_read_at_the_start(ros):
    with pytest.raises(ConfigError, match="'use_sim_time' to 'yes' .* expecting type 'BOOL'"):
        Plain(parameter_overrides=[Parameter('use_sim_time', value='yes')])
    node = Plain()
    (result,) = node.set_parameters(SIM)
    assert not result.successful and 'start it again' in result.reason
    node.destroy_node()


def test_a_source_of_images_refuses_the_time_of_others(ros):
    from eol_ros.nodes.camera import CameraNode
    from eol_ros.settings import CameraSettings

    with pytest.raises(ConfigError, match='^use_sim_time: camera stamps its images itself'):
        CameraNode(CameraSettings(), parameter_overrides=SIM)
