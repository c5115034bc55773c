# SPDX-License-Identifier: Apache-2.0
"""The body of a block: closed, as large as it is said to be, and a cover fits; trimesh judges."""

import numpy as np
import pytest

from assets.covers.body import BodyShape, body_mesh
from assets.covers.mesh import CoverShape, cover_mesh, volume_mm3
from eol_ros.errors import UsageError


def solid(triangles):
    trimesh = pytest.importorskip('trimesh')
    points, index = np.unique(np.round(triangles, 6).reshape(-1, 3), axis=0, return_inverse=True)
    return trimesh.Trimesh(points, index.reshape(-1, 3), process=False)


def inside(triangles, point):
    """Tell by how much of all directions the faces cover, seen from there (Van Oosterom 1983)."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    dots = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    angle = 2 * np.arctan2((a * np.cross(b, c)).sum(1), dots)
    return angle.sum() > 2 * np.pi


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


def test_springs_hook_at_the_middles_of_its_faces():
    """A pin stands free in each window, its axis 2 mm from the face, held above and below."""
    mesh = body_mesh()
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        way, side = np.array([x, y, 0.0]), np.array([-y, x, 0.0])
        axis = 40 * way
        free = [axis + [0, 0, z] for z in (6.5, 12.5, 17, 21.5, 26.5)]
        free += [d * way + [0, 0, 17] for d in (41.5, 37, 35)]
        around = [axis + k * 1.6 * w for w in (way, side) for k in (-1, 1)]
        held = [p + [0, 0, z] for p in around for z in (8, 25)]
        assert not any(inside(mesh, p) for p in free)
        assert all(inside(mesh, p) for p in held)
        assert inside(mesh, axis + [0, 0, 5])  # it stands on something


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


@pytest.mark.parametrize(
    ('shape', 'says'),
    [
        (BodyShape(side_mm=10), 'no room for its walls'),
        (BodyShape(spring_mm=28), 'windows, 23 to 33 mm high'),
        (BodyShape(inset_mm=0.5), 'a pin 0.5 mm from the face'),
    ],
)
def test_impossible_bodies_are_refused(shape, says):
    with pytest.raises(UsageError, match=says):
        body_mesh(shape)
