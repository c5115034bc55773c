# SPDX-License-Identifier: Apache-2.0
"""mono8 images, and the lens they were taken with, onto the graph as CDR bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo

from eol_ros.ros.definitions import definition
from eol_ros.streams import images

if TYPE_CHECKING:
    from eol_ros.core.vision.calibration.model import Calibration
    from eol_ros.ros.node import EolNode

_STAMP = slice(4, 12)  # of any message that begins with a header, behind the head of CDR


class ImagePublisher:
    """Publishes mono8 images of one size on a topic of `node`.

    Where `info_topic` is given, each image is followed there by what `calibration` says of the
    lens, with the image's stamp, while somebody subscribes. That is encoded once for each size.
    """

    def __init__(
        self,
        node: EolNode,
        topic: str,
        info_topic: str = '',
        calibration: Calibration | None = None,
    ):
        self._publisher = node.publisher(topic)
        self._infos = node.publisher(info_topic) if info_topic else None
        self._codec = images.Codec(definition(images.TYPE), node.frame_prefix)
        self._calibration, self._frame_prefix = calibration, node.frame_prefix
        self._info = bytearray()
        self._info_of: tuple[int, ...] = ()  # the size of images that it is for

    def publish(self, stamp_ns: int, image: np.ndarray) -> None:
        """Publish `image`, shape (height, width) uint8, stamped mid-exposure `stamp_ns`."""
        self.send(self.packed(stamp_ns, image))

    def send(self, packed: bytes) -> None:
        """Publish what `packed` has made."""
        self._publisher.publish(packed)
        if self._infos is not None and self._infos.get_subscription_count():
            if self._info_of != self._codec.shape:
                self._info_of = self._codec.shape
                info = camera_info(self._calibration, self._info_of, self._frame_prefix)
                self._info = bytearray(serialize_message(info))
            self._info[_STAMP] = packed[_STAMP]
            self._infos.publish(bytes(self._info))

    def packed(self, stamp_ns: int, image: np.ndarray) -> bytes:
        """Return the message of `image`, for a sender that must lose no time later."""
        return self._codec.pack(stamp_ns, image)

    def subscribers(self) -> int:
        """Return how many readers there are."""
        return int(self._publisher.get_subscription_count())


def camera_info(
    calibration: Calibration | None, shape: tuple[int, ...], frame_prefix: str
) -> CameraInfo:
    """Return the message without a stamp, for images of `shape` (height, width).

    plumb_bob distortion, no rectification, the camera's own matrix. Without a calibration it says
    the size alone: k of zeros is how ROS marks a camera that is not calibrated.
    """
    info = CameraInfo(height=shape[0], width=shape[1])
    info.header.frame_id = frame_prefix + images.FRAME_ID
    if calibration is not None:
        matrix = calibration.camera_matrix
        info.height, info.width = calibration.image_height, calibration.image_width
        info.distortion_model = 'plumb_bob'
        info.d = calibration.distortion_coefficients.tolist()
        info.k = matrix.ravel().tolist()
        info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        info.p = [value for row in matrix.tolist() for value in (*row, 0.0)]
    return info
