# SPDX-License-Identifier: Apache-2.0
"""A camera that looks through a mirror: places, names and yaw come out as without one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.clutter import Cluttered, clutter_calibration
from support.paper import rest_lattice

from eol_ros.core.vision.calibration.charuco import Board, from_board
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.requests import CALIBRATE
from eol_ros.core.vision.states import CALIBRATING, TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow
GRID = np.stack(np.meshgrid(*[np.linspace(-0.4, 0.4, 5)] * 2), -1).reshape(-1, 2)


def flipped(image):
    return np.ascontiguousarray(image[:, ::-1])


def of_flipped(camera):
    """Oracle: the calibration of the images of `camera` turned left for right, written out."""
    last = camera.image_width - 1
    matrix, lens = camera.camera_matrix.copy(), camera.distortion_coefficients.copy()
    matrix[0, 2], lens[3] = last - matrix[0, 2], -lens[3]
    turn = np.array([[-1, 0, last], [0, 1, 0], [0, 0, 1.0]])
    return replace(
        camera,
        camera_matrix=matrix,
        distortion_coefficients=lens,
        homography=turn @ camera.homography,
    )


def test_the_virtual_camera_draws_the_mirror_image():
    rng = np.random.default_rng(1)
    xy, yaw = rest_lattice() + rng.normal(0, 0.01, (25, 2)), rng.normal(0, 0.3, 25)
    velocity = rng.normal(0, 0.3, (25, 3))
    options = RenderOptions(noise='none')
    direct = Renderer(options, Calibration.ideal()).render(*xy.T, yaw, 0, velocity=velocity)
    mirror = Renderer(options, Calibration.ideal(mirror=True)).render(
        *xy.T, yaw, 0, velocity=velocity
    )
    assert np.abs(flipped(mirror).astype(int) - direct).max() <= 1


def scene(k):
    """Poses of a table that is pushed and turned."""
    angle = 0.8 * min(k / 60, 1)
    c, s = np.cos(angle), np.sin(angle)
    return rest_lattice() @ np.array([[c, s], [-s, c]]) + [0.0005 * k, 0.0], angle


@pytest.mark.parametrize('level', ['ordinary', 'hard'])
def test_a_mirror_costs_no_accuracy_and_no_name(level):
    camera = clutter_calibration(level)
    renderer = Cluttered(level, camera, 2)
    direct = Tracker(TrackerSettings(), camera)
    mirror = Tracker(TrackerSettings(), of_flipped(camera))
    errors = {direct: [], mirror: []}
    turns = {direct: [], mirror: []}
    for k in range(90):
        xy, angle = scene(k)
        image = renderer.render(*xy.T, np.full(25, angle), k)
        for tracker, seen_by in ((direct, image), (mirror, flipped(image))):
            tracked = tracker.update(k / 60, seen_by)
            if k > 3:
                assert tracked.state == TRACKING
                whole = tracked.seen & (tracked.visibility > 0.98)
                errors[tracker].append((tracked.world - xy)[whole])
                turns[tracker].append((tracked.yaw - angle)[whole])
    without, through = (np.concatenate(errors[t]) for t in (direct, mirror))
    assert len(through) == pytest.approx(len(without), rel=0.02)
    assert np.abs(through).max() < 2e-3  # a wrong name would be 17 cm
    assert np.sqrt((through**2).mean()) == pytest.approx(np.sqrt((without**2).mean()), rel=0.05)
    without, through = (np.concatenate(turns[t]) for t in (direct, mirror))
    assert np.sqrt((through**2).mean()) == pytest.approx(np.sqrt((without**2).mean()), rel=0.05)
    assert np.sqrt((through**2).mean()) < 5e-3


def test_without_a_file_the_settings_say_it_and_a_new_calibration_keeps_it():
    renderer = Renderer(RenderOptions(), Calibration.ideal(), 2)
    xy = rest_lattice() + np.random.default_rng(3).normal(0, 5e-4, (25, 2))
    images = [flipped(renderer.render(*xy.T, np.full(25, 0.02), k)) for k in range(80)]
    tracker = Tracker(TrackerSettings(mirror=True), None)
    states = [tracker.update(k / 60, images[k]) for k in range(40)]
    assert states[0].state == CALIBRATING
    assert states[-1].state == TRACKING
    assert np.abs(states[-1].world - xy).max() < 1.5e-3
    assert np.abs(states[-1].yaw - 0.02).max() < 2e-3
    tracker.requests.add(0, CALIBRATE)
    states = [tracker.update(k / 60, images[k]) for k in range(40, 80)]
    assert tracker.outcome.text.startswith('calibrated')
    assert tracker.calibration.mirrored
    assert np.abs(states[-1].world - xy).max() < 1.5e-3


def pictured(board, camera, turn, place, distortion):
    """The printed board seen by a pinhole camera with a lens."""
    flat = board.picture(40)
    height, width = flat.shape
    scale = board.square_m / 40
    # board px -> metres about its centre, x right, y away
    to_metres = np.array(
        [[scale, 0, -scale * (width - 1) / 2], [0, -scale, scale * (height - 1) / 2], [0, 0, 1]]
    )
    pose = np.column_stack([turn[:, :2], place])
    seen = camera @ pose @ to_metres
    image = cv2.warpPerspective(flat, seen, (1280, 800), flags=cv2.INTER_AREA, borderValue=120)
    v, u = np.mgrid[0:800, 0:1280].astype(np.float32)
    points = np.stack([u.ravel(), v.ravel()], 1)[:, None]
    source = cv2.undistortPoints(points, camera, distortion, P=camera)
    mapped = source.reshape(800, 1280, 2)
    return cv2.remap(image, mapped[..., 0], mapped[..., 1], cv2.INTER_LINEAR, borderValue=120)


@pytest.mark.parametrize('mirror', [False, True])
def test_a_board_gives_lens_and_table(mirror):
    board = Board(9, 7, 0.07, 0.052)
    camera = np.array([[1040, 0, 630.0], [0, 1040, 405], [0, 0, 1]])
    lens, down = np.array([-0.12, 0.02, 0, 0, 0]), np.diag([1.0, -1, -1])
    tilts = [(0, 0), (0.35, 0), (-0.35, 0.1), (0, 0.4), (0.1, -0.4), (0.3, 0.3), (-0.25, -0.3)]
    images = []
    for a, b in tilts:
        held = a or b
        turn = cv2.Rodrigues(np.array([a, b, 0.05]))[0] @ down if held else down
        place = np.array([0.02, -0.01, 1.1 if held else 1.3])
        image = pictured(board, camera, turn, place, lens)
        images.append(flipped(image) if mirror else image)
    truth = replace(
        Calibration.ideal(),
        camera_matrix=camera,
        distortion_coefficients=lens,
        homography=camera @ np.column_stack([down[:, :2], [0.02, -0.01, 1.3]]),
    )
    truth = of_flipped(truth) if mirror else truth
    solved = from_board(images, board, mirror=mirror)
    found = solved.calibration
    assert solved.refusal() == ''
    assert found.camera_matrix[0, 0] == pytest.approx(1040, rel=0.02)
    assert found.camera_matrix[0, 2] == pytest.approx(truth.camera_matrix[0, 2], abs=8)
    assert found.distortion_coefficients[0] == pytest.approx(-0.12, abs=0.02)
    off = found.to_table(truth.to_pixels(GRID * 0.6)) - GRID * 0.6
    assert np.abs(off).max() < 1e-3
    if mirror:
        return
    with pytest.raises(ConfigError, match='leave out --mirror'):
        from_board(images[:1], board, mirror=True)
    with pytest.raises(ConfigError, match='first image shows 0'):
        from_board([np.zeros((800, 1280), np.uint8)], board)
    with pytest.raises(ConfigError, match='not an ArUco dictionary'):
        replace(board, dictionary='DICT_NONE').made()
