# SPDX-License-Identifier: Apache-2.0
"""How crooked each block stands on the lattice tells quarter turns apart.

Covers are never mounted quite square, and springs never of one length: so each block stands some
degrees off the square, each its own way, whichever way the rim is turned. What is learnt is the
mean and the scatter of each block's yaw against the lattice's, over many places; after darkness
each of the four turns is weighed by what was learnt. Where blocks stand alike, or differently each
time, the scatter says so, and nothing is decided.
"""

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.compiled import njit
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.identity.symmetry import TURNED
from eol_ros.errors import ConfigError

EVERY_S = 0.25  # between two looks
MOVED_M = 0.002  # and so far has a block moved, in the mean, or it is the same look again
MEMORY = 200  # looks
ENOUGH = 30  # looks before a block's scatter is known
FLOOR_RAD = 0.004  # of that scatter
UNKNOWN_RAD = 0.1  # of a block of which little is known
OUTLIER = 3.0  # more sigmas than this count no more
BLOCKS = 12  # fewer decide nothing
FIT = 3.0  # mean squared sigmas of an answer that fits
MARGIN = 20.0  # nats between the best turn and the next


class Yaws:
    """Mean and variance (25,) of the yaw of each block against the lattice, rad."""

    def __init__(self) -> None:
        self.mean = np.zeros(N_BLOCKS)
        self.variance = np.zeros(N_BLOCKS)
        self.looks: np.ndarray = np.zeros(N_BLOCKS, np.int64)
        self.last_s = -np.inf
        self.last_xy = np.full((N_BLOCKS, 2), np.inf)

    def due(self, stamp_s: float) -> bool:
        """Return whether it is time for another look."""
        return not 0.0 <= stamp_s - self.last_s < EVERY_S

    def learn(
        self, stamp_s: float, xy: np.ndarray, yaw_offsets: np.ndarray, seen: np.ndarray
    ) -> None:
        """Take xy (25, 2) m and the yaw offsets (25,) rad of the blocks seen (25,), well named."""
        if self.due(stamp_s) and seen.sum() >= BLOCKS:
            self.last_s = stamp_s
            _learn(xy, yaw_offsets, seen, self.last_xy, self.mean, self.variance, self.looks)

    def packed(self) -> bytes:
        """Return what was learnt, as 75 little-endian float32: means, variances (rad), looks."""
        return np.array([self.mean, self.variance, self.looks], '<f4').tobytes()

    @classmethod
    def unpacked(cls, data: bytes) -> 'Yaws':
        """Return what `packed` gave; raises ConfigError for anything else."""
        numbers = np.frombuffer(data, '<f4') if len(data) == 12 * N_BLOCKS else np.array([np.nan])
        if not np.isfinite(numbers).all():
            raise ConfigError('yaw offsets cannot be read: they are not 75 finite numbers')
        yaws = cls()
        mean, variance, looks = numbers.astype(float).reshape(3, N_BLOCKS)
        yaws.mean, yaws.variance = mean, np.maximum(variance, 0.0)
        yaws.looks = np.clip(looks, 0, MEMORY).astype(np.int64)
        return yaws

    def weigh(self, yaw_offsets: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how well each of 0 to 3 quarter turns of the names explains the yaws.

        That is the log likelihood (4,) in nats, and the mean squared departure (4,) in sigmas.
        yaw_offsets (25,) rad and held (25,) are by the present names.
        """
        nats, fit = np.empty(4), np.empty(4)
        for q, names in enumerate(TURNED):
            spread = self._spread(names)
            off = _apart(yaw_offsets - self.mean[names], held)
            squares = np.minimum(off**2 / spread, OUTLIER**2)[held]
            nats[q] = -0.5 * (squares + elementary.log(spread[held])).sum()
            fit[q] = squares.mean()
        return nats, fit

    def quarters(self, yaw_offsets: np.ndarray, held: np.ndarray) -> int | None:
        """Return by how many quarters the names are to be turned, None where it is not clear."""
        if held.sum() < BLOCKS or (self.looks >= ENOUGH).sum() < BLOCKS:
            return None
        nats, fit = self.weigh(yaw_offsets, held)
        best = int(np.argmax(nats))
        clear = nats[best] - np.delete(nats, best).max() > MARGIN
        return best if clear and fit[best] < FIT else None

    def _spread(self, names: np.ndarray) -> np.ndarray:
        """Return the variance (25,) of the blocks `names`: wide where a block is not known yet."""
        return np.where(
            self.looks[names] >= ENOUGH, self.variance[names] + FLOOR_RAD**2, UNKNOWN_RAD**2
        )


@njit(cache=True)
def _learn(xy, yaw_offsets, seen, last_xy, mean, variance, looks):  # type: ignore[no-untyped-def]  # compiled
    moved, count = 0.0, 0
    off = np.empty(N_BLOCKS)
    for i in range(N_BLOCKS):
        if seen[i]:
            moved += abs(xy[i, 0] - last_xy[i, 0]) + abs(xy[i, 1] - last_xy[i, 1])
            off[count] = yaw_offsets[i] - mean[i]
            count += 1
    if moved < 2 * count * MOVED_M:
        return
    last_xy[:] = xy
    common = np.median(off[:count])
    for i in range(N_BLOCKS):
        if seen[i]:
            rest = yaw_offsets[i] - mean[i] - common
            looks[i] += 1
            share = 1.0 / min(looks[i], MEMORY)
            mean[i] += share * rest
            variance[i] += share * ((1.0 - share) * rest * rest - variance[i])


def _apart(off: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return `off` (25,) without what the blocks held have in common: the lattice's own error."""
    return off - np.median(off[held])
