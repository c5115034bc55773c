# SPDX-License-Identifier: Apache-2.0
"""Markers over real DDS: what RViz would draw, and nothing while it is not there."""

import numpy as np
import pytest
from eol_msgs.msg import Slip, Truth
from geometry_msgs.msg import PoseArray
from rclpy.serialization import deserialize_message
from support.paper import rest_lattice, spring_ends
from support.spinning import Nodes
from visualization_msgs.msg import Marker

from eol_ros.nodes.panel_markers import PERIOD_NS, Markers
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
from eol_ros.settings import MotionSettings, PanelSettings
from eol_ros.streams import blocks

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('any_stamp')]
T0 = 1_700_000_000_000_000_000
ZEROS = np.zeros(25)
TRUTH = Truth(
    rim_x=0.02, rim_y=-0.01, rim_yaw=0.05, x=ZEROS, y=ZEROS, yaw=ZEROS, moving=[False] * 25
)


class Panel(EolNode):
    NAME = 'panel'

    def __init__(self):
        super().__init__(PanelSettings())
        self.markers = Markers(self)


class Table(EolNode):
    """Gives what the markers are made of, and looks at them."""

    NAME = 'motion'

    def __init__(self):
        super().__init__(MotionSettings())
        self.codec = blocks.Codec(definition(blocks.TYPE))
        self.gives = {name: self.publisher(name) for name in ('blocks', 'slips', 'truth')}
        self.seen = []

    def tell(self, number, rows):
        stamp_ns = T0 + number * PERIOD_NS
        self.gives['blocks'].publish(self.codec.pack(stamp_ns, 1, False, number, rows))


@pytest.fixture
def both(ros):
    panel, table = Panel(), Table()
    with Nodes(panel, table) as nodes:
        yield panel, table, nodes.until


def met(table):
    return [publisher.get_subscription_count() for publisher in table.gives.values()]


def test_what_rviz_draws_is_the_table(both):
    panel, table, until = both
    panel.markers.follow()
    until(lambda: panel.markers._publisher.get_subscription_count() == 0)
    assert met(table) == [0, 0, 0]  # nobody looks: nothing is taken in
    eye = table.subscribe('markers', table.seen.append)
    until(lambda: panel.markers._publisher.get_subscription_count())
    panel.markers.follow()
    until(lambda: met(table) == [1, 1, 1])
    rows = np.zeros(25, blocks.BLOCK)
    rows['x'], rows['y'] = rest_lattice().T
    rows['yaw'], rows['seen'] = 0.1, np.arange(25) != 3
    table.tell(1, rows)
    until(lambda: len(table.seen) == 1)
    first = {(m.ns, m.id): m for m in table.seen[0].markers}
    assert {m.header.frame_id for m in first.values()} == {'table'}
    assert {to_ns(m.header.stamp) for m in first.values()} == {T0 + PERIOD_NS}
    assert sorted(n for n, _ in first) == ['blocks'] * 25 + ['springs', 'table']
    for block in range(25):
        pose = first['blocks', block].pose
        assert (pose.position.x, pose.position.y) == pytest.approx(tuple(rest_lattice()[block]))
        assert 2 * np.arctan2(pose.orientation.z, pose.orientation.w) == pytest.approx(0.1)
    assert first['blocks', 3].color.a < first['blocks', 4].color.a == 1.0
    assert len(first['springs', 0].points) == 2 * 40

    table.gives['truth'].publish(TRUTH)
    table.gives['slips'].publish(Slip(kind=Slip.START, block=7, x=0.1, y=0.2))
    until(lambda: panel.markers._rim is not None and panel.markers._slipping)
    rows['x'][9], rows['seen'][9] = np.nan, False
    table.tell(2, rows)
    until(lambda: len(table.seen) == 2)
    second = {(m.ns, m.id): m for m in table.seen[1].markers}
    assert second['rim', 0].pose.position.x == 0.02
    assert second['blocks', 7].color != first['blocks', 7].color
    assert second['blocks', 9].action == Marker.DELETE
    poses = np.column_stack([rows['x'], rows['y'], rows['yaw']])
    ends = spring_ends(poses, np.array([0.02, -0.01, 0.05]))
    known = ends[np.isfinite(ends).all(axis=(1, 2))].reshape(-1, 2)
    points = second['springs', 0].points
    assert np.array([(p.x, p.y) for p in points]) == pytest.approx(known)
    assert len(points) == 2 * (60 - 4)  # those of block 9 are not known

    table.gives['slips'].publish(Slip(kind=Slip.STOP, block=7, x=0.13, y=0.2))
    until(lambda: panel.markers._arrows)
    table.tell(3, rows)
    table.tell(4, rows)
    until(lambda: len(table.seen) == 4)
    arrows = [[m for m in seen.markers if m.ns == 'slips'] for seen in table.seen[2:]]
    assert [len(found) for found in arrows] == [1, 0]  # it lives by itself
    assert [(p.x, p.y) for p in arrows[0][0].points] == [(0.1, 0.2), (0.13, 0.2)]
    assert arrows[0][0].lifetime.sec > 0

    table.tell(4, rows)  # too soon
    table.tell(1, rows)  # a replay begins again
    until(lambda: len(table.seen) == 5)
    assert 'rim' not in {m.ns for m in table.seen[4].markers}
    table.destroy_subscription(eye)
    until(lambda: panel.markers._publisher.get_subscription_count() == 0)
    panel.markers.follow()
    until(lambda: met(table) == [0, 0, 0])


def test_the_poses_of_the_blocks_alone_are_published_for_those_who_ask(both):
    panel, table, until = both
    table.subscribe('block_poses', table.seen.append, raw=True)
    until(lambda: panel.markers._poses.get_subscription_count())
    panel.markers.follow()
    until(lambda: met(table) == [1, 1, 1])
    rows = np.zeros(25, blocks.BLOCK)
    rows['x'] = [*np.arange(24) / 10, np.nan]
    table.tell(1, rows)
    until(lambda: table.seen)
    found = deserialize_message(table.seen[0], PoseArray)
    assert (found.header.frame_id, to_ns(found.header.stamp)) == ('table', T0 + PERIOD_NS)
    assert np.array_equal([p.position.x for p in found.poses], rows['x'], equal_nan=True)
    assert {(p.position.y, p.orientation.w) for p in found.poses} == {(0.0, 1.0)}
