# SPDX-License-Identifier: Apache-2.0
"""Images: sensor_msgs/Image to and from the wire without a copy too many; mono8 is ours.

rclpy checks each byte that is assigned to `Image.data`, 47 ms a megabyte. So a message of the right
size is encoded once from the definition, and only stamp and pixels are written into it; one that is
read is looked into where it lies. What other cameras publish is converted to grey.
"""

from typing import Any, NamedTuple

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.streams.cdr import NS, Decoder, Fixed, words

TYPE = 'sensor_msgs/msg/Image'
FRAME_ID = 'camera_optical'
KNOWN = 4  # layouts kept: a camera has one
_HEAD = ('header.stamp', 'height', 'width', 'encoding', 'is_bigendian', 'step')


class Grey(NamedTuple):
    """One image: the stamp in nanoseconds and (height, width) uint8, a view of a mono8 message."""

    stamp_ns: int
    pixels: np.ndarray


class Codec:
    """Writes mono8 images by the definition of sensor_msgs/msg/Image, and reads images.

    encoding: that of the last image that was converted to grey; '' where none was.
    """

    def __init__(self, definition: str, frame_prefix: str = ''):
        self._frame_id = frame_prefix + FRAME_ID
        self._decoder = Decoder(TYPE, definition)
        self._shape: tuple[int, ...] = ()
        self.encoding = ''
        self._known: dict[int, tuple[Fixed, tuple[str, int, int]]] = {}  # by size

    def pack(self, stamp_ns: int, image: np.ndarray) -> bytes:
        """Return the CDR bytes of an image (height, width) uint8, stamped mid-exposure."""
        if image.shape != self._shape:
            self._make(image.shape)
        self._stamp(divmod(stamp_ns, NS))
        np.copyto(self._pixels, image)
        return bytes(self._raw)

    @property
    def shape(self) -> tuple[int, ...]:
        """Height and width of the last image that was packed; empty before."""
        return self._shape

    def _make(self, shape: tuple[int, ...]) -> None:
        height, width = shape
        head = words(0, 0, self._frame_id, height, width, 'mono8', b'\0', width, height * width)
        self._raw = head + bytes(height * width)
        layout = self._decoder.layout(self._raw)
        self._stamp = Fixed(layout, ('header.stamp',)).writer(self._raw)
        _, start, count = layout.at('data')
        self._pixels = np.frombuffer(self._raw, np.uint8, count, start).reshape(shape)
        self._shape = shape

    def read(self, raw: bytes) -> Grey:
        """Return the image in `raw` in grey; raises ValueError when it cannot be, or is empty.

        See `core.vision.encodings` for the encodings.
        """
        found = self._known.get(len(raw))
        values = found[0].values(raw) if found else None
        if found is None or values is None:  # the first, or one of another camera
            try:
                layout = self._decoder.layout(raw)
            except ConfigError as error:
                raise ValueError(str(error)) from None
            found = Fixed(layout, _HEAD), layout.at('data')
            values = found[0].values(raw)
            if len(self._known) == KNOWN:
                self._known.clear()
            self._known[len(raw)] = found
        if values is None:
            raise ValueError('image is big-endian, which ROS 2 does not write here')
        (seconds, nanoseconds), height, width, encoding, big_endian, step = values
        _, start, count = found[1]
        if count != height * step or not width or not count:
            raise ValueError(f'image of {width}x{height} has {count} bytes in steps of {step}')
        pixels = np.frombuffer(raw, np.uint8, count, start).reshape(height, step)
        if step != width or encoding not in (b'mono8', b'8UC1'):
            from eol_ros.core.vision.encodings import grey  # OpenCV, for those who need it

            name = encoding.decode(errors='replace')
            pixels = grey(name, pixels, width, bool(big_endian))
            self.encoding = '' if name in ('mono8', '8UC1') else name
        return Grey(seconds * NS + nanoseconds, pixels)


def read_compressed(message: Any) -> Grey:
    """Return a sensor_msgs/CompressedImage in grey; raises ValueError when it is no JPEG or PNG."""
    from eol_ros.core.vision.encodings import grey_of_jpeg

    stamp = message.header.stamp
    pixels = grey_of_jpeg(np.frombuffer(message.data, np.uint8))
    return Grey(stamp.sec * NS + stamp.nanosec, pixels)
