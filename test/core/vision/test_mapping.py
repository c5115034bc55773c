# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from eol_ros.core.geometry import BLOCK_SIDE_M, rest_lattice
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect.blobs import BLOB
from eol_ros.core.vision.render.clutter import clutter_calibration


def rotated(calibration, angle):
    """The same camera, mounted at an angle over the table."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return replace(calibration, homography=calibration.homography @ turn)


CAMERAS = [
    Calibration.ideal(), clutter_calibration('brutal'), rotated(Calibration.ideal(), 0.5),
    clutter_calibration('brutal').in_mirror(), rotated(Calibration.ideal(mirror=True), -2.0),
]  # fmt: skip


@pytest.mark.parametrize('calibration', CAMERAS)
def test_a_square_is_expected_at_the_angle_of_its_picture(calibration):
    """Oracle: the sides of small squares, carried into the image corner by corner."""
    random = np.random.default_rng(6)
    xy, yaw = rest_lattice(), random.uniform(-4, 4, 25)
    ahead = np.zeros((25, 5))
    still, contrast = np.zeros((25, 2)), np.ones(25)
    mapping.expected(calibration.packed(), xy, still, yaw, contrast, 0.0, ahead)
    for place, turn, theta in zip(xy, yaw, ahead[:, 2], strict=True):
        corner = turn + np.arange(5) * np.pi / 2
        ring = place + 0.004 * np.column_stack([np.cos(corner), np.sin(corner)])
        du, dv = np.diff(calibration.to_pixels(ring), axis=0).T
        sides = np.arctan2(-dv, du) - np.pi / 4
        seen = np.angle(np.exp(4j * sides).mean()) / 4
        assert abs(np.sin(2 * (theta - seen - np.pi / 4))) == pytest.approx(1, abs=1e-5)
        assert abs(theta) <= np.pi / 4 + 1e-9
    apart = calibration.yaw_to_image(ahead[:, :2], yaw) - ahead[:, 2]
    assert np.abs(np.sin(2 * apart)).max() < 1e-9


@pytest.mark.parametrize('calibration', CAMERAS)
def test_compiled_and_plain_formulas_agree(calibration):
    random = np.random.default_rng(5)
    xy = rest_lattice() + random.normal(0, 0.01, (25, 2))
    velocity, yaw, contrast = random.normal(0, 0.2, (25, 2)), random.normal(0, 1, 25), np.ones(25)
    ahead = np.zeros((25, 5))
    mapping.expected(calibration.packed(), xy, velocity, yaw, contrast, 0.02, ahead)
    assert np.allclose(ahead[:, :2], calibration.to_pixels(xy + 0.02 * velocity), atol=1e-9)

    blobs = np.zeros(25, BLOB)
    blobs['u'], blobs['v'] = calibration.to_pixels(xy).T
    blobs['theta'], blobs['side_px'], blobs['sigma_px'] = yaw, 45.8, 0.01
    at, turned, sigma = mapping.poses(calibration.packed(), blobs, BLOCK_SIDE_M)
    px = np.column_stack([blobs['u'], blobs['v']])
    plain = calibration.poses_to_table(px, yaw, 45.8)
    assert np.allclose(at, plain[:, :2], atol=1e-9)
    assert np.abs(np.sin(turned - plain[:, 2])).max() < 1e-9
    assert np.allclose(sigma, 0.01 * BLOCK_SIDE_M / 45.8)


def test_an_answer_is_the_square_where_seen_and_the_lattice_where_not():
    calibration = clutter_calibration('hard')
    xy, seen = rest_lattice(), np.arange(25) % 3 > 0
    index = np.where(seen, np.arange(25)[::-1], -1)
    blobs = np.zeros(25, BLOB)
    blobs['u'], blobs['v'] = np.arange(25) * 1.5, np.arange(25) * 2.5
    px, world = np.zeros((25, 2)), np.zeros((25, 2))
    steps = np.array([2.0**-20, 2.0**-10])
    mapping.answer(calibration.packed(), xy, seen, index, blobs, steps, px, world)
    assert np.allclose(px[~seen], calibration.to_pixels(xy[~seen]), atol=2.0**-11)
    assert (px[seen, 0] == 1.5 * index[seen]).all()
    assert np.allclose(world, xy, atol=2.0**-21)
    assert (world / steps[0] == np.rint(world / steps[0])).all()
