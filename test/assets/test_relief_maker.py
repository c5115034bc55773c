# SPDX-License-Identifier: Apache-2.0
"""Path-traced covers: cameras and covers are what they are said to be, and the images show them."""

import sys

import cv2
import numpy as np
import pytest
from support.relief import films

from assets.relief import path_tracer, shots, surfaces
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


def test_without_the_path_tracer_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mitsuba', None)

    with pytest.raises(DeviceMissing, match='pip install'):
        path_tracer.mitsuba()


@pytest.mark.soak
def test_the_path_tracer_draws_what_is_shipped():
    pytest.importorskip('mitsuba')
    film = films.one('straight-0mm')
    light = path_tracer.covers_light(film.shot, 64)
    drawn, (u, v) = path_tracer.render(film.shot, light, 4)
    kept = film.light[v : v + drawn.shape[0], u : u + drawn.shape[1]]
    edge = kept > 30

    assert np.abs(drawn - kept)[edge].mean() < 0.06 * kept[edge].mean()
