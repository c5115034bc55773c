# SPDX-License-Identifier: Apache-2.0
"""Markers over real DDS: what RViz would draw, and nothing while it is not there."""

import numpy as np
import pytest
from eol_msgs.msg import Slip, Truth
from geometry_msgs.msg import PoseArray
from rclpy.serialization import deserialize_message
from support.spinning import Nodes
from support.tables import on_tables
from visualization_msgs.msg import Marker

from eol_ros.nodes.panel_markers import PERIOD_NS, Markers
from eol_ros.ros.definitions import definition
from eol_ros.ros.node import EolNode
from eol_ros.ros.stamps import to_ns
from eol_ros.scene import Scene
from eol_ros.settings import MotionSettings, PanelSettings
from eol_ros.streams import blocks

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('any_stamp')]
T0 = 1_700_000_000_000_000_000


class Panel(EolNode):
    NAME = 'panel'

    def __init__(self, shape):
        super().__init__(PanelSettings(), Scene('panel', {}, table=shape))
        self.markers = Markers(self)


class Probe(EolNode):
    """Gives what the markers are made of, and looks at them."""

    NAME = 'motion'

    def __init__(self, shape):
        super().__init__(MotionSettings(), Scene('motion', {}, table=shape))
        self.codec = blocks.Codec(definition(blocks.TYPE), cells=shape.cells)
        self.gives = {name: self.publisher(name) for name in ('blocks', 'slips', 'truth')}
        self.seen = []

    def tell(self, number, rows):
        stamp_ns = T0 + number * PERIOD_NS
        self.gives['blocks'].publish(self.codec.pack(stamp_ns, 1, False, number, rows))


@pytest.fixture
def both(ros, table):
    panel, probe = Panel(table), Probe(table)
    with Nodes(panel, probe) as nodes:
        yield panel, probe, nodes.until


def met(probe):
    return [publisher.get_subscription_count() for publisher in probe.gives.values()]


@on_tables
def test_what_rviz_draws_is_the_table(both, table):
    panel, probe, until = both
    hidden, slips, lost = table.ids[[3, 5, 9]].tolist()
    panel.markers.follow()
    until(lambda: panel.markers._publisher.get_subscription_count() == 0)
    assert met(probe) == [0, 0, 0]  # nobody looks: nothing is taken in
    eye = probe.subscribe('markers', probe.seen.append)
    until(lambda: panel.markers._publisher.get_subscription_count())
    panel.markers.follow()
    until(lambda: met(probe) == [1, 1, 1])
    rows = np.zeros(table.cells, blocks.BLOCK)
    rows['x'], rows['y'] = np.where(table.present, table.rest.T, np.nan)
    rows['yaw'], rows['seen'] = 0.1, table.present & (np.arange(table.cells) != hidden)
    probe.tell(1, rows)
    until(lambda: len(probe.seen) == 1)
    first = {(m.ns, m.id): m for m in probe.seen[0].markers}
    assert {m.header.frame_id for m in first.values()} == {'table'}
    assert {to_ns(m.header.stamp) for m in first.values()} == {T0 + PERIOD_NS}
    assert sorted(n for n, _ in first) == ['blocks'] * table.count + ['springs', 'table']
    for block in table.ids.tolist():
        pose = first['blocks', block].pose
        assert (pose.position.x, pose.position.y) == pytest.approx(tuple(table.rest[block]))
        assert 2 * np.arctan2(pose.orientation.z, pose.orientation.w) == pytest.approx(0.1)
    assert first['blocks', hidden].color.a < first['blocks', slips].color.a == 1.0
    between = int((table.springs >= 0).all(axis=1).sum())
    assert len(first['springs', 0].points) == 2 * between

    zeros = np.zeros(table.cells)
    probe.gives['truth'].publish(
        Truth(rim_x=0.02, rim_y=-0.01, rim_yaw=0.05, x=zeros, y=zeros, yaw=zeros,
              moving=[False] * table.cells)
    )  # fmt: skip
    probe.gives['slips'].publish(Slip(kind=Slip.KIND_START, block=slips, x=0.1, y=0.2))
    until(lambda: panel.markers._rim is not None and panel.markers._slipping)
    rows['x'][lost], rows['seen'][lost] = np.nan, False
    probe.tell(2, rows)
    until(lambda: len(probe.seen) == 2)
    second = {(m.ns, m.id): m for m in probe.seen[1].markers}
    assert second['rim', 0].pose.position.x == 0.02
    assert second['blocks', slips].color != first['blocks', slips].color
    assert second['blocks', lost].action == Marker.DELETE
    poses = np.column_stack([rows['x'], rows['y'], rows['yaw']])
    ends = table.spring_ends(poses, np.array([0.02, -0.01, 0.05]))
    known = ends[np.isfinite(ends).all(axis=(1, 2))].reshape(-1, 2)
    points = second['springs', 0].points
    assert np.array([(p.x, p.y) for p in points]) == pytest.approx(known)
    unknown = int((table.springs == lost).any(axis=1).sum())
    assert len(points) == 2 * (len(table.springs) - unknown)

    probe.gives['slips'].publish(Slip(kind=Slip.KIND_STOP, block=slips, x=0.13, y=0.2))
    until(lambda: panel.markers._arrows)
    probe.tell(3, rows)
    probe.tell(4, rows)
    until(lambda: len(probe.seen) == 4)
    arrows = [[m for m in seen.markers if m.ns == 'slips'] for seen in probe.seen[2:]]
    assert [len(found) for found in arrows] == [1, 0]  # it lives by itself
    assert [(p.x, p.y) for p in arrows[0][0].points] == [(0.1, 0.2), (0.13, 0.2)]
    assert arrows[0][0].lifetime.sec > 0

    probe.tell(4, rows)  # too soon
    probe.tell(1, rows)  # a replay begins again
    until(lambda: len(probe.seen) == 5)
    assert 'rim' not in {m.ns for m in probe.seen[4].markers}
    probe.destroy_subscription(eye)
    until(lambda: panel.markers._publisher.get_subscription_count() == 0)
    panel.markers.follow()
    until(lambda: met(probe) == [0, 0, 0])


def test_the_poses_of_the_blocks_alone_are_published_for_those_who_ask(both):
    panel, probe, until = both
    probe.subscribe('block_poses', probe.seen.append, raw=True)
    until(lambda: panel.markers._poses.get_subscription_count())
    panel.markers.follow()
    until(lambda: met(probe) == [1, 1, 1])
    rows = np.zeros(25, blocks.BLOCK)
    rows['x'] = [*np.arange(24) / 10, np.nan]
    probe.tell(1, rows)
    until(lambda: probe.seen)
    found = deserialize_message(probe.seen[0], PoseArray)
    assert (found.header.frame_id, to_ns(found.header.stamp)) == ('table', T0 + PERIOD_NS)
    assert np.array_equal([p.position.x for p in found.poses], rows['x'], equal_nan=True)
    assert {(p.position.y, p.orientation.w) for p in found.poses} == {(0.0, 1.0)}
