# SPDX-License-Identifier: Apache-2.0
"""One block blinks its infrared light: the second way to know which way round the lattice lies.

The board lets one named block go dark for a moment, once a period. Whatever place goes dark so,
again and again on the beat, while its neighbours stay lit, is that block. Images alone decide.
"""

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.table import Table

EARLY_S, LATE_S = 0.02, 0.08  # a light is believed again only some images after it came back
BEAT_S = 0.05  # blinks may be off the beat by so much
BEATS = 2  # so many right intervals in a row, and the place is known
MOVED_M = 0.01


class Blink:
    """Watches for block `block` going dark for `off_s` once every `period_s`."""

    def __init__(self, block: int, period_s: float, off_s: float, table: Table):
        self.table = table
        self._neighbours = {block: table.neighbours(block) for block in table.ids.tolist()}
        self.block = block
        self.period_s = period_s
        self.off_s = off_s
        self.forget()

    def forget(self) -> None:
        """Start over: ids were reassigned."""
        cells = self.table.cells
        self.lit_s = np.full(cells, np.inf)  # last seen, all neighbours being seen too
        self.lit_xy = np.zeros((cells, 2))
        self.dark = np.zeros(cells, bool)
        self.blink_s = np.full(cells, -np.inf)
        self.beats = np.zeros(cells, int)

    def update(self, stamp_s: float, xy: np.ndarray, seen: np.ndarray) -> int | None:
        """Take one image's blocks; return the quarter turns once they are clear."""
        for block, around in self._neighbours.items():
            clear = all(seen[n] for n in around)
            if seen[block]:
                if self.dark[block] and clear:
                    self._back(block, stamp_s, xy[block])
                self.dark[block] = False
                self.lit_s[block] = stamp_s if clear else np.inf
                self.lit_xy[block] = xy[block]
            else:
                self.dark[block] = clear and np.isfinite(self.lit_s[block])
                if not clear:
                    self.lit_s[block] = np.inf
        places = self.table.unturned_ids[:, self.block]
        known = np.flatnonzero(self.beats[places] >= BEATS)
        others = np.flatnonzero(self.beats[places] > 0)
        if known.size == 1 and others.size == 1:
            return self.table.turns[known[0]]
        return None

    def _back(self, block: int, stamp_s: float, place: np.ndarray) -> None:
        dark_s = stamp_s - self.lit_s[block]
        moved = elementary.hypot(*(place - self.lit_xy[block]))
        if not self.off_s - EARLY_S <= dark_s <= self.off_s + LATE_S or moved > MOVED_M:
            return
        since = self.lit_s[block] - self.blink_s[block]
        periods = round(since / self.period_s) if np.isfinite(since) else 0
        on_beat = 1 <= periods <= 3 and abs(since - periods * self.period_s) < BEAT_S
        self.beats[block] = self.beats[block] + 1 if on_beat else 0
        self.blink_s[block] = self.lit_s[block]
