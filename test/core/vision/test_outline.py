# SPDX-License-Identifier: Apache-2.0
"""The outline of a cover with relief, held against all points of the printed cover."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from support.paper import BLOCK_SIDE_M, BODY_HEIGHT_M, rest_lattice
from support.relief.land import outlines

from assets.covers.mesh import CoverShape, cover_mesh, tile
from eol_ros.core.terrain import landscape
from eol_ros.core.vision import outline
from eol_ros.core.vision.appearance.squares import SQUARE
from eol_ros.core.vision.calibration.calibrate import raise_plane
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import ConfigError
from eol_ros.settings import TrackerSettings

CELLS = 42
GAP_M = 0.001
PLANE_M = 0.013
HALF_M = BLOCK_SIDE_M / 2


@cache
def printed():
    """Return the form of covers, the heights of a landscape and the outlines that follow."""
    shape, heights = CoverShape(), landscape(3, cells=CELLS)
    return shape, heights, outlines(heights, shape, 1e3 * GAP_M, CELLS)


def tilted(k1=0.0, mirror=False):
    """Return a camera that leans by 6 degrees, for the platform's plane, and its pose in OpenCV."""
    turn = cv2.Rodrigues(np.array([np.pi - 0.1, 0.0, 0.0]))[0]
    place = np.array([0.15, -0.2, 1.85])
    camera = np.array([[1000.0, 0, 640], [0, 1000, 400], [0, 0, 1]])
    homography = camera @ np.column_stack([turn[:, :2], -turn @ place])
    lens = np.array([k1, 0, 0, 0, 0.0])
    straight = Calibration(1280, 800, camera, lens, homography / homography[2, 2])
    return (straight.in_mirror() if mirror else straight), turn, -turn @ place


def points_px(triangles_mm, pose, camera, turn, shift, mirror):
    """Return pixels (n, 2) of many points of a cover's surface, by OpenCV."""
    share = np.random.default_rng(1).dirichlet([0.4] * 3, (len(triangles_mm), 12))
    points = np.einsum('nks,nsx->nkx', share, triangles_mm).reshape(-1, 3) * 1e-3
    c, s = np.cos(pose[2]), np.sin(pose[2])
    world = np.column_stack(
        [
            pose[0] + c * points[:, 0] - s * points[:, 1],
            pose[1] + s * points[:, 0] + c * points[:, 1],
            points[:, 2] + GAP_M,
        ]
    )
    if mirror:
        world[:, 0] *= -1
    seen, _ = cv2.projectPoints(
        world, cv2.Rodrigues(turn)[0], shift, camera.camera_matrix, camera.distortion_coefficients
    )
    return seen[:, 0]


def shear_of(camera, px):
    """Return b / conj(a), where a w + b conj(w) is the image (v up) of a small vector w there."""
    at = camera.to_table(px)
    right, up = (camera.to_pixels(at + s) - camera.to_pixels(at - s) for s in np.eye(2) * 0.02)
    one, other = (complex(v[0, 0], -v[0, 1]) for v in (right, up))
    other = -other if camera.mirrored else other
    return (one + 1j * other) / np.conj(one - 1j * other)


@pytest.mark.parametrize('mirror', [False, True])
@pytest.mark.parametrize('k1', [pytest.param(0.0, marks=pytest.mark.slow), -0.1])
@pytest.mark.parametrize('pose', [(0.35, 0.3, 0.1), (-0.3, 0.35, 2.0), (0.1, -0.2, -1.2)])
def test_the_table_is_the_edge_of_all_that_is_seen(pose, k1, mirror):
    shape, heights, covers = printed()
    block = 9
    on_platform, turn, shift = tilted(k1, mirror)
    camera = replace(raise_plane(on_platform, PLANE_M), cover_height_m=PLANE_M)
    seen = points_px(
        cover_mesh(tile(heights, *divmod(block, 5), CELLS), shape),
        pose,
        camera,
        turn,
        shift,
        mirror,
    )
    centre = camera.to_pixels([pose[:2]])
    full = float(camera.yaw_to_image(centre, [pose[2]])[0])
    theta = full - round(full / (np.pi / 2)) * np.pi / 2
    half = float(camera.side_px(centre, BLOCK_SIDE_M)[0]) / 2
    shear = shear_of(camera, centre)
    eye = -turn.T @ np.ravel(shift)
    below = camera.to_pixels([eye[:2] * [-1 if mirror else 1, 1]])[0]

    def off(which):
        """Return how far the outline stands outside of where the table of a cover says, (n,) px."""
        table, found = np.zeros(outline.SIZE, np.float32), []
        land = covers.over(PLANE_M)[which]
        outline.tabulate(camera.packed(), land, *centre[0], full, half, table)
        for side in range(4):
            angle = full + side * np.pi / 2
            normal = np.array([np.cos(angle), -np.sin(angle)])
            along = np.array([-np.sin(angle), -np.cos(angle)])
            d, t = (seen - centre) @ normal, (seen - centre) @ along
            near = d > 0.5 * half
            d, t = d[near], t[near]
            e = shear * np.exp(-2j * angle)
            wall = (below - centre[0]) @ normal - half  # in sight, and how wide, in px
            wall *= (covers.land_mm[block].mean() - covers.lower_mm) * 1e-3 / eye[2]
            glow = outline.SHINE_PX * min(max(wall, 0.0), 1.0)
            for at in np.linspace(-0.85, 0.85, 35) * half:
                stands = outline.outside.py_func(table, side, np.float32(at))
                if stands != outline.NONE:
                    at -= stands * np.tan(theta)  # a row meets it further along the side
                    edge = half + half * e.real + e.imag * at + stands - glow
                    found.append(d[np.abs(t - at) < 0.25].max() - edge)
        return np.array(found)

    mine = off(block)
    assert len(mine) > 0.8 * 4 * 35
    # the points drawn miss the very edge by a little
    assert np.quantile(np.abs(mine), 0.9) < 0.15 and abs(np.median(mine)) < 0.08
    assert np.abs(off(3)).mean() > 3 * np.abs(mine).mean()  # another cover's is told from it


def test_a_flat_cover_in_the_calibrations_plane_stands_nowhere_else():
    camera = Calibration.ideal()
    covers = CoverOutlines(20.0, np.full((1, 4, 9), 20.0))
    table = np.zeros(outline.SIZE, np.float32)
    outline.tabulate(camera.packed(), covers.over(0.02)[0], 900.0, 200.0, 0.2, 22.9, table)

    reached = table[1:][table[1:] != outline.NONE]
    assert len(reached) > 100 and np.abs(reached).max() < 1e-5


@pytest.mark.parametrize('mirror', [False, True])
def test_corners_stand_where_those_of_the_printed_cover_do(mirror):
    """A box with straight edges, by the camera's own lifting of planes: height is all it adds."""
    on_platform = tilted(0.0, mirror)[0]
    camera = replace(raise_plane(on_platform, PLANE_M), cover_height_m=PLANE_M)
    camera = replace(camera, covers=CoverOutlines(1.0, np.full((25, 4, 9), 33.0)))
    pose = np.array([0.35, -0.3, 0.1])
    square = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) * HALF_M
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = pose[:2] + square @ np.array([[c, s], [-s, c]])
    flat = camera.to_pixels(corners)
    top, rim = (
        raise_plane(on_platform, height_m).to_pixels(corners) - flat for height_m in (0.033, 0.001)
    )
    if mirror:  # the same turn round the square as seen in the image
        flat, top, rim = (part[[2, 3, 0, 1]][::-1] for part in (flat, top, rim))
    blob = np.zeros(1, SQUARE)
    middle = flat.mean(axis=0)
    blob['u'], blob['v'] = middle
    blob['theta'] = camera.yaw_to_image([middle], [pose[2]])
    blob['side_px'] = camera.side_px([middle], BLOCK_SIDE_M)

    shifts = outline.corner_shifts(camera, blob)[0]
    angle = blob['theta'][0] + np.arange(4) * np.pi / 2
    normals = np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    for corner, sides in enumerate(((3, 0), (0, 1), (1, 2), (2, 3))):
        for side in sides:
            ends = [k for k in range(4) if side in ((3, 0), (0, 1), (1, 2), (2, 3))[k]]
            lower, upper = ((part[ends] @ normals[side]).mean() for part in (rim, top))
            expected = (rim if lower > upper else top)[corner] @ normals[side]
            glow = outline.SHINE_PX * min(max(lower - upper, 0.0), 1.0)
            assert shifts[corner] @ normals[side] == pytest.approx(expected + glow, abs=0.03)


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
    on_platform, _, _ = tilted()
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
