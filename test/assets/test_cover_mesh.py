# SPDX-License-Identifier: Apache-2.0
"""The covers: one landscape, cut to the bit, each piece closed; trimesh judges independently."""

import numpy as np
import pytest

from assets.covers import mesh as covers
from assets.covers.mesh import CoverShape
from eol_ros.core.terrain import landscape
from eol_ros.errors import UsageError

CELLS = 12


def test_neighbouring_edges_match_to_the_bit():
    land = landscape(3, cells=CELLS)
    shape = CoverShape()
    top = {}
    for row in range(5):
        for col in range(5):
            mesh = covers.cover_mesh(covers.tile(land, row, col, CELLS), shape)
            top[row, col] = np.unique(mesh.astype('<f4').reshape(-1, 3), axis=0)
    half = np.float32(shape.side_mm / 2)
    for (row, col), points in top.items():
        if col < 4:
            edge = points[(points[:, 0] == half) & (points[:, 2] > 0)][:, 1:]
            other = top[row, col + 1]
            assert np.array_equal(edge, other[(other[:, 0] == -half) & (other[:, 2] > 0)][:, 1:])
        if row < 4:
            edge = points[(points[:, 1] == half) & (points[:, 2] > 0)][:, [0, 2]]
            other = top[row + 1, col]
            match = other[(other[:, 1] == -half) & (other[:, 2] > 0)][:, [0, 2]]
            assert np.array_equal(edge, match)


@pytest.mark.parametrize(
    'shape',
    [
        CoverShape(),
        CoverShape(60, 3, 5, 40),
        CoverShape(84, 0.8, 2, 0),
        CoverShape(lip_mm=6),
        CoverShape(60, 3, 14, 40, 9, 3, 0.5),
    ],
)
def test_each_cover_is_watertight(shape):
    trimesh = pytest.importorskip('trimesh')
    land = landscape(1, cells=CELLS)
    triangles = covers.cover_mesh(covers.tile(land, 2, 3, CELLS), shape)
    mesh = trimesh.Trimesh(*_indexed(triangles.astype('<f4')))
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2
    assert mesh.volume > 0
    assert mesh.volume == pytest.approx(covers.volume_mm3(triangles), rel=1e-5)
    assert mesh.bounds[1][:2] == pytest.approx([shape.side_mm / 2] * 2)


def test_a_lip_fits_into_the_body_and_the_rim_stands_on_it():
    """Cut by planes: below its rim the cover keeps within the body, above it is as wide as that."""
    trimesh = pytest.importorskip('trimesh')
    land, shape = landscape(1, cells=CELLS), CoverShape(lip_mm=6)
    triangles = covers.cover_mesh(covers.tile(land, 1, 4, CELLS), shape)
    mesh = trimesh.Trimesh(*_indexed(triangles))
    inside = shape.side_mm / 2 - shape.body_mm

    def half_widths(z):
        cut = mesh.section([0, 0, 1], [0, 0, z])
        loops = [cut.vertices[entity.points] for entity in cut.entities]
        return sorted(np.abs(loop[:, :2]).max() for loop in loops)

    assert mesh.bounds[0][2] == -6
    for z in (-5.9, -0.1):
        inner, outer = half_widths(z)
        assert inside - outer == pytest.approx(shape.clearance_mm)
        assert outer - inner == pytest.approx(shape.wall_mm)
    inner, outer = half_widths(0.1)
    assert outer == pytest.approx(shape.side_mm / 2)
    assert inner < inside  # what stands on the wall is one with the lip
    steps = [half_widths(z)[0] for z in np.arange(0.5, 4.0, 0.25)]
    assert np.diff(steps).max() <= 0.25 + 1e-9  # overhangs by 45 degrees at most
    lightest = covers.cover_mesh(covers.tile(land, 1, 4, CELLS), CoverShape())
    assert covers.volume_mm3(triangles) > covers.volume_mm3(lightest)


def test_any_picture_fits_and_bad_ones_are_refused():
    ramp = np.tile(np.arange(50.0), (30, 1))
    fitted = covers.fit(ramp, 5, 5, 4)
    assert fitted.shape == (21, 21)
    assert fitted[0] == pytest.approx(np.linspace(0, 1, 21))
    up = covers.fit(np.arange(30.0)[:, None] * np.ones(9), 5, 5, 4)
    assert up[0, 0] == 1 and up[-1, 0] == 0  # the image's top row lies furthest away
    assert np.array_equal(covers.fit(np.ones((3, 3)), 2, 2, 2), np.zeros((5, 5)))
    with pytest.raises(UsageError, match='2 x 2'):
        covers.fit(np.ones((1, 9)), 5, 5, 4)


@pytest.mark.parametrize(
    'shape',
    [
        CoverShape(side_mm=0),
        CoverShape(wall_mm=50),
        CoverShape(skirt_mm=1),
        CoverShape(relief_mm=-1),
    ],
)
def test_impossible_covers_are_refused(shape):
    with pytest.raises(UsageError):
        covers.cover_mesh(np.zeros((3, 3)), shape)


def test_hillshade_is_a_picture_with_the_far_edge_on_top():
    land = np.zeros((11, 11))
    land[-1] = 1.0
    picture = covers.hillshade(land)
    assert picture.dtype == np.uint8 and picture.shape == (11, 11)
    assert picture[0].mean() > picture[-1].mean()


def _indexed(triangles):
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return points, index.reshape(-1, 3)
