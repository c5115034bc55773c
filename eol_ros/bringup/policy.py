# SPDX-License-Identifier: Apache-2.0
"""When to start a process again, and when to call it hung. Pure: the time is an argument."""

from dataclasses import dataclass, field

BACKOFF_S = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)
HEALTHY_S = 60.0  # a process that has lived this long begins again with the shortest wait
SILENT_S = 5.0  # no heartbeat for this long: hung
START_S = 180.0  # the first heartbeat may take this long: a first run compiles


@dataclass
class Policy:
    """Back-off and hang detection of one process."""

    started_s: float = 0.0
    beat_s: float | None = None
    failures: int = 0
    restarts: int = 0
    deaths_s: list[float] = field(default_factory=list)

    def start(self, now_s: float) -> None:
        """The process has been started."""
        self.started_s, self.beat_s = now_s, None

    def beat(self, now_s: float) -> None:
        """A heartbeat has come."""
        self.beat_s = now_s

    def hung(self, now_s: float) -> bool:
        """Tell whether it has been silent for too long."""
        if self.beat_s is None:
            return now_s - self.started_s > START_S
        return now_s - self.beat_s > SILENT_S

    def died(self, now_s: float) -> float:
        """Return how long to wait before the next start, in seconds."""
        if now_s - self.started_s > HEALTHY_S:
            self.failures = 0
        wait = BACKOFF_S[min(self.failures, len(BACKOFF_S) - 1)]
        self.failures += 1
        self.restarts += 1
        self.beat_s = None
        self.deaths_s = [t for t in self.deaths_s if now_s - t < 60.0] + [now_s]
        return wait

    def red(self) -> bool:
        """Tell whether it has died three times within a minute."""
        return len(self.deaths_s) >= 3
