# SPDX-License-Identifier: Apache-2.0
"""Flashes of single blocks, limited within each 10 degree field of view and not over the table.

WCAG 2.2 (general flash threshold, 2.3.1) allows more than three flashes a second where those that
occur concurrently cover at most 0.006 sr of any 10 degree field. Two rules keep every such field
of every viewer to three (derived from the geometry of the table in `test/support/flash_bound.py`):

    a block               at most `block_falls(table)` falls of its light in any second, 3 or 1
    a square of 2 x 2     at most SQUARE_FALLS falls of its blocks in any second

A slip always lights its block at once. It reserves the next fall of that light, and the light is
held until both rules allow the fall. Held light loses 6 to 7 % in `window_s`, no opposing change of
10 %. A slip that raises falling light by less than a hold loses makes it hold for `window_s`, which
counts as a fall. So each change of 10 % is complete within a fall, and a closed second contains
moments of at most three falls of a block: the fourth begins `window_s` after the end of the first.

Where blocks stand closer than `block_falls` says, each makes one fall in a second. The flashes of a
field in a second then have no block in common. Each covers more than 0.006 sr, and the field has
0.0239 sr, so there are at most three, at any distance.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.light.flash import DARK, FlashField
from eol_ros.core.table import Table

BLOCK_FALLS, SQUARE_FALLS = 3, 11
APART = 1.3  # gap over side from which blocks of any size may make BLOCK_FALLS
HOLD_RATE = -elementary.log(0.94) / 1.07  # 1/s, 6 % in `window_s` of the default table
FIELD_OF_VIEW, FIELD, OFF = LIMITS = ('field_of_view', 'field', 'false')
RISE = 1.075  # of falling light, by which a slip raises it at least: a hold loses up to 7 %
FIRST = 0.75  # of `peak`, the level of a slip after rest; one that meets light adds the rest


def squares(table: Table) -> np.ndarray:
    """Return the ids of the places of each 2 x 2 square of the lattice, (squares, 4)."""
    columns = table.columns
    corner = (np.arange(table.rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    return corner + np.array([0, 1, columns, columns + 1])


def block_falls(table: Table) -> int:
    """Return how many falls of light a block of `table` may make in any second.

    Examples
    --------
    >>> block_falls(Table()), block_falls(Table(block_side_m=0.03, gap_m=0.02))
    (3, 1)
    """
    side_m, apart = table.block_side_m, min(table.gaps_m) / table.block_side_m
    proven = Table()  # a smaller table with the same proportions is one seen from further away
    if side_m <= proven.block_side_m and apart >= proven.gap_m / proven.block_side_m:
        return BLOCK_FALLS
    return BLOCK_FALLS if apart >= APART else 1


def new_field(limit: str, decay_s: float, peak: float = 1.0, table: Table = Table()) -> FlashField:
    """Return dark blocks under one of LIMITS."""
    make = LocalField if limit == FIELD_OF_VIEW else FlashField
    return make(max(decay_s, make.SHORTEST_S), peak, limit != OFF, table)


class LocalField(FlashField):
    """The light of all blocks, limited within each field of view; see FlashField.

    Examples
    --------
    >>> light = LocalField(decay_s=0.1)
    >>> light.slip(0.0, block=7)
    >>> light.slip(0.1, block=8)
    >>> light.levels(0.1)[7:9].round(3).tolist()
    [0.276, 0.75]
    """

    SHORTEST_S = 0.02  # shortest decay: the block itself ends its fall, not the bridge

    def __init__(
        self, decay_s: float, peak: float = 1.0, limited: bool = True, table: Table = Table()
    ):
        super().__init__(decay_s, peak, limited, table)
        n, all_squares = table.cells, squares(table)
        self._squares = [all_squares[(all_squares == b).any(axis=1)] for b in range(n)]
        self._fall_s = np.full(n, -math.inf)  # when its fall began, or the next one may
        self._ends_s = np.full((n, block_falls(table)), -math.inf)  # of its last falls, rising

    def slip(self, now_s: float, block: int, share: float = 1.0) -> None:
        """Light `block` at `now_s` to a share of the peak; it falls when the limit allows.

        Where that does not raise falling light by RISE, it holds as by `hold`.
        """
        self._advance(now_s)
        before, peak = self._level[block], share * self.peak
        lit = min(max(before, peak), max(FIRST * peak, before + (1 - FIRST) * peak))
        falls = self._fall_s[block] < self._now_s
        self._level[block] = lit
        if falls and lit < RISE * before and self.limited:
            self.hold(now_s, now_s, block)
            return
        if not falls:  # held, or lit at this very moment
            return
        if before > 0:
            self._ended(block, self._now_s)
        self._fall_s[block] = self._now_s
        if self.limited:
            self._fall_s[block] = self._allowed_s(block, self._now_s)
            self.lengthened += self._fall_s[block] > self._now_s

    def takes(self, now_s: float, block: int, share: float) -> bool:
        """Return whether the bridge obeys an order; a dimmed one must find `block` held or dim."""
        self._advance(now_s)
        falls = self._fall_s[block] < self._now_s
        return share >= 1 or bool(falls * RISE * self._level[block] < share * self.peak)

    def hold(self, now_s: float, until_s: float, block: int | None = None) -> None:
        """Let `block`, or none, fall before `until_s`, nor within `window_s`, whatever the
        limit says."""
        self._advance(now_s)
        for one in range(self.table.cells) if block is None else (block,):
            least_s = self._now_s + self.window_s
            self._fall_s[one] = self._allowed_s(one, max(until_s, least_s))
            if self._level[one] > 0:  # a change that has begun may be complete while it holds
                self._ended(one, least_s)

    def shift(self, by_s: float) -> None:
        """Count from now on in times that are `by_s` greater: the clock was set."""
        self._now_s += by_s
        self._fall_s += by_s
        self._ends_s += by_s

    def falls(self, now_s: float) -> np.ndarray:
        """Return whether the light of each block may fall at `now_s`, (cells,)."""
        return self._fall_s <= now_s

    def _ended(self, block: int, at_s: float) -> None:
        self._ends_s[block, :-1] = self._ends_s[block, 1:]
        self._ends_s[block, -1] = at_s

    def _allowed_s(self, block: int, from_s: float) -> float:
        """Return the first time from `from_s` on when both rules allow one fall more of `block`."""
        at_s = max(from_s, float(self._ends_s[block, 0]) + self.window_s)
        before_s = -math.inf
        while before_s < at_s:  # until all squares agree
            before_s = at_s
            for square in self._squares[block]:
                at_s = self._square_allows_s(square, block, at_s)
        return at_s

    def _square_allows_s(self, square: np.ndarray, block: int, at_s: float) -> float:
        """Return the first time from `at_s` on when `square` allows one fall more of `block`.

        A fall that lasts or is reserved may last for ever: a second that contains its begin and
        that of the new fall must not contain moments of SQUARE_FALLS others.
        """
        begins_s = [float(self._fall_s[k]) for k in square if k != block and self._level[k] > 0]
        ends_s = sorted(self._ends_s[square].ravel().tolist())
        for moment_s in sorted({at_s, *(t for t in begins_s if t > at_s)}, reverse=True):
            recent_s = [t for t in ends_s if t + self.window_s > moment_s]
            if len(recent_s) + sum(t <= moment_s for t in begins_s) >= SQUARE_FALLS:
                return self._square_allows_s(square, block, recent_s[0] + self.window_s)
        return at_s

    def _advance(self, now_s: float) -> None:
        """Carry the levels on to `now_s`; times that run backwards are taken as no time at all."""
        now_s = max(now_s, self._now_s)
        for block in np.flatnonzero(self._level).tolist():
            fall_from_s = max(self._now_s, min(float(self._fall_s[block]), now_s))
            held_s, fell_s = fall_from_s - self._now_s, now_s - fall_from_s
            if held_s > 0:
                self._level[block] *= elementary.exp(-HOLD_RATE * held_s)
            if fell_s > 0:
                visible_s = self.decay_s * elementary.log(float(self._level[block]) / DARK)
                self._level[block] *= elementary.exp(-fell_s / self.decay_s)
                if self._level[block] < DARK:
                    self._ended(block, fall_from_s + min(fell_s, max(visible_s, 0.0)))
            if self._level[block] < DARK:
                self._level[block] = 0.0
        self._now_s = now_s
