# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.clutter import clutter_calibration
from support.paper import rest_lattice

from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration


def rotated(calibration, angle):
    """The same camera, mounted at an angle over the table."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return replace(calibration, homography=calibration.homography @ turn)


CAMERAS = [
    Calibration.ideal(), clutter_calibration('brutal'), rotated(Calibration.ideal(), 0.5),
    clutter_calibration('brutal').in_mirror(), rotated(Calibration.ideal(mirror=True), -2.0),
]  # fmt: skip


@pytest.mark.parametrize('camera', CAMERAS)
def test_compiled_and_plain_formulas_agree(camera):
    packed, xy = camera.packed(), rest_lattice() + np.random.default_rng(5).normal(0, 0.01, (25, 2))
    px = camera.to_pixels(xy)
    assert np.allclose([mapping.to_pixel(packed, *at) for at in xy], px, atol=1e-9)
    straight = camera.undistort(px)
    assert np.allclose([mapping.undistorted(packed, *at) for at in px], straight, atol=1e-9)
    assert np.allclose([mapping.distorted(packed, *at) for at in straight], px, atol=1e-9)


@pytest.mark.parametrize('camera', CAMERAS)
def test_the_angle_in_the_image_is_that_of_the_picture(camera):
    """Oracle: the sides of small squares, carried into the image corner by corner."""
    xy, yaw = rest_lattice(), np.random.default_rng(6).uniform(-4, 4, 25)
    angles = camera.yaw_to_image(camera.to_pixels(xy), yaw)
    for place, turn, theta in zip(xy, yaw, angles, strict=True):
        corner = turn + np.arange(5) * np.pi / 2
        ring = place + 0.004 * np.column_stack([np.cos(corner), np.sin(corner)])
        du, dv = np.diff(camera.to_pixels(ring), axis=0).T
        sides = np.arctan2(-dv, du) - np.pi / 4
        seen = np.angle(np.exp(4j * sides).mean()) / 4
        assert abs(np.sin(2 * (theta - seen - np.pi / 4))) == pytest.approx(1, abs=1e-5)


def test_answers_lie_on_their_grids():
    rng = np.random.default_rng(7)
    yaw, sigma = rng.normal(0, 1, 25), rng.uniform(1e-6, 1e-3, 25)
    turned, coarse = np.empty((2, 25))
    mapping.rounded(yaw, sigma, 2.0**-16, 64, turned, coarse)
    assert (turned / 2.0**-16 == np.rint(turned / 2.0**-16)).all()
    assert np.abs(turned - yaw).max() <= 2.0**-17
    assert np.abs(coarse / sigma - 1).max() < 0.016
