# SPDX-License-Identifier: Apache-2.0
"""Detects a stalled worker by the count of the rounds that it has completed."""

from dataclasses import dataclass

STALLED_S = 3.0  # time without a round before the status is an error
HUNG_S = 10.0  # time without a round before the heartbeat stops
PAUSE_S = 1.5  # longest counted pause between two looks: the watcher did not run in the rest


@dataclass
class RoundWatch:
    """Measures the time since a worker last completed a round, in seconds.

    Only time in which the watcher itself ran counts: in a process that waits for a processor the
    workers wait, too.
    """

    stalled_s: float = STALLED_S
    hung_s: float = HUNG_S
    still_s: float = 0.0
    _count: int | None = None
    _looked_s: float = float('-inf')

    def look(self, now_s: float, count: int | None) -> None:
        """Record the present count of rounds; None: no work is due."""
        still = count is not None and count == self._count
        self.still_s = self.still_s + min(now_s - self._looked_s, PAUSE_S) if still else 0.0
        self._count, self._looked_s = count, now_s

    @property
    def stalled(self) -> bool:
        """Whether the worker completed no round for `stalled_s`."""
        return self.still_s >= self.stalled_s

    @property
    def hung(self) -> bool:
        """Whether the worker completed no round for `hung_s`."""
        return self.still_s >= self.hung_s
