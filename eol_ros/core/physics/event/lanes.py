# SPDX-License-Identifier: Apache-2.0
"""The arrays of the event path: a lane for each sliding block and for each spring that changes."""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import uncounted

# A lane moves already; or it starts at rest, pulled by more than its friction, by little more, or
# by just as much. A lane that creeps moves so slowly that its direction follows the force at once.
MOVING, LOOSE, WEAK, LEVEL, CREEPING = range(5)
WEAKEST = 0.01  # of the pull: less of it beyond friction is a weak start
NOTHING = 1e-12  # of the pull: so little beyond friction is rounding


class Root(NamedTuple):
    """Vectors as series, and what the inverse of their length needs; rows are lanes."""

    x: np.ndarray
    y: np.ndarray
    square: np.ndarray
    inverse: np.ndarray  # 1 / length


class Plane(NamedTuple):
    """The sliding blocks, and the springs that they change; series run along the rows."""

    slot: np.ndarray  # lane of each block, or -1
    slots: np.ndarray  # block of each lane
    start: np.ndarray  # how each lane starts: MOVING, LOOSE, WEAK, LEVEL or CREEPING
    ax: np.ndarray  # displacement series
    ay: np.ndarray
    w: Root  # velocity, or for fresh lanes velocity / t
    fx: np.ndarray  # force of one order
    fy: np.ndarray
    past_x: np.ndarray  # force of all orders, for lanes that start WEAK, LEVEL or CREEPING
    past_y: np.ndarray
    known_x: np.ndarray  # direction of all orders, for lanes that creep, as last worked out
    known_y: np.ndarray
    tie_lo: np.ndarray  # rows tie_lo[c]..tie_lo[c + 1]: linear springs of lane c to other lanes
    tie: np.ndarray
    tie_k: np.ndarray
    d: Root  # along the springs
    px: np.ndarray  # force of the springs on their first ends
    py: np.ndarray
    place: np.ndarray  # lane of each spring, or -1
    act: np.ndarray  # spring of each lane
    act_first: np.ndarray  # lanes of its ends, or -1
    act_second: np.ndarray
    act_anchor: np.ndarray
    natural: np.ndarray  # length (m) of each lane's spring without force; 0 while it passes zero
    swing: np.ndarray


def _root(lanes: int, size: int) -> Root:
    return Root(*np.zeros((4, lanes, size)))


def make_plane(at: Lattice, order: int) -> Plane:
    """Return empty lanes for a lattice."""
    size, springs = order + 2, len(at.k) if at.geometric else 0
    ties = 1 if at.geometric else len(at.near)
    weak = at.n if np.any((1 - 2 * WEAKEST) * at.static <= at.friction) else 0
    return Plane._make([
        np.full(at.n, -1, np.int64), *np.zeros((2, at.n), np.int64), *np.zeros((2, at.n, size)),
        _root(at.n, size), *np.zeros((2, at.n)), *np.zeros((4, weak, size)),
        np.zeros(at.n + 1, np.int64), np.zeros(ties, np.int64), np.zeros(ties),
        _root(springs, size), *np.zeros((2, springs, size)),
        np.full(max(springs, 1), -1, np.int64), *np.zeros((4, springs), np.int64),
        np.zeros(springs), np.zeros(at.n),
    ])  # fmt: skip


@uncounted
def fill_plane(sliding, at, pl):
    """Give each sliding block and each spring of one its lane; return how many of each."""
    m = count = 0
    for i in range(at.n):
        pl.slot[i] = -1
        if sliding[i]:
            pl.slot[i] = m
            pl.slots[m] = i
            m += 1
    if at.geometric:
        for e in range(len(at.k)):
            i, j = at.first[e], at.second[e]
            rim = j >= at.n
            pl.place[e] = -1
            if sliding[i] or (not rim and sliding[j]):
                take_lane(e, count, at, pl)
                count += 1
    else:
        ties = 0
        for c in range(m):
            i = pl.slots[c]
            for e in range(at.lo[i], at.lo[i + 1]):
                j = pl.slot[at.near[e]]
                if j >= 0:
                    pl.tie[ties], pl.tie_k[ties] = j, at.k_near[e]
                    ties += 1
            pl.tie_lo[c + 1] = ties
    return m, count


@uncounted
def take_lane(e, lane, at, pl):
    """Give spring e a lane."""
    i, j = at.first[e], at.second[e]
    pl.place[e], pl.act[lane] = lane, e
    pl.natural[lane] = at.natural[e]
    pl.act_first[lane] = pl.slot[i]
    pl.act_second[lane] = -1 if j >= at.n else pl.slot[j]
    pl.act_anchor[lane] = j - at.n if j >= at.n else -1
