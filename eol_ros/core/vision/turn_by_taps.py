# SPDX-License-Identifier: Apache-2.0
"""The turn of the lattice, told by taps: what images show of slips goes to the coincidence."""

import numpy as np

from eol_ros.core.motion.slips import START, SlipDetector
from eol_ros.core.table import Table
from eol_ros.core.vision.symmetry import Coincidence
from eol_ros.settings import MotionSettings

RESTED_S = 0.085  # a block seen at rest for less may have begun before it came into view
PATIENCE_S = 0.15  # for so long a better time of an onset is waited for


class TurnByTaps:
    """Onsets against taps, while the turn is open or taps have not confirmed it yet."""

    def __init__(self, table: Table) -> None:
        self.table, self.coincidence = table, Coincidence(table)
        self.onsets: SlipDetector | None = None  # while the turn of the lattice is in question
        self.begun = np.zeros(table.cells, bool)  # slips whose onset is still to be told
        self.confirmed = False  # taps have agreed with the turn since the lattice was found

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a tap that the accelerometer of `block` felt."""
        self.coincidence.tap(stamp_s, block, sigma_s)

    def lost(self, stamp_s: float) -> None:
        """Take an image in which there is no lattice."""
        self.onsets, self.confirmed = None, False
        self.coincidence.update(stamp_s)

    def settled(self, final: bool) -> None:
        """Begin again after the ids were turned; final: taps need not be heard any more."""
        self.confirmed, self.onsets = final, None
        self.coincidence.forget()

    def update(
        self, stamp_s: float, xy: np.ndarray, seen: np.ndarray, sigma: np.ndarray, known: bool
    ) -> int | None:
        """Take one image's blocks; return the quarter turns once they are clear, or None.

        xy (cells, 2), sigma (cells,) in m; known: the turn is thought to be known.
        """
        asked = not self.confirmed and self.coincidence.listening(stamp_s)
        if known and not asked:
            self.onsets = None
            self.coincidence.update(stamp_s)
            return None
        if self.onsets is None:
            self.onsets = SlipDetector(MotionSettings(), self.table)
            self.begun[:] = False
            self.coincidence.forget()
        self._watch(self.onsets, stamp_s, xy, seen, sigma)
        return self.coincidence.update(stamp_s, known)

    def _watch(
        self,
        onsets: SlipDetector,
        stamp_s: float,
        xy: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray,
    ) -> None:
        """Tell the coincidence what this image shows: onsets, and what rests or slides."""
        x, y = xy.T
        events = onsets.update(stamp_s, x, y, seen, sigma)
        slips = onsets.slips
        for event in events:
            # A block that came out from under an arm on its way began nobody knows when.
            if event.kind == START:
                self.begun[event.block] = slips['rested_s'][event.block] >= RESTED_S
        # Two images later an onset is known twice as well: it may wait for them, but not for ever.
        late = stamp_s - slips['onset_s'] > PATIENCE_S
        for block in np.flatnonzero(self.begun & ((slips['refine_in'] == 0) | late)).tolist():
            onset = slips[block]
            self.coincidence.onset(float(onset['onset_s']), block, float(onset['onset_sigma_s']))
            self.begun[block] = False
        moving = onsets.moving
        self.coincidence.look(stamp_s, seen & ~moving, seen & moving)
