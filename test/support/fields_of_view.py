# SPDX-License-Identifier: Apache-2.0
"""Flashes of the rendered table as WCAG 2.2 counts them: a pixel and a 10 degree field at a time.

Written from the standard's text and independent of eol_ros.core.light: a flash is a pair of
opposing changes of 10 % or more of the maximum relative luminance; a field flashes where such
changes that occur concurrently (within CONCURRENT_S) cover more than 0.006 sr of a 10 degree field.
Stricter than the text, changes above a relative luminance of 0.8 count as well.
"""

import math

import numpy as np
from scipy.spatial import KDTree

from eol_ros.core.compiled import njit

RATE_HZ = 120
CONCURRENT_S = 0.05
PIXEL_DEG = 0.25


def fields(centres_m, eye_m, step_deg=1.5, side_m=0.084):
    """Return the solid angle in sr of each block in each field, (fields, blocks).

    centres_m: (blocks, 2) on the table; eye_m: x, y and height over it. Rays from the eye, one for
    each pixel of a regular grid of angles, meet the table; discs of 10 degrees lie on the grid.
    """
    eye = np.array(eye_m)
    gaze = np.append(np.mean(centres_m, axis=0), 0.0) - eye
    gaze /= np.linalg.norm(gaze)
    right = np.cross(gaze, [0.0, 0.0, 1.0] if abs(gaze[2]) < 0.99 else [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, gaze)
    angle = np.radians(np.arange(-50, 50 + PIXEL_DEG / 2, PIXEL_DEG))
    h, v = np.meshgrid(angle, angle)
    # longitude h and latitude v around the gaze: a pixel covers cos(v) of its square
    rays = ((np.cos(v) * np.cos(h))[..., None] * gaze + (np.cos(v) * np.sin(h))[..., None] * right
            + np.sin(v)[..., None] * up)  # fmt: skip
    down = rays[..., 2] < -0.05
    pixels = rays[down]
    spot = eye[:2] - eye[2] / pixels[:, 2:] * pixels[:, :2]
    apart, block = KDTree(centres_m).query(spot, p=np.inf)
    lit = apart <= side_m / 2
    pixels, block = pixels[lit], block[lit]
    weight = np.cos(v)[down][lit] * math.radians(PIXEL_DEG) ** 2
    found = []
    stride = round(step_deg / PIXEL_DEG)
    middles = rays[::stride, ::stride].reshape(-1, 3)
    chord = 2 * math.sin(math.radians(2.5)) + 1e-9  # includes pixels on the edge
    for inside in KDTree(pixels).query_ball_point(middles, chord, return_sorted=True):
        if weight[inside].sum() > 0.006:
            found.append(np.bincount(block[inside], weight[inside], len(centres_m)))
    return np.array(found).reshape(-1, len(centres_m))


def distinct(areas_sr, most_blocks=12):
    """Return one field, (n, blocks), of each kind that counts the same flashes.

    That depends on which sets of its blocks cover more than 0.006 sr, and on nothing else. A block
    that decides of no set is left out. Fields of more than `most_blocks` blocks are kept as they
    are.
    """
    kinds = {}
    for field in np.asarray(areas_sr):
        blocks = np.flatnonzero(field)
        if len(blocks) > most_blocks:
            kinds[field.tobytes()] = field
            continue
        total_sr = np.zeros((2,) * len(blocks))
        for axis, one_sr in enumerate(field[blocks]):  # summed in the order of `_flashed`
            with_it = [slice(None)] * len(blocks)
            with_it[axis] = 1
            total_sr[tuple(with_it)] += one_sr
        covers = total_sr > 0.006
        decides = [
            bool((covers.take(0, axis) != covers.take(1, axis)).any())
            for axis in range(len(blocks))
        ]
        for axis in np.flatnonzero(np.logical_not(decides))[::-1]:
            covers = covers.take(0, axis)
        kept = np.zeros_like(field)
        kept[blocks[decides]] = field[blocks[decides]]
        kinds.setdefault((np.flatnonzero(kept).tobytes(), covers.tobytes()), kept)
    return np.array(list(kinds.values())).reshape(-1, np.shape(areas_sr)[1])


def most_in_a_second(levels, areas_sr, rate_hz=RATE_HZ):
    """Return the most flashes of any field in any second.

    levels: (samples, blocks) at `rate_hz`; areas_sr: as `fields` returns it. The pairs of a second
    are at most its changes to one side, whichever are fewer.
    """
    levels, areas_sr = (np.ascontiguousarray(array, float) for array in (levels, areas_sr))
    return int(_most(levels, areas_sr, rate_hz))


@njit(cache=True)
def _changes(luminance, up, down):
    """Mark the changes of a pixel by 10 % from the extreme since the change before it."""
    direction = 0
    low = high = luminance[0]
    for k in range(len(luminance)):
        value = luminance[k]
        low, high = min(low, value), max(high, value)
        if direction <= 0 and value - low >= 0.1:
            direction, high = 1, value
            up[k] = 1
        elif direction >= 0 and high - value >= 0.1:
            direction, low = -1, value
            down[k] = 1


@njit(cache=True)
def _flashed(marks, blocks, sr, concurrent, found):
    """Mark when concurrent changes of the blocks of a field first cover more than 0.006 sr."""
    last = np.full(len(blocks), -(10**9))  # the change of each that no flash has used
    for k in range(len(marks)):
        new = False
        for n in range(len(blocks)):
            if marks[k, blocks[n]]:
                last[n] = k
                new = True
        if not new:
            continue
        covered = 0.0
        for n in range(len(blocks)):
            if last[n] >= k - concurrent:
                covered += sr[n]
        if covered > 0.006:
            found[k] = 1
            for n in range(len(blocks)):
                if last[n] >= k - concurrent:
                    last[n] = -(10**9)


@njit(cache=True)
def _most(levels, areas_sr, rate_hz):
    samples, blocks = levels.shape
    concurrent = CONCURRENT_S * rate_hz
    up, down = np.zeros((samples, blocks), np.int8), np.zeros((samples, blocks), np.int8)
    for block in range(blocks):
        _changes(levels[:, block], up[:, block], down[:, block])
    most = 0
    for field in range(len(areas_sr)):
        seen = np.flatnonzero(areas_sr[field])
        rises, falls = np.zeros(samples, np.int64), np.zeros(samples, np.int64)
        _flashed(up, seen, areas_sr[field][seen], concurrent, rises)
        _flashed(down, seen, areas_sr[field][seen], concurrent, falls)
        count_up = count_down = 0
        for k in range(samples):
            count_up += rises[k]
            count_down += falls[k]
            if k > rate_hz:
                count_up -= rises[k - rate_hz - 1]
                count_down -= falls[k - rate_hz - 1]
            most = max(most, min(count_up, count_down))
    return most
