# SPDX-License-Identifier: Apache-2.0
"""A calibration as sensor_msgs/CameraInfo."""

from sensor_msgs.msg import CameraInfo

from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.ros.stamps import now_ns, to_msg
from eol_ros.streams.images import FRAME_ID


def camera_info(calibration: Calibration, frame_prefix: str = '') -> CameraInfo:
    """Return the message: plumb_bob distortion, no rectification, the camera's own matrix."""
    matrix = calibration.camera_matrix
    info = CameraInfo(
        width=calibration.image_width,
        height=calibration.image_height,
        distortion_model='plumb_bob',
        d=[float(v) for v in calibration.distortion_coefficients],
        k=[float(v) for v in matrix.ravel()],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[float(v) for row in matrix for v in (*row, 0.0)],
    )
    info.header.stamp, info.header.frame_id = to_msg(now_ns()), frame_prefix + FRAME_ID
    return info
