# SPDX-License-Identifier: Apache-2.0
"""The table as markers for RViz and Foxglove; computed while somebody subscribes, else nothing is.

Namespaces: table, rim, springs, blocks (orange while they slip) and slips, an arrow from where a
slip began to where it ended. The rim is known from the twin alone.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from eol_msgs.msg import Slip, Truth
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from eol_ros.ros.stamps import to_msg
from eol_ros.streams import blocks

PERIOD_NS = 50_000_000  # at most so often: for the eye
HEIGHT_M = 0.04  # of a block, as it is drawn
LIFE = Duration(sec=2)  # of an arrow
SAND, STEEL, SPRING, BLOCK, HIDDEN, SLIPS = (
    ColorRGBA(r=r, g=g, b=b, a=a)
    for r, g, b, a in (
        (0.25, 0.22, 0.2, 1.0), (0.6, 0.62, 0.63, 1.0), (0.6, 0.6, 0.6, 1.0),
        (0.55, 0.54, 0.49, 1.0), (0.55, 0.54, 0.49, 0.4), (1.0, 0.54, 0.36, 1.0),
    )
)  # fmt: skip


class Markers:
    """Publishes `markers` and `block_poses` for `node`; `follow` is to be called now and then."""

    def __init__(self, node: Any):
        self._node = node
        self._publisher = node.publisher('markers')
        self._poses = node.publisher('block_poses')
        self._open: list[Any] = []
        self._forget()

    def _forget(self) -> None:
        self._last_ns = 0
        self._rim: np.ndarray | None = None
        self._slipping: dict[int, tuple[float, float]] = {}  # block -> where it began
        self._arrows: deque[Marker] = deque(maxlen=self._node.table.cells)  # not published yet

    def follow(self) -> None:
        """Subscribe to what markers and poses are made of while somebody subscribes to either."""
        looked_at = any(p.get_subscription_count() for p in (self._publisher, self._poses))
        if looked_at and not self._open:
            self._open = [
                self._node.subscribe('blocks', self._on_blocks),
                self._node.subscribe('slips', self._on_slip),
                self._node.subscribe('truth', self._on_truth),
            ]
        elif self._open and not looked_at:
            while self._open:
                self._node.destroy_subscription(self._open.pop())
            self._forget()

    def _on_truth(self, truth: Truth) -> None:
        self._rim = np.array([truth.rim_x, truth.rim_y, truth.rim_yaw])

    def _on_slip(self, slip: Slip) -> None:
        if slip.kind == Slip.KIND_START:
            self._slipping[slip.block] = slip.x, slip.y
            return
        begin, end = self._slipping.pop(slip.block, None), (slip.x, slip.y)
        if begin is not None and begin != end:
            arrow = self._marker('slips', Marker.ARROW, slip.block, SLIPS, (0.008, 0.02, 0.0))
            arrow.points, arrow.lifetime = _points([begin, end], HEIGHT_M + 0.01), LIFE
            self._arrows.append(arrow)

    def _on_blocks(self, message: blocks.Blocks) -> None:
        if message.stamp_ns < self._last_ns:  # time has gone back: a replay has begun again
            self._forget()
        if message.stamp_ns - self._last_ns < PERIOD_NS:
            return
        self._last_ns = message.stamp_ns
        found = [self._table(), self._springs(message.rows), *self._blocks(message.rows)]
        if self._rim is not None:
            found.append(self._frame(self._rim))
        found += self._arrows
        self._arrows.clear()
        for marker in found:
            marker.header.stamp = to_msg(message.stamp_ns)
        self._publisher.publish(MarkerArray(markers=found))
        there = message.rows[self._node.table.ids]
        poses = PoseArray(poses=[_pose_of(row) for row in there])
        poses.header.stamp = to_msg(message.stamp_ns)
        poses.header.frame_id = self._node.frame_prefix + blocks.FRAME_ID
        self._poses.publish(poses)

    def _marker(
        self, name: str, kind: int, number: int, color: ColorRGBA, scale: Iterable[float]
    ) -> Marker:
        x, y, z = scale
        marker = Marker(ns=name, id=number, type=kind, color=color, scale=Vector3(x=x, y=y, z=z))
        marker.header.frame_id = self._node.frame_prefix + blocks.FRAME_ID
        return marker

    def _table(self) -> Marker:
        width, depth = self._node.table.platform_m
        marker = self._marker('table', Marker.CUBE, 0, SAND, (width, depth, 0.01))
        marker.pose = _pose(0.0, 0.0, 0.0, -0.005)
        return marker

    def _frame(self, rim: np.ndarray) -> Marker:
        bar = self._node.table.rim_width_m
        marker = self._marker('rim', Marker.LINE_STRIP, 0, STEEL, (bar, 0.0, 0.0))
        a, b = ((inner + bar) / 2 for inner in self._node.table.rim_m())
        corners = [(-a, -b), (a, -b), (a, b), (-a, b), (-a, -b)]
        x, y, yaw = rim.tolist()
        marker.pose, marker.points = _pose(x, y, yaw, HEIGHT_M / 2), _points(corners, 0.0)
        return marker

    def _springs(self, rows: np.ndarray) -> Marker:
        marker = self._marker('springs', Marker.LINE_LIST, 0, SPRING, (0.004, 0.0, 0.0))
        places = np.stack([rows[name] for name in ('x', 'y', 'yaw')], 1)
        ends = self._node.table.spring_ends(places, self._rim)
        known = ends[np.isfinite(ends).all(axis=(1, 2))]
        marker.points = _points(known.reshape(-1, 2).tolist(), HEIGHT_M / 2)
        return marker

    def _blocks(self, rows: np.ndarray) -> Iterable[Marker]:
        side = self._node.table.block_side_m
        size = side, side, HEIGHT_M
        for block in self._node.table.ids.tolist():
            row = rows[block]
            color = SLIPS if block in self._slipping else BLOCK if row['seen'] else HIDDEN
            marker = self._marker('blocks', Marker.CUBE, block, color, size)
            pose = _pose_of(row, HEIGHT_M / 2)
            if math.isfinite(pose.position.x + pose.position.y + pose.orientation.z):
                marker.pose = pose
            else:  # the tracker does not know where
                marker.action = Marker.DELETE
            yield marker


def _pose_of(row: np.void, z: float = 0.0) -> Pose:
    return _pose(float(row['x']), float(row['y']), float(row['yaw']), z)


def _pose(x: float, y: float, yaw: float, z: float) -> Pose:
    turn = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return Pose(position=Point(x=x, y=y, z=z), orientation=turn)


def _points(places: Iterable[Iterable[float]], z: float) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y in places]
