# SPDX-License-Identifier: Apache-2.0
"""Frames for tf2: world -> table -> camera_optical, by the calibration."""

from typing import Any

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from tf2_msgs.msg import TFMessage

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.streams import blocks, images

WORLD = 'world'


class Frames:
    """Publishes `/tf_static` for `node`."""

    def __init__(self, node: Any):
        self._node = node
        self._publisher = node.publisher('/tf_static')

    def publish(self, calibration: Calibration) -> None:
        """Tell where the table and its camera are; a camera in a mirror has no place."""
        table = self._node.frame_prefix + blocks.FRAME_ID
        found = [_transform(WORLD, table, np.eye(3), np.zeros(3))]
        if not calibration.mirrored:
            camera = self._node.frame_prefix + images.FRAME_ID
            found.append(_transform(table, camera, *calibration.camera_pose()))
        self._publisher.publish(TFMessage(transforms=found))


def _transform(
    parent: str, child: str, rotation: np.ndarray, position: np.ndarray
) -> TransformStamped:
    x, y, z = position.tolist()
    transform = Transform(translation=Vector3(x=x, y=y, z=z), rotation=quaternion(rotation))
    found = TransformStamped(child_frame_id=child, transform=transform)
    found.header.frame_id, found.header.stamp = parent, to_msg(now_ns())
    return found


def quaternion(r: np.ndarray) -> Quaternion:
    """Return the quaternion of a rotation matrix (3, 3).

    Each row below is the quaternion (w, x, y, z) times four times one of its parts; the row of the
    largest part is taken (Shepperd 1978), to avoid division by a small number.
    """
    (a, b, c), (d, e, f), (g, h, i) = r.tolist()
    rows = np.array([
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    ])  # fmt: skip
    row = rows[rows.diagonal().argmax()]
    w, x, y, z = (row / np.linalg.norm(row)).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
