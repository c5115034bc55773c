# SPDX-License-Identifier: Apache-2.0
"""Hand-drawn paths through the descriptor space, along which blocks play."""

import functools
from collections.abc import Sequence

import numpy as np


def along(lines: Sequence[str], at: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) on the paths `lines` where blocks at `at` (n, 2) play, in 0..1.

    A line has the points of one path, "X,Y X,Y ...". The x of a block is its position along each
    path, as a share of the path's length. Its y interpolates linearly between neighbouring paths,
    from the first (0) to the last (1); with one path it has no effect.

    Examples
    --------
    >>> along(['0,0 1,0 1,1'], np.array([[0.25, 0.9], [0.75, 0.1]])).tolist()
    [[0.5, 0.0], [1.0, 0.5]]
    >>> along(['0,0 1,0', '0,1 1,1'], np.array([[0.25, 0.75]])).tolist()
    [[0.25, 0.75]]
    """
    paths = np.stack([_on(points, at[:, 0]) for points in _points(tuple(lines))])
    level = at[:, 1] * (len(paths) - 1)
    low = np.clip(np.nan_to_num(level), 0, max(len(paths) - 2, 0)).astype(int)
    rows = np.arange(len(at))
    first, second = paths[low, rows], paths[np.minimum(low + 1, len(paths) - 1), rows]
    return first + (level - low)[:, None] * (second - first)


@functools.lru_cache(4)
def _points(lines: tuple[str, ...]) -> list[np.ndarray]:
    return [np.array([point.split(',') for point in line.split()], float) for line in lines]


def _on(points: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the places (n, 2) at the shares (n,) of the length of a polyline (points, 2)."""
    step = np.diff(points, axis=0)
    length = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2)
    ends = np.cumsum(length)
    i = np.minimum(np.searchsorted(ends, share * ends[-1]), len(ends) - 1)
    passed = (share * ends[-1] - (ends - length)[i]) / np.maximum(length[i], 1e-9)
    return points[i] + passed[:, None] * step[i]
