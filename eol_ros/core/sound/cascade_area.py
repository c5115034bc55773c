# SPDX-License-Identifier: Apache-2.0
"""Area so far of the cascade that a grain belongs to, from the triggers up to that grain.

A cascade grows while it sounds: its final area is unknown until it ends. The area so far counts the
blocks that have sounded in it up to now. Triggers have block and time, live and in a bag, so this
needs no other topic and gives the same result offline.
"""

import math
from dataclasses import dataclass

from eol_ros.core.table import Table

# Times are compared in whole milliseconds, a third of one off the round ones, so that no rounding
# of a time axis decides: a live run and a file count from different moments.
NUDGE = 0.37


@dataclass
class _Cascade:
    onset_s: float
    blocks: set[int]


class CascadeAreas:
    """Tracks cascades; a sounding block joins the cascade of its neighbours, corners included.

    It joins when one that it touches, or it itself, has sounded at most `gap_s` ago.
    """

    def __init__(self, gap_s: float, table: Table = Table()):
        self.gap_s = gap_s
        self._touching = [{b, *table.neighbours(b, diagonal=True)} for b in range(table.cells)]
        self._last_s = [float('-inf')] * table.cells
        self._of: list[_Cascade | None] = [None] * table.cells

    def add(self, time_s: float, block: int) -> tuple[int, int, bool]:
        """Take one grain that sounds; return area so far, ms since the onset, and if it grew."""
        gap = int(1e3 * self.gap_s)
        joined: list[_Cascade] = []
        for other in self._touching[block]:
            past = _milliseconds(time_s - self._last_s[other])
            cascade = self._of[other]
            if past < -gap:  # the stamps began again
                self._of[other] = None
            elif cascade is not None and past <= gap and cascade not in joined:
                joined.append(cascade)
        if joined:
            first = min(joined, key=lambda r: r.onset_s)
            for cascade in joined:
                if cascade is not first:
                    first.blocks |= cascade.blocks
                    self._of = [first if r is cascade else r for r in self._of]
        else:
            first = _Cascade(time_s, set())
        grew = block not in first.blocks
        first.blocks.add(block)
        self._of[block], self._last_s[block] = first, time_s
        return len(first.blocks), max(0, _milliseconds(time_s - first.onset_s)), grew


def _milliseconds(span_s: float) -> int:
    return math.floor(1e3 * max(min(span_s, 1e6), -1e6) + NUDGE)
