# SPDX-License-Identifier: Apache-2.0
"""Flashes of the white LEDs: a slip lights its block at once, then the light dies away.

The whole field flashes at most three times in any second, whatever the blocks do (WCAG 2.2, success
criterion 2.3.1, level A). A flash is there a pair of opposing changes of relative luminance of 10 %
or more. The limit never delays or dims a slip; it lengthens the decay of what already shines:

    fall   light decays with its time constant, exp(-t / decay_s)
    hold   light dies away by HOLD_RATE, so slowly that it makes no opposing change of 10 % before
           the next fall may begin; each block by the same share of its own light, so that this is
           true of any sum of them, and of an eye or a camera that is dazzled by a few

A slip that meets falling light puts the whole field into hold for MIN_PERIOD_S. Each fall of 10 %
or more, in any one block and in the sum of any of them, shares some moment with a `fall`, and two
of those are MIN_PERIOD_S apart from the end of one to the start of the next; so four such falls
take more than a second, however one counts them.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.serial_protocol import GROUP
from eol_ros.core.table import Table

FLASHES_PER_S = 3
FLASH_DEPTH = 0.1  # least change that counts, as a share of the greatest luminance (WCAG 2.2)
MIN_PERIOD_S = 1.001 / FLASHES_PER_S  # the thousandth keeps four falls out of a closed second
HOLD_RATE = -elementary.log(1.0 - 0.8 * FLASH_DEPTH) / MIN_PERIOD_S  # 1/s, 8 % in a period
DARK = 0.5 / 255  # rounds to level 0 on the wire


def window_s(table: Table) -> float:
    """Return how long a fall of light counts after its end, in s.

    A closed second, 50 ms within which changes are concurrent, and the time for which a block obeys
    a word of the bridge, 20 ms for each group of blocks, since words of groups take turns.
    """
    return 1.05 + 0.02 * -(-table.cells // GROUP)


class FlashField:
    """The light of all blocks, a pure function of the slips and the times of its calls.

    A decay below SHORTEST_S is raised to it: blocks then follow the bridge within 0.022 of the
    decay, over a link of 2 ms.

    Parameters
    ----------
    decay_s : float
        Time constant of a fall.
    peak : float
        Level in 0..1 that a slip sets.
    limited : bool
        Keep to three flashes a second (WCAG 2.3.1).
    table : Table
        The table of the blocks.

    Examples
    --------
    >>> light = FlashField(decay_s=0.1)
    >>> light.slip(0.0, block=7)
    >>> float(light.levels(0.0)[7]), round(float(light.levels(0.1)[7]), 3)
    (1.0, 0.368)
    """

    SHORTEST_S = 0.182

    def __init__(
        self, decay_s: float, peak: float = 1.0, limited: bool = True, table: Table = Table()
    ):
        if not decay_s > 0:
            raise ValueError(f'decay_s is {decay_s}; it must be positive')
        if not 0 <= peak <= 1:
            raise ValueError(f'peak is {peak}; it must lie in 0..1')
        self.decay_s = decay_s
        self.peak = peak
        self.limited = limited
        self.table = table
        self.window_s = window_s(table)
        self.lengthened = 0  # falls that had to wait, for the health report
        self._level = np.zeros(table.cells)
        self._now_s = -math.inf
        self._fall_at_s = -math.inf  # start of this fall, or earliest of the next
        self._fell_s = -math.inf  # when light was last seen falling

    def slip(self, now_s: float, block: int, share: float = 1.0) -> None:
        """Light `block` at `now_s` to a share of the peak; the field stops falling until the limit
        allows it again."""
        self._advance(now_s)
        self._level[block] = max(self._level[block], share * self.peak)
        if self.limited and self._fall_at_s < self._now_s:  # not in hold already
            self._fall_at_s = max(self._now_s, self._fell_s + MIN_PERIOD_S)
            self.lengthened += self._fall_at_s > self._now_s

    def takes(self, now_s: float, block: int, share: float) -> bool:
        """Return whether the bridge obeys an order to light `block`: always."""
        return True

    def hold(self, now_s: float, until_s: float, block: int | None = None) -> None:
        """Let nothing fall before `until_s`, whatever the limit says and whichever `block` it is
        for."""
        self._advance(now_s)
        self._fall_at_s = until_s

    def take_over(self, other: 'FlashField', now_s: float | None = None) -> None:
        """Shine as `other` at `now_s`, whose limit was another one; hold for `window_s`, in which
        neither knows what fell.

        Without `now_s` at the last time that `other` was asked for.
        """
        self._now_s = other._now_s if now_s is None else now_s
        self._level, self.lengthened = other.levels(self._now_s), other.lengthened
        self.hold(self._now_s, self._now_s + self.window_s)

    def levels(self, now_s: float) -> np.ndarray:
        """Return the light of each block at `now_s`, (cells,), 0..1 of full luminance."""
        self._advance(now_s)
        return self._level.copy()

    def level_bytes(self, now_s: float) -> bytes:
        """Return the light of each block at `now_s` as the wire carries it, a byte 0..255 each."""
        return np.rint(self.levels(now_s) * 255).astype(np.uint8).tobytes()

    @property
    def dark(self) -> bool:
        """True when nothing glows any more."""
        return not self._level.any()

    def shift(self, by_s: float) -> None:
        """Count from now on in times that are `by_s` greater: the clock was set."""
        self._now_s += by_s
        self._fall_at_s += by_s
        self._fell_s += by_s

    def _advance(self, now_s: float) -> None:
        """Carry the levels on to `now_s`; times that run backwards are taken as no time at all."""
        now_s = max(now_s, self._now_s)
        if not self.dark:
            fall_from_s = max(self._now_s, min(self._fall_at_s, now_s))
            held_s = fall_from_s - self._now_s
            fell_s = now_s - fall_from_s
            if held_s > 0:
                self._level *= elementary.exp(-HOLD_RATE * held_s)
            if fell_s > 0 and self._level.any():
                visible_s = self.decay_s * elementary.log(float(np.max(self._level)) / DARK)
                self._fell_s = fall_from_s + min(fell_s, visible_s)
                self._level *= elementary.exp(-fell_s / self.decay_s)
            self._level[self._level < DARK] = 0.0
        self._now_s = now_s
