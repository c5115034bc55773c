# SPDX-License-Identifier: Apache-2.0
"""Every cover spreads its light differently: by that a block is known again without its place.

What is learnt of each block is the mean pattern of its cover (detect/cover_light) and how far its
patterns depart from that. One cover is looked at in each image, so it costs next to nothing; all of
them only when names are in doubt. Covers that look alike decide nothing.
"""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.geometry import COLS, N_BLOCKS, ROWS
from eol_ros.core.vision.detect.cover_light import CELLS, SIZE
from eol_ros.core.vision.identity.fitting import assign
from eol_ros.core.vision.identity.symmetry import TURNED
from eol_ros.errors import ConfigError

MOVED_M = 0.002  # nearer to where it was learnt last, it is the same look again,
FIRST = 8  # but for the first ones
MEMORY = 100  # looks
SPREAD, PRIOR = 0.02, 10.0  # departure of a cover of which little is known, worth so many looks
FLOOR = 0.012  # and none counts as known better: a common sensor's noise is 0.009
ALIKE = 8.0  # cells that count as independent: what departs does so over several of them
MOST = 25.0  # squared departures count no further: a cover may flash, or be half dark
FIT, ODD = 4.0, 9.0  # squared departures of a cover as it was learnt, and of another one
BLOCKS = 6  # fewer do not tell which way round all lie
MARGIN = 20.0  # nats between the best answer and the next
CHANGED_S, CHANGED_LOOKS = 20.0, 8  # a cover that is odd for so long is another cover
STEP = 1 / 256  # of a pattern that is kept
KEPT = N_BLOCKS * (SIZE + 4 + 1)  # bytes


def _turned_cells() -> np.ndarray:
    """Return for 0 to 3 quarters the cells (4, SIZE) of a pattern as axes turned so far see it."""
    row, column = np.divmod(np.arange(SIZE), CELLS)
    turned = []
    for _ in range(4):
        turned.append(row * CELLS + column)
        row, column = column, CELLS - 1 - row
    return np.array(turned)


TURNED_CELLS = _turned_cells()


class CoverPatterns:
    """Pattern (25, SIZE) of each cover, the mean square (25,) of what departs from it, looks."""

    def __init__(self) -> None:
        self.mean = np.zeros((N_BLOCKS, SIZE))
        self.variance = np.zeros(N_BLOCKS)
        self.looks: np.ndarray = np.zeros(N_BLOCKS, np.int64)
        self.odd_s = np.full(N_BLOCKS, np.inf)  # since when it is another cover
        self.odd_looks: np.ndarray = np.zeros(N_BLOCKS, np.int64)
        self.at = np.full((N_BLOCKS, 2), np.inf)  # where it was learnt last

    def learn(self, stamp_s: float, block: int, pattern: np.ndarray, x: float, y: float) -> bool:
        """Take the pattern (SIZE,) of a block of which the name is known, at x, y in m.

        Returns whether it is another cover than was learnt, for long enough; it is learnt instead.
        """
        return bool(
            _learn(
                stamp_s, block, pattern, x, y, self.mean, self.variance, self.looks, self.odd_s,
                self.odd_looks, self.at,
            )
        )  # fmt: skip

    def departures(self, patterns: np.ndarray) -> np.ndarray:
        """Return how far patterns (k, SIZE) are from that of each block, (k, 25), squared.

        In standard deviations; ODD for a block of which nothing was learnt.
        """
        found = np.empty((len(patterns), N_BLOCKS))
        _departures(np.ascontiguousarray(patterns), self.mean, self.variance, self.looks, found)
        return found

    def proofs(
        self, patterns: np.ndarray, good: np.ndarray, names: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return how far patterns (k, SIZE) are from those of the blocks `names` (k,), squared.

        And how far from that of the nearest block; inf where there is no pattern (`good` (k,)), and
        0 from a block of which nothing was learnt: there is nothing to prove it by.
        """
        own, nearest = np.full((2, len(names)), np.inf)
        _proofs(patterns, good, names, self.mean, self.variance, self.looks, own, nearest)
        return own, nearest

    def quarters(self, patterns: np.ndarray, names: np.ndarray) -> int | None:
        """Return by how many quarters the names are to be turned, None where it is not clear.

        patterns (k, SIZE) of the blocks that are called `names` (k,) now, in the axes that they
        have by these names.
        """
        nats, fit = self.weigh(patterns, names)
        best = int(np.argmax(nats))
        clear = len(names) >= BLOCKS and nats[best] - np.delete(nats, best).max() > MARGIN
        return best if clear and fit[best] < FIT else None

    def placed(
        self, patterns: np.ndarray, names: np.ndarray, seen: np.ndarray
    ) -> tuple[int, int] | None:
        """Return ids to shift the names by, and quarters to turn them by then; None: not clear.

        A row at the border that an arm hides may lie on either side: the lattice alone does not say
        so. Arguments as of `quarters`; seen (n,): all names in sight, which must stay on the table.
        """
        if len(names) < BLOCKS:
            return None
        rows, columns = np.divmod(seen, COLS)
        shifts = [
            COLS * up + right
            for up in range(-rows.min(), ROWS - rows.max())
            for right in range(-columns.min(), COLS - columns.max())
        ]
        nats, fit = np.array([self.weigh(patterns, names + shift) for shift in shifts]).swapaxes(
            0, 1
        )
        best = int(np.argmax(nats))
        clear = nats.flat[best] - np.delete(nats, best).max() > MARGIN
        if not clear or fit.flat[best] >= FIT:
            return None
        return shifts[best // 4], best % 4

    def weigh(self, patterns: np.ndarray, names: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how well each of 0 to 3 quarter turns of the names explains the patterns.

        That is the log likelihood (4,) in nats, and the median (4,) of the squared departures. What
        all covers have in common is left out: camera and lamps may do that.
        """
        nats, fit = np.zeros(4), np.full(4, np.inf)
        if len(names):
            for q in range(4):
                off = patterns[:, TURNED_CELLS[q]]
                common = np.median(off - self.mean[TURNED[q][names]], axis=0)
                turned = self.departures(off - common)
                own = turned[np.arange(len(names)), TURNED[q][names]]
                nats[q], fit[q] = -0.5 * ALIKE * own.sum(), np.median(own)
        return nats, fit

    def named(self, patterns: np.ndarray, names: np.ndarray, free: np.ndarray) -> np.ndarray | None:
        """Return the right names (k,) of patterns (k, SIZE) that are called `names`, or None.

        None where nothing is wrong, or where it is not clear what is right. free (25,): names that
        are these blocks' or nobody's.
        """
        off = self.departures(patterns)
        own = off[np.arange(len(names)), names]
        choice = np.flatnonzero(free)
        right = choice[assign(off[:, choice])]
        best = off[np.arange(len(names)), right]
        other = right != names
        if not other.any() or best[other].max() > FIT or own[other].min() < ODD:
            return None
        return right if 0.5 * ALIKE * (own - best).sum() > MARGIN else None

    def packed(self) -> bytes:
        """Return what was learnt: patterns as int8 in STEP, float32 mean squares, uint8 looks."""
        kept = np.clip(np.rint(self.mean / STEP), -127, 127).astype(np.int8)
        return (
            kept.tobytes()
            + self.variance.astype('<f4').tobytes()
            + self.looks.astype(np.uint8).tobytes()
        )

    @classmethod
    def unpacked(cls, data: bytes) -> 'CoverPatterns':
        """Return what `packed` gave; raises ConfigError for anything else."""
        many = N_BLOCKS * SIZE
        variance = np.frombuffer(data[many : many + 4 * N_BLOCKS], '<f4') if data else np.zeros(1)
        if len(data) != KEPT or not (np.isfinite(variance) & (variance >= 0)).all():
            raise ConfigError(
                f'patterns of covers cannot be read: they are not {KEPT} bytes of what was learnt'
            )
        covers = cls()
        covers.mean[:] = np.frombuffer(data[:many], np.int8).reshape(N_BLOCKS, SIZE) * STEP
        covers.variance = variance.astype(float)
        looks = np.frombuffer(data[many + 4 * N_BLOCKS :], np.uint8)
        covers.looks = np.minimum(looks, MEMORY).astype(np.int64)
        return covers


@njit(inline='always')
def _spread(variance, looks):
    known = (PRIOR * SPREAD * SPREAD + looks * variance) / (PRIOR + looks)
    return max(known, FLOOR * FLOOR)


@njit(cache=True)
def _departures(patterns, mean, variance, looks, out):
    for b in range(mean.shape[0]):
        per_spread = 1.0 / (SIZE * _spread(variance[b], looks[b]))
        for i in range(patterns.shape[0]):
            if looks[b] == 0:
                out[i, b] = ODD
                continue
            total = 0.0
            for k in range(SIZE):
                off = patterns[i, k] - mean[b, k]
                total += off * off
            out[i, b] = min(total * per_spread, MOST)


@njit(cache=True)
def _proofs(patterns, good, names, mean, variance, looks, own, nearest):
    off = np.empty((1, mean.shape[0]))
    for k in range(names.size):
        if good[k]:
            _departures(patterns[k : k + 1], mean, variance, looks, off)
            own[k] = off[0, names[k]] if looks[names[k]] > 0 else 0.0
            nearest[k] = off.min()


@njit(cache=True)
def _learn(stamp_s, block, pattern, x, y, mean, variance, looks, odd_s, odd_looks, at):
    square = 0.0
    for k in range(SIZE):
        off = pattern[k] - mean[block, k]
        square += off * off / SIZE
    changed = False
    if looks[block] > 0 and square > ODD * _spread(variance[block], looks[block]):
        if not odd_s[block] <= stamp_s:
            odd_s[block], odd_looks[block] = stamp_s, 0
        odd_looks[block] += 1
        if stamp_s - odd_s[block] < CHANGED_S or odd_looks[block] < CHANGED_LOOKS:
            return False
        looks[block], variance[block], changed = 0, 0.0, True
    odd_s[block] = np.inf
    near = abs(x - at[block, 0]) < MOVED_M and abs(y - at[block, 1]) < MOVED_M
    if looks[block] >= FIRST and near:
        return changed
    at[block, 0], at[block, 1] = x, y
    looks[block] = min(looks[block] + 1, MEMORY)
    share = 1.0 / looks[block]
    if looks[block] == 1:
        share, square = 1.0, 0.0
    variance[block] += share * ((1.0 - share) * square - variance[block])
    for k in range(SIZE):
        mean[block, k] += share * (pattern[k] - mean[block, k])
    return changed
