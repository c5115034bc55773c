# SPDX-License-Identifier: Apache-2.0
"""A camera made of software, with the methods of cv2.VideoCapture and a script of faults."""

import threading
import time
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from eol_ros.devices.camera.sources import LiveCamera
from eol_ros.settings import CameraSettings


def number_of(image: np.ndarray) -> int:
    """Return the number written into the first pixels of a fake image."""
    return int(sum((int(v) > 127) << k for k, v in enumerate(image[0, : 16 * 8 : 8])))


class FakeCamera:
    """A V4L2 camera of `width` x 200 at 200 images/s that knows `formats`; of one reader at a time.

    script: by the number of the image, what happens and for how much: `stall` for so many s,
    `repeat` the buffer, `unplug` for so many s, `jump` of the driver's clock by so many s, `break`
    the JPEG data. Each image carries its number, so that a reader can tell which ones it got.
    """

    HEIGHT, FPS = 200, 200.0

    def __init__(
        self,
        width: int = 320,
        formats: Sequence[str] = ('GREY', 'MJPG'),
        exposure_steps: int = 1,
        manual_exposure: bool = True,
        script: Mapping[int, tuple[str, float]] | None = None,
    ):
        self.width, self.formats, self.script = width, tuple(formats), script or {}
        self.exposure_steps, self.manual_exposure = exposure_steps, manual_exposure
        self.number = -1
        self.clock_shift_s = self.gone_until_s = 0.0
        self.opened = 0
        self.set_order: list[int] = []
        self.released = threading.Event()

    def open(self, path: str) -> 'FakeCamera':
        """Begin as cv2.VideoCapture(path) does."""
        self.opened += 1
        self._present = time.monotonic() >= self.gone_until_s
        self._values = {
            cv2.CAP_PROP_FOURCC: float(cv2.VideoWriter.fourcc(*self.formats[0])),
            cv2.CAP_PROP_FRAME_WIDTH: float(self.width),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self.HEIGHT),
            cv2.CAP_PROP_FPS: self.FPS,
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_EXPOSURE: 100.0,
        }
        self._due_s, self._stamp_ms = time.monotonic(), 0.0
        return self

    def isOpened(self) -> bool:  # noqa: N802, the name is OpenCV's
        return self._present

    def set(self, key: int, value: float) -> bool:
        self.set_order.append(key)
        if key == cv2.CAP_PROP_FOURCC:
            name = int(value).to_bytes(4, 'little').decode()
            if name not in self.formats:
                return False
            self._values[cv2.CAP_PROP_EXPOSURE] = 100.0  # a new format forgets the exposure
            self._values[cv2.CAP_PROP_AUTO_EXPOSURE] = 3.0
        elif key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS):
            return False  # it has one mode
        elif key == cv2.CAP_PROP_EXPOSURE:
            value = max(1, value // self.exposure_steps) * self.exposure_steps
        exposes = key in (cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE)
        if exposes and not self.manual_exposure:
            return False
        self._values[key] = float(value)
        return True

    def get(self, key: int) -> float:
        if key == cv2.CAP_PROP_POS_MSEC:
            return self._stamp_ms
        return self._values.get(key, 0.0)

    def grab(self) -> bool:
        """Wait for the next image; False when the camera is gone."""
        self.number += 1
        what, amount = self.script.get(self.number, ('', 0.0))
        self._broken = what == 'break'
        if what == 'unplug':
            self.gone_until_s = time.monotonic() + amount
        if time.monotonic() < self.gone_until_s:
            return False
        if what == 'repeat':
            return True
        if what == 'stall':
            time.sleep(amount)
        if what == 'jump':
            self.clock_shift_s += amount
        self._due_s = max(self._due_s + 1 / self.FPS, time.monotonic() - 2 / self.FPS)
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._stamp_ms = (time.monotonic() - 0.0005 + self.clock_shift_s) * 1e3
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        """Return the image grabbed last, raw as with CAP_PROP_CONVERT_RGB off."""
        image = np.full((self.HEIGHT, self.width), 20, np.uint8)
        for k in range(16):
            image[:8, 8 * k : 8 * k + 8] = 255 * (self.number >> k & 1)
        fourcc = int(self._values[cv2.CAP_PROP_FOURCC]).to_bytes(4, 'little')
        if fourcc == b'MJPG':
            data = cv2.imencode('.jpg', image)[1].reshape(1, -1)
            return True, np.zeros_like(data) if self._broken else data
        if fourcc == b'YUYV':
            return True, np.stack([image, np.full_like(image, 128)], axis=2)
        return True, image

    def release(self) -> None:
        self.released.set()


def fake_source(camera: FakeCamera, settings: CameraSettings) -> LiveCamera:
    """Return our side of a fake camera."""
    source = LiveCamera(settings)
    source.find, source.open_capture = (lambda name: name), camera.open
    return source
