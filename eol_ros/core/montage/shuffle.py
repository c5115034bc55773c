# SPDX-License-Identifier: Apache-2.0
"""When the two walls change, and to which pair: every `period_s` while anything moves."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from eol_ros.errors import ConfigError

SAFE_PERIOD_S = 0.34
"""WCAG 2.3.1 allows three flashes in any one second; changes this far apart stay below it."""
AHEAD = 8
"""How many coming pairs are known in advance, so that a wall can decode them before their turn."""


@dataclass(frozen=True)
class Flip:
    """One change of both walls: to pair number `pair` at `time_s`; `coming` follow in order."""

    pair: int
    time_s: float
    coming: tuple[int, ...]


def check_period(period_s: float) -> float:
    """Return `period_s`, or raise ConfigError when changing that fast could trigger seizures."""
    if not period_s >= SAFE_PERIOD_S:
        raise ConfigError(
            f'montage.period_s: {period_s:g} is below {SAFE_PERIOD_S} s (flash safety, WCAG 2.3.1);'
            f' use {SAFE_PERIOD_S} or more, the work itself uses 0.5'
        )
    return period_s


class Deck:
    """Pair numbers in an endless seeded order: each shown once a round, never twice in a row."""

    def __init__(self, count: int, rng: np.random.Generator):
        if count < 1:
            raise ConfigError('montage: no pair of pictures to show')
        self.count = count
        self._rng = rng
        self._coming: deque[int] = deque()
        self._last = -1
        self._fill()

    def _fill(self) -> None:
        while len(self._coming) <= AHEAD:
            round_ = self._rng.permutation(self.count)
            if self.count > 1 and round_[0] == self._last:
                round_ = np.roll(round_, -1)
            self._coming.extend(int(pair) for pair in round_)
            self._last = self._coming[-1]

    def draw(self) -> int:
        """Take the next pair."""
        pair = self._coming.popleft()
        self._fill()
        return pair

    def coming(self) -> tuple[int, ...]:
        """Return the next `AHEAD` pairs without taking them."""
        return tuple(self._coming)[:AHEAD]


class Shuffle:
    """Turns slips into flips.

    Feed it each slip's start and stop, ask `update` for a flip whenever time has passed. While at
    least one slip is open a flip is due every `period_s`; the beat is kept over late calls, and two
    flips are never closer than `period_s`, also over a pause. A slip whose stop never comes (the
    sender died) counts as moving for `longest_slip_s` only.
    """

    def __init__(
        self,
        count: int,
        period_s: float,
        rng: np.random.Generator,
        lead_s: float = 0.0,
        longest_slip_s: float = 10.0,
    ):
        self.period_s = check_period(period_s)
        self.lead_s = lead_s
        self.longest_slip_s = longest_slip_s
        self._rng = rng
        self._deck = Deck(count, rng)
        self._open: dict[int, float] = {}
        self._beat_s = -np.inf

    @property
    def moving(self) -> int:
        """How many blocks are in a slip now."""
        return len(self._open)

    @property
    def due_s(self) -> float:
        """When to ask `update` again; infinity while nothing moves."""
        if not self._open:
            return np.inf
        return min(self._beat_s + self.period_s, min(self._open.values()) + self.longest_slip_s)

    def replace(self, count: int) -> None:
        """The folder changed: go on with `count` pairs and a fresh order."""
        self._deck = Deck(count, self._rng)

    def slip(self, block: int, started: bool, now_s: float) -> None:
        """Note the start or the stop of one block's slip at `now_s`."""
        if started:
            self._open[block] = now_s
        else:
            self._open.pop(block, None)

    def forget(self) -> None:
        """Nothing moves any more as far as anyone knows; the beat is kept."""
        self._open.clear()

    def may_change(self, now_s: float) -> bool:
        """Return whether a change out of turn keeps `period_s` from the last; if so, count it."""
        if now_s < self._beat_s + self.period_s:
            return False
        self._beat_s = now_s
        return True

    def show(self, now_s: float) -> Flip:
        """Change now, whatever moves: the first picture of a run."""
        self._beat_s = now_s
        return Flip(self._deck.draw(), now_s + self.lead_s, self._deck.coming())

    def update(self, now_s: float) -> Flip | None:
        """Return the flip that is due at `now_s`, or None."""
        self._open = {b: t for b, t in self._open.items() if now_s - t < self.longest_slip_s}
        due_s = self._beat_s + self.period_s
        if not self._open or now_s < due_s:
            return None
        # Keep the beat when a call comes a little late; start a new one after a pause or a stall.
        on_beat = now_s - due_s < 0.2 * self.period_s
        flip = self.show(now_s)
        if on_beat:
            self._beat_s = due_s
            flip = Flip(flip.pair, due_s + self.lead_s, flip.coming)
        return flip
