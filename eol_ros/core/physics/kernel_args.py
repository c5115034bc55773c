# SPDX-License-Identifier: Apache-2.0
"""What the compiled kernels take: plain arrays bundled by meaning, as named tuples."""

from typing import NamedTuple

import numpy as np


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
    geometric: bool
    rail: bool


class Log(NamedTuple):
    """Events: time, block, 1 breaks loose or 0 sticks."""

    t: np.ndarray
    block: np.ndarray
    start: np.ndarray


class Ledger(NamedTuple):
    """What a run adds up: events, drive work and friction heat (J), counts of `event.kernel`."""

    log: Log
    work_and_heat: np.ndarray
    counts: np.ndarray


class Grid(NamedTuple):
    """Samples: when, and what."""

    t: np.ndarray
    u: np.ndarray
    v: np.ndarray


def empty_log(capacity: int) -> Log:
    """Return a log without events, for `capacity` of them."""
    return Log(np.empty(capacity), np.empty(capacity, np.int64), np.empty(capacity, np.int8))
