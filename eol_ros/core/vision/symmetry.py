# SPDX-License-Identifier: Apache-2.0
"""Which way round does the lattice lie? Answered by the blocks' own accelerometers.

A square lattice looks the same after a quarter turn, most others after half a turn, so after
darkness the camera alone cannot know. But it sees which place begins to slip and which places rest,
and the block there reports a knock under its true name. What is added up for each turn is the
logarithm of the likelihood of all taps: each comes from an onset that was seen, from a block that
slides already, from one that is hidden, or, hardly ever, from one that was seen to rest. The answer
is given when the posterior probability that it is wrong is below ERROR (sequential test: Wald, Ann.
Math. Stat. 16, 1945).
"""

import math
from collections import deque

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.table import Table

LAG_S = 0.25  # evidence is judged this long after its stamp, when all of it has arrived
WINDOW_S = 0.04  # an onset and a tap further apart are of two slips
TIMING_S = 0.0005  # of clocks, beside what taps and onsets say of themselves
HONEST = 0.8  # onsets are so much better than they say
HEARD = 0.965  # share of onsets that are answered by a tap; the rest lost, or no onset at all
RESTING_HZ = 0.01  # taps of a block that is seen to rest: somebody touched it
UNSEEN_HZ = 0.7  # taps of a block that nobody sees: its slips
BURST_S = 0.1  # or as many as of all blocks, this near,
TWIN_S = 0.015  # or as of the three that a turn takes it for: what is alike lets go alike
RETAP_SHARE = 0.3  # of that is how often a block on its way taps: stuck for a moment and gone again
REACH = 3.0  # standard errors of a tap's time
SURE_IMAGES = 3  # so many images at rest before a block is known to rest
ERROR = 1e-5  # chance of a wrong answer
SURE_ERROR = 1e-11  # to contradict a turn that was thought known
ANSWERED = 0.6  # share of the onsets that the answer must explain, two at least

UNSEEN, RESTING, SLIDING = 0, 1, 2


class Coincidence:
    """Weighs onsets against taps; `belief` (turns,) in nats, for each turn of the table."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._fixed = (table.turned_ids == np.arange(table.cells)).all(axis=0)  # by every turn
        self.taps: list[tuple[float, int, float]] = []
        self.judged_s = -np.inf
        self.took = 0  # onsets that the last answer rests on
        self.forget()

    def forget(self) -> None:
        """Start over: ids were reassigned."""
        self.onsets: list[tuple[float, int, float]] = []
        self.images: deque[tuple[float, np.ndarray]] = deque()  # stamp, what each place did
        self.rested: np.ndarray = np.zeros(self.table.cells, int)  # images in a row
        turns = len(self.table.turns)
        self.belief = np.zeros(turns)
        self.answered = np.zeros(
            turns, int
        )  # of the telling ones, with a tap where each turn wants it
        self.count = 0  # onsets until the last tap judged, since the belief was empty
        self.telling = 0  # of these, not of the block that a turn leaves where it is
        self.counted_s = -np.inf

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a knock that `block` felt; the order of arrival does not matter."""
        if 0 <= block < self.table.cells and np.isfinite(stamp_s):
            self.taps.append((stamp_s, block, sigma_s))

    def look(self, stamp_s: float, quiet: np.ndarray, moving: np.ndarray) -> None:
        """Take what an image shows of each place: quiet, moving (cells,), hidden if neither."""
        self.rested = np.where(quiet, self.rested + 1, 0)
        state = np.where(moving, SLIDING, np.where(self.rested > SURE_IMAGES, RESTING, UNSEEN))
        self.images.append((stamp_s, state))

    def onset(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take the beginning of a slip as seen, under its present id."""
        self.onsets.append((stamp_s, block, sigma_s))

    def listening(self, now_s: float) -> bool:
        """Whether any tap is there to be judged now or soon."""
        return any(t[0] <= now_s + 1.0 for t in self.taps)

    def update(self, now_s: float, known: bool = False) -> int | None:
        """Judge what is old enough; return the quarter turns once they are clear, or None.

        known: the turn is thought to be known; more is asked of what might contradict it.
        """
        until = now_s - LAG_S
        since, self.judged_s = self.judged_s, max(until, self.judged_s)
        answer = None
        if not (self.images or self.onsets or self.taps):
            return None
        if self.images:
            for tap in sorted(t for t in self.taps if since < t[0] <= until):
                self._judge(tap)
                answer = self.answer(known)
                if answer is not None:
                    place = self.table.unturned_ids[self.table.turns.index(answer), tap[1]]
                    self.took = self.count + sum(
                        o[1] == place and 0.0 < o[0] - tap[0] <= WINDOW_S for o in self.onsets
                    )
                    break
        past = until - 2 * WINDOW_S - BURST_S
        self.onsets = [o for o in self.onsets if o[0] > past]
        self.taps = [t for t in self.taps if t[0] > past]
        while self.images and self.images[0][0] < past:
            self.images.popleft()
        return answer

    def answer(self, known: bool = False) -> int | None:
        """Return the quarter turns that the evidence is clear about, or None."""
        best = int(np.argmax(self.belief))
        others = np.delete(self.belief, best) - self.belief[best]
        if elementary.exp(others).sum() > (SURE_ERROR if known else ERROR):
            return None
        return (
            self.table.turns[best]
            if self.answered[best] >= max(2.0, ANSWERED * self.telling)
            else None
        )

    def _judge(self, tap: tuple[float, int, float]) -> None:
        """Add what one tap says of each turn.

        An onset is answered or not. That it is not costs every turn the same, 1 - HEARD; that it is
        gains HEARD / (1 - HEARD) times its density over all else that may have made the tap.
        """
        stamp_s, name, sigma_s = tap
        new = [o[1] for o in self.onsets if self.counted_s < o[0] <= stamp_s]
        self.count += len(new)
        self.telling += sum(not self._fixed[block] for block in new)
        self.counted_s = stamp_s
        near = [o for o in self.onsets if abs(o[0] - stamp_s) <= WINDOW_S + REACH * sigma_s]
        for q in range(len(self.belief)):
            place = int(self.table.unturned_ids[q, name])
            answers = math.fsum(
                _density(stamp_s - at_s, sigma_s, HONEST * spread_s)
                for at_s, block, spread_s in near
                if block == place
            )
            answers *= HEARD / (1.0 - HEARD)
            chance = self._chance_hz(tap, place)
            self.belief[q] += elementary.log(answers + chance)
            self.answered[q] += answers > chance and not self._fixed[name]

    def _chance_hz(self, tap: tuple[float, int, float], place: int) -> float:
        """How often the block at `place` taps at such a moment without an onset that is seen."""
        stamp_s, _, sigma_s = tap
        sigma = elementary.hypot(sigma_s, TIMING_S)
        about = [t for t in self.taps if abs(t[0] - stamp_s) <= BURST_S]
        alike = self.table.turned_ids[1:, tap[1]]
        twins = sum(abs(t[0] - stamp_s) <= TWIN_S and t[1] in alike for t in about)
        blocks, others = self.table.count, max(len(alike), 1)
        unseen_hz = max(
            UNSEEN_HZ, len(about) / (2 * BURST_S * blocks), twins / (2 * TWIN_S * others)
        )
        hz = (unseen_hz, RESTING_HZ, RETAP_SHARE * unseen_hz)
        before = _below((self.images[0][0] - stamp_s) / sigma)
        total = unseen_hz * before
        for at_s, state in self.images:  # each tells of the time since the one before
            until = _below((at_s - stamp_s) / sigma)
            total += hz[state[place]] * (until - before)
            before = until
        return total + unseen_hz * (1.0 - before)


def _density(apart_s: float, *sigmas_s: float) -> float:
    sigma = math.sqrt(TIMING_S**2 + math.fsum(s * s for s in sigmas_s))
    away = apart_s / sigma
    return elementary.exp(-0.5 * away * away) / (sigma * math.sqrt(2 * math.pi))


def _below(sigmas: float) -> float:
    return 0.5 * math.erfc(-sigmas / math.sqrt(2.0))
