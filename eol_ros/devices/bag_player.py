# SPDX-License-Identifier: Apache-2.0
"""Plays a bag against a clock: rate, start, loop, pause. Bytes and stamps stay as recorded."""

import threading
import time
from collections.abc import Callable, Collection

from eol_ros.devices.bag_reader import BagMessage, BagReader
from eol_ros.errors import ConfigError

LATE_S = 0.5  # further behind than this, the clock is set anew instead of hurrying after it
NAP_S = 0.1  # longest wait before stop and pause are looked at again


def choose(bag: BagReader, asked: Collection[str], favourites: Collection[str]) -> list[str]:
    """Return the full names of the topics `asked`, or of the first favourite that the bag has.

    Raises ConfigError when there is none.
    """
    if asked:
        return [bag.find(name) for name in asked]
    for name in favourites:
        if bag.counts.get(name):
            return [name]
    raise ConfigError(
        f'{bag.path}: neither {" nor ".join(favourites)} in it; say which topics to play, there '
        f'are {", ".join(t for t, n in bag.counts.items() if n) or "none"}'
    )


class BagPlayer:
    """Hands each message of `topics` to `give` when its time has come.

    rate: recorded seconds per second of the clock; `fast` hands over as fast as `give` takes.
    `start_s` counts from the first message of the bag. Clock and sleep are arguments so that tests
    need not wait.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Collection[str],
        give: Callable[[BagMessage], None],
        rate: float = 1.0,
        fast: bool = False,
        loop: bool = False,
        start_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.played = 0
        self.position_s = start_s  # recorded time of the newest message, from the start of the bag
        self.rounds = 0
        self.late_s = 0.0  # how far the newest message came after its time
        self._bag, self._topics, self._give = bag, frozenset(topics), give
        self._rate, self._fast, self._loop, self._start_s = rate, fast, loop, start_s
        self._clock, self._sleep = clock, sleep
        self._stop = threading.Event()
        self._paused = threading.Event()

    @property
    def paused(self) -> bool:
        """Whether the replay stands still."""
        return self._paused.is_set()

    def pause(self) -> None:
        """Stand still, or go on."""
        if self.paused:
            self._paused.clear()
        else:
            self._paused.set()

    def stop(self) -> None:
        """End `run` within NAP_S."""
        self._stop.set()

    def run(self) -> None:
        """Play until the end, or for ever with `loop`, or until `stop`."""
        while not self._stop.is_set():
            before = self.played
            self._round()
            self.rounds += 1
            if not self._loop or self.played == before:
                return

    def _round(self) -> None:
        bag_start = self._bag.start_ns
        origin: float | None = None  # the clock's time of the start of the bag
        first_ns = bag_start + round(self._start_s * 1e9)
        for message in self._bag.messages(self._topics, first_ns):
            at_s = (message.log_ns - bag_start) * 1e-9
            if origin is None:  # the first message plays at once
                origin = self._clock() - at_s / self._rate
            origin = self._wait(origin, at_s)
            if self._stop.is_set():
                return
            self._give(message)
            self.played += 1
            self.position_s = at_s

    def _wait(self, origin: float, at_s: float) -> float:
        """Wait until `at_s` is due; return the origin, moved by pauses and by being far behind."""
        while not self._stop.is_set():
            due = origin + at_s / self._rate
            now = self._clock()
            if self.paused:
                self._sleep(NAP_S)
                origin += self._clock() - now
            elif self._fast or now >= due:
                self.late_s = 0.0 if self._fast else now - due
                return origin + self.late_s if self.late_s > LATE_S else origin
            else:
                self._sleep(min(due - now, NAP_S))
        return origin
