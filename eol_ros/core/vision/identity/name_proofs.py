# SPDX-License-Identifier: Apache-2.0
"""Which names rest on a look at the cover, and which are only guessed from a place so far."""

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import hypot
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.identity.cover_patterns import FIRST, FIT, ODD, CoverPatterns
from eol_ros.core.vision.identity.lattice import Lattice

JUMP_M = 0.03  # a block that is found further than this from where it went is looked at,
TRIES = 8  # so many times
HOLD_S, FORGET_S = 0.3, 2.0  # a light waits so long for its name, at most, and then not soon again
FAR_M = 0.04  # and that only so far from where its block should be
TOLD_S = 600.0  # it is said so long that covers were changed
RARELY = 16  # images between looks at a cover of which nothing was to be seen so often,
LOOK_EACH = 4  # and between looks at covers that are known


class NameProofs:
    """Which names are proved by their covers; what was followed since stays proved.

    changed_s (25,): when a cover was last found to be another one, -inf: never.
    """

    def __init__(self) -> None:
        self.changed_s, self.last_change_s = np.full(N_BLOCKS, -np.inf), -np.inf
        self._images = self._next = 0
        self.lost()

    def lost(self) -> None:
        """Start over: the lattice is not known."""
        self.checked: np.ndarray = np.zeros(N_BLOCKS, bool)
        self.tries: np.ndarray = np.zeros(N_BLOCKS, np.int64)
        self.waited: np.ndarray = np.zeros(N_BLOCKS, np.int64)  # images
        self.was: np.ndarray = np.zeros(N_BLOCKS, bool)  # in sight
        self.place = np.full((N_BLOCKS, 2), np.nan)  # where each block should be next
        self.came = np.full((N_BLOCKS, 2), np.nan)  # and where it should have been now
        self.far: np.ndarray = np.zeros(N_BLOCKS, bool)  # from there, when it got its name
        self.held_s = np.full(N_BLOCKS, np.inf)  # when its name was first held back
        self.last_s = -np.inf
        self.resumed_s = self.ask_s = np.inf
        self.sure = False

    def changed(self, stamp_s: float) -> tuple[int, ...]:
        """Return the blocks whose covers were found to be others in the last TOLD_S."""
        if self.last_change_s < stamp_s - TOLD_S:
            return ()
        return tuple(np.flatnonzero(self.changed_s >= stamp_s - TOLD_S).tolist())

    def change(self, stamp_s: float, block: int) -> None:
        """Take that the cover of `block` is another one."""
        self.changed_s[block] = self.last_change_s = stamp_s

    def turn(self, covers: CoverPatterns) -> int:
        """Return whose cover is to be learnt from this image, -1 for none."""
        self._images += 1
        block = self._next
        if self._images % LOOK_EACH and covers.looks[block] >= FIRST:
            return -1
        self._next = (block + 1) % N_BLOCKS
        return block if self.checked[block] or self.tries[block] >= TRIES else -1

    def doubtful(self, lattice: Lattice) -> np.ndarray:
        """Take what the lattice says; return the blocks whose names are to be proved now."""
        step = min(lattice.last_s - self.last_s, 0.1)
        self.last_s = lattice.last_s
        asked: np.ndarray = _doubtful(
            lattice.xy, lattice.velocity, lattice.seen, step, self.was, self.place, self.came,
            self.far, self.held_s, self.checked, self.tries, self.waited,
        )  # fmt: skip
        return asked

    def tried(self, blocks: np.ndarray, off: np.ndarray) -> bool:
        """Take how far the covers of `blocks` (k,) are from theirs, inf where none was to be seen.

        That proves names, or does not. Returns whether one is disproved. off: CoverPatterns.proofs.
        """
        return bool(_tried(blocks, off, self.tries, self.checked))

    def held_back(
        self,
        stamp_s: float,
        blocks: np.ndarray,
        own: np.ndarray,
        nearest: np.ndarray,
        looks: np.ndarray,
    ) -> np.ndarray:
        """Return which `blocks` (k,) lose their names again, for they have others' covers.

        Or stand far from where they were carried. Not for long: a cover may be of no help for ever.
        own, nearest (k,): CoverPatterns.proofs; looks (25,): at the covers that were learnt.
        """
        held: np.ndarray = _held_back(
            stamp_s, blocks, own, nearest, looks, self.waited, self.far, self.held_s
        )
        return held

    def renamed(self) -> None:
        """Go on from places under new names."""
        self.was[:] = False
        self.place[:] = np.nan


@njit(cache=True)
def _tried(blocks, off, tries, checked):
    disproved = False
    for k in range(blocks.size):
        if off[k] < np.inf:
            tries[blocks[k]] += 1
            checked[blocks[k]] = off[k] < FIT
            disproved |= off[k] >= FIT
    return disproved


@njit(cache=True)
def _doubtful(xy, velocity, seen, step, was, place, came, far, held_s, checked, tries, waited):
    """Note what is not where it should be, and where it should be next; return what to prove."""
    due = np.zeros(N_BLOCKS, np.bool_)
    for i in range(N_BLOCKS):
        off = hypot(xy[i, 0] - place[i, 0], xy[i, 1] - place[i, 1])
        if not (seen[i] and was[i] and off < JUMP_M):
            checked[i], tries[i], waited[i], far[i] = False, 0, 0, off > FAR_M
        waited[i] = 0 if checked[i] or not seen[i] else waited[i] + 1
        if waited[i] > 1 or checked[i]:
            held_s[i] = np.inf
        was[i] = seen[i]
        for k in range(2):
            came[i, k] = place[i, k]
            place[i, k] = xy[i, k] + velocity[i, k] * step
        due[i] = waited[i] > 0 and (waited[i] <= TRIES or waited[i] % RARELY == 0)
    return np.flatnonzero(due)


@njit(cache=True)
def _held_back(stamp_s, blocks, own, nearest, looks, waited, far, held_s):
    back = np.zeros(blocks.size, np.bool_)
    for k in range(blocks.size):
        if own[k] < ODD:
            continue
        block = blocks[k]
        since = stamp_s - held_s[block]
        begun = not 0.0 <= since < FORGET_S  # -inf: not yet
        if begun:
            held_s[block] = stamp_s
        wait = nearest[k] < FIT and waited[block] <= TRIES
        wait |= far[block] and waited[block] == 1  # a name just given
        late = not begun and since > HOLD_S
        back[k] = wait and not late and looks[block] >= FIRST
    return blocks[back]
