# SPDX-License-Identifier: Apache-2.0
"""Frames by the calibration: a point that tf2 moves into the camera is seen where it is."""

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.nodes.panel_frames import Frames, quaternion
from eol_ros.ros.node import EolNode
from eol_ros.settings import PanelSettings


class Panel(EolNode):
    NAME = 'panel'

    def __init__(self):
        super().__init__(PanelSettings())
        self.frames, self.told = Frames(self), []
        self.frames._publisher.publish = self.told.append  # the message, as it is handed to DDS


def turned(q, v):
    """Rotate v (3,) by a quaternion message."""
    axis = np.array([q.x, q.y, q.z])
    return v + 2 * np.cross(axis, np.cross(axis, v) + q.w * v)


def rotation(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


@pytest.mark.parametrize('axis', [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 2, 3), (-1, 1, 0.1)])
@pytest.mark.parametrize('angle', [0.0, 1e-6, 1.0, 3.0, np.pi])
def test_a_quaternion_turns_as_its_matrix(axis, angle):
    matrix = rotation(axis, angle)
    for v in np.eye(3):
        assert turned(quaternion(matrix), v) == pytest.approx(matrix @ v, abs=1e-9)


@pytest.mark.parametrize('tilt', [0.0, 0.2, -0.35])
def test_a_point_of_the_table_is_seen_where_the_frames_say(ros, tilt):
    """A camera that is turned about its x axis, at a height of 1.8 m and aside."""
    ideal = Calibration.ideal()
    axes = rotation((1, 0.3, 0), np.pi + tilt).T  # table to camera
    place = np.array([0.1, -0.2, 1.8])
    columns = np.stack([axes[:, 0], axes[:, 1], -axes @ place], axis=1)
    matrix = ideal.camera_matrix
    camera = Calibration(1280, 800, matrix, np.zeros(5), matrix @ columns, cover_height_m=0.05)
    panel = Panel()
    panel.frames.publish(camera)
    (message,) = panel.told
    names = [(t.header.frame_id, t.child_frame_id) for t in message.transforms]
    assert names == [('world', 'table'), ('table', 'camera_optical')]
    pose = message.transforms[1].transform
    at = np.array([pose.translation.x, pose.translation.y, pose.translation.z])
    assert at == pytest.approx(place + [0, 0, 0.05])
    inverse = pose.rotation
    inverse.x, inverse.y, inverse.z = -inverse.x, -inverse.y, -inverse.z
    for x, y in ((0.0, 0.0), (0.3, 0.2), (-0.4, 0.1)):
        seen = matrix @ turned(inverse, np.array([x, y, 0.05]) - at)
        assert seen[:2] / seen[2] == pytest.approx(camera.to_pixels([[x, y]])[0], abs=1e-6)
    panel.destroy_node()


def test_the_frames_are_latched_and_a_mirror_has_no_camera(ros):
    panel = Panel()
    assert panel.frames._publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    panel.frames.publish(Calibration.ideal(mirror=True))
    assert [t.child_frame_id for t in panel.told[0].transforms] == ['table']
    panel.destroy_node()
