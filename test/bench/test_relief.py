# SPDX-License-Identifier: Apache-2.0
"""The tracker and the calibration on path-traced covers."""

from dataclasses import replace

import numpy as np
import pytest
from support.paper import BLOCK_SIDE_M, PLATFORM_SIDE_M
from support.relief import films

from benchmarks import vision_relief
from eol_ros.core.motion.motion import Motion
from eol_ros.core.vision.calibration.calibrate import from_images, nominal
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.requests import CALIBRATE
from eol_ros.core.vision.tracker import Tracker
from eol_ros.said import parts_of
from eol_ros.settings import MotionSettings, TrackerSettings


@pytest.mark.slow
def test_the_figures_are_those_of_a_tracker_that_sees_the_films():
    """By figures that only images and tracker together can give."""
    film = films.one('steep')
    flat, known = (vision_relief.rest(film, 6, how) for how in (False, True))

    assert known['first_sight'] == 25 and known['coverage'] == 1.0
    assert known['error_mm_rms'] < 0.3 and known['error_mm_worst'] < 0.8
    assert known['yaw_deg_rms'] < 0.2
    assert flat['error_mm_rms'] > 2 * known['error_mm_rms']
    # the same blocks by a camera that is said to stand 5 mm beside where it stands
    moved = film.calibration.homography @ np.array([[1, 0, -0.005], [0, 1, 0], [0, 0, 1.0]])
    wrong = replace(film, calibration=replace(film.calibration, homography=moved / moved[2, 2]))
    assert vision_relief.rest(wrong, 3, True)['error_mm_rms'] > 4.0


def at_rest(film, images):
    """Places and sigmas, m, of `images` of a film after the first ten, and the slips of them."""
    tracker = Tracker(TrackerSettings(), films.calibration(film, True))
    motion, places, sigmas, slips = Motion(MotionSettings()), [], [], []
    for k in range(images + 10):
        if k == 2:  # a lattice alone does not tell which way round it lies
            turned = np.median(film.shot.poses[:, 2]) / (np.pi / 2)
            tracker.follower.turn(round(float(turned)) % 4)
        found = tracker.update(k / 60, films.sensed(film.light, k))
        if k >= 10:
            slips += motion.update(k / 60, *found.world.T, found.seen, found.sigma_m)[0]
            assert found.seen.all()
            places.append(found.world)
            sigmas.append(found.sigma_m)
    return np.array(places), np.array(sigmas), slips


@pytest.mark.slow
def test_noise_keeps_to_the_bound_where_covers_are_half_dark_or_flash():
    film = films.one('tilted-lit')
    found = vision_relief.rest(film, 40, True)

    assert found['noise_um'] < 2.2 * 19.19  # the Cramer-Rao bound of the outlines, by v0.2.0
    assert 1 / 1.5 < found['sigma_of_scatter'] < 1.5


def behind_a_wall(film, block, share):
    """Return `film` with the outer `share` of one cover as dark as the platform."""
    camera = films.calibration(film, True)
    u, v = camera.to_pixels(film.shot.poses[block, None, :2])[0]
    half = camera.side_px(np.array([[u, v]]), 0.084)[0] / 2
    rows = slice(round(v - 1.6 * half), round(v + 1.6 * half))
    light = film.light.copy()
    light[rows, round(u - 1.6 * half) : round(u - half + share * 2 * half)] = np.median(light)
    return replace(film, light=light)


@pytest.mark.slow
def test_sigma_is_the_scatter_also_behind_a_wall_but_not_at_once():
    film = films.one('straight')
    block = int(np.argmin(film.shot.poses[:, 0]))
    places, sigma, _ = at_rest(behind_a_wall(film, block, 0.2), 180)
    scatter = places.std(axis=0).mean(axis=1)

    honest = np.median(sigma[60:], axis=0) / scatter
    assert np.all((honest > 1 / 1.5) & (honest < 1.8))
    # what has not lasted may be an arm: sigma says what it may lead the block by
    assert sigma[0, block] > 1.5 * scatter[block]
    assert np.all(sigma[-60:, block] < 3 * scatter[block])


def apart_m(found, film):
    """Return how far from each block (25,) the nearest square is, whatever its name."""
    apart = film.shot.poses[:, None, :2] - found.world[None]
    return np.hypot(*apart.transpose(2, 0, 1)).min(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize('grey', [40, 250])
def test_all_covers_are_found_in_six_images_however_bright_they_are(grey):
    shown = [film for film in films.load() if not film.name.endswith('-lit')]
    for film in shown[grey == 40 :: 2]:  # half of them in each light
        camera = films.calibration(film, True)
        u, v = np.rint(camera.to_pixels(film.shot.poses[:, :2])).astype(int).T
        ground, middle = np.median(film.light), np.median(film.light[v, u])
        light = ground + (film.light - ground) * np.float32((grey - ground) / (middle - ground))
        tracker = Tracker(TrackerSettings(), camera)
        found = [tracker.update(k / 60, films.sensed(light, k)) for k in range(6)]
        assert found[0].seen.sum() >= (20 if grey == 40 else 24), film.name
        found = found[-1]
        assert found.seen.all(), film.name
        assert apart_m(found, film).max() < 0.006


@pytest.mark.slow
def test_a_turned_table_rests_under_its_own_names():
    film = films.one('tilted-2-0', films.TURNED)
    places, _, slips = at_rest(film, 60)
    away = np.hypot(*np.moveaxis(places - np.median(places, axis=0), -1, 0))

    assert slips == [] and (away < 8 * places.std(axis=0).max(axis=1)).all()


@pytest.mark.slow
def test_blocks_calibrate_a_camera_above_printed_covers():
    one = vision_relief.solved([films.one('straight')], True)
    assert one['refused'] == '' and 'held at k1 = 0' in one['note']
    assert [part[0] for part in parts_of(one['note'])] == ['lens_held']
    assert one['error_mm_rms'] < 1.0


def platform_mm(found, true):
    """How far off a calibration puts the platform, mm RMS."""
    off = vision_relief.misplaced(found, true, PLATFORM_SIDE_M, 15)
    return 1e3 * np.sqrt((off**2).sum(axis=1).mean())


@pytest.mark.slow
def test_a_camera_with_a_lens_calibrates_by_three_images_and_while_the_tracker_runs():
    shown = {film.name: film for film in films.load(films.STIRRED)}
    group = [shown[f'lens-{k}'] for k in (1, 2, 3)]
    images = [films.sensed(film.light, 100 + k) for k, film in enumerate(group)]
    solved = from_images(images, nominal(1280, 800), films.SKIRT_M, films.covers(group[0]))
    true = films.calibration(group[0], True)
    assert solved.refusal() == '' and 'held at k1 = 0' not in solved.note
    assert platform_mm(solved.calibration, true) < 1.0
    assert solved.calibration.distortion_coefficients[0] == pytest.approx(-0.1, abs=0.01)

    side_px = np.median(true.side_px(true.to_pixels(group[0].shot.poses[:, :2]), BLOCK_SIDE_M))
    height, width = group[0].light.shape
    start = Calibration.ideal(width, height, float(side_px) / BLOCK_SIDE_M)
    start = replace(start, cover_height_m=films.SKIRT_M, covers=true.covers)
    tracker = Tracker(TrackerSettings(), start)
    tracker.requests.add(500_000_000, CALIBRATE)
    for k in range(180):
        tracker.update(k / 60, films.sensed(group[0].light, k))
        if tracker.outcome is not None and tracker.outcome.kind == CALIBRATE:
            break
    assert tracker.outcome.kind == CALIBRATE and not tracker.outcome.refused
    assert platform_mm(tracker.calibration, true) < 1.0
