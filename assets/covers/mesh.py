# SPDX-License-Identifier: Apache-2.0
"""One continuous landscape, cut into the covers of the blocks, and written as STL.

Heights are sampled on one grid over the whole lattice; neighbouring covers take the same samples
along their common edge, so the cut fits to the bit. Arrays are indexed [row (y away), column (x
right)].
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from eol_ros.devices.files.stl_file import FACET
from eol_ros.errors import UsageError
from eol_ros.settings import TableSettings

CONTOURS = 14  # steps of height between the lines of `hillshade`


@dataclass(frozen=True)
class CoverShape:
    """Sizes of a printed cover, in millimetres (the unit of STL files)."""

    side_mm: float = TableSettings.block_side_m * 1e3
    wall_mm: float = 1.6  # thickness of sides and roof
    skirt_mm: float = 12.0  # from the lower rim to the lowest point of the landscape
    relief_mm: float = 26.0  # from the lowest to the highest point of the landscape
    lip_mm: float = 0.0  # how far a lip reaches down into the block's body; 0: there is none
    body_mm: float = 2.0  # thickness of the body's walls, on which the cover stands
    clearance_mm: float = 0.2  # between lip and body on each side

    def check(self) -> 'CoverShape':
        """Return self, or raise UsageError when no such cover can stand."""
        if min(self.side_mm, self.wall_mm, self.skirt_mm) <= 0 or self.relief_mm < 0:
            raise UsageError('side, wall and skirt must be above 0 mm, relief 0 mm or more')
        if self.wall_mm * 2 >= self.side_mm:
            raise UsageError(f'wall {self.wall_mm:g} mm leaves no room inside {self.side_mm:g} mm')
        if self.wall_mm >= self.skirt_mm:
            raise UsageError(f'skirt {self.skirt_mm:g} mm must exceed the wall {self.wall_mm:g} mm')
        if min(self.lip_mm, self.body_mm, self.clearance_mm) < 0:
            raise UsageError('lip, body and clearance must be 0 mm or more')
        if self.lip_mm:
            inside = self.side_mm - 2 * (self.body_mm + self.clearance_mm + self.wall_mm)
            if inside <= 0:
                raise UsageError(f'a body of {self.body_mm:g} mm leaves no room for a lip')
            if self.wall_mm + self._shoulder_mm() >= self.skirt_mm - self.wall_mm:
                raise UsageError(
                    f'skirt {self.skirt_mm:g} mm is too low for the shoulder above a lip, which is '
                    f'{self.wall_mm + self._shoulder_mm():g} mm high: make it higher, or --lip 0'
                )
        return self

    def _shoulder_mm(self) -> float:
        """How much narrower the inside is at the lip than above it."""
        return self.body_mm + self.clearance_mm

    def rings(self) -> list[tuple[float, float]]:
        """Return half width and height of the edges around the opening, from inside to outside."""
        inner, outer = self.side_mm / 2 - self.wall_mm, self.side_mm / 2
        if not self.lip_mm:
            return [(inner, 0.0), (outer, 0.0)]
        lip, shoulder = outer - self.body_mm - self.clearance_mm, self._shoulder_mm()
        return [
            (inner, self.wall_mm + shoulder),  # slopes by 45 degrees, so that it prints
            (lip - self.wall_mm, self.wall_mm),
            (lip - self.wall_mm, -self.lip_mm),
            (lip, -self.lip_mm),
            (lip, 0.0),
            (outer, 0.0),
        ]


def fit(heights: np.ndarray, rows: int, cols: int, cells: int) -> np.ndarray:
    """Return a height map (h, w), rows top to bottom as in an image, as 0..1 on the covers' grid.

    That is (rows * cells + 1, cols * cells + 1). Raises UsageError below 2 x 2.
    """
    source = np.asarray(heights, float)[::-1]
    if source.ndim != 2 or min(source.shape) < 2:
        raise UsageError(f'a height map is an image of 2 x 2 or more, not {source.shape}')
    v = np.linspace(0, source.shape[0] - 1, rows * cells + 1)
    u = np.linspace(0, source.shape[1] - 1, cols * cells + 1)
    iv = np.minimum(v.astype(int), source.shape[0] - 2)
    iu = np.minimum(u.astype(int), source.shape[1] - 2)
    fv, fu = (v - iv)[:, None], (u - iu)[None, :]
    top = source[iv][:, iu] * (1 - fu) + source[iv][:, iu + 1] * fu
    low = source[iv + 1][:, iu] * (1 - fu) + source[iv + 1][:, iu + 1] * fu
    grid = top * (1 - fv) + low * fv
    span = float(np.ptp(grid))
    return (grid - grid.min()) / span if span > 0 else np.zeros_like(grid)


def tile(heights: np.ndarray, row: int, col: int, cells: int) -> np.ndarray:
    """Return the samples of one cover, edges included, shape (cells + 1, cells + 1)."""
    return heights[row * cells : (row + 1) * cells + 1, col * cells : (col + 1) * cells + 1]


def cover_mesh(heights: np.ndarray, shape: CoverShape) -> np.ndarray:
    """Return one cover as triangles, shape (n, 3, 3) in mm, counter-clockwise from outside.

    `heights` (cells + 1, cells + 1) in 0..1. The cover is a hollow cap, open below, its lower rim
    centred on the origin: landscape on top, straight sides, and a roof inside that follows the
    landscape at one wall's thickness, so that light shines through it evenly. A lip reaches into
    the body of the block, below z = 0.
    """
    shape.check()
    cells = heights.shape[0] - 1
    outer = _surface(shape.side_mm, shape.skirt_mm + shape.relief_mm * heights)
    inside = shape.side_mm - 2 * shape.wall_mm
    shrink = inside / shape.side_mm
    at = (np.arange(cells + 1) / cells - 0.5) * shrink + 0.5  # inner samples in units of the side
    roof = _resample(shape.skirt_mm + shape.relief_mm * heights, at) - shape.wall_mm
    inner = _surface(inside, roof)

    loop = _border(cells)
    square = outer[loop] * [2 / shape.side_mm, 2 / shape.side_mm, 0]
    rings = [square * half + [0, 0, z] for half, z in shape.rings()]
    below = [inner[loop], *rings]
    return np.concatenate(
        [
            _grid_triangles(outer, cells, up=True),
            _grid_triangles(inner, cells, up=False),
            _band(rings[-1], outer[loop]),
            *(_band(low, high) for low, high in pairwise(below)),
        ]
    )


def volume_mm3(triangles: np.ndarray) -> float:
    """Return the volume that a closed mesh (n, 3, 3) in mm encloses, by the divergence theorem."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return float(np.einsum('ij,ij->', a, np.cross(b, c)) / 6)


def hillshade(heights: np.ndarray) -> np.ndarray:
    """Return the landscape (h, w), 0..1, as an image (h, w) uint8: light from the upper left.

    Its rows go from top to bottom.
    """
    steep_y, steep_x = np.gradient(heights * 22)
    light = (0.62 + 0.55 * (steep_x * 0.7 - steep_y * 0.7)) / np.sqrt(1 + steep_x**2 + steep_y**2)
    grey = np.clip(0.2 + 0.62 * light + 0.2 * heights, 0.05, 1)
    level = np.floor(heights * CONTOURS)
    line = np.zeros_like(grey, bool)
    line[:-1] |= level[1:] != level[:-1]
    line[:, :-1] |= level[:, 1:] != level[:, :-1]
    grey = np.where(line, grey * 0.72, grey)
    grey = np.where(heights <= 0, 0.1, grey)
    return (255 * grey[::-1]).astype(np.uint8)


def _surface(side_mm: float, z: np.ndarray) -> np.ndarray:
    cells = z.shape[0] - 1
    axis = (np.arange(cells + 1) / cells - 0.5) * side_mm
    x, y = np.meshgrid(axis, axis)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def _resample(z: np.ndarray, at: np.ndarray) -> np.ndarray:
    cells = z.shape[0] - 1
    i = np.minimum((at * cells).astype(int), cells - 1)
    f = at * cells - i
    rows = z[i] * (1 - f)[:, None] + z[i + 1] * f[:, None]
    return rows[:, i] * (1 - f) + rows[:, i + 1] * f


def _grid_triangles(points: np.ndarray, cells: int, up: bool) -> np.ndarray:
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    index = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    return points[index if up else index[:, ::-1]]


def _border(cells: int) -> np.ndarray:
    """Return the indices of the border, counter-clockwise seen from above."""
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    return np.concatenate([corner[0, :-1], corner[:-1, -1], corner[-1, :0:-1], corner[:0:-1, 0]])


def _band(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Join two loops of equal length; facing outwards when `low` runs counter-clockwise below."""
    low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    first = np.stack([low, low_next, high_next], axis=1)
    second = np.stack([low, high_next, high], axis=1)
    return np.concatenate([first, second])


def save(path: str | Path, triangles: np.ndarray, name: str = '') -> None:
    """Write triangles (n, 3, 3) to a binary STL file."""
    facets = np.zeros(len(triangles), FACET)
    facets['corners'] = triangles
    a, b, c = (facets['corners'][:, i].astype(float) for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facets['normal'] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    # A header that begins with "solid" would be taken for the text form.
    header = f'binary STL, mm; {name}'.encode('ascii', 'replace')[:80].ljust(80)
    count = len(facets).to_bytes(4, 'little')
    Path(path).write_bytes(header + count + facets.tobytes())
