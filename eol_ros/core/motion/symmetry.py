# SPDX-License-Identifier: Apache-2.0
"""Which way round does the lattice lie? Answered by the blocks' own accelerometers.

A square lattice looks the same after a quarter turn, so after darkness the camera alone cannot
know. But it sees which place begins to slip, and the block there reports a knock under its true
name. Each onset seen and each tap heard speaks for or against the four turns; what is added up is
the logarithm of their likelihoods, and the answer is given when one turn leads by MARGIN nats.
"""

import numpy as np

from eol_ros.core.geometry import COLS, N_BLOCKS

LAG_S = 0.25  # evidence is judged this long after its stamp, when all of it has arrived
WINDOW_S = 0.04  # an onset and a tap further apart are of two slips
TIMING_S = 0.002  # of clocks and onsets, beside what they say of themselves
HEARD = 0.95  # share of slips whose tap arrives
SEEN = 0.88  # share of taps whose slip is seen to begin
RATE_HZ = 0.7  # slips of one block, a second: how often a tap is there by chance
BURST_S = 0.1  # and how many of them there are about, this near
MISSEEN = 0.05  # share of onsets that are none, or at another time
MARGIN = 13.0
SURE_MARGIN = 25.0  # to contradict a turn that was thought known


def turned(quarters: int) -> np.ndarray:
    """Return the true id (25,) of each id, if the lattice stands `quarters` x 90 deg further."""
    row, column = np.divmod(np.arange(N_BLOCKS), COLS)
    for _ in range(quarters % 4):
        row, column = COLS - 1 - column, row
    return row * COLS + column


TURNED = np.array([turned(q) for q in range(4)])
UNTURNED = np.argsort(TURNED, axis=1)


class Coincidence:
    """Weighs onsets against taps; `belief` (4,) in nats, for 0 to 3 quarter turns."""

    def __init__(self) -> None:
        self.taps: list[tuple[float, int, float]] = []
        self.onsets: list[tuple[float, int, float]] = []
        self.judged_s = -np.inf
        self.belief = np.zeros(4)
        self.count = 0  # onsets judged since the belief was empty

    def forget(self) -> None:
        """Begin again: the ids were given anew."""
        self.onsets = []
        self.belief = np.zeros(4)
        self.count = 0

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a knock that `block` felt; the order of arrival does not matter."""
        if 0 <= block < N_BLOCKS and np.isfinite(stamp_s):
            self.taps.append((stamp_s, block, sigma_s))

    def onset(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take the beginning of a slip as seen, under its present id."""
        self.onsets.append((stamp_s, block, sigma_s))

    def listening(self, now_s: float) -> bool:
        """Whether any tap is there to be judged now or soon."""
        return any(t[0] <= now_s + 1.0 for t in self.taps)

    def update(self, now_s: float) -> None:
        """Judge what is old enough."""
        until = now_s - LAG_S
        since, self.judged_s = self.judged_s, max(until, self.judged_s)
        for onset in sorted(o for o in self.onsets if since < o[0] <= until):
            self.count += 1
            for q in range(4):
                self.belief[q] += self._onset_speaks(onset, int(TURNED[q, onset[1]]))
        for tap in sorted(t for t in self.taps if since < t[0] <= until):
            if not self.onsets:
                continue
            for q in range(4):
                self.belief[q] += self._tap_speaks(tap, int(UNTURNED[q, tap[1]]))
        self.onsets = [o for o in self.onsets if o[0] > until - 2 * WINDOW_S]
        self.taps = [t for t in self.taps if t[0] > until - 2 * WINDOW_S]

    def answer(self, known: bool = False) -> int | None:
        """Return the quarter turns that the evidence is clear about, or None."""
        order = np.argsort(-self.belief, kind='stable')
        lead = self.belief[order[0]] - self.belief[order[1]]
        return int(order[0]) if lead >= (SURE_MARGIN if known else MARGIN) else None

    def _onset_speaks(self, onset: tuple[float, int, float], block: int) -> float:
        # In a cascade all tap at once, and a tap by chance is nothing rare.
        about = sum(abs(t - onset[0]) <= BURST_S for t, _, _ in self.taps)
        rate_hz = max(RATE_HZ, about / (2 * BURST_S * N_BLOCKS))
        best = 1.0 - HEARD
        for stamp_s, name, sigma_s in self.taps:
            if name == block and abs(stamp_s - onset[0]) <= WINDOW_S:
                best += HEARD * _density(stamp_s - onset[0], sigma_s, onset[2]) / rate_hz
        return float(np.log(MISSEEN + (1.0 - MISSEEN) * best))

    def _tap_speaks(self, tap: tuple[float, int, float], block: int) -> float:
        near = any(
            b == block and abs(t - tap[0]) <= 3.0 * _joint(tap[2], sigma_s)
            for t, b, sigma_s in self.onsets
        )
        return 0.0 if near else float(np.log(1.0 - SEEN))


def _joint(*sigmas_s: float) -> float:
    return float(np.sqrt(TIMING_S**2 + sum(s * s for s in sigmas_s)))


def _density(apart_s: float, *sigmas_s: float) -> float:
    sigma = _joint(*sigmas_s)
    return float(np.exp(-0.5 * (apart_s / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)))
