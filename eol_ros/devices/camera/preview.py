# SPDX-License-Identifier: Apache-2.0
"""JPEG copies of the images, packed in a thread so that nothing waits for them."""

import contextlib
import queue
import threading
from collections.abc import Callable

import cv2
import numpy as np

from eol_ros.devices.rounds import Rounds

QUALITY = 80
SCALE = 0.5  # of the image: noise averages out, and an image takes a sixth of the bytes


class Preview:
    """Packs images at most `rate_hz` times a second, by their stamps; one that comes late is
    dropped.

    give(stamp_ns, jpeg bytes) is called from the thread.
    """

    def __init__(self, give: Callable[[int, bytes], None]):
        self._give = give
        self._next_ns = 0
        self._waiting: queue.Queue = queue.Queue(maxsize=1)
        self.rounds = Rounds()
        self._thread = threading.Thread(target=self._pack, name='preview', daemon=True)
        self._thread.start()

    def due(self, stamp_ns: int, rate_hz: float) -> bool:
        """Whether an image of this stamp is wanted; moves on to the next time if so."""
        if 0 < self._next_ns - stamp_ns < 1e9 / rate_hz:  # else the clock was set back
            return False
        self._next_ns = stamp_ns + int(0.95e9 / rate_hz)
        return True

    def take(self, stamp_ns: int, image: np.ndarray) -> None:
        """Take an image (h, w) uint8 that nobody will change."""
        if not self._waiting.full():
            self._waiting.put_nowait((stamp_ns, image))

    def close(self) -> None:
        """End the thread."""
        with contextlib.suppress(queue.Full):  # the thread has stalled or ended
            self._waiting.put(None, timeout=1.0)
        self._thread.join(timeout=2.0)

    def _pack(self) -> None:
        while True:
            with self.rounds.waiting():
                item = self._waiting.get()
            if item is None:
                return self.rounds.rest()
            stamp_ns, image = item
            width, height = (max(1, round(SCALE * n)) for n in image.shape[::-1])  # one line, too
            small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            done, jpeg = cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            if done:
                self._give(stamp_ns, jpeg.tobytes())
