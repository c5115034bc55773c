# SPDX-License-Identifier: Apache-2.0
"""Images of other cameras in grey, against what a camera of each encoding would see."""

import cv2
import numpy as np
import pytest

from eol_ros.core.vision.encodings import KNOWN, grey, grey_of_jpeg

SCENE = cv2.GaussianBlur(np.random.default_rng(4).integers(0, 256, (48, 64), np.uint8), (0, 0), 3)
CHANNELS = {'rgb8': 3, 'bgr8': 3, '8UC3': 3, 'rgba8': 4, 'bgra8': 4, '8UC4': 4}


def seen_by(encoding, scene):
    """Return the rows of a camera that sees a grey scene: all its colours are equally bright."""
    if encoding in CHANNELS:
        return np.repeat(scene, CHANNELS[encoding], axis=1)
    if encoding in ('mono16', '16UC1'):
        return (scene.astype('<u2') << 8 | 0x7F).view(np.uint8)
    if encoding in ('yuv422', 'uyvy'):
        return np.stack([np.full_like(scene, 128), scene], axis=-1).reshape(len(scene), -1)
    if encoding in ('yuv422_yuy2', 'yuyv'):
        return np.stack([scene, np.full_like(scene, 128)], axis=-1).reshape(len(scene), -1)
    return scene


@pytest.mark.parametrize('encoding', KNOWN)
@pytest.mark.parametrize('padding', [0, 5])
def test_a_grey_scene_is_the_same_in_every_encoding(encoding, padding):
    rows = np.pad(seen_by(encoding, SCENE), ((0, 0), (0, padding)), constant_values=255)
    found = grey(encoding, rows, SCENE.shape[1])
    assert found.dtype == np.uint8 and found.flags.c_contiguous
    if 'bayer' in encoding:  # neighbours are mixed in
        assert np.abs(found.astype(int) - SCENE)[2:-2, 2:-2].max() <= 6
    else:
        assert np.array_equal(found, SCENE)


@pytest.mark.parametrize(
    ('encoding', 'pattern'),
    [('rgb8', 'rgb'), ('bgr8', 'bgr'), ('rgba8', 'rgbx'), ('bgra8', 'bgrx')],
)
def test_colours_have_their_brightness(encoding, pattern):
    """Weights of ITU-R BT.601."""
    for colour, weight in (('r', 0.299), ('g', 0.587), ('b', 0.114)):
        pixel = [200 if name == colour else 0 for name in pattern]
        found = grey(encoding, np.tile(np.uint8(pixel), (4, 6)), 6)
        assert np.abs(found - 200 * weight).max() <= 1


@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
def test_a_bayer_pattern_begins_with_its_name(pattern):
    tile = np.uint8([200 * (name == 'r') for name in pattern]).reshape(2, 2)
    found = grey(f'bayer_{pattern}8', np.tile(tile, (8, 8)), 16)
    assert np.abs(found[4:-4, 4:-4] - 200 * 0.299).max() <= 1


def test_the_higher_byte_is_taken_in_either_order():
    wide = (SCENE.astype('u2') << 8).astype('>u2')
    assert np.array_equal(grey('mono16', wide.view(np.uint8), 64, big_endian=True), SCENE)


@pytest.mark.parametrize(
    ('encoding', 'shape', 'words'),
    [
        ('jpeg', (4, 8), "is 'jpeg'; known are mono8,"),
        ('rgb8', (4, 23), 'rgb8, 8 wide, in steps of 23 bytes: too short'),
        ('mono16', (4, 15), 'too short'),
        ('bayer_rggb8', (4, 7), 'too short'),
    ],
)
def test_what_cannot_be_converted_is_refused(encoding, shape, words):
    with pytest.raises(ValueError, match=words):
        grey(encoding, np.zeros(shape, np.uint8), 8)


@pytest.mark.parametrize('shape', [(1, 1), (1, 8), (2, 2), (3, 3)])
@pytest.mark.parametrize('encoding', ['bayer_rggb8', 'bayer_grbg8'])
def test_an_image_too_small_for_its_pattern_is_no_fault(encoding, shape):
    try:
        assert grey(encoding, np.zeros(shape, np.uint8), shape[1]).shape == shape
    except ValueError:
        pass


def test_jpeg():
    done, jpeg = cv2.imencode('.jpg', SCENE, [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert done and np.abs(grey_of_jpeg(jpeg.ravel()).astype(int) - SCENE).max() < 8
    for bad in (jpeg.ravel()[:0], jpeg.ravel()[:200], np.zeros(100, np.uint8)):
        with pytest.raises(ValueError, match='no JPEG or PNG'):
            grey_of_jpeg(bad)
