# SPDX-License-Identifier: Apache-2.0
"""The outline of a cover with relief: which of its edges a camera sees, and where in the image.

A cover has straight sides. On the side that turns to the camera its lower rim is the outline, on
the others the edge of the land, which rises and falls along the side. Both stand off the plane that
the calibration is for, so the image shows them beside the square that a flat cover would be:
parallax, up to some px. How far is a table along each side, made again for each place of a block.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.vision.calibration.covers import POINTS
from eol_ros.core.vision.calibration.mapping import distorted, lifted, undistorted
from eol_ros.core.vision.calibration.model import Calibration

BINS = 48  # of a table along a side
REACH = 1.25  # half sides that a table reaches from the middle of its side
MIDDLE = 0.92  # half sides of it that are read: at its ends other edges stand
NONE = np.float32(99.0)  # px: no edge here that would be the outline
STEEP = 0.8  # px of parallax a px along the side above which an edge is too slanted to be read
# px by which a lit wall in sight, a px of it or more, is found further out than other sides are: it
# shines on the sandpaper beside its lower rim. By path-traced images, of all sides together.
SHINE_PX = np.float32(0.2)
SIZE = 1 + 4 * BINS  # of a table: its reach in px, 0 where there is none, then the sides


@njit(cache=True, inner=True)
def _draw(table, reach, t0, d0, t1, d1):
    """Raise `table` (BINS,) to the line from t0, d0 to t1, d1."""
    if t1 < t0:
        t0, d0, t1, d1 = t1, d1, t0, d0
    per_px = BINS / (2.0 * reach)
    first = max(int(math.ceil((t0 + reach) * per_px - 0.5)), 0)
    last = min(int(math.floor((t1 + reach) * per_px - 0.5)), BINS - 1)
    slope = (d1 - d0) / max(t1 - t0, 1e-9)
    for b in range(first, last + 1):
        d = d0 + ((b + 0.5) / per_px - reach - t0) * slope
        if table[b] == NONE or table[b] < d:
            table[b] = d


@njit(cache=True)
def tabulate(camera, heights, u, v, theta, half, table, shine=SHINE_PX):
    """Fill `table` (SIZE,) with how far outside the sides of a flat square the outline stands.

    camera: Calibration.packed(). heights (4, 1 + POINTS) m over the calibration's plane. The square
    is at `u`, `v` px, angle `theta` of the block's own x axis, half side in px as the fit takes it;
    `shine` is what the light of a wall in sight adds, px.
    """
    table[0] = REACH * half
    cu, cv = undistorted(camera, u, v)
    low = heights[0, 0]
    high = low
    for side in range(4):
        for j in range(1, POINTS + 1):
            high = max(high, heights[side, j])
    span = max(high - low, 1e-6)
    # parallax at the corners: exact at three heights, and a parabola between
    shift = np.empty((4, 3, 2))
    for k in range(4):  # from side k - 1 to side k
        angle = theta + (k - 0.5) * math.pi / 2
        pu = cu + half * math.sqrt(2.0) * cos(angle)
        pv = cv - half * math.sqrt(2.0) * sin(angle)
        bu, bv = distorted(camera, pu, pv)
        for m in range(3):
            qu, qv = lifted(camera, pu, pv, low + 0.5 * m * span)
            qu, qv = distorted(camera, qu, qv)
            shift[k, m, 0], shift[k, m, 1] = qu - bu, qv - bv
    mirrored = camera[28] < 0
    upper = np.empty(BINS, np.float32)
    for k in range(4):
        angle = theta + k * math.pi / 2
        nu, nv = cos(angle), -sin(angle)
        tu, tv = -sin(angle), -cos(angle)
        one, other = shift[k], shift[(k + 1) % 4]
        mine = table[1 + k * BINS : 1 + (k + 1) * BINS]
        mine[:] = NONE
        upper[:] = NONE
        physical = -k % 4 if mirrored else k
        d0, d1 = one[0, 0] * nu + one[0, 1] * nv, other[0, 0] * nu + other[0, 1] * nv
        t0, t1 = one[0, 0] * tu + one[0, 1] * tv, other[0, 0] * tu + other[0, 1] * tv
        _draw(mine, table[0], t0 - half, d0, t1 + half, d1)
        lower_d = 0.5 * (d0 + d1)
        upper_d = 0.0
        before_t = before_d = 0.0
        for j in range(POINTS):
            at = j if not mirrored else POINTS - 1 - j
            s = (heights[physical, 1 + at] - low) / span
            w0 = (1.0 - s) * (1.0 - 2.0 * s)
            w1 = 4.0 * s * (1.0 - s)
            w2 = s * (2.0 * s - 1.0)
            f = j / (POINTS - 1.0)
            du = dv = 0.0
            for axis in range(2):
                a = w0 * one[0, axis] + w1 * one[1, axis] + w2 * one[2, axis]
                b = w0 * other[0, axis] + w1 * other[1, axis] + w2 * other[2, axis]
                if axis == 0:
                    du = a + f * (b - a)
                else:
                    dv = a + f * (b - a)
            d = du * nu + dv * nv
            t = (2.0 * f - 1.0) * half + du * tu + dv * tv
            if j > 0:
                _draw(upper, table[0], before_t, before_d, t, d)
            before_t, before_d = t, d
            upper_d += d / POINTS
        far = upper_d > lower_d
        for b in range(BINS):
            if upper[b] != NONE and (mine[b] == NONE or upper[b] > mine[b]):
                mine[b] = upper[b]
            elif upper[b] == NONE and far:
                mine[b] = NONE  # beside the land stands the slanting edge of another side
            elif mine[b] != NONE:
                wall = mine[b] - upper[b] if upper[b] != NONE else np.float32(1.0)
                mine[b] += shine * min(wall, np.float32(1.0))
        pitch = 2.0 * table[0] / BINS
        for b in range(BINS - 1):  # where the land falls steeply no edge is read well
            steep = mine[b] != NONE and mine[b + 1] != NONE
            upper[b] = -NONE if steep and abs(mine[b + 1] - mine[b]) > STEEP * pitch else NONE
        for b in range(BINS - 1):
            if upper[b] == -NONE:
                mine[b] = NONE


@njit(inline='always')
def outside(table, side, t):
    """Return how far outside of a flat square's `side` the outline stands, or NONE.

    At `t` along it: see tabulate.
    """
    at = (t + table[0]) * (np.float32(0.5 * BINS) / table[0]) - np.float32(0.5)
    b = int(at)
    if at < np.float32(0.0) or b >= BINS - 1:
        return NONE
    first, second = table[1 + side * BINS + b], table[2 + side * BINS + b]
    if max(first, second) == NONE:
        return NONE
    return first + (at - np.float32(b)) * (second - first)


def tables(calibration: Calibration, blobs: np.ndarray, shine: np.float32 = SHINE_PX) -> np.ndarray:
    """Return tables (n, SIZE) of blocks 0 to n - 1, found as `blobs` (n,), a SQUARE array.

    shine: as of `tabulate`.
    """
    found = np.zeros((len(blobs), SIZE), np.float32)
    if calibration.covers is None:
        return found
    camera, heights = calibration.packed(), calibration.covers.over(calibration.cover_height_m)
    for i, blob in enumerate(blobs):
        u, v, theta, half = (float(blob[k]) for k in ('u', 'v', 'theta', 'side_px'))
        tabulate(camera, heights[i], u, v, theta, half / 2, found[i], shine)
    return found


def corner_shifts(calibration: Calibration, blobs: np.ndarray) -> np.ndarray:
    """Return how far (n, 4, 2) px the corners of outlines stand beside those of flat covers.

    Arguments as of `tables`; order of the corners as of corners.corners. A side stands where the
    straight line nearest to its outline does.
    """
    sides = tables(calibration, blobs)[:, 1:].reshape(-1, 4, BINS).astype(float)
    there = sides < NONE
    t = ((np.arange(BINS) + 0.5) / BINS * 2 - 1) * REACH
    weight = np.where(there & (abs(t) < MIDDLE), 1.0, 0.0)
    n = np.maximum(weight.sum(axis=2), 1.0)
    middle = (weight * t).sum(axis=2) / n
    lever = weight * (t - middle[..., None])
    mean = (weight * np.where(there, sides, 0.0)).sum(axis=2) / n
    slope = (lever * np.where(there, sides, 0.0)).sum(axis=2) / np.maximum((lever * t).sum(2), 1e-9)
    low, high = mean - slope * (1 + middle), mean + slope * (1 - middle)  # at t = -1 and 1
    angle = blobs['theta'][:, None] + np.arange(4) * np.pi / 2
    normal = np.stack([elementary.cos(angle), -elementary.sin(angle)], axis=-1)
    pairs = ((3, 0), (0, 1), (1, 2), (2, 3))  # each ends where the next begins
    return np.stack(
        [high[:, i, None] * normal[:, i] + low[:, j, None] * normal[:, j] for i, j in pairs], axis=1
    )
