# SPDX-License-Identifier: Apache-2.0
"""What the recorder does beside recording: repairs earlier bags, and removes what is too much."""

import contextlib
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from eol_ros.devices.bag.recover import NoRoom, repair_all
from eol_ros.devices.bag.retention import MARGIN_BYTES, Folder, Limits, enforce
from eol_ros.devices.rounds import Rounds
from eol_ros.errors import EolError
from eol_ros.settings import RecorderSettings

ROUND_S = 60.0
BUSY_S = 0.25  # after this it is asked again whether the recording is busy
SHARE = 0.25  # of the time a repair works at the side of a recording; then it rests
GB = 1e9


class Stopped(Exception):
    """The recorder ends: what is being done is done again at the next start."""


class Breather:
    """Called between two pieces of work: rests, so that the recording comes first.

    `busy` tells that the recording needs all there is: the rest lasts as long.
    """

    def __init__(
        self,
        stop: threading.Event,
        clock: Callable[[], float] = time.monotonic,
        busy: Callable[[], bool] = lambda: False,
    ):
        self._stop, self._clock, self._busy = stop, clock, busy
        self.begin()

    def begin(self) -> None:
        """Begin to work: what has passed before was no work."""
        self._since = self._clock()

    def __call__(self) -> None:
        """Rest in proportion to the work since the last rest; raise Stopped when told so."""
        rest_s = (self._clock() - self._since) * (1 / SHARE - 1)
        while self._stop.wait(rest_s) or self._busy():
            if self._stop.is_set():
                raise Stopped
            rest_s = BUSY_S
        self.begin()


class Housekeeper(threading.Thread):
    """Goes round in `root` once a minute, at lowest priority, from when `begin` is set to `stop`.

    `writing` returns the bag in the making, `busy` tells that it has no time to share, `say` takes
    what was done, in words.
    """

    def __init__(
        self,
        root: Path,
        settings: RecorderSettings,
        images: str,
        begin: threading.Event,
        stop: threading.Event,
        writing: Callable[[], Path | None],
        busy: Callable[[], bool],
        say: Callable[[str], object],
    ):
        super().__init__(name='bag-housekeeper', daemon=True)
        self._root, self._settings, self._say = root, settings, say
        self._begin, self._stopped, self._recording_busy = begin, stop, busy
        self.rounds = Rounds()
        self._breathe = Breather(stop, busy=self._busy)
        self._folder = Folder(root, images, writing, self._breathe)
        self._told = ''

    def run(self) -> None:
        """Go round until told to stop."""
        with contextlib.suppress(OSError, AttributeError):  # Linux only: of this thread alone
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
        while not self._begin.wait(0.1):
            if self._stopped.is_set():
                return
        with contextlib.suppress(Stopped):
            while not self._stopped.is_set():
                self._round(self._repair)
                self._round(self._retain)
                with self.rounds.waiting():
                    self._stopped.wait(ROUND_S)
            self.rounds.rest()

    def _busy(self) -> bool:
        self.rounds.done()
        return self._recording_busy()

    def _round(self, work: Callable[[], None]) -> None:
        self.rounds.done()
        self._breathe.begin()
        try:
            work()
        except (OSError, EolError) as error:
            kind = 'waits' if isinstance(error, NoRoom) else 'failed'
            if kind != self._told:  # once, not every minute
                self._say(f'care for earlier bags {kind}: {error}')
            self._told = kind

    def _repair(self) -> None:
        for done in repair_all(self._root, self._breathe, self._settings.min_free_gb):
            self._say(done.words)

    def _retain(self) -> None:
        s = self._settings
        if s.keep_days or s.keep_gb:
            limits = Limits(s.keep_days, s.keep_gb * GB, s.min_free_gb * GB + MARGIN_BYTES)
            for line in enforce(self._folder, limits, time.time()):
                self._say(line)
                self._breathe()
