# SPDX-License-Identifier: Apache-2.0
"""How far the walls are broken: the further the greater a cascade, and calm heals it slowly."""

from eol_ros.core import elementary
from eol_ros.core.table import Table

CASCADES = 64  # remembered, so that a slip that comes late still counts for its own


class Damage:
    """Turns slips into a level, 0 (whole) to 1.

    A cascade of `area` blocks raises the level to log(area) / log(blocks), of the `blocks` of the
    table, where it stood lower, while it runs; from the newest slip on it falls, by 1 in `heal_s`.
    """

    def __init__(self, heal_s: float, blocks: int = Table().count):
        self.heal_s, self._log_blocks = heal_s, elementary.log(float(blocks))
        self._level, self._at_s = 0.0, 0.0
        self._blocks: dict[int, set[int]] = {}

    def slip(self, block: int, cascade: int, now_s: float) -> None:
        """Note the onset of a slip that belongs to `cascade`, at `now_s`."""
        blocks = self._blocks.setdefault(cascade, set())
        blocks.add(block)
        if len(self._blocks) > CASCADES:
            del self._blocks[next(iter(self._blocks))]
        reached = elementary.log(float(len(blocks))) / self._log_blocks
        self._level, self._at_s = max(self.level(now_s), reached), now_s

    def level(self, now_s: float) -> float:
        """Return the level at `now_s`."""
        return max(self._level - max(now_s - self._at_s, 0.0) / self.heal_s, 0.0)

    def degree(self, count: int, now_s: float) -> int:
        """Return which of `count` pictures, of ever greater damage, is due at `now_s`; from 0."""
        return min(int(self.level(now_s) * count), count - 1)
