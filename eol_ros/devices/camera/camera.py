# SPDX-License-Identifier: Apache-2.0
"""The camera, kept open: images handed over one by one with their stamps, whatever the cable does.

One thread reads and decodes, a second hands over. Of a live camera only the newest image is kept,
so a slow reader sees the present and not a queue of the past; of a file every image is handed over,
decoded some ahead, each at its time.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eol_ros.devices.backoff import Backoff
from eol_ros.devices.camera.sources import LiveCamera, Picture, VideoFile
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.devices.rounds import Rounds
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import clauses, said

AHEAD = 6  # images of a file decoded before their time
WATCHDOG_IMAGES = 3
BEHIND_S = 1.0  # a file that is later than this goes on from now
NS = 1_000_000_000


@dataclass(frozen=True)
class State:
    """How the camera is, and a sentence for people.

    `opening`, `streaming`, `stalled` (no image for three image times), `lost` (to be opened again),
    `wrong` (not what the scene says; to be tried again), `ended` (a file without `loop`).
    """

    kind: str
    text: str


class Camera:
    """Images of `source` from `start` to `close`.

    `deliver(stamp_ns, image)` is called from one thread with the mid-exposure stamp in nanoseconds
    of system time (ROS time) and the (height, width) uint8 image. `on_state` is called from any. A
    file that cannot be used raises DeviceMissing or ConfigError in `start`; a camera is looked for
    until it is there.
    """

    def __init__(
        self,
        source: VideoFile | LiveCamera,
        deliver: Callable[[int, np.ndarray], None],
        on_state: Callable[[State], None] = lambda state: None,
        loop: bool = True,
        backoff: Backoff | None = None,
    ):
        self.source = source
        self.state = State('opening', said('opening', name=source.name))
        self.delivered = self.dropped = self.opened = self.stalls = 0
        self.late_ms = 0.0  # of the last image of a file behind its time
        self._deliver, self._on_state = deliver, on_state
        self._loop = loop
        self._backoff = backoff or Backoff()
        self._waiting: deque[Picture] = deque()
        self._room = threading.Condition()
        self._stop = threading.Event()
        self._at_end = False
        self.reading, self.handing_over = Rounds(), Rounds()
        self._threads = [
            carrier_thread(name, run)
            for name, run in (('reader', self._read), ('hand-over', self._hand_over))
        ]

    def start(self) -> None:
        """Begin; returns as soon as a file is open, and at once with a camera."""
        if not self.source.live:
            self.source.open()
            self._opened()
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop handing over, and release the camera."""
        self._stop.set()
        with self._room:
            self._room.notify_all()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=3.0)

    def _opened(self) -> None:
        self.opened += 1
        self._streams()

    def _streams(self) -> None:
        name, fps = self.source.name, f'{self.source.fps:g}'
        self._tell('streaming', said('camera', name=name, fps=fps))

    def _tell(self, kind: str, text: str) -> None:
        self._set_state(kind, clauses([text, *self.source.notes]))

    def _set_state(self, kind: str, text: str) -> None:
        state = State(kind, text)
        if state != self.state:
            self.state = state
            self._on_state(state)

    def _read(self) -> None:
        """Reader thread: open, read until it fails, open again."""
        try:
            while not self._stop.is_set():
                try:
                    if self.source.live:
                        self.source.open()
                        self._backoff.succeeded()
                        self._opened()
                    if self._read_all():
                        return
                except (DeviceMissing, ConfigError, OSError) as error:
                    self.source.close()
                    if self._stop.is_set():
                        return
                    pause_s = self._backoff.failed()
                    kind = 'wrong' if isinstance(error, ConfigError) else 'lost'
                    self._set_state(
                        kind, clauses([str(error), said('again', seconds=f'{pause_s:.0f}')])
                    )
                    with self.reading.waiting():
                        self._stop.wait(pause_s)
        finally:
            self.reading.rest()
            self.source.close()

    def _read_all(self) -> bool:
        """Read until the camera fails (raises), or the file ends, or `close` is called (True)."""
        while not self._stop.is_set():
            picture = self.source.read()
            self.reading.done()
            if picture is not None:
                self._offer(picture)
                continue
            if not self._loop:
                self._at_end = True  # the last images are still on their way
                return True
            notes = list(self.source.notes)
            self.source.open()
            self.source.notes = notes
            if notes:
                self._streams()
        return True

    def _offer(self, picture: Picture) -> None:
        with self._room:
            if self.source.live:
                self.dropped += len(self._waiting)
                self._waiting.clear()
            while len(self._waiting) >= AHEAD and not self._stop.is_set():
                self._room.wait(0.5)
                self.reading.done()
            self._waiting.append(picture)
            self._room.notify_all()

    def _take(self, timeout_s: float) -> Picture | None:
        with self._room:
            if not self._waiting and not self._stop.is_set():
                self._room.wait(timeout_s)
            if not self._waiting or self._stop.is_set():
                return None
            picture = self._waiting.popleft()
            self._room.notify_all()
            return picture

    def _hand_over(self) -> None:
        """Hand-over thread: the watchdog, the pace of a file, the call to `deliver`."""
        pace = Pace(self.source.fps or 60.0)
        while not self._stop.is_set():
            period_s = 1 / (self.source.fps or 60.0)
            patience_s = WATCHDOG_IMAGES * period_s
            with self.handing_over.waiting():
                picture = self._take(patience_s if self.source.live else max(patience_s, 0.5))
            if picture is None and self._at_end and not self._waiting:
                self._tell('ended', said('ended', name=self.source.name))
                return self.handing_over.rest()
            if picture is None:
                self._miss()
                continue
            if picture.monotonic_ns is None:
                stamp_ns, go_ns = pace.next(time.monotonic_ns(), time.time_ns())
                with self.handing_over.waiting():
                    self._stop.wait(max(0, go_ns - time.monotonic_ns()) / NS)
                if self._stop.is_set():
                    break
                self.late_ms = max(0.0, (time.time_ns() - stamp_ns) / 1e6)
            else:
                stamp_ns = time.time_ns() - time.monotonic_ns() + picture.monotonic_ns
            if self.state.kind == 'stalled':
                self._streams()
            self._deliver(stamp_ns, picture.image)
            self.delivered += 1
        self.handing_over.rest()

    def _miss(self) -> None:
        if self.state.kind == 'streaming' and self.delivered:
            self.stalls += 1
            images = (
                said('image_times', count=WATCHDOG_IMAGES)
                if self.source.live
                else said('half_second')
            )
            self._set_state('stalled', said('no_image_from', name=self.source.name, span=images))


class Pace:
    """When the images of a file at `fps` are due: exactly a period apart.

    One that is late is handed over at once, but the rest not in a burst: readers hold only so many,
    so what was missed is caught up with at twice the rate. Later than a second, it goes on from
    now.
    """

    def __init__(self, fps: float):
        self._fps = fps
        self._count = self._began_ns = self._epoch_ns = self._went_ns = 0

    def next(self, now_ns: int, system_ns: int) -> tuple[int, int]:
        """Return the next image's stamp (system time) and when it may go (time of `now_ns`)."""
        due_ns = self._began_ns + round(self._count * NS / self._fps)
        if not self._count or now_ns - due_ns > BEHIND_S * NS:
            self._count, self._began_ns, due_ns = 0, now_ns, now_ns
            self._epoch_ns = system_ns - now_ns
        self._count += 1
        self._went_ns = max(due_ns, now_ns, self._went_ns + round(0.5 * NS / self._fps))
        return self._epoch_ns + due_ns, self._went_ns
