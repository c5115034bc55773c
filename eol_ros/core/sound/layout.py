# SPDX-License-Identifier: Apache-2.0
"""Places of the grains in the unit square: as measured, by rank, or spread evenly."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from eol_ros.core import elementary
from eol_ros.core.sound.ranks import ranked

EXACT_UP_TO = 2048  # grains placed in one assignment, which costs n^3; more are halved first


def scaled(values: np.ndarray, name: str) -> np.ndarray:
    """Return (n,) in 0..1: minimum to maximum, of log2 where the descriptor is in Hz.

    A value that is missing (NaN: no pitch) lies in the middle, as do all if they are the same.
    """
    values = np.asarray(values, float)
    if name.endswith('_hz'):
        values = elementary.log2(np.maximum(values, 1.0))
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(values), 0.5)
    low, high = values[known].min(), values[known].max()
    if high <= low:
        return np.full(len(values), 0.5)
    return np.where(known, (values - low) / (high - low), 0.5)


def lattice(n: int) -> np.ndarray:
    """Return `n` evenly spread places in the unit square, shape (n, 2), without one empty cell.

    Rows are as many as the root of `n`; where `n` is no product, rows of c and c + 1 cells
    alternate as evenly as they can, each stretched to the full width.
    """
    rows = max(1, round(np.sqrt(n)))
    edges = np.arange(rows + 1) * n // rows
    row = np.repeat(np.arange(rows), np.diff(edges))
    nth = np.arange(n) - edges[row]
    return np.stack([(nth + 0.5) / np.diff(edges)[row], (row + 0.5) / rows], axis=1)


def even(places: np.ndarray) -> np.ndarray:
    """Return `places` (n, 2) moved onto `lattice(n)` with the least total squared displacement.

    The assignment is exact up to 2048 grains. More are first halved at the median of their wider
    side, again and again, and each part takes the nearest share of the lattice: still one grain
    to a cell, and the order of the halves is kept.
    """
    cells = lattice(len(places))
    return cells[_assign(np.asarray(places, float), cells)]


def _assign(places: np.ndarray, cells: np.ndarray) -> np.ndarray:
    if len(places) <= EXACT_UP_TO:
        cost = ((places[:, None] - cells[None]) ** 2).sum(axis=2)
        return linear_sum_assignment(cost)[1]
    side = int(np.ptp(cells[:, 1]) >= np.ptp(cells[:, 0]))
    half = len(places) // 2
    by_place = np.argsort(places[:, side], kind='stable')
    by_cell = np.lexsort((cells[:, 1 - side], cells[:, side]))
    found = np.empty(len(places), np.int64)
    for part in (slice(None, half), slice(half, None)):
        inner = _assign(places[by_place[part]], cells[by_cell[part]])
        found[by_place[part]] = by_cell[part][inner]
    return found


def arrange(
    x: np.ndarray,
    y: np.ndarray,
    names: tuple[str, str],
    layout: str = 'even',
    blend: float = 1.0,
) -> np.ndarray:
    """Place grains in the unit square by two descriptors.

    Parameters
    ----------
    x, y : ndarray
        (n,) descriptors.
    names : tuple of str
        What they are; frequencies are laid out by their logarithm.
    layout : str
        raw, rank or even (from rank, which keeps the order of both axes best).
    blend : float
        0..1: from its raw place (0) to its place in the layout (1).

    Returns
    -------
    ndarray
        (n, 2) in 0..1.

    Examples
    --------
    >>> pitch, flatness = np.array([100.0, 200.0, 900.0]), np.array([0.3, 0.2, 0.1])
    >>> arrange(pitch, flatness, ('pitch_hz', 'flatness'), 'rank').tolist()
    [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]]
    """
    raw = np.stack([scaled(x, names[0]), scaled(y, names[1])], axis=1)
    if layout == 'raw' or not len(raw):
        return raw
    by_rank = np.stack([ranked(raw[:, 0]), ranked(raw[:, 1])], axis=1)
    target = even(by_rank) if layout == 'even' else by_rank
    return (1 - blend) * raw + blend * target
