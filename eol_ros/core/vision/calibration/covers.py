# SPDX-License-Identifier: Apache-2.0
"""How high the covers stand: what a camera needs to know of relief to tell where a block is."""

from dataclasses import dataclass

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.settings import TableSettings

POINTS = 33  # heights along a side
MOST_MM = 200.0
FLAT = np.zeros((0, 4, 1 + POINTS))  # covers without relief


@dataclass(frozen=True)
class CoverOutlines:
    """Heights over the platform, in mm, of what can be the outline of each cover.

    Args:
        lower_mm: of the lower rim.
        land_mm: (n, 4, k) of the land along the sides +x, +y, -x and -y of the block's own axes,
            each counter-clockwise seen from above.

    Raises:
        ConfigError: another shape, or heights that no cover has.
    """

    lower_mm: float
    land_mm: np.ndarray

    def __post_init__(self) -> None:
        land = np.array(self.land_mm, float)
        if land.ndim != 3 or land.shape[1] != 4 or land.shape[2] < 2 or not len(land):
            raise ConfigError(
                f'covers: heights of shape {land.shape}; they must be blocks x 4 sides x 2 or more'
            )
        heights = np.append(land.ravel(), self.lower_mm)
        if not (np.isfinite(heights).all() and abs(heights).max() <= MOST_MM):
            raise ConfigError(f'covers: heights must lie within {MOST_MM:g} mm of the platform')
        if land.min() < self.lower_mm:
            raise ConfigError(
                f'covers: land at {land.min():g} mm lies below the lower rim, which is at '
                f'{self.lower_mm:g} mm'
            )
        land.setflags(write=False)
        object.__setattr__(self, 'land_mm', land)

    @classmethod
    def of_meshes(
        cls, meshes: list[np.ndarray], gap_mm: float, side_m: float = TableSettings.block_side_m
    ) -> 'CoverOutlines':
        """Return those of printed covers, triangles (n, 3, 3) in mm each, by block id.

        The lower rim of a mesh lies at z = 0 and stands `gap_mm` over the platform.
        """
        return cls(gap_mm, np.round([gap_mm + _edges(mesh, side_m) for mesh in meshes], 2))

    def over(self, plane_m: float) -> np.ndarray:
        """Return heights (n + 1, 4, 1 + POINTS) in m over a plane: lower rim, then land.

        The last cover is the mean of all, for a block that is not known by name.
        """
        land = _resampled(self.land_mm)
        land = np.concatenate([land, np.full((1, 4, POINTS), land.mean())])
        lower = np.full((*land.shape[:2], 1), self.lower_mm)
        return 1e-3 * np.concatenate([lower, land], axis=2) - plane_m


def _edges(mesh: np.ndarray, side_m: float) -> np.ndarray:
    """Return heights (4, POINTS) of the upper edges of a cover's sides."""
    points = mesh.reshape(-1, 3).astype(float)
    half = np.abs(points[:, :2]).max()
    if not 0.8 < 2e-3 * half / side_m < 1.2:
        raise ConfigError(
            f'covers: a mesh is {2 * half:g} wide; covers are {1e3 * side_m:g} mm, their '
            'lower rim centred on the origin'
        )
    found = []
    for away, along in (((1, 0), (0, 1)), ((0, 1), (-1, 0)), ((-1, 0), (0, -1)), ((0, -1), (1, 0))):
        side = points[points[:, :2] @ away > half - 0.05]
        at = np.round(side[:, :2] @ along, 2)
        places, index = np.unique(at, return_inverse=True)
        top = np.zeros(len(places))
        np.maximum.at(top, index.reshape(-1), side[:, 2])
        found.append(np.interp(np.linspace(-half, half, POINTS), places, top))
    return np.array(found)


def _resampled(land: np.ndarray) -> np.ndarray:
    """Return heights (..., POINTS) of heights (..., k) at equal steps along the same side."""
    at = np.linspace(0, land.shape[-1] - 1, POINTS)
    low = np.minimum(at.astype(int), land.shape[-1] - 2)
    return land[..., low] * (1 - at + low) + land[..., low + 1] * (at - low)
