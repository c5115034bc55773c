# SPDX-License-Identifier: Apache-2.0
"""Lattice, covers and taps together: 25 names, and which way round the lattice lies."""

from collections.abc import Callable

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.identity.blink import Blink
from eol_ros.core.vision.identity.cover_patterns import FIT, CoverPatterns
from eol_ros.core.vision.identity.lattice import Bare, Lattice
from eol_ros.core.vision.identity.name_proofs import NameProofs
from eol_ros.core.vision.identity.turn_by_taps import TurnByTaps
from eol_ros.core.vision.states import TRACKING

ASK_S = 0.25  # between two looks at all covers while the turn is open
RESUMED_S = 1.0  # for so long after darkness the covers are asked whether the turn is right

# of detections (k,) turned by yaw (k,): patterns (k, SIZE), and for which (k,) there is one
Glance = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Identity:
    """The lattice, and what the blocks' accelerometers say about its turn.

    Taps count a fixed time after their stamp, so that their arrival does not matter. Without taps
    nothing here costs anything but while the turn is open.
    """

    def __init__(
        self, trust_start: bool = True, blink: Blink | None = None, covers: bool = True
    ) -> None:
        self.lattice = Lattice(trust_start)
        self.blink = blink
        self.turn = TurnByTaps()
        self.covers = CoverPatterns() if covers else None
        self.names = NameProofs()

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a knock that the accelerometer of `block` felt."""
        self.turn.tap(stamp_s, block, sigma_s)

    def update(
        self,
        stamp_s: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        faint: np.ndarray | None = None,
        glance: Glance | None = None,
        sound: np.ndarray | None = None,
        bare: Bare | None = None,
    ) -> None:
        """Take the detections of one image; see Lattice.update. glance: looks at covers in it."""
        lattice = self.lattice
        if self.covers is None or glance is None:
            lattice.update(stamp_s, xy, yaw, sigma, faint, None, sound, bare)
        else:
            lattice.update(stamp_s, xy, yaw, sigma, faint, self._vouches(glance), sound, bare)
            self._know_covers(stamp_s, xy, yaw, sigma, glance)
        if lattice.state != TRACKING:
            self.turn.lost(stamp_s)
            if self.blink is not None:
                self.blink.forget()
            return
        if self.blink is not None and not self.turn.confirmed:
            quarters = self.blink.update(stamp_s, lattice.xy, lattice.seen)
            if quarters is not None:
                self._settle(quarters)
                return
        if lattice.ambiguous:
            quarters = lattice.yaws.quarters(lattice.yaw_offsets(), lattice.seen)
            if quarters is not None:
                self._settle(quarters, final=False)
                return
        known = not lattice.ambiguous
        quarters = self.turn.update(stamp_s, lattice.xy, lattice.seen, lattice.sigma, known)
        if quarters is not None:
            self._settle(quarters, final=known)

    def _vouches(self, glance: Glance) -> Callable[[np.ndarray, np.ndarray], bool]:
        """Return what asks covers whether a reading of the lattice can be believed at once."""
        covers = self.covers
        assert covers is not None

        def vouch(index: np.ndarray, yaw: np.ndarray) -> bool:
            blocks = np.flatnonzero(index >= 0)
            patterns, good = glance(index[blocks], yaw[blocks])
            if covers.quarters(patterns[good], blocks[good]) is not None:
                return True
            return covers.placed(patterns[good], blocks[good], blocks) is not None

        return vouch

    def _look(self, blocks: np.ndarray, glance: Glance) -> tuple[np.ndarray, np.ndarray]:
        """Return patterns and for which there is one, of blocks (k,) that are in sight."""
        return glance(self.lattice.index[blocks], self.lattice.yaw[blocks])

    def _know_covers(
        self, stamp_s: float, xy: np.ndarray, yaw: np.ndarray, sigma: np.ndarray, glance: Glance
    ) -> None:
        """Prove new names by the covers that bear them, and learn one cover more."""
        lattice, names, covers = self.lattice, self.names, self.covers
        assert covers is not None
        if lattice.state != TRACKING:
            names.lost()
            return
        if names.resumed_s == np.inf:
            names.resumed_s = names.ask_s = stamp_s
        resumed = stamp_s - names.resumed_s < RESUMED_S and not names.sure
        if stamp_s >= names.ask_s and (lattice.ambiguous or resumed):
            names.ask_s = stamp_s + ASK_S
            blocks = np.flatnonzero(lattice.seen)
            patterns, good = self._look(blocks, glance)
            quarters = covers.quarters(patterns[good], blocks[good])
            if quarters is None and lattice.ambiguous:
                placed = covers.placed(patterns[good], blocks[good], blocks)
                if placed is not None and self._shift(stamp_s, placed[0], xy, yaw, sigma):
                    quarters = placed[1]
            if quarters is not None:
                names.sure = True
                if quarters:  # the lattice has guessed, and what was learnt stays true
                    lattice.ambiguous = True
                if lattice.ambiguous:
                    self._settle(quarters, final=False)
        if lattice.ambiguous:
            return
        asked = names.doubtful(lattice)
        if len(asked):
            self._prove(asked, stamp_s, xy, yaw, sigma, glance)
        block = names.turn(covers)
        if block >= 0:
            patterns, good = self._look(np.array([block]), glance)
            x, y = lattice.xy[block]
            if good[0] and covers.learn(stamp_s, block, patterns[0], x, y):
                names.change(stamp_s, block)

    def _shift(
        self, stamp_s: float, by: int, xy: np.ndarray, yaw: np.ndarray, sigma: np.ndarray
    ) -> bool:
        """Take all names for those that are `by` ids further; False where order forbids it."""
        blocks = np.flatnonzero(self.lattice.seen)
        index = np.full(N_BLOCKS, -1)
        index[blocks + by] = self.lattice.index[blocks]
        return self.lattice.rename(stamp_s, index, xy, yaw, sigma)

    def _prove(
        self,
        asked: np.ndarray,
        stamp_s: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        glance: Glance,
    ) -> None:
        """Look at the covers of blocks `asked` (k,), not simply followed; give them their names."""
        names, covers = self.names, self.covers
        assert covers is not None
        own, nearest = covers.proofs(*self._look(asked, glance), asked)
        disproved = names.tried(asked, own)
        if own.max() < FIT:
            return
        # where nothing is to be seen all may be right
        if disproved and self._put_right(stamp_s, xy, yaw, sigma, glance):
            return
        for block in names.held_back(self.lattice.last_s, asked, own, nearest, covers.looks):
            self.lattice.drop(block, names.came[block])
            names.was[block], names.place[block] = False, names.came[block]

    def _put_right(
        self, stamp_s: float, xy: np.ndarray, yaw: np.ndarray, sigma: np.ndarray, glance: Glance
    ) -> bool:
        """Look at all covers in sight, and give them their names where others are wrong."""
        lattice, names, covers = self.lattice, self.names, self.covers
        assert covers is not None
        blocks = np.flatnonzero(lattice.seen)
        patterns, good = self._look(blocks, glance)
        free = ~(lattice.seen & names.checked)  # who is not proved can lose a name
        free[blocks[good]] = True
        right = covers.named(patterns[good], blocks[good], free)
        if right is None:
            return False
        index = np.where(free, -1, lattice.index)
        index[right] = lattice.index[blocks[good]]
        renamed = lattice.rename(stamp_s, index, xy, yaw, sigma)
        if renamed:
            names.renamed()
        return renamed

    def _settle(self, quarters: int, final: bool = True) -> None:
        """Turn the ids; what taps settled first is heard again, and must be surer to be final."""
        if quarters and not self.lattice.ambiguous and self.covers is not None:
            self.covers = CoverPatterns()  # what was learnt was learnt under other names
        self.lattice.turn_ids(quarters)
        self.names.renamed()
        self.turn.settled(final)
