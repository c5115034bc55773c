# SPDX-License-Identifier: Apache-2.0
"""The four corners of a cover, each side measured on its own: what calibration is solved from."""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit, read_only
from eol_ros.core.vision import outline
from eol_ros.core.vision.calibration import falling_light, profiles
from eol_ros.core.vision.calibration.model import Calibration

BLUR_PX = 1.25  # of a lens in focus
WHOLE = 0.6  # share of a side that agrees
ROUNDS = 8  # at most, of reading all sides again where they were found
SETTLED_PX = 0.005  # what no further round would change


@njit(cache=True)
def _placed(table, half, lines, placed):
    """Fill `placed` (SIZE,) with `table`, or a flat square's, each side moved to its own line.

    lines (4, 2): how far outside of its place in a square each side lies, and its slope along t.
    """
    placed[0] = np.float32(outline.REACH * half)
    for side in range(4):
        for b in range(outline.BINS):
            at = 1 + side * outline.BINS + b
            beside = table[at] if table[0] > 0.0 else np.float32(0.0)
            placed[at] = beside
            if beside != outline.NONE:
                t = ((b + 0.5) / outline.BINS * 2.0 - 1.0) * outline.REACH * half
                placed[at] += lines[side, 0] + lines[side, 1] * t


@njit(cache=True)
def _line(lines):
    """Return the line a + b t through the offsets of one side, and the share that agrees."""
    a = b = share = 0.0
    width = 1.5
    for _ in range(5):
        s0 = s1 = s2 = y0 = y1 = rest2 = total = used = 0.0
        for line in lines:
            t, y, w = line.t, line.offset, line.weight
            rest = y - a - b * t
            if line.valid == 0.0 or w <= 0 or abs(rest) >= width:
                continue
            tukey = (1 - (rest / width) ** 2) ** 2
            rest2 += tukey * rest * rest
            total += tukey
            used += 1
            w *= tukey
            s0 += w
            s1 += w * t
            s2 += w * t * t
            y0 += w * y
            y1 += w * t * y
        det = s0 * s2 - s1 * s1
        if used < 6 or det <= 0:
            return 0.0, 0.0, 0.0
        a = (s2 * y0 - s1 * y1) / det
        b = (s0 * y1 - s1 * y0) / det
        share = used / max(len(lines), 1)
        width = max(6 * math.sqrt(rest2 / total), 0.05)
    return a, b, share


@njit(cache=True)
def _gathered(lines, light, sides, seen):
    """Fill `seen` (4, BINS, 3) with the pixels of the profiles, by their distance from the line.

    How many, and the sums of their distances and of their light.
    """
    seen[:] = 0.0
    for side in range(4):
        for i in range(lines.shape[1]):
            line = lines[side, i]
            for k in range(sides.taps if line.valid else 0):
                d, grey = line.first + sides.slope * k, light[side, i, k]
                b = int(math.floor((d + falling_light.REACH_PX) / falling_light.BIN_PX))
                if abs(line.t + d * sides.lean) > sides.limit or grey >= profiles.FULL:
                    continue
                if 0 <= b < seen.shape[1]:
                    seen[side, b, 0] += 1.0
                    seen[side, b, 1] += d
                    seen[side, b, 2] += grey


@njit(cache=True)
def side_lines(image, squares, blur, tables, work, out, seen):
    """Fit a line to each side of `squares` (n, >= 4): u, v, theta, half side.

    tables (n, outline.SIZE): where the outline of a cover with relief stands; the lines are then
    those of a flat one. work: of profiles.workspace. out (n, 4, 3): distance of the side from the
    centre in px, its turn against the square in rad, and the share of its profiles that agree. A
    tilted camera makes the four differ, by a px and more. All are read again where they were found
    until none moves: a step stops short of its end, and light outside of one that stands wrong is
    the light of an edge.

    seen (n, 4, BINS, 3), or empty: what is seen beside these lines, see falling_light.edges.
    """
    (profile, light), placed = work, np.zeros(outline.SIZE, np.float32)
    for s in range(squares.shape[0]):
        u, v, theta, half = squares[s, 0], squares[s, 1], squares[s, 2], squares[s, 3]
        out[s] = 0.0
        lines = np.zeros((4, 2))
        sides = profiles.sides_of(theta, half, blur, tables[s, 0] > 0.0)
        for _ in range(ROUNDS):
            _placed(tables[s], half, lines, placed)
            counts = profiles.gather(image, u, v, theta, half, sides, placed, profile, light)
            levels = profiles.levels(profile, light, counts, sides)
            if levels.contrast == 0.0:
                out[s, :, 2] = 0.0
                break
            levels = profiles.shrink_levels(profile, levels, sides.soft)
            profiles.offsets(profile, light, sides, levels)
            most = 0.0
            for side in range(4):
                its = profile[side, profiles.IDLE : profiles.IDLE + counts[side]]
                a, b, out[s, side, 2] = _line(its)
                lines[side, 0] += a
                lines[side, 1] += b
                most = max(most, abs(a) + abs(b) * half)
            if most < SETTLED_PX:
                break
        if len(seen):
            _gathered(profile, light, sides, seen[s])
        for side in range(4):
            out[s, side, 0] = half + lines[side, 0]
            out[s, side, 1] = -math.atan(lines[side, 1])


def _read(
    image: np.ndarray, blobs: np.ndarray, tables: np.ndarray, covers: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (n, 4) of `blobs`, their lines (n, 4, 3), and `covers` times what is seen."""
    squares = np.column_stack([blobs['u'], blobs['v'], blobs['theta'], blobs['side_px'] / 2])
    lines, seen = np.zeros((len(squares), 4, 3)), np.zeros((covers, 4, falling_light.BINS, 3))
    side_lines(read_only(image), squares, BLUR_PX, tables, profiles.workspace(), lines, seen)
    return squares, lines, seen


def sides_px(image: np.ndarray, squares: np.ndarray, camera: Calibration) -> np.ndarray:
    """Return how wide blocks (n,) are between their sides, px; NaN where a side is not whole.

    squares: SQUARE (n,), where they stand in `image`.
    """
    tables = outline.tables(camera, squares, falling_light.NEAR_SHINE_PX)
    _, lines, _ = _read(image, squares, tables)
    return np.where((lines[..., 2] > WHOLE).all(axis=1), lines[..., 0].sum(axis=1) / 2, np.nan)


def corners(image: np.ndarray, blobs: np.ndarray, tables: np.ndarray | None = None) -> np.ndarray:
    """Return the corners (n, 4, 2) in px of `blobs` (SQUARE array); NaN where a side is not whole.

    Order as seen from the block's own axes: (+x -y), (+x +y), (-x +y), (-x -y). With tables of
    covers with relief sides are where falling_light finds them.
    """
    covers = len(blobs) if tables is not None else 0
    if tables is None:
        tables = np.zeros((len(blobs), outline.SIZE), np.float32)
    squares, lines, seen = _read(image, blobs, tables, covers)
    if covers:
        wide = float(np.median(blobs['side_px']))
        lines[..., 0] += falling_light.edges(seen, BLUR_PX, wide)
    flat = squares[:, 2, None] + np.arange(4) * np.pi / 2
    angle = flat + lines[:, :, 1]
    # a point on each side, and its normal; a line is n . (p - c) = d
    foot = np.stack([elementary.cos(flat), -elementary.sin(flat)], axis=-1) * lines[:, :, :1]
    normal = np.stack([elementary.cos(angle), -elementary.sin(angle)], axis=-1)
    reach = (normal * foot).sum(axis=-1)
    found, whole = np.full((len(squares), 4, 2), np.nan), lines[:, :, 2] > WHOLE
    both = whole & np.roll(whole, 1, axis=1)  # each corner is between a side and the one before
    pairs = np.stack([np.roll(normal, 1, axis=1), normal], axis=2)[both]
    offset = np.stack([np.roll(reach, 1, axis=1), reach], axis=2)[both]
    centre = np.broadcast_to(squares[:, None, :2], found.shape)[both]
    found[both] = np.linalg.solve(pairs, offset[..., None])[..., 0] + centre
    return found
