# SPDX-License-Identifier: Apache-2.0
"""The body of a block: closed, as large as it is said to be, and a cover fits; trimesh judges."""

import numpy as np
import pytest

from assets.covers.body import BodyShape, body_mesh
from assets.covers.mesh import CoverShape, cover_mesh, volume_mm3


def solid(triangles):
    trimesh = pytest.importorskip('trimesh')
    points, index = np.unique(np.round(triangles, 6).reshape(-1, 3), axis=0, return_inverse=True)
    return trimesh.Trimesh(points, index.reshape(-1, 3), process=False)


def test_it_is_closed_and_has_the_volume_of_its_parts():
    s = BodyShape()
    mesh = solid(body_mesh(s))
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.is_volume
    assert mesh.bounds.tolist() == [[-42, -42, 0], [42, 42, 34]]
    box = 84**2 * 34 - 80**2 * 31
    boss = 12 * 4 * 24 - 8 * 4 * 10  # behind each wall, less the window
    shaft = 2.2 * 2.2 * ((27 - 22) + (12 - 6))
    assert mesh.volume == pytest.approx(box + 4 * (boss - 8 * 2 * 10 - shaft))
    assert mesh.volume == pytest.approx(volume_mm3(body_mesh(s)))


def test_the_lip_of_a_cover_goes_in_and_its_rim_stands_on_the_edge():
    body = body_mesh()
    cover = cover_mesh(np.zeros((5, 5)), CoverShape(lip_mm=6.0)) + [0, 0, 34]
    lip = cover.reshape(-1, 3)
    lip = np.abs(lip[lip[:, 2] < 34])
    assert lip[:, 2].min() == 28
    assert lip[:, :2].max() == pytest.approx(40 - 0.2)
    bosses = body.reshape(-1, 3)
    bosses = bosses[np.abs(bosses[:, :2]).max(axis=1) < 39.9]
    assert bosses[:, 2].max() <= 28 - 1  # they do not touch it
