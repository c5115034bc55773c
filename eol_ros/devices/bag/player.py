# SPDX-License-Identifier: Apache-2.0
"""Plays a bag against a clock: rate, start, loop, pause. Bytes and stamps stay as recorded.

Messages are played in the order in which they were received. Images and blocks (stamped with the
time of exposure) and taps (stamped with the time of the tap) are played when recorded time reaches
their stamp. Messages between them keep their distance in time from an image. So a replay does not
repeat the delays of the recorded run, which a low rate would make several times as long.
"""

import threading
import time
from collections.abc import Callable, Collection
from typing import NamedTuple

from eol_ros.devices.bag.reader import BagMessage, BagReader
from eol_ros.errors import ConfigError
from eol_ros.settings import ReplaySettings
from eol_ros.streams.cdr import stamp_ns

LATE_S = 0.02  # further behind than this, recorded time waits instead of hurrying on
NAP_S = 0.1  # longest wait before stop and pause are looked at again
LEAD_NS = 1_000_000  # recorded time begins so long before the first message
TAIL_NS = 300_000_000  # and ends so long after the last: what fades goes on to fade
STAND_S = 0.5  # before a new round, for all that follow recorded time to have noticed
LATEST_NS = 10_000_000_000  # a message on its way for longer was kept for who comes late
BACK_NS = 1_000_000_000  # stamps that fall back by more belong to a new round, too


def complete(bag: BagReader, images: str = 'camera/image_raw', blocks: str = 'blocks') -> bool:
    """Return whether a bag has all the images of its run, and not those of some moments."""
    count = bag.count(images)
    return count > 0 and count >= 0.99 * bag.count(blocks)


def choose(bag: BagReader, asked: Collection[str], usual: Collection[str]) -> list[str]:
    """Return the full names of the topics `asked`, or those of the `usual` that the bag has.

    Raises ConfigError when there is none.
    """
    if asked:
        return [bag.find(name) for name in asked]
    found = [name for name in usual if bag.counts.get(name)]
    if found:
        return found
    raise ConfigError(
        f'{bag.path}: neither {" nor ".join(usual)} in it; say which topics to play, there '
        f'are {", ".join(t for t, n in bag.counts.items() if n) or "none"}'
    )


class Pace(NamedTuple):
    """Recorded time is `origin_ns` at `origin_s` of the clock and runs at `rate` to `limit_ns`."""

    origin_s: float
    origin_ns: int
    rate: float
    limit_ns: int


class Played(NamedTuple):
    """The topics that are played.

    `stamped` are played by their stamps and give the delay of the run, `taps` by their stamps if
    the order allows it.
    """

    names: Collection[str]
    stamped: Collection[str] = ()
    taps: Collection[str] = ()


class BagPlayer:
    """Hands each message of `topics` to `give` when its time has come.

    `begin` is called before each round, when all nodes have seen recorded time
    go back.
    Clock and sleep are arguments so that tests need not wait.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Played,
        give: Callable[[BagMessage], None],
        settings: ReplaySettings,
        begin: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        start_s = settings.start_s
        self.played = 0
        self.position_s = start_s  # recorded time of the newest message, from the start of the bag
        self.rounds = 0
        self.late_s = 0.0  # how far the newest message came after its time
        self._bag, self._topics, self._give = bag, frozenset(topics.names), give
        self._stamped = frozenset(topics.stamped) & self._topics
        self._taps = frozenset(topics.taps)
        self.rate = settings.rate  # may be changed while it plays
        self._fast, self._loop, self._begin = settings.fast, settings.loop, begin
        self._first_ns = bag.start_ns + round(start_s * 1e9)  # of the recorder's clock
        self.first_ns = self._first_ns  # of the round that plays
        self.over = False
        self._clock, self._sleep = clock, sleep
        self._stop = threading.Event()
        self._paused = threading.Event()
        self._lock = threading.Lock()
        self._delay_ns = 0  # from the stamp of the last stamped message to its recording
        self._start = self._start_at(self._first_ns)
        self._sought_ns: int | None = None  # recorded time at which to go on
        start_ns = self._start[0] + LEAD_NS
        self._pace = Pace(clock(), start_ns - LEAD_NS, 0.0, start_ns)
        self._shown_ns = 0

    def _start_at(self, first_ns: int) -> tuple[int, int]:
        """Return recorded time and delay with which a round begins, from `first_ns` of the bag."""
        delay_ns = self._delay_ns
        first = next(iter(self._bag.messages(self._stamped or self._topics, first_ns)), None)
        if first is not None and self._stamped and (stamp := stamp_ns(first.data)):
            delay_ns = _sent_ns(first) - stamp
        return (_sent_ns(first) if first else first_ns) - delay_ns - LEAD_NS, delay_ns

    @property
    def paused(self) -> bool:
        """Whether the replay stands still."""
        return self._paused.is_set()

    def pause(self, on: bool | None = None) -> None:
        """Stand still or go on; None: whichever it does not do now."""
        if self.paused if on is None else not on:
            self._paused.clear()
        else:
            self._paused.set()

    def seek(self, at_ns: int) -> bool:
        """Go on at recorded time `at_ns`, as the stamps have it; return whether it is in the bag.

        A time before the bag is its beginning. `begin` is called as before a round.
        """
        if self.over or at_ns > self._bag.end_ns - self._start[1]:
            return False
        self._sought_ns = max(at_ns, self._bag.start_ns - self._start[1])
        return True

    def stop(self) -> None:
        """End `run` within NAP_S."""
        self._stop.set()

    def now_ns(self) -> int:
        """Return recorded time, as the stamps have it; it goes back only when a round begins."""
        with self._lock:
            self._shown_ns = max(self._shown_ns, self._ideal_ns(self._clock()))
            return self._shown_ns

    def run(self) -> None:
        """Play until the end, or for ever with `loop`, or until `stop`."""
        first_ns, start, stand_s = self._first_ns, self._start, 0.0
        while not self._stop.is_set():
            before = self.played
            self._round(first_ns, start, stand_s)
            first_ns, start, stand_s = self._first_ns, self._start, STAND_S
            if self._sought_ns is not None:
                first_ns, self._sought_ns = self._sought_ns + self._start[1], None
                start = self._start_at(first_ns)
                self.first_ns = first_ns
                continue
            self.first_ns = first_ns
            self.rounds += 1
            if not self._loop or self.played == before:
                break
        self.over = True

    def _round(self, first_ns: int, start: tuple[int, int], stand_s: float) -> None:
        begin_ns, self._delay_ns = start
        self._stand(begin_ns, stand_s)
        due_ns = begin_ns
        for message in self._bag.messages(self._topics, first_ns):
            if message.topic in self._stamped and (stamp := stamp_ns(message.data)):
                self._delay_ns = _sent_ns(message) - stamp
            wish_ns = _sent_ns(message) - self._delay_ns
            if message.topic in self._taps:
                wish_ns = max(min(wish_ns, stamp_ns(message.data)), due_ns)
            if wish_ns < due_ns - BACK_NS:
                self._stand(wish_ns - LEAD_NS, STAND_S)
                due_ns = wish_ns
            due_ns = max(due_ns, wish_ns)
            self._wait(due_ns)
            if self._ends:
                return
            self._give(message)
            self.played += 1
            self.position_s = (message.log_ns - self._bag.start_ns) * 1e-9
            slack_ns = round(LATE_S * self.rate * 1e9)
            self._pace = self._pace._replace(limit_ns=due_ns + slack_ns)  # while the next is read
        if not self._fast and due_ns > begin_ns:
            self._wait(max(due_ns, self._bag.end_ns - self._delay_ns) + TAIL_NS)

    @property
    def _ends(self) -> bool:
        """Whether the round ends before its time."""
        return self._stop.is_set() or self._sought_ns is not None

    def _ideal_ns(self, now_s: float) -> int:
        pace = self._pace
        return min(pace.limit_ns, pace.origin_ns + round((now_s - pace.origin_s) * pace.rate * 1e9))

    def _stand(self, at_ns: int, seconds: float) -> None:
        """Let recorded time stand at `at_ns`, tell `begin`, and then let it run."""
        with self._lock:
            self._pace, self._shown_ns = Pace(self._clock(), at_ns, 0.0, at_ns), at_ns
        self._sleep_for(seconds / 2)  # who follows recorded time has noticed, and begun again
        self._begin()
        self._sleep_for(seconds / 2)
        self._pace = Pace(self._clock(), at_ns, self.rate, at_ns)

    def _sleep_for(self, seconds: float) -> None:
        end_s = self._clock() + seconds
        while not self._ends and (left_s := end_s - self._clock()) > 0:
            self._sleep(min(left_s, NAP_S))

    def _wait(self, due_ns: int) -> None:
        """Wait until recorded time is `due_ns`; where that is long past, it goes on from there."""
        if self._fast:
            self._pace = Pace(self._clock(), due_ns, 0.0, due_ns)
            return
        self._pace = self._pace._replace(limit_ns=due_ns)
        while not self._ends:
            pace, now_s = self._pace, self._clock()
            at_ns = pace.origin_ns + round((now_s - pace.origin_s) * pace.rate * 1e9)
            if self.paused:
                self._pace = Pace(now_s, min(at_ns, due_ns), 0.0, due_ns)
                self._sleep(NAP_S)
                continue
            if pace.rate != self.rate:  # it stood still, or is to go at another pace
                self._pace = Pace(now_s, at_ns, self.rate, due_ns)
                continue
            left_s = (due_ns - at_ns) * 1e-9 / self.rate
            if left_s <= 0:
                self.late_s = -left_s
                if self.late_s > LATE_S:
                    self._pace = Pace(now_s, due_ns, self.rate, due_ns)
                return
            self._sleep(min(left_s, NAP_S))


def _sent_ns(message: BagMessage) -> int:
    """Return when it was sent; not all who write bags know, or by the same clock."""
    known = 0 <= message.log_ns - message.publish_ns < LATEST_NS
    return message.publish_ns if known else message.log_ns
