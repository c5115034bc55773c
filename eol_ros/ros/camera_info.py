# SPDX-License-Identifier: Apache-2.0
"""The lens of a camera as sensor_msgs/CameraInfo."""

from sensor_msgs.msg import CameraInfo

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.streams.images import FRAME_ID


def camera_info(
    calibration: Calibration | None, shape: tuple[int, ...], frame_prefix: str
) -> CameraInfo:
    """Return the message without a stamp, for images of `shape` (height, width).

    plumb_bob distortion, no rectification, the camera's own matrix. Without a calibration it says
    the size alone: k of zeros is how ROS marks a camera that is not calibrated.
    """
    info = CameraInfo(height=shape[0], width=shape[1])
    info.header.frame_id = frame_prefix + FRAME_ID
    if calibration is not None:
        matrix = calibration.camera_matrix
        info.height, info.width = calibration.image_height, calibration.image_width
        info.distortion_model = 'plumb_bob'
        info.d = calibration.distortion_coefficients.tolist()
        info.k = matrix.ravel().tolist()
        info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        info.p = [value for row in matrix.tolist() for value in (*row, 0.0)]
    return info
