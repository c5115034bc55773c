# SPDX-License-Identifier: Apache-2.0
"""A run on its way to the disk: bounded queue in, one writing thread, a bag folder out.

The caller of `take` never waits, and the writing thread does not wait for a sync. When disk or
processor are too slow the queue fills. Images are then stored uncompressed, and later dropped and
counted; all other messages are kept. When the disk is full or gone, recording pauses, reports it,
and begins a new bag when it can.
What is deleted, if anything, `retention` says.
"""

import atexit
import contextlib
import errno
import itertools
import json
import math
import re
import shutil
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from eol_ros.devices.bag.backlog import Backlog, Waiting
from eol_ros.devices.bag.housekeeping import Housekeeper
from eol_ros.devices.bag.mcap_file import BagMessage, BagTopic
from eol_ros.devices.bag.selection import Dropped, Losses, Selection, Slipping
from eol_ros.devices.bag.writer import BagExists, BagWriter
from eol_ros.devices.rounds import Rounds
from eol_ros.disk import DISK, Disk, read
from eol_ros.errors import ConfigError, EolError
from eol_ros.said import said
from eol_ros.settings import RecorderSettings

FLUSH_S = 1.0
RETRY_S = 3.0
ROOM = 1.1  # of `min_free_gb`, before it goes on: else each image that goes makes a bag of its own
BUDGET = '.pictures-of-today.json'  # beside the bags
QUEUE_BYTES = 64 << 20  # above this, images are dropped
MOST_BYTES = 256 << 20  # above this, all are dropped: half an hour of a rehearsal, measured
SLOW = said('too_slow')
STUCK = 'the disk does not answer'
CALM_BYTES = 4 << 20  # with more than this waiting, earlier bags are not cared for
HURRY_BYTES = QUEUE_BYTES // 4  # with more than this waiting, images are not compressed
GB = 1e9


class ImageBudget:
    """Counts the bytes of raw images that are kept in a day, over the runs of that day."""

    def __init__(self, root: Path, most_gb: float, today: Callable[[], str]):
        self.bytes, self.spent = 0, False
        self._file, self._most_gb, self._today = root / BUDGET, most_gb, today
        self._day = today()
        self.bytes = read(self._file, self._of_today) or 0
        self._told = self._day, self.bytes

    def take(self, size: int) -> bool:
        """Return whether there is room for an image, and count it."""
        self.spent = self.bytes + size > self._most_gb * GB
        self.bytes += 0 if self.spent else size
        return not self.spent

    def keep(self) -> None:
        """Start over with a new day, and note what was kept, for a run after this one."""
        day = self._today()
        if day != self._day:
            self._day, self.bytes, self.spent = day, 0, False
        if self._told != (day, self.bytes):
            self._told = day, self.bytes
            with contextlib.suppress(OSError):
                DISK.write(self._file, json.dumps({'day': day, 'bytes': self.bytes}))

    def _of_today(self, content: bytes) -> int:
        kept = json.loads(content)
        return int(kept['bytes']) if kept['day'] == self._day else 0


class Sync(threading.Thread):
    """Has the disk keep what is in a file so far, in a thread of its own: it may take seconds."""

    def __init__(self, writer: BagWriter, file: BinaryIO, disk: Disk, done: Callable[[], None]):
        super().__init__(name='bag-writer-sync', daemon=True)
        self.writer, self.ended = writer, False
        self.error: OSError | None = None
        self._file, self._disk, self._done = file, disk, done

    def run(self) -> None:
        """Do it; `done` is called when `ended` and `error` are known."""
        try:
            with self._file:
                self._disk.sync(self._file)
        except OSError as error:
            self.error = error
        self.ended = True
        self._done()


@dataclass(frozen=True)
class Roles:
    """Topics that are treated in a way of their own.

    `images` and `infos`: the raw images and what describes their camera. `rhythm`: those whose
    stamps come regularly, `rate_hz` times a second. `thinned`: those made for the eye, of which one
    per `display_period_s` is enough. `requests`: those whose ids their answers carry.
    """

    images: str = ''
    infos: str = ''
    requests: str = ''
    rhythm: Sequence[str] = ()
    thinned: Sequence[str] = ()
    rate_hz: float = 0.0


@dataclass(frozen=True)
class Machine:
    """Clock, disk, thread and date of a recording, which tests replace.

    With `threaded` off nothing is written but by `pump` and `close`.
    """

    clock: Callable[[], float] = time.monotonic
    disk: Disk = DISK
    threaded: bool = True
    today: Callable[[], str] = lambda: time.strftime('%Y-%m-%d')


class Recording:
    """Records messages of `topics` into a new folder under `root`.

    Raises ConfigError when `root` cannot be written.
    """

    def __init__(
        self,
        root: Path,
        name: str,
        topics: Sequence[BagTopic],
        about: Mapping[str, str],
        settings: RecorderSettings,
        roles: Roles | None = None,
        machine: Machine | None = None,
    ):
        roles, machine = roles or Roles(), machine or Machine()
        images = roles.images
        self.root = root
        self.rounds = Rounds()  # of the writing thread; a round ends when its bytes are written
        self.folder: Path | None = None
        self.trouble = ''  # why nothing is recorded now; empty while all is well
        self.drop_cause = ''  # of the newest messages that were dropped
        self.time_jump_s = 0.0  # by which the system clock was set where this bag ends
        self.sync_s = 0.0  # how long the disk took when it was last told to keep what it has
        self.repaired: list[str] = []
        self.budget = ImageBudget(root, settings.images_max_gb, machine.today)
        self._name = re.sub(r'[^\w+-]+', '-', name) or 'run'
        self._topics, self._about, self._settings = tuple(topics), dict(about), settings
        self._images = images
        self._selection = Selection(
            settings, {images, roles.infos} - {''}, roles.thinned, self.budget.take
        )
        self._losses = Losses(images, roles.rhythm, roles.rate_hz, roles.requests)
        self._queue = Backlog(QUEUE_BYTES, images, MOST_BYTES)
        self._written = 0  # messages of bags already closed
        self._ready = threading.Condition()
        self._closing = False
        self._stop, self._kept = threading.Event(), threading.Event()
        self._writer: BagWriter | None = None
        self._syncing: Sync | None = None
        self._clock, self._disk, self._threaded = machine.clock, machine.disk, machine.threaded
        self._next_flush = self._next_try = self._synced_s = self._clock()
        self._unsaved_s: float | None = None  # since when the oldest message is not on the disk
        self._open()
        if not self._threaded:
            return
        self._thread = threading.Thread(target=self._run, name='bag-writer', daemon=True)
        atexit.register(self.close)  # a caller that forgets to close still gets a complete bag
        self._thread.start()
        self._housekeeper = Housekeeper(
            root, settings, images, self._kept, self._stop,
            lambda: self.folder, lambda: self._queue.bytes > CALM_BYTES, self.repaired.append,
        )  # fmt: skip
        self._housekeeper.start()

    def take(self, item: BagMessage) -> None:
        """Hand over a message; never waits."""
        with self._ready:
            if self._closing:
                self._losses.unwritten[item.topic] += 1
                return
            before = self._queue.dropped.total()
            self._queue.put(self._clock(), item)
            if self._queue.dropped.total() > before:
                stuck = self._queue.dropped.keys() - {self._images}
                self.drop_cause = self.trouble or (STUCK if stuck else SLOW)
            self._ready.notify()

    def slip(self, news: Slipping) -> None:
        """Tell that a slip has started or stopped: images around it are kept."""
        with self._ready:
            self._queue.put(self._clock(), news)
            self._ready.notify()

    def request(self, id_: str, is_request: bool) -> None:
        """Note a request, or an answer to one: an answer without its request counts as a loss."""
        self._losses.requests.take(id_, is_request)

    def go_on(self, before: 'Recording') -> None:
        """Do not count requests as lost that came while `before` was written."""
        self._losses.requests.go_on(before._losses.requests)

    def close(self) -> None:
        """Write what is queued, finish the file, end the thread; a second call does nothing."""
        atexit.unregister(self.close)
        with self._ready:
            first, self._closing = not self._closing, True
            self._ready.notify()
        self._stop.set()
        if self._threaded:
            self._thread.join()
            self._housekeeper.join()
        elif first:
            self.pump()
            self._finish()

    def pump(self) -> None:
        """Write all that is queued, and do what is due; the writing thread does it for ever."""
        while entry := self._queue.pop():
            self._step(entry)
        self._step()

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        writer = self._writer
        return self._written + (writer.message_count if writer else 0)

    @property
    def lost(self) -> int:
        """Messages that were sent and are not in the bag though they should be."""
        return self._losses.lost.total() + self.dropped.total()

    @property
    def dropped(self) -> Counter[str]:
        """Messages that came and were not written, per topic."""
        return self._queue.dropped + self._losses.unwritten

    @property
    def received(self) -> Counter[str]:
        """Messages that came out of the queue so far, per topic."""
        return self._losses.gaps.received

    @property
    def queued_mb(self) -> float:
        """What waits to be written now."""
        return round(self._queue.bytes / 1e6, 1)

    def housekeeping(self) -> int | None:
        """Return the completed rounds of the care for earlier bags; None: no work is due."""
        return self._housekeeper.rounds() if self._threaded else None

    def gaps(self) -> dict[str, str]:
        """Return what was lost, per topic, as it goes into the metadata of the bag."""
        return self._losses.said(self.dropped, self.time_jump_s)

    def _run(self) -> None:
        try:
            self._write_all()
        finally:
            with self._ready:  # empty except after a fault
                while entry := self._queue.pop():
                    self._lose(entry)
            self._finish()
            self.rounds.rest()

    def _write_all(self) -> None:
        while True:
            with self._ready:
                if not self._queue and not self._closing:
                    due_s = min(self._next_flush, self._sync_due())
                    self._ready.wait(max(0.0, due_s - self._clock()))
                entry = self._queue.pop()
                if entry is None and self._closing:
                    return
            try:
                self._step(entry)
            except BaseException:
                self._lose(entry)
                raise
            self.rounds.done()

    def _lose(self, entry: Waiting | None) -> None:
        if entry and isinstance(entry.item, BagMessage):
            self._losses.unwritten[entry.item.topic] += 1

    def _step(self, entry: Waiting | None = None) -> None:
        """Write what has waited, and do what is due."""
        if entry is not None:
            self._write(entry.item)
            if self._unsaved_s is None:
                self._unsaved_s = entry.came_s
            with self._ready:
                self._queue.done(entry)
        now = self._clock()
        if now >= self._sync_due():
            self._sync()
        if now < self._next_flush:
            return
        self._next_flush = now + FLUSH_S
        self._kept.set()
        self.budget.keep()
        if self._writer:
            self._guarded('flush')
            self._check_space()
            self._next_try = now + RETRY_S
        elif now >= self._next_try:
            self._next_try = now + RETRY_S
            self._reopen()

    def _sync_due(self) -> float:
        """Return when to begin a sync, so that nothing is older than `sync_s` when it ends.

        A disk that is slower than that is not asked all the time.
        """
        if self._syncing is not None:
            return 0.0 if self._syncing.ended else math.inf
        every_s = self._settings.sync_s
        if not every_s or self._unsaved_s is None:
            return math.inf
        return max(self._unsaved_s + every_s - self.sync_s, self._synced_s + every_s / 4)

    def _sync(self) -> None:
        """Begin to sync what is written, or end what has been begun."""
        if self._syncing is not None:
            self._end_sync()
            return
        begun_s, self._unsaved_s = self._clock(), None

        def done() -> None:
            with self._ready:
                self._synced_s = self._clock()
                self.sync_s = self._synced_s - begun_s
                self._ready.notify()

        if not self._threaded:
            self._guarded('sync')
            done()
        elif (writer := self._writer) and (handle := self._guarded('second_handle')):
            self._syncing = Sync(writer, handle, self._disk, done)
            self._syncing.start()

    def _end_sync(self) -> None:
        """Wait for a running sync to end; if the disk refuses, continue without its bag."""
        sync, self._syncing = self._syncing, None
        if sync:
            sync.join()
            if sync.error and sync.writer is self._writer:
                self._pause(self._refused(sync.error), whole=False)

    def _write(self, item: BagMessage | Slipping | Dropped) -> None:
        if not isinstance(item, Slipping):
            self._losses.count(item)
        for kept in () if isinstance(item, Dropped) else self._selection.take(item):
            self._guarded('write', *kept, self._queue.bytes > HURRY_BYTES)
            if not self._writer:  # or not any more
                self._losses.unwritten[kept.topic] += 1
                self.drop_cause = self.trouble

    def _guarded(self, action: str, *args) -> Any:
        """Let the writer do it; on a refusing disk leave the file as it is and go on without."""
        try:
            return getattr(self._writer, action)(*args) if self._writer else None
        except OSError as error:
            self._pause(self._refused(error), whole=False)
            return None

    def _refused(self, error: OSError) -> str:
        """Return in words what the disk says; a full one is called full."""
        words = error.strerror or str(error)
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return said('disk_full', root=self.root, words=words)
        return f'{self.folder}: {words}'

    def _check_space(self) -> None:
        try:
            free = shutil.disk_usage(self.root).free / GB
        except OSError as error:
            self._pause(f'{self.root}: {error.strerror}', whole=False)
            return
        if free < self._settings.min_free_gb:
            self._pause(self._full(free), whole=True)

    def _full(self, free_gb: float) -> str:
        least = self._settings.min_free_gb
        return said(
            'disk_low',
            free=f'{free_gb:.2f}',
            root=self.root,
            least=f'{least:g}',
            above=f'{ROOM * least:g}',
        )

    def _pause(self, trouble: str, whole: bool) -> None:
        writer, self._writer = self._writer, None
        if writer is None:
            return
        self._written += writer.message_count
        writer.gaps = self.gaps()
        try:
            writer.close() if whole else writer.abandon()
        except OSError:
            writer.abandon()
        self.trouble = trouble

    def _open(self) -> None:
        with contextlib.suppress(OSError):  # making the bag's own folder below says why not
            self.root.mkdir(parents=True, exist_ok=True)
        if self.root.is_dir():
            free = shutil.disk_usage(self.root).free / GB
            if free < self._settings.min_free_gb * (ROOM if self.trouble else 1.0):
                self.trouble = self._full(free)
                return
        try:
            self._writer = self._new_bag()
        except ConfigError as error:
            raise ConfigError(
                f'{error}. Choose another with --bag DIR or recorder.folder, or say recorder: off'
            ) from None
        self.folder, self.trouble = self._writer.folder, ''

    def _new_bag(self) -> BagWriter:
        """Return the writer of a bag whose name no other has: recorders may share a folder."""
        name = stem = f'{self._name}_{time.strftime("%Y-%m-%d_%H-%M-%S")}'
        numbers = itertools.count(2)
        while True:
            try:
                return BagWriter(
                    self.root / name,
                    self._topics,
                    self._about,
                    self._settings.split_minutes * 60,
                    round(self._settings.split_gb * GB),
                    self._disk,
                )
            except BagExists:
                name = f'{stem}_{next(numbers)}'

    def _reopen(self) -> None:
        try:
            self._open()
        except OSError as error:
            self.trouble = self._refused(error)
        except EolError as error:
            self.trouble = str(error)

    def _finish(self) -> None:
        self._end_sync()
        self.budget.keep()
        if self._writer:
            self._writer.gaps = self.gaps()
            self._guarded('close')
