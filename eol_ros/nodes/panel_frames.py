# SPDX-License-Identifier: Apache-2.0
"""Frames for tf2: world -> table -> camera_optical, by the calibration."""

import math
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

    The largest of its four parts is taken first (Shepperd 1978), so none is divided by a small one.
    """
    parts = np.array([np.trace(r), *np.diag(r)])
    k = int(parts.argmax())
    if k == 0:
        w = math.sqrt(1 + parts[0]) / 2
        x, y, z = (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]) / np.array(4 * w)
        return Quaternion(x=float(x), y=float(y), z=float(z), w=w)
    i, j, m = k - 1, k % 3, (k + 1) % 3
    q = np.zeros(4)
    q[i] = math.sqrt(1 + r[i, i] - r[j, j] - r[m, m]) / 2
    q[j], q[m] = (r[j, i] + r[i, j]) / (4 * q[i]), (r[m, i] + r[i, m]) / (4 * q[i])
    q[3] = (r[m, j] - r[j, m]) / (4 * q[i])
    x, y, z, w = q.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
