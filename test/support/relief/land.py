# SPDX-License-Identifier: Apache-2.0
"""What a camera sees of the covers that are cut out of a landscape, without their meshes."""

import numpy as np

from assets.covers.mesh import CoverShape, tile
from eol_ros.core.vision.calibration.covers import CoverOutlines, _resampled


def land_edges(heights: np.ndarray, shape: CoverShape, cells: int) -> np.ndarray:
    """Return the height of the land along the sides of each cover, (n, 4, cells + 1).

    In mm over the lower rim; sides +x, +y, -x, -y, each counter-clockwise seen from above.
    """
    rows, cols = (heights.shape[0] - 1) // cells, (heights.shape[1] - 1) // cells
    found = []
    for i in range(rows * cols):
        land = tile(heights, *divmod(i, cols), cells)
        found.append([land[:, -1], land[-1, ::-1], land[::-1, 0], land[0]])
    return shape.skirt_mm + shape.relief_mm * np.array(found)


def outlines(heights: np.ndarray, shape: CoverShape, gap_mm: float, cells: int) -> CoverOutlines:
    """Return the outlines of covers whose lower rims are `gap_mm` high, as a file keeps them."""
    edges = gap_mm + _resampled(land_edges(heights, shape, cells))
    return CoverOutlines(gap_mm, np.round(edges, 2))
