# SPDX-License-Identifier: Apache-2.0
"""When to start a process again, and when to call it hung. Pure: times and counts are arguments.

A process that waits for a processor is not to blame for its silence. Its heartbeat is therefore due
after so many seconds in which it could have run: those in which it waited, for a processor or for a
disk, count only up to a limit. What is blocked, stopped or spinning waits for neither.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from eol_ros.bringup.processor import Thread
from eol_ros.devices.backoff import Backoff
from eol_ros.said import Said, said

HEALTHY_S = 60.0  # a process that has lived this long starts again at once
STOPPED_S = 2.5  # no heartbeat for this long from one that is stopped (SIGSTOP): nothing can come
SILENT_S = 5.0  # no heartbeat for this long, though it could have run: hung
STARVED_S = 60.0  # nor for this long, whatever it waited for
START_S = 180.0  # the first heartbeat may take this long: without a cache a node compiles itself
START_STARVED_S = 600.0
START_AGAIN_S = 10.0  # and this long, or START_AGAIN times as long as before, where it has run
START_AGAIN = 4.0
UNFED_S = 3.0  # for so long a node may get nothing of what another node gives
UNFED_FIRST_S = 15.0  # before all have been well for the first time
UNFED_MOST_S = 60.0  # and twice as long each time, if that did not help
QUIET_S = 1.5  # a heartbeat is late: from here on it is looked what the process does
LOOK_S = 0.5  # how often
PAUSE_S = 0.5  # bringup looks ten times a second: of a longer gap it was away for the rest itself

FINE, STARVED, HUNG = 'fine', 'starved', 'hung'


def waited_s(before: Mapping[int, Thread], after: Mapping[int, Thread], span_s: float) -> float:
    """Return for how much of `span_s` a process waited for a processor between two looks.

    Waits of its threads add up, to the whole span at most: what one of them has to say goes through
    the hands of several, and each waits its turn. The kernel counts a wait when it is over; so one
    that still lasts shows as a thread that is to run (R) and has been given no turn since. Without
    the kernel's count, a thread that is to run has waited whenever it did not run.
    """
    sum_s = 0.0
    for number in before.keys() & after.keys():
        old, new = before[number], after[number]
        idle_s = max(span_s - (new.ran_ns - old.ran_ns) * 1e-9, 0.0)
        if old.waited_ns is None or new.waited_ns is None:
            waited = idle_s if new.state == 'R' else 0.0
        elif old.state == new.state == 'R' and old.turns == new.turns:
            waited = idle_s
        else:
            waited = (new.waited_ns - old.waited_ns) * 1e-9
        sum_s += min(waited, idle_s)
    return min(sum_s, span_s)


@dataclass(frozen=True)
class Look:
    """What the kernel said of a process at one moment."""

    at_s: float
    threads: Mapping[int, Thread]
    disk_wait_s: float | None  # of the whole machine, since boot


def disk_s(before_s: float | None, look: Look) -> float:
    """Return for how long a process has waited for a disk up to `look`, at most.

    A thread in uninterruptible sleep (D) waits for a disk only while the kernel counts somebody as
    waiting for one (/proc/pressure/io, `before_s` at the look before; None: it does not count);
    else for a driver, which may never answer.
    """
    if before_s is None or look.disk_wait_s is None:
        return 0.0
    return look.disk_wait_s - before_s if 'D' in {t.state for t in look.threads.values()} else 0.0


@dataclass
class Silence:
    """How long a process has said nothing, and what it waited for meanwhile, in seconds."""

    last_s: float  # when time was last added
    quiet_s: float = field(default_factory=lambda: QUIET_S)  # only a longer one is looked into
    silent_s: float = 0.0  # while bringup itself was awake
    looked_s: float = 0.0  # of these, between two looks
    processor_s: float = 0.0  # of these, waited for a processor
    disk_s: float = 0.0  # and for a disk
    _look: Look | None = None
    _looked_at_s: float = 0.0  # silent_s at that look

    def pass_until(self, now_s: float) -> None:
        """Time has passed; what bringup itself has slept through is nobody's silence."""
        self.silent_s += min(now_s - self.last_s, PAUSE_S)
        self.last_s = now_s

    def due(self) -> bool:
        """Tell whether it is time for a look."""
        if self._look is None:
            return self.silent_s >= self.quiet_s
        return self.last_s - self._look.at_s >= LOOK_S

    def take(self, look: Look) -> None:
        """Add what it waited for since the look before."""
        if (before := self._look) is not None and (span_s := look.at_s - before.at_s) > 0:
            processor = waited_s(before.threads, look.threads, span_s)
            disk = min(disk_s(before.disk_wait_s, look), span_s - processor)
            counted_s = self.silent_s - self._looked_at_s
            self.looked_s += counted_s
            self.processor_s += processor * counted_s / span_s
            self.disk_s += disk * counted_s / span_s
        self._look, self._looked_at_s = look, self.silent_s

    def verdict(self, allowed_s: float, most_s: float) -> str:
        """Tell whether it may be silent for so long: FINE, STARVED, or HUNG."""
        if self.stopped and self.silent_s > min(STOPPED_S, allowed_s):
            return HUNG
        could_run_s = self.silent_s - self.processor_s - self.disk_s
        if could_run_s > allowed_s or self.silent_s > most_s:
            return HUNG
        mostly = self.looked_s > 0 and self.processor_s + self.disk_s >= self.looked_s / 2
        return STARVED if mostly and self.silent_s > min(SILENT_S, allowed_s) else FINE

    @property
    def stopped(self) -> bool:
        """Whether somebody had stopped it (SIGSTOP, a debugger) at the last look."""
        states = {t.state for t in self._look.threads.values()} if self._look else set()
        return bool(states) and states <= {'T', 't'}

    def words(self) -> Said:
        """Return what it waits for: "starved: waited 4.3 of the last 5.0 s for a processor"."""
        waited, span = f'{max(self.processor_s, self.disk_s):.1f}', f'{self.looked_s:.1f}'
        if self.waits_for == 'disk':
            return said('starved_disk', waited=waited, span=span)
        return said('starved_processor', waited=waited, span=span)

    @property
    def waits_for(self) -> str:
        """What it has waited for longest: processor or disk."""
        return 'disk' if self.disk_s > self.processor_s else 'processor'

    def measured(self) -> str:
        """Return all that was measured, for the log."""
        threads = self._look.threads.values() if self._look else ()
        return (
            f'silent for {self.silent_s:.1f} s; in {self.looked_s:.1f} s of these it waited '
            f'{self.processor_s:.1f} s for a processor, {self.disk_s:.1f} s for a disk; its '
            f'threads are {"".join(t.state for t in threads) or "not known"}'
        )


@dataclass
class StarvedInput:
    """A live node without input although its publisher sends: DDS has lost the connection.

    It was seen once in some seventy kills on a busy machine, for minutes, before ports were marked
    (see shared_memory); DDS discovers a new process. On a slow machine a restart does not help, so
    the time limit doubles each time, until the node has been well for a minute.
    """

    since_s: float | None = None
    looked_s: float = 0.0
    patience_s: float = field(default_factory=lambda: UNFED_S)
    judged_s: float = 0.0

    def look(self, now_s: float, gets: float, given: float, starting: bool = False) -> bool:
        """Tell whether it has lasted too long; rates in 1/s, looked at several times a second.

        starting: all start at the same time, and DDS and the processors are busy with that.
        """
        away, self.looked_s = now_s - self.looked_s > PAUSE_S, now_s
        if gets > 0.0 or given < 1.0 or away:
            self.since_s = None
            if gets > 0.0 and now_s - self.judged_s > HEALTHY_S:
                self.patience_s = UNFED_S
            return False
        if self.since_s is None:
            self.since_s = now_s
        if now_s - self.since_s < max(self.patience_s, UNFED_FIRST_S if starting else 0.0):
            return False
        self.since_s, self.judged_s = None, now_s
        self.patience_s = min(2 * self.patience_s, UNFED_MOST_S)
        return True


@dataclass
class Policy:
    """Back-off and hang detection of one process."""

    started_s: float = 0.0
    beat_s: float | None = None
    silence: Silence = field(default_factory=lambda: Silence(0.0))
    backoff: Backoff = field(default_factory=Backoff)
    restarts: int = 0
    start_took_s: float | None = None  # the longest that it took to its first heartbeat, so far
    unfed: bool = False  # it was ended because it got nothing: DDS is to blame

    def start(self, now_s: float) -> None:
        """The process has been started."""
        self.started_s, self.beat_s = now_s, None
        self.silence = Silence(now_s)

    def beat(self, now_s: float) -> None:
        """A heartbeat has come."""
        if self.beat_s is None:
            self.start_took_s = max(self.start_took_s or 0.0, self.silence.silent_s)
        self.beat_s = now_s
        self.silence = Silence(now_s)

    def verdict(self) -> str:
        """Tell how it is: FINE, STARVED or HUNG."""
        if self.beat_s is None:
            return self.silence.verdict(self._start_s(), START_STARVED_S)
        return self.silence.verdict(SILENT_S, STARVED_S)

    def _start_s(self) -> float:
        """Return how long its first heartbeat may take: what it compiled once it need not again."""
        if self.start_took_s is None:
            return START_S
        return min(max(START_AGAIN_S, START_AGAIN * self.start_took_s), START_S)

    def died(self, now_s: float) -> float:
        """Return how long to wait before the next start, in seconds; 0 for one that was healthy.

        Also 0 after a starved input: `StarvedInput` lengthens its own interval.
        """
        wait = 0.0
        if now_s - self.started_s > HEALTHY_S:
            self.backoff.succeeded()
        elif not self.unfed:
            wait = self.backoff.failed()
        self.unfed = False
        self.restarts += 1
        self.beat_s = None
        return wait
