# SPDX-License-Identifier: Apache-2.0
"""What stands on the table when covers are as they are printed, as triangles.

Metres in the frame `table`, z up from the sandpaper. A cover is the one of `assets.covers`: roof
and sides, the sides cut into rows so that they can hold the light that leaves them.
"""

from dataclasses import dataclass

import numpy as np
from support.paper import COLS, PLATFORM_SIDE_M, RIM_SIDE_M, ROWS, spring_ends
from support.relief.scene import CELLS, GAP_M, Shot

from assets.covers.mesh import CoverShape, tile
from eol_ros.core.terrain import landscape

SIDE_ROWS = 6  # of triangles from the lower rim to the land
SAND, STEEL, WOOD, SLEEVE = 0.25, 0.35, 0.12, 0.45  # albedo in the near infrared
BAR_M = 0.03  # width and height of the rim's bars
SPRING_HEIGHT_M = 0.008
CASTOR_M = 0.02


@dataclass(frozen=True)
class Mesh:
    """Triangles with what each vertex shines by itself and how much light it sends back.

    vertices (n, 3) m, faces (m, 3), glow and albedo (n,).
    """

    vertices: np.ndarray
    faces: np.ndarray
    glow: np.ndarray
    albedo: np.ndarray


def covers(shot: Shot) -> np.ndarray:
    """Return the land (25, CELLS + 1, CELLS + 1) of all covers, 0..1 of their relief."""
    land = landscape(shot.landscape, cells=CELLS)
    return np.array([tile(land, *divmod(i, COLS), CELLS) for i in range(ROWS * COLS)])


def cover_surface(land: np.ndarray, shape: CoverShape) -> tuple[np.ndarray, np.ndarray]:
    """Return what is seen of one cover: vertices (n, 3) in mm over its lower rim, faces (m, 3).

    First the roof's (CELLS + 1)^2 vertices, row by row, then those of each side (-y, +x, +y, -x),
    from the lower rim upwards.
    """
    n = CELLS + 1
    axis = (np.arange(n) / CELLS - 0.5) * shape.side_mm
    x, y = np.meshgrid(axis, axis)
    top = shape.skirt_mm + shape.relief_mm * land
    vertices = [np.stack([x, y, top], axis=-1).reshape(-1, 3)]
    corner = np.arange(n * n).reshape(n, n)
    faces = [_quads(corner)]
    half = shape.side_mm / 2
    edges = (
        np.column_stack([axis, np.full(n, -half), top[0]]),
        np.column_stack([np.full(n, half), axis, top[:, -1]]),
        np.column_stack([axis[::-1], np.full(n, half), top[-1, ::-1]]),
        np.column_stack([np.full(n, -half), axis[::-1], top[::-1, 0]]),
    )
    start = n * n
    for edge in edges:
        up = np.linspace(0, 1, SIDE_ROWS + 1)[:, None, None]
        vertices.append(
            (edge * np.concatenate([[1, 1], [0]]) + up * (edge * [0, 0, 1])).reshape(-1, 3)
        )
        faces.append(_quads(start + np.arange((SIDE_ROWS + 1) * n).reshape(-1, n)))
        start += (SIDE_ROWS + 1) * n
    return np.concatenate(vertices), np.concatenate(faces)


def placed(vertices_mm: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return vertices (n, 3) in mm of a cover as metres on the table, at `pose` (x, y, yaw)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    p = vertices_mm * 1e-3
    return np.column_stack(
        [
            pose[0] + c * p[:, 0] - s * p[:, 1],
            pose[1] + s * p[:, 0] + c * p[:, 1],
            p[:, 2] + GAP_M,
        ]
    )


def furniture(shot: Shot) -> list[Mesh]:
    """Return the sandpaper, rim, castors, springs and arms of a shot."""
    half = 1.2 * PLATFORM_SIDE_M / 2
    sand = _box((-half, -half, -0.01), (half, half, 0.0), SAND)
    inner, outer, low = RIM_SIDE_M / 2, RIM_SIDE_M / 2 + BAR_M, CASTOR_M
    found = [sand]
    for a, b in (
        ((-outer, -outer), (outer, -inner)),
        ((-outer, inner), (outer, outer)),
        ((-outer, -inner), (-inner, inner)),
        ((inner, -inner), (outer, inner)),
    ):
        found.append(_box((*a, low), (*b, low + BAR_M), WOOD))
    for sx in (-1, 1):
        for sy in (-1, 1):
            at = np.array([sx, sy]) * (outer + CASTOR_M / 2)
            found.append(_box((*(at - CASTOR_M / 2), 0), (*(at + CASTOR_M / 2), CASTOR_M), STEEL))
    for one, other in spring_ends(shot.poses, np.zeros(3)):
        ends = [np.append(end, SPRING_HEIGHT_M) for end in (one, other)]
        found.append(_rod(*ends, 0.003, STEEL))
    for arm in shot.arms:
        found.append(_rod(arm[:3], arm[3:6], arm[6], SLEEVE))
    return found


def _quads(corner: np.ndarray) -> np.ndarray:
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)


def _plain(vertices: np.ndarray, faces: np.ndarray, albedo: float) -> Mesh:
    n = len(vertices)
    return Mesh(vertices, faces, np.zeros(n), np.full(n, albedo))


def _box(low: tuple[float, ...], high: tuple[float, ...], albedo: float) -> Mesh:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    vertices = np.array(low) + corners * (np.array(high) - np.array(low))
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    return _plain(vertices, faces, albedo)


def _rod(
    one: np.ndarray, other: np.ndarray, radius_m: float, albedo: float, sides: int = 12
) -> Mesh:
    """Return a rod with flat ends."""
    along = (other - one) / np.linalg.norm(other - one)
    first = np.cross(along, [0, 0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0, 0])
    first /= np.linalg.norm(first)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius_m * (
        np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(along, first))
    )
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = [
        np.stack([k, after, sides + after], -1),
        np.stack([k, sides + after, sides + k], -1),
        np.stack([np.zeros(sides, int), after, k], -1),
        np.stack([np.full(sides, sides), sides + k, sides + after], -1),
    ]
    return _plain(np.concatenate([one + ring, other + ring]), np.concatenate(faces), albedo)
