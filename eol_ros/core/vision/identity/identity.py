# SPDX-License-Identifier: Apache-2.0
"""Lattice and taps together: 25 names, and an answer to which way round the lattice lies."""

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.motion.slips import START, SlipDetector
from eol_ros.core.vision.identity.blink import Blink
from eol_ros.core.vision.identity.lattice import Lattice
from eol_ros.core.vision.identity.symmetry import Coincidence
from eol_ros.core.vision.states import TRACKING
from eol_ros.settings import MotionSettings

RESTED_S = 0.085  # a block seen at rest for less may have begun before it came into view
PATIENCE_S = 0.15  # and then for better times of its onset


class Identity:
    """The lattice, and what the blocks' accelerometers say about its turn.

    Taps count a fixed time after their stamp, so that their arrival does not matter. Without taps
    nothing here costs anything but while the turn is open.
    """

    def __init__(self, trust_start: bool = True, blink: Blink | None = None):
        self.lattice = Lattice(trust_start)
        self.blink = blink
        self.coincidence = Coincidence()
        self.onsets: SlipDetector | None = None  # while the turn of the lattice is in question
        self.begun = np.zeros(N_BLOCKS, bool)  # slips whose onset is still to be told
        self.confirmed = False  # taps have agreed with the turn since the lattice was found

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a knock that the accelerometer of `block` felt."""
        self.coincidence.tap(stamp_s, block, sigma_s)

    def update(
        self,
        stamp_s: float,
        xy: np.ndarray,
        yaw: np.ndarray,
        sigma: np.ndarray,
        faint: np.ndarray | None = None,
    ) -> None:
        """Take the detections of one image; see Lattice.update."""
        lattice = self.lattice
        lattice.update(stamp_s, xy, yaw, sigma, faint)
        if lattice.state != TRACKING:
            self.onsets, self.confirmed = None, False
            self.coincidence.update(stamp_s)
            if self.blink is not None:
                self.blink.forget()
            return
        if self.blink is not None and not self.confirmed:
            quarters = self.blink.update(stamp_s, lattice.xy, lattice.seen)
            if quarters is not None:
                self._settle(quarters)
                return
        if lattice.ambiguous:
            quarters = lattice.yaws.quarters(lattice.yaw_offsets(), lattice.seen)
            if quarters is not None:
                self._settle(quarters, final=False)
                return
        asked = not self.confirmed and self.coincidence.listening(stamp_s)
        if not (lattice.ambiguous or asked):
            self.onsets = None
            self.coincidence.update(stamp_s)
            return
        if self.onsets is None:
            self.onsets = SlipDetector(MotionSettings())
            self.begun[:] = False
            self.coincidence.forget()
        self._watch(self.onsets, stamp_s)
        known = not lattice.ambiguous
        quarters = self.coincidence.update(stamp_s, known)
        if quarters is not None:
            self._settle(quarters, final=known)

    def _watch(self, onsets: SlipDetector, stamp_s: float) -> None:
        """Tell the coincidence what this image shows: onsets, and what rests or slides."""
        lattice = self.lattice
        x, y = lattice.xy.T
        for event in onsets.update(stamp_s, x, y, lattice.seen, lattice.sigma):
            # A block that came out from under an arm on its way began nobody knows when.
            if event.kind == START:
                self.begun[event.block] = onsets.rested_s[event.block] >= RESTED_S
        # Two images later an onset is known twice as well: it may wait for them, but not for ever.
        late = stamp_s - onsets.onset_s > PATIENCE_S
        for block in np.flatnonzero(self.begun & ((onsets.fresh == 0) | late)).tolist():
            self.coincidence.onset(
                float(onsets.onset_s[block]), block, float(onsets.onset_sigma_s[block])
            )
            self.begun[block] = False
        moving = onsets.moving
        self.coincidence.look(stamp_s, lattice.seen & ~moving, lattice.seen & moving)

    def _settle(self, quarters: int, final: bool = True) -> None:
        """Turn the ids; what taps settled first is heard again, and must be surer to be final."""
        self.lattice.turn_ids(quarters)
        self.confirmed, self.onsets = final, None
        self.coincidence.forget()
