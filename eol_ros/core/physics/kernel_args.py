# SPDX-License-Identifier: Apache-2.0
"""What the compiled kernels take: plain arrays bundled by meaning, as named tuples."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from eol_ros.core.physics.model import Model


LANES = 4


class Lattice(NamedTuple):
    """Springs and blocks. Rows lo[i]..lo[i + 1] of near, k_near and spring are the springs of block
    i to other blocks; rows rim_lo[i]..rim_lo[i + 1] of rim_spring those to the rim.
    """

    n: int
    first: np.ndarray  # (s,)
    second: np.ndarray  # (s,), n + anchor for springs to the rim
    k: np.ndarray
    natural: np.ndarray
    rest: np.ndarray
    anchors: np.ndarray
    lo: np.ndarray  # (n + 1,)
    near: np.ndarray
    k_near: np.ndarray
    spring: np.ndarray
    rim_lo: np.ndarray  # (n + 1,)
    rim_spring: np.ndarray
    k_sum: np.ndarray  # (n,)
    drive: np.ndarray  # (n, 3): sum of k, k A_x, k A_y over the springs to the rim
    arm: np.ndarray  # (n,): sum of k |A| over them
    far: float  # the greatest |A|
    mass: np.ndarray
    inverse: np.ndarray
    static: np.ndarray
    friction: np.ndarray
    weakening: float
    geometric: bool
    rail: bool


class Rim(NamedTuple):
    """The drive; see `Drive`."""

    kind: int
    par: np.ndarray
    knots: np.ndarray
    cubics: np.ndarray


class Log(NamedTuple):
    """Events: time, block, 1 breaks loose or 0 sticks."""

    t: np.ndarray
    block: np.ndarray
    start: np.ndarray


class Grid(NamedTuple):
    """Samples: when, and what."""

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray


def lattice_of(model: 'Model') -> Lattice:
    """Return the kernels' view of a model."""
    n = model.n
    rim = model.second >= n
    number = np.arange(len(model.k))
    a, b, k = model.first[~rim], model.second[~rim], model.k[~rim]
    ends, others = np.concatenate([a, b]), np.concatenate([b, a])
    both, spring = np.concatenate([k, k]), np.concatenate([number[~rim], number[~rim]])
    order = np.lexsort((spring, ends))
    rim_block = model.first[rim]
    rim_order = np.argsort(rim_block, kind='stable')
    pulls = model.k[rim, None] * np.column_stack([np.ones(rim.sum()), model.anchors])
    drive = np.zeros((n, 3))
    np.add.at(drive, rim_block, pulls)
    arms = np.hypot(model.anchors[:, 0], model.anchors[:, 1])
    return Lattice(
        n,
        model.first,
        model.second,
        model.k,
        model.natural,
        model.rest,
        model.anchors,
        np.searchsorted(ends[order], np.arange(n + 1)),
        others[order],
        both[order],
        spring[order],
        np.searchsorted(rim_block[rim_order], np.arange(n + 1)),
        number[rim][rim_order],
        np.bincount(ends, both, n) + np.bincount(rim_block, model.k[rim], n),
        drive,
        np.bincount(rim_block, model.k[rim] * arms[model.second[rim] - n], n),
        float(arms.max(initial=0.0)),
        model.mass,
        1.0 / model.mass,
        model.static,
        model.kinetic,
        float(model.weakening),
        bool(model.geometric),
        bool(model.rail),
    )


def rim_of(model: 'Model') -> Rim:
    """Return the kernels' view of a model's drive."""
    return Rim(model.kind, model.par, model.knots, model.cubics)


def empty_log(capacity: int) -> Log:
    """Return a log without events, for `capacity` of them."""
    return Log(np.empty(capacity), np.empty(capacity, np.int64), np.empty(capacity, np.int8))
