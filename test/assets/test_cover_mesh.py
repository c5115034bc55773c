# SPDX-License-Identifier: Apache-2.0
"""The covers: one landscape, cut to the bit, each piece closed; trimesh judges independently."""

import numpy as np
import pytest

from assets.covers import mesh as covers
from assets.covers.mesh import CoverShape
from eol_ros.core.terrain import landscape

CELLS = 12


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


def _indexed(triangles):
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return points, index.reshape(-1, 3)
