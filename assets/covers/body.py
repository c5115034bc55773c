# SPDX-License-Identifier: Apache-2.0
"""The body of a block, to print: an open box on which a cover stands, and on which springs hook.

In the middle of each wall is a window, and behind it a boss with a shaft for a steel pin, dropped
in from above: a spring's hook goes round the pin, so it pulls at the face of the block. In mm, the
underside at z = 0, centred on the origin.
"""

from dataclasses import dataclass

import numpy as np

from assets.covers.mesh import CoverShape
from eol_ros.errors import UsageError
from eol_ros.settings import TableSettings


@dataclass(frozen=True)
class BodyShape:
    """Sizes in millimetres; what the drawings in docs/build show."""

    side_mm: float = TableSettings.block_side_m * 1e3
    height_mm: float = TableSettings.body_height_m * 1e3
    wall_mm: float = CoverShape.body_mm
    floor_mm: float = 3.0
    spring_mm: float = 17.0  # height at which springs pull
    window_mm: tuple[float, float] = (8.0, 10.0)  # width and height
    boss_mm: tuple[float, float] = (12.0, 4.0)  # width, and depth behind the wall
    pin_mm: float = 2.0  # diameter; 20 mm long
    inset_mm: float = 2.0  # of the pin's axis from the face
    lip_mm: float = 6.0  # of the cover: so far bosses stay below the edge, and a millimetre more

    def check(self) -> 'BodyShape':
        """Return self, or raise UsageError when no such body can be."""
        half, deep = self.side_mm / 2, self.wall_mm + self.boss_mm[1]
        if min(self.side_mm, self.wall_mm, self.floor_mm) <= 0 or 2 * deep >= self.side_mm:
            raise UsageError(f'a body of {self.side_mm:g} mm has no room for its walls')
        low, high = (self.spring_mm + s * self.window_mm[1] / 2 for s in (-1, 1))
        if not self.floor_mm + 3 < low < high < self.boss_top_mm() - 3:
            raise UsageError(
                f'the windows, {low:g} to {high:g} mm high, do not lie between a floor of '
                f'{self.floor_mm:g} mm and a lip of {self.lip_mm:g} mm'
            )
        if not self.pin_mm / 2 + 0.5 < self.inset_mm < deep - self.pin_mm / 2 < half:
            raise UsageError(f'a pin {self.inset_mm:g} mm from the face does not lie in its boss')
        return self

    def boss_top_mm(self) -> float:
        """Return how high bosses are."""
        return self.height_mm - self.lip_mm - 1


def body_mesh(shape: BodyShape | None = None) -> np.ndarray:
    """Return the body as triangles, shape (n, 3, 3) in mm, counter-clockwise from outside.

    It is made of bricks of a grid that is not even; where a full one meets an empty one is a face.
    """
    s = (shape or BodyShape()).check()
    half, inner = s.side_mm / 2, s.side_mm / 2 - s.wall_mm
    play = s.pin_mm / 2 + 0.1
    axis, deep = half - s.inset_mm, inner - s.boss_mm[1]
    wide, window = s.boss_mm[0] / 2, s.window_mm[0] / 2
    low, high = (s.spring_mm + sign * s.window_mm[1] / 2 for sign in (-1, 1))
    shaft = low - 6
    plan = [half, inner, deep, axis - play, axis + play, wide, window, play]
    across = np.unique(np.round([sign * v for v in plan for sign in (-1, 1)], 9))
    up = np.unique([0, s.floor_mm, shaft, low, high, s.boss_top_mm(), s.height_mm])
    mid, height = (across[:-1] + across[1:]) / 2, (up[:-1] + up[1:]) / 2
    x, y, z = np.meshgrid(mid, mid, height, indexing='ij')
    outwards, along = np.maximum(abs(x), abs(y)), np.minimum(abs(x), abs(y))
    full = (z < s.floor_mm) | (outwards > inner)
    full |= (outwards > deep) & (along < wide) & (z < s.boss_top_mm())
    full &= ~((outwards > deep) & (along < window) & (z > low) & (z < high))
    in_shaft = (abs(outwards - axis) < play) & (along < play) & (z > shaft)
    full &= ~(in_shaft & (z < s.boss_top_mm()))
    return _faces(full, (across, across, up))


def _faces(full: np.ndarray, edges: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return triangles where bricks end; `edges` are the planes between them along each axis."""
    found = []
    padded = np.pad(full, 1)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(padded.astype(np.int8), axis=axis)  # 1: begins, -1: ends
        for sign in (1, -1):
            at = np.argwhere(step == sign)
            at[:, u] -= 1  # of the padding
            at[:, v] -= 1
            corners = np.zeros((len(at), 4, 3))
            for k, (du, dv) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                corners[:, k, axis] = edges[axis][at[:, axis]]
                corners[:, k, u] = edges[u][at[:, u] + du]
                corners[:, k, v] = edges[v][at[:, v] + dv]
            if sign == 1:  # looks back
                corners = corners[:, ::-1]
            found += [corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]
    return np.concatenate(found)
