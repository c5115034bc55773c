# SPDX-License-Identifier: Apache-2.0
"""The arrays of the event path: sliding blocks and changing springs side by side, a lane each."""

from typing import NamedTuple

import numpy as np
from numba import njit

from eol_ros.core.physics.lattice import LANES

DENSE = 48  # up to so many sliding blocks linear springs stand as a square matrix


class Root(NamedTuple):
    """Vectors as series, and what the inverse of their length needs; rows k, one lane each."""

    x: np.ndarray
    y: np.ndarray
    square: np.ndarray
    inverse: np.ndarray  # 1 / length
    nx: np.ndarray  # x / length
    ny: np.ndarray


class Plane(NamedTuple):
    """The sliding blocks side by side, and the springs that change."""

    slot: np.ndarray  # lane of each block, or -1
    slots: np.ndarray  # block of each lane
    fresh: np.ndarray  # lanes that start at rest
    ax: np.ndarray  # displacement series
    ay: np.ndarray
    w: Root  # velocity, or for fresh lanes velocity / t
    fx: np.ndarray  # force of one order
    fy: np.ndarray
    inverse: np.ndarray
    friction: np.ndarray
    drive: np.ndarray  # (3, lanes)
    dense: np.ndarray
    d: Root  # along the active springs; nx, ny become their forces
    place: np.ndarray  # lane of each spring, or -1
    act: np.ndarray  # spring of each lane
    act_first: np.ndarray  # lanes of its ends, or -1
    act_second: np.ndarray
    act_anchor: np.ndarray
    act_k: np.ndarray
    act_natural: np.ndarray
    swing: np.ndarray


@njit(cache=True)
def _root(size, wide):
    return Root(
        np.zeros((size, wide)), np.zeros((size, wide)), np.zeros((size, wide)),
        np.zeros((size, wide)), np.zeros((size, wide)), np.zeros((size, wide)),
    )


@njit(cache=True)
def make_plane(at, order):
    """Return empty lanes for a lattice."""
    wide = (at.n + LANES - 1) // LANES * LANES
    springs = len(at.k) if at.geometric else 0
    lanes = (springs + LANES - 1) // LANES * LANES
    size, side = order + 2, min(DENSE, wide)
    return Plane(
        np.full(at.n, -1), np.zeros(wide, np.int64), np.zeros(wide, np.bool_),
        np.zeros((size, wide)), np.zeros((size, wide)), _root(size, wide),
        np.zeros(wide), np.zeros(wide), np.zeros(wide), np.zeros(wide), np.zeros((3, wide)),
        np.zeros((side, side)), _root(size, lanes), np.full(max(springs, 1), -1),
        np.zeros(lanes, np.int64), np.zeros(lanes, np.int64), np.zeros(lanes, np.int64),
        np.zeros(lanes, np.int64), np.zeros(lanes), np.zeros(lanes), np.zeros(wide),
    )


@njit(cache=True)
def fill_plane(sliding, driven, at, pl):
    """Give each sliding block and each changing spring its lane; return how many of each."""
    m = count = 0
    for i in range(at.n):
        pl.slot[i] = -1
        if sliding[i]:
            pl.slot[i] = m
            pl.slots[m] = i
            pl.inverse[m], pl.friction[m] = at.inverse[i], at.friction[i]
            for q in range(3):
                pl.drive[q, m] = at.drive[i, q]
            m += 1
    for c in range(m, (m + LANES - 1) // LANES * LANES):
        pl.inverse[c] = pl.friction[c] = pl.swing[c] = 0.0
        pl.fresh[c] = False
        for k in range(len(pl.ax)):
            pl.ax[k, c] = pl.ay[k, c] = 0.0
            pl.w.x[k, c] = pl.w.y[k, c] = 0.0
        pl.drive[0, c] = pl.drive[1, c] = pl.drive[2, c] = 0.0
    if at.geometric:
        for e in range(len(at.k)):
            i, j = at.first[e], at.second[e]
            rim = j >= at.n
            pl.place[e] = -1
            if sliding[i] or (driven if rim else sliding[j]):
                pl.place[e] = count
                pl.act[count] = e
                pl.act_first[count] = pl.slot[i]
                pl.act_second[count] = -1 if rim else pl.slot[j]
                pl.act_anchor[count] = j - at.n if rim else -1
                pl.act_k[count], pl.act_natural[count] = at.k[e], at.natural[e]
                count += 1
        for q in range(count, (count + LANES - 1) // LANES * LANES):
            pl.act_k[q] = pl.act_natural[q] = 0.0
            for k in range(len(pl.ax)):
                pl.d.x[k, q] = pl.d.y[k, q] = 0.0
    elif m <= DENSE:
        mp = (m + LANES - 1) // LANES * LANES
        for c in range(m):
            for j in range(mp):
                pl.dense[c, j] = 0.0
            i = pl.slots[c]
            pl.dense[c, c] = -at.k_sum[i]
            for e in range(at.lo[i], at.lo[i + 1]):
                j = pl.slot[at.near[e]]
                if j >= 0:
                    pl.dense[c, j] += at.k_near[e]
    return m, count
