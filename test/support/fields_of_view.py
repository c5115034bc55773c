# SPDX-License-Identifier: Apache-2.0
"""Flashes of the rendered table as WCAG 2.2 counts them: a pixel and a 10 degree field at a time.

Written from the standard's text and independent of eol_ros.core.light: a flash is a pair of
opposing changes of 10 % or more of the maximum relative luminance; a field flashes where such
changes that occur concurrently (within CONCURRENT_S) cover more than 0.006 sr of a 10 degree field.
Stricter than the text, changes above a relative luminance of 0.8 count as well.
"""

import math

import numpy as np

RATE_HZ = 120
CONCURRENT_S = 0.05
PIXEL_DEG = 0.25
SIDE_M = 0.084


def fields(centres_m, eye_m, step_deg=1.5):
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
    way = np.where(down, -eye[2] / np.where(down, rays[..., 2], -1.0), np.nan)
    spot = eye[:2] + way[..., None] * rays[..., :2]
    sr = np.cos(v) * math.radians(PIXEL_DEG) ** 2
    shows = np.full(h.shape, -1)
    for block, centre in enumerate(centres_m):
        shows[(np.abs(spot - centre) <= SIDE_M / 2).all(axis=-1)] = block
    lit = shows >= 0
    pixels, block, weight = rays[lit], shows[lit], sr[lit]
    found = []
    stride = round(step_deg / PIXEL_DEG)
    for middle in rays[::stride, ::stride].reshape(-1, 3):
        inside = pixels @ middle >= math.cos(math.radians(5))
        if weight[inside].sum() > 0.006:
            found.append(np.bincount(block[inside], weight[inside], len(centres_m)))
    return np.array(found).reshape(-1, len(centres_m))


def changes(luminance):
    """Return (sample, direction) of each change of a pixel by 10 % from the extreme before it."""
    found, direction = [], 0
    low = high = luminance[0]  # since the last change; the extreme that the next one starts from
    for k, value in enumerate(luminance.tolist()):
        low, high = min(low, value), max(high, value)
        if direction <= 0 and value - low >= 0.1:
            direction, high = 1, value
            found.append((k, 1))
        elif direction >= 0 and high - value >= 0.1:
            direction, low = -1, value
            found.append((k, -1))
    return found


def most_in_a_second(levels, areas_sr):
    """Return the most flashes of any field in any second.

    levels: (samples, blocks) at RATE_HZ; areas_sr: as `fields` returns it. The pairs of a second
    are at most its changes to one side, whichever are fewer.
    """
    marked = {+1: np.zeros(levels.shape, bool), -1: np.zeros(levels.shape, bool)}
    for block in range(levels.shape[1]):
        for k, direction in changes(levels[:, block]):
            marked[direction][k, block] = True
    counts = [_events(mark, areas_sr) for mark in marked.values()]
    window = np.ones(RATE_HZ + 1, int)
    sums = [np.array([np.convolve(row, window) for row in of]) for of in counts]
    return int(np.minimum(*sums).max()) if len(areas_sr) else 0


def _events(mark, areas_sr):
    """Count, (fields, samples), when concurrent changes first cover more than 0.006 sr."""
    times = np.flatnonzero(mark.any(axis=1))
    events = np.zeros((len(areas_sr), len(mark)), int)
    last = np.full((len(areas_sr), mark.shape[1]), -np.inf)  # change that no event has used
    for k in times:
        last[:, mark[k]] = k
        recent = last >= k - CONCURRENT_S * RATE_HZ
        flashed = (areas_sr * recent).sum(axis=1) > 0.006
        events[flashed, k] = 1
        last[recent & flashed[:, None]] = -np.inf
    return events
