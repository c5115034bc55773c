# SPDX-License-Identifier: Apache-2.0
"""Whether a worker still works: from a count of the rounds that it has completed."""

from dataclasses import dataclass

STALLED_S = 3.0  # no round for so long: the status says so
HUNG_S = 10.0  # no round for so long: no heartbeat any more
PAUSE_S = 1.5  # of a longer pause between two looks, who looks was away for the rest


@dataclass
class RoundWatch:
    """For how long a worker has completed no round, in seconds.

    Only time in which the watcher itself ran counts: a process that waits for a processor keeps
    its workers waiting, too.
    """

    stalled_s: float = STALLED_S
    hung_s: float = HUNG_S
    still_s: float = 0.0
    _count: int | None = None
    _looked_s: float = float('-inf')

    def look(self, now_s: float, count: int | None) -> None:
        """Take the count of rounds as it is now; None: nothing is due."""
        still = count is not None and count == self._count
        self.still_s = self.still_s + min(now_s - self._looked_s, PAUSE_S) if still else 0.0
        self._count, self._looked_s = count, now_s

    @property
    def stalled(self) -> bool:
        """Whether no round was completed for `stalled_s`."""
        return self.still_s >= self.stalled_s

    @property
    def hung(self) -> bool:
        """Whether no round was completed for `hung_s`."""
        return self.still_s >= self.hung_s
