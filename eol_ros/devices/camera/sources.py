# SPDX-License-Identifier: Apache-2.0
"""Where images come from: a V4L2 camera, or any file that OpenCV opens. Both give grey uint8."""

import os
import tempfile
import time
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from eol_ros.devices.camera.ports import find_camera
from eol_ros.devices.files.names import is_text
from eol_ros.disk import check_file, readable
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import said
from eol_ros.settings import CameraSettings

COLOUR_LEVELS = 12  # channels further apart are colour; JPEG of a grey image stays within 2
COLOUR_SHARE = 1e-3  # of the pixels
MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
EXPOSURE_UNIT_US = 100  # of V4L2_CID_EXPOSURE_ABSOLUTE
CLOCK_TRUST_S = 1.0  # a driver's stamp that differs from now by more is of another clock


class Picture(NamedTuple):
    """One image, (height, width) uint8, and its mid-exposure time.

    `monotonic_ns` is on CLOCK_MONOTONIC; None for a file, whose images are due when the clock says.
    """

    monotonic_ns: int | None
    image: np.ndarray


class SourceLost(OSError):
    """The camera sends no more images: it is unplugged, or its driver gave up."""


def is_file(device: str) -> bool:
    """Return whether `device` names a video file or a numbered series of images, not a camera."""
    return readable(device) or (not device.startswith('/dev/') and any(c in device for c in '%/.'))


def check_image(image: np.ndarray, settings: CameraSettings, name: str) -> None:
    """Raise ConfigError unless `image` is grey, 8 bit, of the size that the scene names."""
    height, width = image.shape[:2]
    if image.dtype != np.uint8:
        raise ConfigError(f'{name} has {image.dtype} pixels; 8-bit grey is needed')
    if (width, height) != (settings.width, settings.height):
        raise ConfigError(
            f'{name} is {width}x{height}, the scene says {settings.width}x{settings.height}: '
            f'set camera.width and camera.height, and use the calibration of that size'
        )


def is_coloured(image: np.ndarray) -> bool:
    """Return whether an image of shape (height, width, 3) shows colour, not grey three times."""
    first = image[..., :1].astype(np.int16)
    apart = np.abs(image[..., 1:3].astype(np.int16) - first).max(axis=2)
    return float((apart > COLOUR_LEVELS).mean()) > COLOUR_SHARE


def open_video(path: str, backend: int = 0) -> Any:
    """Return an OpenCV capture of a video file; neither OpenCV nor FFmpeg prints anything.

    backend: one of cv2's CAP constants; 0 lets OpenCV choose.
    """
    os.environ.setdefault('OPENCV_FFMPEG_LOGLEVEL', '-8')  # AV_LOG_QUIET
    import cv2

    if hasattr(cv2, 'utils'):
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    if is_text(path):
        return cv2.VideoCapture(path, backend)
    with tempfile.TemporaryDirectory() as folder:  # OpenCV ends the process for other names
        link = os.path.join(folder, f'video{os.path.splitext(path)[1]}')
        os.symlink(os.path.abspath(path), link)
        return cv2.VideoCapture(link if is_text(link) else os.path.join(folder, 'none'), backend)


class VideoFile:
    """The images of a file, one after another, as fast as they can be decoded."""

    live: Literal[False] = False

    def __init__(self, settings: CameraSettings):
        self.name = settings.device
        self.fps = settings.fps
        self.notes: list[str] = []
        self._settings = settings
        self._capture: Any = None
        self._grey = True
        self._expected = 0

    def open(self) -> None:
        """Open the file at its beginning; DeviceMissing or ConfigError say what is wrong."""
        check_file(self.name)
        if '%' not in self.name and not os.path.isfile(self.name):
            raise DeviceMissing(f'camera.device: there is no file {self.name}')
        if self._capture is None:
            self._inspect()
        else:
            self._capture.release()
        self._capture = self._start(self._grey)
        self._read = 0

    def _start(self, grey: bool) -> Any:
        import cv2

        capture = open_video(self.name)
        if not capture.isOpened():
            raise ConfigError(
                f'camera.device: OpenCV cannot open {self.name} as a video; give a video '
                'or /dev/videoN'
            )
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0 if grey else 1)
        return capture

    def _inspect(self) -> None:
        """Look at the first image both ways: as the file has it, and as OpenCV converts it.

        Unconverted luma is three times as quick to get and bit-exact, but it is only right where
        the file uses the full range 0..255; and it hides colour.
        """
        import cv2

        converted = self._start(grey=False)
        ok, image = converted.read()
        if not ok:
            raise ConfigError(f'camera.device: {self.name} has no image that can be read')
        check_image(image, self._settings, self.name)
        if image.ndim == 3 and is_coloured(image):
            raise ConfigError(
                f'{self.name} is in colour where grey is meant: make it grey '
                f'(ffmpeg -i IN -vf format=gray -c:v mjpeg -q:v 3 OUT.avi)'
            )
        self._expected = int(converted.get(cv2.CAP_PROP_FRAME_COUNT))
        if not self.fps:
            self.fps = converted.get(cv2.CAP_PROP_FPS)
            if not 0 < self.fps <= 1000:
                raise ConfigError(f'{self.name} does not say how fast it is: set camera.fps')
        converted.release()
        plain = self._start(grey=True)
        ok, raw = plain.read()
        plain.release()
        grey = image if image.ndim == 2 else image[..., 1]
        self._grey = bool(
            ok
            and raw.shape == grey.shape
            and raw.dtype == np.uint8
            and np.abs(raw.astype(np.int16) - grey).mean() < 0.5
        )

    def read(self) -> Picture | None:
        """Return the next image, None at the end."""
        ok, image = self._capture.read()
        if not ok:
            if self._expected > self._read and '%' not in self.name:
                self.notes = [
                    f'{self.name} breaks off after {self._read} of {self._expected} images'
                ]
            return None
        self._read += 1
        return Picture(None, image if image.ndim == 2 else np.ascontiguousarray(image[..., 1]))

    def position_s(self) -> float:
        """Return the time that the file gives the image just read."""
        import cv2

        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3

    def close(self) -> None:
        """Release the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def open_v4l2(path: str) -> Any:
    """Return an OpenCV capture of the V4L2 device at `path`."""
    os.environ.setdefault('OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT', '1')  # s; it is 10 otherwise
    import cv2

    return cv2.VideoCapture(path, cv2.CAP_V4L2)


class LiveCamera:
    """A V4L2 camera in GREY or MJPG with manual exposure.

    `find` returns the path for a name in the scene; `open_capture(path)` returns an object with the
    methods of cv2.VideoCapture.
    """

    live: Literal[True] = True

    def __init__(self, settings: CameraSettings):
        self.name = settings.device
        self.fps = settings.fps or 60.0
        self.notes: list[str] = []
        self.odd_stamps = self.repeated = 0
        self.exposure_us = float(settings.exposure_us)
        self._settings = settings
        self.find: Callable[[str], str] = find_camera
        self.open_capture: Callable[[str], Any] = open_v4l2
        self._capture: Any = None
        self._format = ''
        self._last_ns = 0

    @property
    def values(self) -> dict[str, Any]:
        """Return the counters by name."""
        return {
            'odd_stamps': self.odd_stamps,
            'repeated': self.repeated,
            'exposure_us': self.exposure_us,
        }

    def open(self) -> None:
        """Open the camera, set format, then exposure, and read back what it took."""
        import cv2

        path = self.find(self._settings.device)
        self.name, self.notes = path, []
        self._capture = capture = self.open_capture(path)
        if not capture.isOpened():
            raise DeviceMissing(said('camera_busy', name=path))
        self._set_format(capture, path)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 2)
        # After the format, because drivers forget it at a change of format.
        self._set_exposure(capture)
        self._last_ns = 0

    def _set_format(self, capture: Any, path: str) -> None:
        import cv2

        s = self._settings
        wanted = ('GREY', 'MJPG') if s.format == 'auto' else (s.format,)
        for name in wanted:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*name))
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, s.width)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, s.height)
            if s.fps:
                capture.set(cv2.CAP_PROP_FPS, s.fps)
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
            taken = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, 'little').decode('latin-1')
            if taken.strip() in (name, name.replace('GREY', 'Y8')):
                self._format = name
                break
        else:
            raise ConfigError(
                f'camera {path} gives {taken.strip()!r} images, not {" or ".join(wanted)}: '
                f'a monochrome camera is needed (camera.format chooses)'
            )
        width, height = (int(capture.get(p)) for p in (3, 4))
        if (width, height) != (s.width, s.height):
            raise ConfigError(
                f'camera {path} gives {width}x{height} images, the scene says '
                f'{s.width}x{s.height}: set camera.width and camera.height to a size it has'
            )
        rate = capture.get(cv2.CAP_PROP_FPS)
        if s.fps and rate and abs(rate - s.fps) > 0.02 * s.fps:
            self.notes.append(f'{rate:g} images/s, not the {s.fps:g} asked for')
        self.fps = rate or s.fps or 60.0

    def _set_exposure(self, capture: Any) -> None:
        import cv2

        asked_us = self._settings.exposure_us
        capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE)
        capture.set(cv2.CAP_PROP_EXPOSURE, asked_us / EXPOSURE_UNIT_US)
        if self._settings.gain >= 0:
            capture.set(cv2.CAP_PROP_GAIN, self._settings.gain)
        taken_us = capture.get(cv2.CAP_PROP_EXPOSURE) * EXPOSURE_UNIT_US
        if capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) != MANUAL_EXPOSURE or taken_us <= 0:
            self.notes.append('the camera keeps its automatic exposure: expect blur')
        else:
            if abs(taken_us - asked_us) > max(0.05 * asked_us, EXPOSURE_UNIT_US):
                self.notes.append(f'exposure {taken_us:.0f} us, not the {asked_us} asked for')
            self.exposure_us = taken_us

    def read(self) -> Picture:
        """Wait for the next image and return it; SourceLost when the camera has none to give."""
        import cv2

        while True:
            if not self._capture.grab():
                raise SourceLost(said('no_more_images', name=self.name))
            now_ns = time.monotonic_ns()
            driver_ns = int(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            if driver_ns and driver_ns == self._last_ns:
                self.repeated += 1  # some drivers hand out a buffer twice
                continue
            ok, data = self._capture.retrieve()
            if not ok:
                raise SourceLost(said('no_more_images', name=self.name))
            stamp_ns = driver_ns
            if not self._last_ns < driver_ns <= now_ns + 1e6 or (
                now_ns - driver_ns > CLOCK_TRUST_S * 1e9
            ):
                self.odd_stamps += 1
                stamp_ns = now_ns
            else:
                self._last_ns = driver_ns
            return Picture(stamp_ns - int(self.exposure_us * 500), self._grey(data))

    def _grey(self, data: np.ndarray) -> np.ndarray:
        import cv2

        height, width = self._settings.height, self._settings.width
        if self._format == 'MJPG' and data.size != height * width:
            image = cv2.imdecode(data.reshape(-1), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise SourceLost(f'camera {self.name} sends broken JPEG images')
            check_image(image, self._settings, f'camera {self.name}')
            return image
        if data.size == height * width and data.dtype == np.uint8:
            return data.reshape(height, width)
        raise ConfigError(
            f'camera {self.name} gives arrays of shape {data.shape} {data.dtype} where '
            f'{height}x{width} grey is meant'
        )

    def close(self) -> None:
        """Release the camera."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None


def source_of(settings: CameraSettings) -> VideoFile | LiveCamera:
    """Return the source that `settings.device` names."""
    return VideoFile(settings) if is_file(settings.device) else LiveCamera(settings)
