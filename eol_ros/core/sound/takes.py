# SPDX-License-Identifier: Apache-2.0
"""Cut a sound that still goes on into takes: from a little before it rises until it has gone."""

import numpy as np

HOP_S = 0.01  # a level each
LEAST_S = 0.05


class Takes:
    """Takes of a sound that comes block by block; the same whatever the blocks.

    A take begins `before_s` before the level (RMS of 10 ms, dBFS) reaches `on_db`, and ends when it
    has been below `off_db` for `hold_s`, or after `most_s`. Takes shorter than LEAST_S are left
    out: knocks on the stand.
    """

    def __init__(
        self,
        rate: int,
        on_db: float = -40.0,
        off_db: float = -50.0,
        before_s: float = 0.05,
        hold_s: float = 0.3,
        most_s: float = 30.0,
    ):
        self.level_db = -np.inf  # of the newest 10 ms
        self._hop = max(1, round(HOP_S * rate))
        self._on, self._off = on_db, off_db
        hops = [max(1, round(s / HOP_S)) for s in (before_s, hold_s, LEAST_S, most_s)]
        self._before, self._hold, self._least, self._most = hops
        self._rest = np.zeros(0, np.float32)
        self._kept: list[np.ndarray] = []  # hops of the take, or the last before one
        self._loud = -1  # hops since the take began; -1: none is going on
        self._quiet = 0

    def feed(self, samples: np.ndarray) -> list[np.ndarray]:
        """Take the next samples (n,), full scale 1; return the takes (m,) that have ended."""
        samples = np.concatenate([self._rest, np.asarray(samples, np.float32)])
        whole = len(samples) // self._hop * self._hop
        self._rest = samples[whole:]
        found = []
        for hop in samples[:whole].reshape(-1, self._hop):
            power = float(np.mean(hop.astype(np.float64) ** 2))
            self.level_db = 10 * np.log10(max(power, 1e-20))
            self._kept.append(hop)
            if self._loud < 0:
                if self.level_db < self._on:
                    del self._kept[: -self._before]
                    continue
                self._loud = self._quiet = 0
            self._loud += 1
            self._quiet = self._quiet + 1 if self.level_db < self._off else 0
            if self._quiet >= self._hold or self._loud >= self._most:
                found += self.end()
        return found

    def end(self) -> list[np.ndarray]:
        """Return the take (m,) that is going on, if it is long enough to be one; begin again."""
        long = self._loud - self._quiet >= self._least
        found = [np.concatenate(self._kept)] if long else []
        self._kept, self._loud = [], -1
        return found
