# SPDX-License-Identifier: Apache-2.0
"""mono8 images in place, against the serialiser of rclpy."""

import numpy as np
import pytest

pytest.importorskip('sensor_msgs.msg')

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image

from eol_ros.ros.definitions import definition
from eol_ros.streams.images import KNOWN, TYPE, Codec

STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture
def codec():
    return Codec(definition(TYPE))


def image(shape, seed=3):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def message(pixels, frame_id='camera_optical', **fields):
    height, width = pixels.shape
    made = Image(height=height, width=width, encoding='mono8', step=width, data=pixels.tobytes())
    made.header.frame_id = frame_id
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(STAMP_NS, 10**9)
    for name, value in fields.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize('shape', [(8, 12), (7, 5), (1, 1), (101, 77)])
def test_packed_bytes_are_those_of_rclpy(codec, shape):
    pixels = image(shape)
    assert deserialize_message(codec.pack(STAMP_NS, pixels), Image) == message(pixels)
    again = codec.pack(STAMP_NS + 1, ~pixels)
    stamp_ns, read = codec.read(again)
    assert stamp_ns == STAMP_NS + 1
    assert np.array_equal(read, ~pixels)


def test_images_of_several_cameras_are_read_one_after_the_other(codec):
    """Sizes come and go; two messages of one size may have their pixels at different places."""
    for round_ in range(2):
        for k in range(KNOWN + 2):
            pixels = image((20, 16 + k), seed=round_)
            for frame_id in ('a', 'abcde', ''):
                stamp_ns, read = codec.read(serialize_message(message(pixels, frame_id)))
                assert stamp_ns == STAMP_NS and np.array_equal(read, pixels)
    short, long = message(image((4, 6)), 'a' * 7), message(image((4, 5)), 'a' * 11)
    raws = serialize_message(short), serialize_message(long)
    assert len(raws[0]) == len(raws[1])
    for made, raw in zip((short, long, short), (*raws, raws[0]), strict=True):
        assert codec.read(raw)[1].tobytes() == bytes(made.data)


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({'encoding': 'rgb8'}, 'image is rgb8, 12 wide, in steps of 12 bytes: too short'),
        ({'encoding': ''}, "image is ''; known are mono8, "),
        ({'step': 13}, 'image of 12x8 has 96 bytes in steps of 13'),
        ({'height': 9}, 'image of 12x9 has 96 bytes'),
    ],
)
def test_what_is_no_grey_image_is_refused(codec, fields, words):
    good = serialize_message(message(image((8, 12))))
    codec.read(good)  # its layout is known
    with pytest.raises(ValueError, match=words):
        codec.read(serialize_message(message(image((8, 12)), **fields)))
    assert codec.read(good)[0] == STAMP_NS


def test_a_colour_image_and_padded_rows_are_read_in_grey(codec):
    pixels = image((8, 12))
    padded = np.pad(pixels, ((0, 0), (0, 4)))
    made = message(pixels, step=16, data=padded.tobytes())
    assert np.array_equal(codec.read(serialize_message(made)).pixels, pixels)
    colours = np.repeat(pixels, 3, axis=1)
    made = message(pixels, encoding='bgr8', step=36, data=colours.tobytes())
    assert np.array_equal(codec.read(serialize_message(made)).pixels, pixels)
    assert codec.encoding == 'bgr8'


def test_a_message_that_is_cut_is_refused(codec):
    raw = serialize_message(message(image((8, 12))))
    codec.read(raw)
    for size in (0, 3, 20, len(raw) - 1):
        with pytest.raises(ValueError):
            codec.read(raw[:size])
    with pytest.raises(ValueError, match='big-endian'):
        Codec(definition(TYPE)).read(b'\0\0' + raw[2:])
