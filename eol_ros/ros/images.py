# SPDX-License-Identifier: Apache-2.0
"""mono8 images onto the graph as CDR bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eol_ros.ros.definitions import definition
from eol_ros.streams import images

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode


class ImagePublisher:
    """Publishes mono8 images of one size on a topic of `node`."""

    def __init__(self, node: EolNode, topic: str):
        self._publisher = node.publisher(topic)
        self._codec = images.Codec(definition(images.TYPE), node.frame_prefix)

    def publish(self, stamp_ns: int, image: np.ndarray) -> None:
        """Publish `image`, shape (height, width) uint8, stamped mid-exposure `stamp_ns`."""
        self.send(self.packed(stamp_ns, image))

    def send(self, packed: bytes) -> None:
        """Publish what `packed` has made."""
        self._publisher.publish(packed)

    def packed(self, stamp_ns: int, image: np.ndarray) -> bytes:
        """Return the message of `image`, for a sender that must lose no time later."""
        return self._codec.pack(stamp_ns, image)

    def subscribers(self) -> int:
        """Return how many readers there are."""
        return int(self._publisher.get_subscription_count())
