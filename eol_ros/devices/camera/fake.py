# SPDX-License-Identifier: Apache-2.0
"""A camera made of software, with the methods of cv2.VideoCapture and a script of what goes wrong.

`FakeDriver` is the hardware, which outlives the captures opened on it; each image carries its own
number in its first eight pixels, so that a reader can tell which ones it got.
"""

import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Mishap(NamedTuple):
    """At image number `at`: `stall` for `amount` s, `repeat` the buffer, `unplug` for `amount` s,
    `jump` of the driver's clock by `amount` s, `break` the JPEG data."""

    at: int
    what: str
    amount: float = 0.0


def number_of(image: np.ndarray) -> int:
    """Return the number written into the first eight pixels of a fake image."""
    return int(sum((int(v) > 127) << k for k, v in enumerate(image[0, : 16 * 8 : 8])))


class FakeDriver:
    """A V4L2 camera of `width` x `height` at `fps` that knows `formats` and goes by `script`."""

    def __init__(
        self,
        width: int = 320,
        height: int = 200,
        fps: float = 200.0,
        formats: Sequence[str] = ('GREY', 'MJPG'),
        exposure_steps: int = 1,
        manual_exposure: bool = True,
        script: Sequence[Mishap] = (),
    ):
        self.width, self.height, self.fps = width, height, fps
        self.formats, self.exposure_steps = tuple(formats), exposure_steps
        self.manual_exposure = manual_exposure
        self.script = {m.at: m for m in script}
        self.number = -1
        self.clock_shift_s = 0.0
        self.gone_until_s = 0.0
        self.opened = 0
        self.set_order: list[int] = []
        self.released = threading.Event()

    def open(self, path: str) -> 'FakeCapture':
        """Return a capture, as cv2.VideoCapture(path) does."""
        self.opened += 1
        return FakeCapture(self)


class FakeCapture:
    """One opening of a FakeDriver."""

    def __init__(self, driver: FakeDriver):
        import cv2

        self._cv2, self._driver = cv2, driver
        self._present = time.monotonic() >= driver.gone_until_s
        self._values = {
            cv2.CAP_PROP_FOURCC: float(cv2.VideoWriter.fourcc(*driver.formats[0])),
            cv2.CAP_PROP_FRAME_WIDTH: float(driver.width),
            cv2.CAP_PROP_FRAME_HEIGHT: float(driver.height),
            cv2.CAP_PROP_FPS: driver.fps,
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_EXPOSURE: 100.0,
        }
        self._due_s = time.monotonic()
        self._stamp_ms = 0.0

    def isOpened(self) -> bool:  # noqa: N802, the name is OpenCV's
        """Return whether the camera is there."""
        return self._present

    def set(self, key: int, value: float) -> bool:
        """Set a property as far as the driver lets."""
        cv2, driver = self._cv2, self._driver
        driver.set_order.append(key)
        if key == cv2.CAP_PROP_FOURCC:
            name = int(value).to_bytes(4, 'little').decode()
            if name not in driver.formats:
                return False
            self._values[cv2.CAP_PROP_EXPOSURE] = 100.0  # a new format forgets the exposure
            self._values[cv2.CAP_PROP_AUTO_EXPOSURE] = 3.0
        elif key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS):
            return False  # it has one mode
        elif key == cv2.CAP_PROP_EXPOSURE:
            value = max(1, value // driver.exposure_steps) * driver.exposure_steps
        exposes = key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE)
        if exposes and not driver.manual_exposure:
            return False
        self._values[key] = float(value)
        return True

    def get(self, key: int) -> float:
        """Return a property."""
        if key == self._cv2.CAP_PROP_POS_MSEC:
            return self._stamp_ms
        return self._values.get(key, 0.0)

    def grab(self) -> bool:
        """Wait for the next image; False when the camera is gone."""
        driver = self._driver
        driver.number += 1
        mishap = driver.script.get(driver.number)
        self._broken = bool(mishap and mishap.what == 'break')
        if mishap and mishap.what == 'unplug':
            driver.gone_until_s = time.monotonic() + mishap.amount
        if time.monotonic() < driver.gone_until_s:
            return False
        if mishap and mishap.what == 'repeat':
            return True
        if mishap and mishap.what == 'stall':
            time.sleep(mishap.amount)
        if mishap and mishap.what == 'jump':
            driver.clock_shift_s += mishap.amount
        self._due_s = max(self._due_s + 1 / driver.fps, time.monotonic() - 2 / driver.fps)
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._stamp_ms = (time.monotonic() - 0.0005 + driver.clock_shift_s) * 1e3
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        """Return the image grabbed last, raw as with CAP_PROP_CONVERT_RGB off."""
        cv2, driver = self._cv2, self._driver
        image = np.full((driver.height, driver.width), 20, np.uint8)
        for k in range(16):
            image[:8, 8 * k : 8 * k + 8] = 255 * (driver.number >> k & 1)
        fourcc = int(self._values[cv2.CAP_PROP_FOURCC]).to_bytes(4, 'little')
        if fourcc == b'MJPG':
            _, data = cv2.imencode('.jpg', image)
            data = data.reshape(1, -1)
            return True, np.zeros_like(data) if self._broken else data
        if fourcc == b'YUYV':
            return True, np.stack([image, np.full_like(image, 128)], axis=2)
        return True, image

    def release(self) -> None:
        """Close it."""
        self._driver.released.set()
