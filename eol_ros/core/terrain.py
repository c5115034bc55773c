# SPDX-License-Identifier: Apache-2.0
"""The landscape on the covers of the blocks, sampled on one grid over the whole table.

Arrays are indexed [row (y away), column (x right)].
"""

import numpy as np

from eol_ros.settings import TableSettings


def landscape(
    seed: int,
    rows: int = TableSettings.rows,
    cols: int = TableSettings.columns,
    cells: int = 32,
) -> np.ndarray:
    """Return heights 0..1 on the grid of `rows` x `cols` covers of `cells` x `cells` squares each.

    Ridged multifractal noise (Musgrave in Ebert et al., Texturing and Modeling, 3rd ed. 2003, ch.
    16) over a warped plane, with a flat sea where it lies low. Shape (rows * cells + 1, cols *
    cells + 1).
    """
    rng = np.random.default_rng(seed)
    y, x = np.meshgrid(
        np.arange(rows * cells + 1) / cells, np.arange(cols * cells + 1) / cells, indexing='ij'
    )
    warp_x = _noise(rng, x / 2.6, y / 2.6)
    warp_y = _noise(rng, x / 2.6, y / 2.6)
    x, y = x + 0.9 * warp_x, y + 0.9 * warp_y
    height = 0.9 * _noise(rng, x / 3.1, y / 3.1)
    weight = np.ones_like(height)
    for octave in range(6):
        scale = 2.1**octave / 2.2
        ridge = (1 - np.abs(_noise(rng, x * scale, y * scale))) ** 2
        height += 0.62**octave * ridge * weight * 0.8
        weight = np.clip(ridge * weight * 1.4, 0, 1)
    height -= np.quantile(height, 0.12)  # an eighth of the land lies under water
    sea = np.maximum(height, 0.0)
    return sea / max(float(sea.max()), 1e-12)


def _noise(rng: np.random.Generator, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return gradient noise in about -1..1 at (x, y) (Perlin, SIGGRAPH 2002)."""
    x = x - np.floor(x.min())
    y = y - np.floor(y.min())
    ix, iy = x.astype(int), y.astype(int)
    angle = rng.uniform(0, 2 * np.pi, (iy.max() + 2, ix.max() + 2))
    gx, gy = np.cos(angle), np.sin(angle)
    fx, fy = x - ix, y - iy

    def corner(dy: int, dx: int) -> np.ndarray:
        return gx[iy + dy, ix + dx] * (fx - dx) + gy[iy + dy, ix + dx] * (fy - dy)

    sx, sy = (f * f * f * (f * (f * 6 - 15) + 10) for f in (fx, fy))
    low = corner(0, 0) * (1 - sx) + corner(0, 1) * sx
    high = corner(1, 0) * (1 - sx) + corner(1, 1) * sx
    return 1.5 * (low * (1 - sy) + high * sy)
