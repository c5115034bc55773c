# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.clutter import Cluttered, clutter_calibration
from support.paper import rest_lattice

from eol_ros.core.table import Table
from eol_ros.core.vision.appearance.squares import find_squares, lattice
from eol_ros.core.vision.calibration import calibrate
from eol_ros.core.vision.calibration.model import Calibration

pytestmark = pytest.mark.slow  # the first run compiles
WORN = np.random.default_rng(0)
SCATTER, YAW = WORN.normal(0, 0.003, (25, 2)), WORN.normal(0, 0.05, 25)


def leaning(tilt_deg, heading_deg, px_per_m, width=1280, height=800):
    """A pinhole camera that turns about the table's middle: K [r1 r2 t] (Zhang 2000)."""
    ideal = Calibration.ideal(width, height, px_per_m)
    matrix = ideal.camera_matrix
    tilt, heading = np.radians([tilt_deg, heading_deg])
    x, y = np.cos(heading), np.sin(heading)
    cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])  # about the axis (x, y, 0): Rodrigues
    turn = np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross
    pose = np.diag([1.0, -1.0, -1.0]) @ turn
    seen = matrix @ np.column_stack([pose[:, :2], [0, 0, matrix[0, 0] / px_per_m]])
    return replace(ideal, homography=seen / seen[2, 2])


def drawn(camera, rim=0.0, level='clean', seed=1, **light):
    """An image of blocks beside their places in a rim turned by `rim`, and their poses."""
    c, s = np.cos(rim), np.sin(rim)
    xy = (rest_lattice() + SCATTER) @ [[c, s], [-s, c]]
    renderer = Cluttered(level, camera, seed)
    image = renderer.render(*xy.T, YAW + rim, 0, **light)
    image.flags.writeable = False
    return image, np.column_stack([xy, YAW + rim])


def looked(image, start=None, mirror=False):
    start = start or calibrate.nominal(*image.shape[::-1])
    return find_squares(image, start, mirror)


def off_truth(found, camera, poses):
    """Greatest error of places in px, of angles in rad, and of sides as a share."""
    half = 0.042
    x, y, yaw = poses.T
    ends = [
        camera.to_pixels(np.column_stack([x + half * np.cos(yaw + a), y + half * np.sin(yaw + a)]))
        for a in np.arange(4) * np.pi / 2
    ]
    squares, middle = found.blocks, np.mean(ends, axis=0)
    across, along = ends[0] - ends[2], ends[1] - ends[3]
    s = -1 if camera.mirrored else 1  # by the formula of poses_to_table
    turn = np.arctan2(-across[:, 1] - s * along[:, 0], across[:, 0] - s * along[:, 1])
    wide = np.sqrt(np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]))
    return (
        np.hypot(squares['u'] - middle[:, 0], squares['v'] - middle[:, 1]).max(),
        np.abs(np.angle(np.exp(1j * (squares['theta'] - turn)))).max(),
        np.abs(squares['side_px'] / wide - 1).max(),
    )


@pytest.mark.parametrize(
    ('side_px', 'size'),
    [
        (15, (1280, 800)), (19, (1280, 800)), (30, (640, 400)), (44, (1280, 800)),
        (75, (1280, 800)), (120, (1920, 1200)), (200, (2592, 2048)),
    ],
)  # fmt: skip
def test_blocks_of_any_size_are_found(side_px, size):
    camera = Calibration.ideal(*size, side_px / 0.084)
    image, poses = drawn(camera)
    found = looked(image)
    assert found.seen.all()
    px, turn, side = off_truth(found, camera, poses)
    assert px < 0.1 and turn < 0.02 and side < 0.03


@pytest.mark.parametrize(
    ('tilt_deg', 'heading_deg', 'rim', 'mirror'),
    [(10, 0, -0.7, True), (25, 90, 0.0, False), (40, 200, 0.35, True), (40, 300, -0.7, False)],
)
def test_a_camera_may_lean_and_look_into_a_mirror(tilt_deg, heading_deg, rim, mirror):
    camera = leaning(tilt_deg, heading_deg, 430.0)
    camera = camera.in_mirror() if mirror else camera
    image, poses = drawn(camera, rim)
    found = looked(image, mirror=mirror)
    assert found.seen.all() and found.calibration.mirrored == mirror
    px, turn, side = off_truth(found, camera, poses)
    assert px < 0.1 and turn < 0.02 and side < 0.03
    # the frame is that of the rim: apart from its turn, metres are those of the table
    at = found.calibration.to_table(camera.to_pixels(poses[:, :2]))
    assert np.abs(at - rest_lattice()).max() < 0.015


@pytest.mark.parametrize('level', ['ordinary', 'hard', 'brutal'])
def test_what_lies_about_on_the_table_is_no_block(level):
    camera = clutter_calibration(level)
    image, poses = drawn(camera, 0.1, level, 3)
    shown = Cluttered(level, camera, 3).visible_share(*poses.T, 0) == 1
    found = looked(image)
    assert found.calibration is not None and found.seen[shown].mean() > 0.9
    truth = camera.to_pixels(poses[:, :2])
    off = np.hypot(found.blocks['u'] - truth[:, 0], found.blocks['v'] - truth[:, 1])
    assert off[found.seen].max() < 1.0


def test_most_blocks_are_found_while_some_are_dark():
    camera = leaning(20, 45, 450.0)
    light = np.ones(25)
    light[[0, 1, 2, 3, 4, 12, 23]] = 0.0
    light[7] = 0.3
    image, _ = drawn(camera, ir=light)
    found = looked(image)
    assert (found.seen == (light > 0)).sum() >= 17


def test_images_without_a_lattice():
    dark = np.full((800, 1280), 12, np.uint8)
    dark.flags.writeable = False
    noise = np.random.default_rng(2).integers(0, 255, (800, 1280)).astype(np.uint8)
    noise.flags.writeable = False
    for image in (dark, noise):
        found = looked(image)
        assert found.calibration is None and not found.seen.any()
        assert 'squares seen, not 25' in found.why
    assert len(lattice(dark, Table())[0]) == 0
    lamps = Cluttered('brutal', clutter_calibration('brutal'), 5)
    image = lamps.render(*rest_lattice().T, np.zeros(25), 0, ir=np.zeros(25))
    image.flags.writeable = False
    assert looked(image).calibration is None
