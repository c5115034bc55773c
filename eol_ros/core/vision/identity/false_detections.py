# SPDX-License-Identifier: Apache-2.0
"""Lights that stand still while the blocks about them move: lamps and reflections, no blocks.

A map of lamps learnt in the dark takes them off the image; these are the ones that it lacks.
"""

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import hypot
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.identity.fitting import affine

MOST = 32
WITNESSES = 12  # so many blocks must be in sight
AGE_S = 0.1
TRAVEL_M = 0.04  # springs and friction let no block stay behind so far when the lattice goes
STILL_M = 0.002  # a lamp is found within this of where it was
# A block that is followed to this near a lamp, wherever it may stop on its way, is over it if there
# is no other light within AROUND_M. So is a hidden one where the light is a sound outline: no lamp
# shines through what hides a block over it.
OVER_M, HIDDEN_OVER_M = 0.003, 0.01
AROUND_M = 0.02
FORGET_S = 5.0  # a lamp that was not seen for so long is gone


class Lamps:
    """Remembers `place` (MOST, 2) m of lights that cannot be blocks; NaN where there is none."""

    def __init__(self, candidates: int):
        self.place = np.full((MOST, 2), np.nan)
        self.seen_s = np.full(MOST, -np.inf)
        self.count = 0
        self.born = np.full(candidates, np.inf)  # of the lights that are watched
        self.home = np.zeros((candidates, 2))
        self.blocks = np.zeros((candidates, N_BLOCKS, 2))  # where the blocks were then

    def renamed(self) -> None:
        """Start over to compare where blocks were: their ids mean others now."""
        self.born[:] = np.inf

    def learn(
        self, stamp_s: float, xy: np.ndarray, seen: np.ndarray, light: np.ndarray, born: np.ndarray
    ) -> None:
        """Take lights (k, 2) that are no blocks, with the times since when they shine (k,).

        xy (25, 2), seen (25,): where the blocks are. A light that stays while the lattice goes away
        under it is a lamp from now on.
        """
        for k in stayed(stamp_s, xy, seen, light, born, self.born, self.home, self.blocks):
            self._add(stamp_s, light[k])

    def _add(self, stamp_s: float, place: np.ndarray) -> None:
        near = np.flatnonzero(elementary.hypot(*(self.place - place).T) < STILL_M)
        k = int(near[0]) if near.size else int(np.argmin(self.seen_s))
        self.place[k], self.seen_s[k] = place, stamp_s
        self.count = int(np.isfinite(self.seen_s).sum())

    def others(
        self,
        stamp_s: float,
        points: np.ndarray,
        xy: np.ndarray,
        ahead: np.ndarray,
        seen: np.ndarray,
        sound: np.ndarray | None = None,
    ) -> np.ndarray | None:
        """Return which of `points` (n, 2) are no lamps, as indices, or None for all of them.

        xy (25, 2), seen (25,): blocks in the last image; ahead (25, 2) m: how they moved since.
        sound (n,): so good an outline that it can be a hidden block's.
        """
        gone = np.flatnonzero(stamp_s - self.seen_s > FORGET_S)
        self.seen_s[gone], self.place[gone] = -np.inf, np.nan
        self.count = int(np.isfinite(self.seen_s).sum())
        if sound is None:
            sound = np.zeros(len(points), bool)
        free, lit = apart(points, self.place, xy, ahead, seen, sound)
        self.seen_s[lit] = stamp_s
        return None if free.all() else np.flatnonzero(free)


@njit(cache=True)
def stayed(stamp_s, xy, seen, light, born, watched, home, blocks):
    """Which lights stayed at home (k, 2) while the lattice went away; see Lamps.

    watched (k,): births at the last call. home and blocks (k, 25, 2) are set again for new lights
    and for those that have moved.
    """
    found = np.zeros(born.size, np.bool_)
    for k in range(born.size):
        if born[k] == np.inf:
            watched[k] = np.inf
            continue
        if (
            born[k] != watched[k]
            or hypot(light[k, 0] - home[k, 0], light[k, 1] - home[k, 1]) > STILL_M
        ):
            watched[k] = born[k]
            home[k] = light[k]
            blocks[k] = xy
        elif stamp_s - born[k] > AGE_S and seen.sum() >= WITNESSES:
            # Where the lattice, as it went and turned, would have taken a block.
            fit = affine(blocks[k], xy, seen)
            dx = fit[0, 0] + home[k, 0] * fit[1, 0] + home[k, 1] * fit[2, 0] - light[k, 0]
            dy = fit[0, 1] + home[k, 0] * fit[1, 1] + home[k, 1] * fit[2, 1] - light[k, 1]
            if dx * dx + dy * dy > TRAVEL_M * TRAVEL_M:
                found[k] = True
                blocks[k] = xy
    return np.flatnonzero(found)


@njit(cache=True)
def apart(points, lamps, xy, ahead, seen, sound):
    """Which points are no lamps (n,), and which lamps were seen (m,).

    Of two lights at one place one is a block beside the lamp: the lamp is the nearer one.
    """
    free = np.ones(points.shape[0], np.bool_)
    lit = np.zeros(lamps.shape[0], np.bool_)
    for k in range(lamps.shape[0]):
        near = STILL_M
        nearest = -1
        for j in range(points.shape[0]):
            away = hypot(points[j, 0] - lamps[k, 0], points[j, 1] - lamps[k, 1])
            if away < near:
                near, nearest = away, j
        if nearest >= 0:
            free[nearest] = False
            lit[k] = True
    for j in range(points.shape[0]):
        if free[j]:
            continue
        for i in range(xy.shape[0]):
            if not (seen[i] or sound[j]):
                continue
            dx, dy = points[j, 0] - xy[i, 0], points[j, 1] - xy[i, 1]
            way = ahead[i, 0] ** 2 + ahead[i, 1] ** 2
            along = 1.0
            if way > 0.0:
                along = min(max((dx * ahead[i, 0] + dy * ahead[i, 1]) / way, 0.0), 1.0)
            x, y = xy[i, 0] + along * ahead[i, 0], xy[i, 1] + along * ahead[i, 1]
            reach = OVER_M if seen[i] else HIDDEN_OVER_M
            if hypot(points[j, 0] - x, points[j, 1] - y) < reach:
                alone = True
                for other in range(points.shape[0]):
                    away = hypot(points[other, 0] - x, points[other, 1] - y)
                    if other != j and away < AROUND_M:
                        alone = False
                if alone:
                    free[j] = True
    return free, lit
