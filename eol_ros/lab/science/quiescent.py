# SPDX-License-Identifier: Apache-2.0
"""Cascades of a simulation: what moves between one moment of rest and the next."""

import numpy as np

from eol_ros.errors import EolError


class NotAtRest(EolError):
    """Events that do not begin from rest, or that contradict each other."""


def cascades(block: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return size (slips) and area (distinct blocks) of each cascade, two (c,) int64.

    block, start: (e,) events in order of time; 1 where the block breaks loose, 0 where it sticks.
    All blocks stick at first. A cascade lasts as long as any block slides, so what one calls a
    cascade depends on the speed of the drive: the faster, the more of them run into one. One that
    is under way at the end is left out.
    """
    block, start = np.asarray(block, np.int64), np.asarray(start, bool)
    if len(block) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    moving = np.where(start, 1, -1).cumsum()
    if np.min(moving) < 0 or np.max(moving) > len(np.unique(block)):
        raise NotAtRest('the events do not begin with all blocks at rest')
    ends = np.flatnonzero(moving == 0) + 1
    begins = np.concatenate([[0], ends[:-1]])
    sizes = np.add.reduceat(start[: ends[-1]], begins) if len(ends) else np.zeros(0, np.int64)
    areas = [len(np.unique(block[b:e][start[b:e]])) for b, e in zip(begins, ends, strict=False)]
    return sizes.astype(np.int64), np.array(areas, np.int64)


def joined(begin: np.ndarray, end: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Return the area of each cascade of slips from rest to rest, (c,) int64.

    begin, end: (n,) of slips in any order, in one unit; block: (n,). As `cascades`, where what is
    known are slips and not events: a slip belongs to the cascade that is under way as it begins.
    """
    order = np.argsort(begin, kind='stable')
    begin, end, block = (np.asarray(part)[order] for part in (begin, end, block))
    if not len(begin):
        return np.zeros(0, np.int64)
    reached = np.maximum.accumulate(end)
    first = np.flatnonzero(np.r_[True, begin[1:] > reached[:-1]])
    return np.array([len(np.unique(part)) for part in np.split(block, first[1:])], np.int64)
