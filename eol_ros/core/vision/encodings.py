# SPDX-License-Identifier: Apache-2.0
"""Images of other cameras as grey ones: encodings of sensor_msgs/image_encodings, and JPEG.

Every conversion is one of integers: the same bits on every processor.
"""

import cv2
import numpy as np

GREY = ('mono8', '8UC1')
# OpenCV names a Bayer pattern by its second row; these names are those of its first one, as in ROS.
_BAYER = {
    'bayer_rggb8': cv2.COLOR_BayerRGGB2GRAY,
    'bayer_bggr8': cv2.COLOR_BayerBGGR2GRAY,
    'bayer_gbrg8': cv2.COLOR_BayerGBRG2GRAY,
    'bayer_grbg8': cv2.COLOR_BayerGRBG2GRAY,
}
_COLOURS = {
    'rgb8': (3, cv2.COLOR_RGB2GRAY),
    'bgr8': (3, cv2.COLOR_BGR2GRAY),
    '8UC3': (3, cv2.COLOR_BGR2GRAY),
    'rgba8': (4, cv2.COLOR_RGBA2GRAY),
    'bgra8': (4, cv2.COLOR_BGRA2GRAY),
    '8UC4': (4, cv2.COLOR_BGRA2GRAY),
}
# Formats of two bytes a pixel of which one is the brightness, by its place.
_YUV = {'yuv422': 1, 'uyvy': 1, 'yuv422_yuy2': 0, 'yuyv': 0}
_WIDE = ('mono16', '16UC1')
KNOWN = (*GREY, *_COLOURS, *_WIDE, *_YUV, *_BAYER)


def grey(encoding: str, rows: np.ndarray, width: int, big_endian: bool = False) -> np.ndarray:
    """Return an image as (height, width) uint8.

    encoding: one of KNOWN. rows: (height, step) uint8; what a row has behind its pixels is left
    out. big_endian: order of the two bytes of `mono16`, of which the higher one is taken. Raises
    ValueError for another encoding, or rows that are shorter than their pixels.
    """
    channels, code = _COLOURS.get(encoding, (2 if encoding in _YUV or encoding in _WIDE else 1, 0))
    if encoding not in KNOWN:
        raise ValueError(f'image is {encoding!r}; known are {", ".join(KNOWN)}')
    if rows.shape[1] < channels * width:
        raise ValueError(
            f'image is {encoding}, {width} wide, in steps of {rows.shape[1]} bytes: too short'
        )
    pixels = rows[:, : channels * width]
    try:
        if encoding in _COLOURS:
            return cv2.cvtColor(pixels.reshape(len(rows), width, channels), code)
        if encoding in _BAYER:
            return cv2.cvtColor(np.ascontiguousarray(pixels), _BAYER[encoding])
    except cv2.error as error:
        raise ValueError(f'image is {encoding}, {width}x{len(rows)}: {error.err}') from None
    first = _YUV.get(encoding, int(not big_endian)) if channels == 2 else 0
    return np.ascontiguousarray(pixels[:, first::channels])


def grey_of_jpeg(data: np.ndarray) -> np.ndarray:
    """Return the image of a JPEG or PNG file, (n,) uint8, as (height, width) uint8.

    Raises ValueError where it is none.
    """
    try:
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        image = None
    if image is None:
        raise ValueError(f'{len(data)} bytes that are no JPEG or PNG image')
    return np.asarray(image, np.uint8)
