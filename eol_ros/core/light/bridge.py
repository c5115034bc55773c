# SPDX-License-Identifier: Apache-2.0
"""The white LEDs of blocks that flash by themselves, and the bridge that counts them together.

What firmware/block/light.c and firmware/bridge do, over a link without loss: a block lights up at
a tap, or when the host lights it. It falls only while the bridge is there and the limit of
flashes allows it: under that of the whole field all fall together, under that of each field of view
each by itself.
"""

import math

import numpy as np

from eol_ros.core.light.flash import MIN_PERIOD_S
from eol_ros.core.light.local import FIELD_OF_VIEW, new_field
from eol_ros.core.table import Table

DECAY_S = 0.1  # decay time until the host sends its own


class Bridge:
    """Blocks and bridge as they are after power-up; times in s must not fall.

    Examples
    --------
    >>> bridge = Bridge()
    >>> bridge.felt(0.0, 7), float(bridge.levels(0.0)[7])
    (True, 0.75)
    >>> bridge.link(0.0, False)
    >>> round(float(bridge.levels(1.0)[7]), 2)
    0.71
    """

    def __init__(self, table: Table = Table()) -> None:
        self.limit, self.table = FIELD_OF_VIEW, table
        self.field = new_field(FIELD_OF_VIEW, DECAY_S, table=table)
        self.by_itself = True
        self.linked = True
        self._silent: set[int] = set()  # not heard by the bridge: they might flash uncounted

    def configure(
        self, now_s: float, by_itself: bool, limit: str, peak: float, decay_s: float
    ) -> None:
        """Take the host's settings of flashes."""
        self.by_itself = by_itself
        if limit != self.limit:
            before, self.limit = self.field, limit
            self.field = new_field(limit, decay_s, peak, self.table)
            self.field.take_over(before, now_s)
            if not self.linked or self._silent:
                self._hold(now_s)
        self.field.peak, self.field.decay_s = peak, max(decay_s, self.field.SHORTEST_S)

    def felt(self, now_s: float, block: int) -> bool:
        """Handle a tap of a block; return whether the tap lights the block."""
        if self.by_itself:
            self.field.slip(now_s, block)
        return self.by_itself

    def light(self, now_s: float, mask: int, share: float = 1.0) -> None:
        """Light the blocks of `mask` to a share of the peak, except those that are brighter.

        Without the bridge no block receives the command.
        """
        if self.linked:
            for block in self.table.ids.tolist():
                if mask >> block & 1 and self.field.takes(now_s, block, share):
                    self.field.slip(now_s, block, share)

    def link(self, now_s: float, linked: bool) -> None:
        """Connect or disconnect the bridge.

        After a connection nothing falls until earlier falls no longer count.
        """
        if linked != self.linked:
            self.linked = linked
            self._hold(now_s)

    def hear(self, now_s: float, block: int, heard: bool) -> None:
        """Note whether the bridge hears a block; light of a block that it does not hear is held."""
        if heard == (block in self._silent):
            self._silent ^= {block}
            if self.linked:
                self._hold(now_s, block)

    def _hold(self, now_s: float, block: int | None = None) -> None:
        if self.limit == FIELD_OF_VIEW:
            for one in self.table.ids.tolist() if block is None else (block,):
                alone = not self.linked or one in self._silent
                self.field.hold(now_s, math.inf if alone else now_s, one)
        else:  # the silent one might flash, so nothing falls
            alone = not self.linked or bool(self._silent)
            self.field.hold(now_s, math.inf if alone else now_s + MIN_PERIOD_S)

    def levels(self, now_s: float) -> np.ndarray:
        """Return the light of each block at `now_s`, shape (cells,), 0..1."""
        return self.field.levels(now_s)
