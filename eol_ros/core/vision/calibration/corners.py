# SPDX-License-Identifier: Apache-2.0
"""The four corners of a cover, each side measured on its own: what calibration is solved from.

A blurred step is fitted to the light across each of some parts of a side, and a line through where
these stand.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit, read_only
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision import outline
from eol_ros.core.vision.calibration import falling_light
from eol_ros.core.vision.calibration.falling_light import BIN_PX, BINS, REACH_PX
from eol_ros.core.vision.calibration.model import Calibration

BLUR_PX = 1.25  # of a lens in focus
PARTS, ENDS = 8, 2  # of a side; of one in relief, whose light falls towards it
CORNER_PX = 1.75  # left out at each end of a side, where two edges mix
FULL = 254  # grey levels: a saturated pixel says nothing
# Step of a part, in that which a quarter of all parts of a cover exceeds: half a printed cover may
# be half as bright as the other half, and light falls towards its corners to two thirds
STEPS = 0.3, 2.0
OTHER, MIN_STEP = 0.2, 8.0  # of that step, light beside it that is not the platform's; grey levels
WHOLE = 0.6  # share of a side that agrees
ROUNDS = 8  # at most, of reading all sides again where they were found
SETTLED_PX = 0.01  # what no further round would change


@njit(cache=True)
def _gather(image, squares, tables, lines, seen):
    """Fill `seen` (n, 4, parts, BINS, 3) with the pixels beside the sides; see falling_light.edges.

    squares (n, 4): u, v, theta, half side. lines (n, 4, 2): by how much each side stands further
    outside, and its slope along the side; tables as of `corners`.
    """
    seen[:] = 0.0
    parts = seen.shape[2]
    for s in range(squares.shape[0]):
        u, v, theta, half = squares[s, 0], squares[s, 1], squares[s, 2], squares[s, 3]
        c, z, limit = cos(theta), sin(theta), half - CORNER_PX
        reach = (half + 2 * REACH_PX) * (abs(c) + abs(z))
        for row in range(max(int(v - reach), 0), min(int(v + reach) + 1, image.shape[0])):
            for col in range(max(int(u - reach), 0), min(int(u + reach) + 1, image.shape[1])):
                grey, x, y = image[row, col], col - u, v - row
                along, across = c * x + z * y, c * y - z * x
                for side in range(4):
                    if side % 2 == 0:
                        d, t = (along, across) if side == 0 else (-along, -across)
                    else:
                        d, t = (across, -along) if side == 1 else (-across, along)
                    if abs(t) >= limit or grey >= FULL:
                        continue
                    d -= half + lines[s, side, 0] + lines[s, side, 1] * t
                    if tables[s, 0] > 0.0:
                        d -= outline.outside(tables[s], side, np.float32(t))
                    b = int(math.floor((d + REACH_PX) / BIN_PX))
                    if 0 <= b < BINS:
                        its = seen[s, side, int((t / limit + 1.0) * 0.5 * parts), b]
                        its[0] += 1.0
                        its[1] += d
                        its[2] += grey


def _line(off: np.ndarray, good: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return a, b of the line a + b t through `off` (..., parts), and the share that agrees.

    good, t: as large. By Tukey's weights (Huber and Ronchetti, Robust Statistics, 2009).
    """
    a, b, width = np.zeros(off.shape[:-1]), np.zeros(off.shape[:-1]), 1.5
    for _ in range(5):
        rest = off - a[..., None] - b[..., None] * t
        weight = good * np.clip(1 - (rest / width) ** 2, 0, 1) ** 2
        total = weight.sum(-1) + 1e-9
        width = np.maximum(6 * np.sqrt((weight * rest**2).sum(-1) / total), 0.05)[..., None]
        middle = (weight * t).sum(-1) / total
        lever = weight * (t - middle[..., None])
        b = (lever * off).sum(-1) / ((lever * t).sum(-1) + 1e-9)
        a = (weight * off).sum(-1) / total - b * middle
    return a, b, (weight > 0).mean(-1)


def _lines(
    image: np.ndarray, blobs: np.ndarray, tables: np.ndarray, parts: int, rounds: int
) -> tuple[np.ndarray, ...]:
    """Return lines (n, 4, 2) as of `_gather`, by how much they move, and the share that agrees.

    All sides are read again where they were found until none moves: a step stops short of its end,
    and light outside of one that stands wrong is the light of an edge. Then what is seen at these
    lines, 0 of parts that do not agree, and where (n, 1, parts) px they lie along a side.
    """
    squares = np.column_stack([blobs['u'], blobs['v'], blobs['theta'], blobs['side_px'] / 2])
    lines, seen = np.zeros((len(blobs), 4, 2)), np.zeros((len(blobs), 4, parts, BINS, 3))
    t = (squares[:, 3, None, None] - CORNER_PX) * ((np.arange(parts) + 0.5) / parts * 2 - 1)
    share, good, moved = np.zeros(lines.shape[:2]), np.zeros(0), np.zeros(lines.shape)
    low, high = STEPS
    for k in range(rounds):
        _gather(read_only(image), squares, tables, lines, seen)
        at, levels = falling_light.steps(seen, BLUR_PX)
        outside, step = levels[..., 0], levels[..., 1]
        usual = np.quantile(step, 0.75, axis=(1, 2))[:, None, None]
        bare = np.quantile(outside, 0.25, axis=(1, 2))[:, None, None]
        good = (low * usual < step) & (step < high * usual) & (usual > MIN_STEP)
        good &= outside < bare + np.maximum(OTHER * usual, 4.0)
        a, b, share = _line(at, good, t)
        moved = np.where((share > 0.3)[..., None], np.stack([a, b], -1), 0.0)
        far = np.abs(moved)
        if k == rounds - 1 or (far[..., 0] + far[..., 1] * squares[:, 3:]).max() < SETTLED_PX:
            break
        lines += moved
    return lines, moved, share, seen * good[..., None, None], t


def sides_px(image: np.ndarray, squares: np.ndarray, camera: Calibration) -> np.ndarray:
    """Return how wide blocks (n,) are between their sides, px; NaN where a side is not whole.

    squares: SQUARE (n,), where they stand in `image`.
    """
    tables = outline.tables(camera, squares, falling_light.NEAR_SHINE_PX)
    _, moved, share, _, _ = _lines(image, squares, tables, 4, 1)  # one reading: from where they are
    wide = squares['side_px'] + moved[..., 0].sum(axis=1) / 2
    return np.where((share > WHOLE).all(axis=1), wide, np.nan)


def corners(image: np.ndarray, blobs: np.ndarray, tables: np.ndarray | None = None) -> np.ndarray:
    """Return the corners (n, 4, 2) in px of `blobs` (SQUARE array); NaN where a side is not whole.

    Order as seen from the block's own axes: (+x -y), (+x +y), (-x +y), (-x -y). With tables of
    covers with relief (outline.tables) sides are where falling_light finds them.
    """
    flat = np.zeros((len(blobs), outline.SIZE), np.float32)
    where = flat if tables is None else tables
    lines, moved, share, seen, t = _lines(image, blobs, where, PARTS, ROUNDS)
    if tables is not None:
        side_px = float(np.median(blobs['side_px']))
        seen = seen.reshape(*seen.shape[:2], ENDS, -1, *seen.shape[3:]).sum(axis=3)
        t = np.broadcast_to(t.reshape(len(t), 1, ENDS, -1).mean(axis=3), seen.shape[:3])
        good, off = seen[..., 0].sum(axis=-1) > 0, np.zeros(t.shape)
        off[good] = falling_light.edges(seen[good], BLUR_PX, side_px)
        a, b, _ = _line(off, good, t)
        moved = np.stack([a, b], axis=-1)
    lines += moved
    reach = blobs['side_px'][:, None] / 2 + lines[..., 0]
    square = blobs['theta'][:, None] + np.arange(4) * np.pi / 2
    angle = square - np.arctan(lines[..., 1])
    # a point on each side, and its normal; a line is n . (p - c) = d
    foot = np.stack([elementary.cos(square), -elementary.sin(square)], axis=-1) * reach[..., None]
    normal = np.stack([elementary.cos(angle), -elementary.sin(angle)], axis=-1)
    reach = (normal * foot).sum(axis=-1)
    found, whole = np.full((len(blobs), 4, 2), np.nan), share > WHOLE
    both = whole & np.roll(whole, 1, axis=1)  # each corner is between a side and the one before
    pairs = np.stack([np.roll(normal, 1, axis=1), normal], axis=2)[both]
    offset = np.stack([np.roll(reach, 1, axis=1), reach], axis=2)[both]
    place = np.column_stack([blobs['u'], blobs['v']])[:, None]
    centre = np.broadcast_to(place, found.shape)[both]
    found[both] = np.linalg.solve(pairs, offset[..., None])[..., 0] + centre
    return found
