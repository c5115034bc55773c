# SPDX-License-Identifier: Apache-2.0
"""Covers with relief: the tracker is right about those of the twin."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.paper import BODY_HEIGHT_M, rest_lattice
from support.relief.land import outlines

from assets.covers.mesh import CoverShape, cover_mesh, tile
from eol_ros.core.terrain import landscape
from eol_ros.core.vision.calibration.calibrate import raise_plane
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

CELLS = 42
GAP_M = 0.001


def tilted():
    """Return a camera that leans by 6 degrees, for the platform's plane."""
    turn = cv2.Rodrigues(np.array([np.pi - 0.1, 0.0, 0.0]))[0]
    place = np.array([0.15, -0.2, 1.85])
    camera = np.array([[1000.0, 0, 640], [0, 1000, 400], [0, 0, 1]])
    homography = camera @ np.column_stack([turn[:, :2], -turn @ place])
    return Calibration(1280, 800, camera, np.zeros(5), homography / homography[2, 2])


@pytest.mark.parametrize(
    ('lower', 'land', 'words'),
    [
        (1.0, np.zeros((25, 3, 9)), r'shape \(25, 3, 9\)'),
        (1.0, np.full((25, 4, 9), np.nan), 'within 200 mm'),
        (30.0, np.full((25, 4, 9), 20.0), 'below the lower rim'),
    ],
)
def test_heights_that_no_cover_has_are_named(lower, land, words):
    with pytest.raises(ConfigError, match=words):
        CoverOutlines(lower, land)


def test_a_mesh_in_metres_is_named():
    mesh = cover_mesh(np.zeros((9, 9)), CoverShape()) * 1e-3
    with pytest.raises(ConfigError, match='84 mm'):
        CoverOutlines.of_meshes([mesh], 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('shape', 'gap_m'),
    [(CoverShape(), GAP_M), (CoverShape(lip_mm=6), BODY_HEIGHT_M)],
    ids=['over the platform', 'with a lip, on bodies'],
)
def test_the_tracker_is_right_about_the_twins_covers(shape, gap_m):
    on_platform = tilted()
    land = landscape(3, cells=CELLS)
    meshes = [cover_mesh(tile(land, *divmod(i, 5), CELLS), shape) for i in range(25)]
    covers = CoverOutlines.of_meshes(meshes, 1e3 * gap_m)
    expected = outlines(land, shape, 1e3 * gap_m, CELLS)
    assert covers.land_mm == pytest.approx(expected.land_mm, abs=0.02)  # the lip is none of it
    plane_m = gap_m + 1e-3 * shape.skirt_mm
    flat = replace(raise_plane(on_platform, plane_m), cover_height_m=plane_m)
    camera = replace(flat, covers=covers)
    rng = np.random.default_rng(4)
    xy = rest_lattice() + rng.normal(0, 0.003, (25, 2))
    yaw = rng.normal(0, 0.05, 25)
    renderer = Renderer(calibration=camera, seed=2)
    images = [renderer.render(*xy.T, yaw, k).copy() for k in range(8)]
    error_mm = []
    for calibration in (camera, flat):
        tracker = Tracker(TrackerSettings(), calibration)
        for k, image in enumerate(images):
            found = tracker.update(k / 60, image)
        seen = found.seen
        error_mm.append(1e3 * np.hypot(*(found.world - xy)[seen].T).max())
        if calibration is camera:
            assert seen.all()
            assert np.abs(np.degrees(found.yaw - yaw)).max() < 0.2

    # the twin's walls shine on nothing: half of SHINE_PX, 0.17 mm here, is the outline's own
    assert error_mm[0] < 0.4 and error_mm[1] > 3 * error_mm[0]
