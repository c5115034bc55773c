# SPDX-License-Identifier: Apache-2.0
"""Path-traced covers: cameras and covers are what they are said to be, and the images show them."""

import sys

import cv2
import numpy as np
import pytest
from support.relief import films, scene
from support.relief.scene import Shot

from assets.relief import path_tracer, shots, surfaces
from eol_ros.core import terrain
from eol_ros.errors import DeviceMissing


def outline(film, block):
    """Return the hull (n, 2) px of all points of a cover, seen by OpenCV's own camera."""
    vertices, _ = surfaces.cover_surface(surfaces.covers(film.shot)[block], film.shot.shape())
    points = surfaces.placed(vertices, film.shot.poses[block])
    calibration = film.calibration
    grid = np.array([[x, y] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
    plane = np.column_stack([grid, np.zeros(len(grid))])
    _, turn, shift = cv2.solvePnP(
        plane,
        calibration.to_pixels(grid),
        calibration.camera_matrix,
        calibration.distortion_coefficients,
    )
    seen, _ = cv2.projectPoints(
        points, turn, shift, calibration.camera_matrix, calibration.distortion_coefficients
    )
    return cv2.convexHull(seen[:, 0].astype(np.float32))[:, 0]


@pytest.mark.parametrize('view', [shots.STRAIGHT, shots.ASIDE, shots.TILTED, shots.STEEP])
def test_a_view_is_the_camera_that_its_numbers_say(view):
    grid = np.array([[x, y] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.1, 0.5)])
    calibration = view.calibration()
    _, turn, shift = cv2.solvePnP(
        np.column_stack([grid, np.zeros(len(grid))]),
        calibration.to_pixels(grid),
        calibration.camera_matrix,
        None,
    )
    turn = cv2.Rodrigues(turn)[0]
    place = -turn.T @ shift[:, 0]
    tilt = np.degrees(np.arccos(-turn[2, 2]))

    assert np.allclose(place, [*view.offset_m, scene.CAMERA_HEIGHT_M], atol=1e-5)
    assert tilt == pytest.approx(view.tilt_deg, abs=1e-3)
    if view.tilt_deg:
        heading = np.degrees(np.arctan2(turn[2, 1], turn[2, 0]))
        assert abs((heading - view.heading_deg + 180) % 360 - 180) < 1e-3


def test_the_surface_is_the_printed_cover():
    """Same roof, same sides: every corner of the surface lies on the mesh of `eol covers`."""
    shot = Shot('one', relief_mm=26.0)
    land = surfaces.covers(shot)[7]
    vertices, faces = surfaces.cover_surface(land, shot.shape())
    printed = terrain.cover_mesh(land, shot.shape())
    n = scene.CELLS + 1
    roof = printed[: 2 * scene.CELLS**2].reshape(-1, 3)
    key = {tuple(point) for point in np.round(roof, 6)}

    assert {tuple(point) for point in np.round(vertices[: n * n], 6)} == key
    sides = vertices[n * n :]
    assert np.allclose(np.abs(sides[:, :2]).max(axis=1), 42.0)
    # closed by its lower opening it holds wall, roof and the room within
    corners = vertices[faces]
    lid = np.array(
        [[[-42, -42, 0], [42, 42, 0], [42, -42, 0]], [[-42, -42, 0], [-42, 42, 0], [42, 42, 0]]]
    )
    whole = terrain.volume_mm3(np.concatenate([corners, lid]))
    height = (shot.shape().skirt_mm + 26.0 * land).astype(float)
    mean = (height[:-1, :-1] + height[1:, 1:]) / 3 + (height[:-1, 1:] + height[1:, :-1]) / 6
    assert whole == pytest.approx(mean.sum() * (84.0 / scene.CELLS) ** 2, rel=1e-9)


def test_the_shipped_films_are_small_and_show_covers_where_they_are_said_to_be():
    assert sum(file.stat().st_size for file in films.FOLDER.iterdir()) < 8e6
    shown = films.load()
    assert {f.name for f in shown} == {shot.name for shot in shots.small_set()}
    for film in shown:
        for block in (0, 4, 12, 20, 24):
            hull = outline(film, block)
            middle = hull.mean(axis=0)
            inner = np.zeros(film.light.shape, np.uint8)
            cv2.fillConvexPoly(inner, np.rint(middle + 0.8 * (hull - middle)).astype(int), 1)
            beyond = np.zeros(film.light.shape, np.uint8)
            cv2.fillConvexPoly(beyond, np.rint(middle + 1.5 * (hull - middle)).astype(int), 1)
            cv2.fillConvexPoly(beyond, np.rint(middle + 1.2 * (hull - middle)).astype(int), 0)
            # a camera that is off by 4 px would show the table in one or light in the other
            assert film.light[inner > 0].min() > 1.3 * film.light[beyond > 0].max(), film.name


@pytest.mark.parametrize('place', [20.0, 20.25, 20.5])
def test_an_edge_is_as_wide_wherever_in_a_pixel_it_lies(place):
    strata = 8
    fine = np.zeros((16 * strata, 40 * strata), np.float32)
    fine[:, : int(place * strata)] = 1.0
    row = path_tracer.through_lens(fine, strata)[8].astype(float)
    steps, at = row[:-1] - row[1:], np.arange(1, 40)
    width = np.sqrt((steps * at**2).sum() - (steps * at).sum() ** 2)

    assert (steps * at).sum() == pytest.approx(place, abs=1e-3)
    # lens, the box of a pixel, and the step from one to the next of which the differences are
    assert width == pytest.approx(np.sqrt(films.PSF_PX**2 + 2 / 12), abs=3e-3)


def test_what_is_kept_is_what_was_drawn(tmp_path):
    shot = shots.small_set()[0]
    light = np.random.default_rng(1).uniform(0, 300, (50, 60))
    truth = shots.save(tmp_path, shot, light, (100, 200))
    shots.save_truth(tmp_path, {'films': {shot.name: truth}})
    film = films.load(tmp_path)[0]

    assert np.abs(film.light[200:250, 100:160] - light).max() <= 0.5 / films.STEPS + 1e-4
    assert np.allclose(film.shot.poses, shot.poses) and film.shot.view == shot.view


def test_without_the_path_tracer_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mitsuba', None)

    with pytest.raises(DeviceMissing, match='pip install'):
        path_tracer.mitsuba()


@pytest.mark.soak
def test_the_path_tracer_draws_what_is_shipped():
    pytest.importorskip('mitsuba')
    film = next(f for f in films.load() if f.name == 'straight-0mm')
    light = path_tracer.covers_light(film.shot, 64)
    drawn, (u, v) = path_tracer.render(film.shot, light, 4)
    kept = film.light[v : v + drawn.shape[0], u : u + drawn.shape[1]]
    edge = kept > 30

    assert np.abs(drawn - kept)[edge].mean() < 0.06 * kept[edge].mean()
