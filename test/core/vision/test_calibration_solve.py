# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.clutter import Cluttered, clutter_calibration
from support.paper import rest_lattice
from support.relief import films, scene

from eol_ros.core.vision.calibration import calibrate
from eol_ros.core.vision.calibration.corners import corners
from eol_ros.errors import ConfigError

pytestmark = pytest.mark.slow  # the first run compiles
GRID = np.stack(np.meshgrid(*[np.linspace(-0.4, 0.4, 5)] * 2), -1).reshape(-1, 2)


def still(level='ordinary', seed=0, scatter=0.003):
    """One image of resting blocks without arms, its poses, and the renderer."""
    rng = np.random.default_rng(seed)
    renderer = Cluttered(level, clutter_calibration(level), 11)
    xy = rest_lattice() + rng.normal(0, scatter, (25, 2))
    yaw = rng.normal(0, 0.05, 25)
    index = next(
        k
        for k in range(0, 3000, 30)
        if renderer.visible_share(*xy.T, yaw, k).min() == 1 and not len(renderer.scenery.arms(k)[0])
    )
    return renderer.render(*xy.T, yaw, index).copy(), np.column_stack([xy, yaw]), renderer


def view(image):
    squares = calibrate.all_blocks(image, calibrate.nominal(1280, 800), False)
    return np.arange(25), corners(image, squares)


def test_blocks_alone_give_lens_tilt_and_metres():
    views, truth = [], clutter_calibration('ordinary')
    for seed in range(3):
        image = still(seed=seed)[0]
        views.append(view(image))
    solved = calibrate.from_blocks(views, calibrate.nominal(1280, 800), cover_height_m=0.05)
    camera = solved.calibration
    assert solved.refusal() == ''
    assert camera.residual_px < 0.1
    assert camera.residual_mm == pytest.approx(camera.residual_px / camera.px_per_m() * 1e3)
    assert camera.cover_height_m == 0.05
    off = camera.to_table(truth.to_pixels(GRID)) - GRID
    # the blocks' scatter on the lattice is what is left: 3 mm over 75 places
    assert np.sqrt((off**2).mean()) < 1.5e-3
    stretch = np.ptp(off[:, 0]) + np.ptp(off[:, 1])
    assert stretch < 3e-3
    assert camera.distortion_coefficients[0] == pytest.approx(-0.08, abs=0.02)
    assert set(solved.by_name()) == {f'block {i}' for i in range(25)}
    assert (solved.corner_mm > 0).all()


def pushed(seed, camera, rim=(0.0, 0.0, 0.0), noise_px=0.03):
    """Ids and corners (25, 4, 2) px of blocks that were stirred, in a rim at x, y, yaw."""
    rng = np.random.default_rng(seed)
    half = 0.042 * np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]])
    xy = rest_lattice() + rng.normal(0, 0.003, (25, 2))
    found = []
    for place, yaw in zip(xy, rng.normal(0, 0.05, 25), strict=True):
        c, s = np.cos(yaw), np.sin(yaw)
        found.append(place + half @ [[c, s], [-s, c]])
    c, s = np.cos(rim[2]), np.sin(rim[2])
    table = np.array(found) @ [[c, s], [-s, c]] + rim[:2]
    px = camera.to_pixels(table.reshape(-1, 2)).reshape(25, 4, 2)
    return np.arange(25), px + rng.normal(0, noise_px, (25, 4, 2))


def test_the_rim_may_be_pushed_and_turned_between_images():
    truth = clutter_calibration('hard')
    rims = np.array([[0.05, -0.03, 0.2], [-0.04, 0.05, -0.15], [-0.01, -0.02, -0.05]])
    views = [pushed(seed, truth, rim) for seed, rim in enumerate(rims)]
    solved = calibrate.from_blocks(views, calibrate.nominal(1280, 800))
    assert solved.refusal() == '' and solved.calibration.residual_px < 0.1
    # the frame is the mean of the rim's places
    off = solved.calibration.to_table(truth.to_pixels(GRID)) - GRID
    assert np.sqrt((off**2).mean()) < 1.5e-3
    assert solved.calibration.distortion_coefficients[0] == pytest.approx(-0.12, abs=0.02)


@pytest.mark.parametrize('tilt_deg, most_m', [(0.0, 1e-4), (10.0, 1.5e-3)])
def test_pixels_are_square_though_a_leaning_camera_may_look_beside_its_axis(tilt_deg, most_m):
    truth = scene.View(tilt_deg=tilt_deg, heading_deg=30.0).calibration()
    matrix = truth.camera_matrix + [[60.0, 0, 10.0], [0, 60.0, -10.0], [0, 0, 0]]
    seen = replace(
        truth,
        camera_matrix=matrix,
        homography=matrix @ np.linalg.inv(truth.camera_matrix) @ truth.homography,
    )
    views = [pushed(seed, seen, noise_px=0.2) for seed in range(3)]
    solved = calibrate.from_blocks(views, calibrate.nominal(1280, 800), lens=0, corner_sigma_px=0.2)
    off = solved.calibration.to_table(seen.to_pixels(GRID)) - GRID
    fit = np.linalg.lstsq(np.column_stack([GRID, np.ones(25)]), off, rcond=None)[0]
    stretch, shear = fit[0, 0] - fit[1, 1], fit[0, 1] + fit[1, 0]
    assert 0.7 * max(abs(stretch), abs(shear)) < most_m  # at the platform's edge


def test_what_is_no_calibration_is_refused():
    ids, found = view(still()[0])
    bent = found + 4 * np.sin(found / 60)  # no camera sees so
    solved = calibrate.from_blocks([(ids, bent)], calibrate.nominal(1280, 800))
    assert 'residual' in solved.refusal()


def test_a_cover_that_is_refused_at_first_sight_is_looked_for_and_what_is_left_out_is_said():
    film = films.one('tilted-0-1', films.TURNED)
    image = films.sensed(film.light, 1)
    camera = films.calibration(film, True)
    start = replace(
        calibrate.nominal(1280, 800), cover_height_m=films.SKIRT_M, covers=camera.covers
    )
    blobs = calibrate.all_blocks(image, start, False)
    truth = camera.to_pixels(film.shot.poses[:, :2])
    assert np.hypot(*(truth - np.column_stack([blobs['u'], blobs['v']])).T).max() < 3
    hidden = image.copy()
    hidden[:, :640] = 4
    solved = calibrate.from_images(
        [image, hidden], calibrate.nominal(1280, 800), films.SKIRT_M, camera.covers
    )
    assert '1 of 2 images left out' in solved.note and 'squares seen, not 25' in solved.note


def test_all_covers_are_found_at_first_sight_under_a_camera_that_leans():
    # a camera that hangs straight expects covers up to 7 % larger or smaller than they are here
    film = films.one('steep-3', films.STIRRED)
    camera = films.calibration(film, True)
    start = replace(
        calibrate.nominal(1280, 800), cover_height_m=films.SKIRT_M, covers=camera.covers
    )
    truth = camera.to_pixels(film.shot.poses[:, :2])
    for seed in range(4):
        image = films.sensed(film.light * np.float32(1.4), seed)
        blobs = calibrate.all_blocks(image, start, False)  # two of these showed 24, and refused
        assert np.hypot(*(truth - np.column_stack([blobs['u'], blobs['v']])).T).max() < 4


def test_a_wrong_click_is_named():
    truth = clutter_calibration('clean')
    xy = np.array([[-0.7, -0.7], [0.7, -0.7], [0.7, 0.7], [-0.7, 0.7], [0, 0], [0.3, 0.3]])
    px = truth.to_pixels(xy)
    px[4] += [9.0, 0.0]
    refusal = calibrate.from_points(px, xy, calibrate.nominal(1280, 800)).refusal()
    assert 'point 5' in refusal


@pytest.mark.parametrize(
    ('xy', 'words'),
    [
        (np.zeros((3, 2)), 'at least 4'),
        (np.column_stack([np.arange(5.0), np.arange(5.0)]), 'one line'),
    ],
)
def test_points_that_say_too_little(xy, words):
    with pytest.raises(ConfigError, match=words):
        calibrate.from_points(xy * 100 + 50, xy, calibrate.nominal(1280, 800))


@pytest.mark.parametrize('mirror', [1, -1])
def test_a_raised_plane_is_seen_as_geometry_says(mirror):
    """Oracle: points 60 mm above the platform, projected by K [R t] written out."""
    angle, far = 0.1, 1000 / 545
    turn = np.array(
        [[1, 0, 0], [0, -np.cos(angle), -np.sin(angle)], [0, np.sin(angle), -np.cos(angle)]]
    ) @ np.diag([mirror, 1, 1])
    start = calibrate.nominal(1280, 800)
    homography = start.camera_matrix @ np.column_stack([turn[:, :2], [0, 0, far]])
    raised = calibrate.raise_plane(replace(start, homography=homography / homography[2, 2]), 0.06)
    world = np.column_stack([GRID, np.full(len(GRID), 0.06)])
    seen = (world @ turn.T + [0, 0, far]) @ start.camera_matrix.T
    assert np.abs(raised.to_pixels(GRID) - seen[:, :2] / seen[:, 2:]).max() < 1e-6
