# SPDX-License-Identifier: Apache-2.0
"""Images to be followed afterwards: a .npy stack, a video, a folder of images, or a bag."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.devices.files import picture_file, text_table
from eol_ros.devices.files.names import visible
from eol_ros.disk import check_file
from eol_ros.errors import ConfigError, DeviceMissing, EolError, UsageError

PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm')
IMAGE_TOPIC = 'camera/image_raw'
TAPS_TOPIC = 'block_taps'
DEFAULT_FPS = 60.0
FASTEST_FPS = 10000.0
LATEST_S = 1e11  # of a time, in s: beyond it, doubles lose the order of images
JUMP_NS = 60 * 10**9  # stamps that run ahead of reception by more are of another clock


@dataclass
class ImageSource:
    """Images with their times: `read()` yields (stamp_s, (h, w) uint8), in order.

    count: how many to expect, 0 where unknown. notes: what went wrong on the way, one line each,
    known when all are read. taps: (stamp_s, block, sigma_s) of the blocks' accelerometers, from a
    bag. about: what a bag says of itself, such as its scene.
    """

    name: str
    fps: float
    count: int
    _images: Any
    notes: list[str] = field(default_factory=list)
    taps: list[tuple[float, int, float]] = field(default_factory=list)
    about: dict[str, str] = field(default_factory=dict)

    def read(self) -> Iterator[tuple[float, np.ndarray]]:
        """Yield the images; call once."""
        yield from self._images(self)


class Moments:
    """When the images of a source were taken: image k at k / fps, or as `stamps` says.

    Args:
        fps: images a second; of a source with stamps, what their median distance says.
        stamps: a file with one mid-exposure time a line; see `read_stamps`.

    Raises:
        DeviceMissing, ConfigError: as `read_stamps`.
    """

    def __init__(self, fps: float | None, stamps: str | None = None):
        self.fps, self.stamps = fps, stamps
        self._times = read_stamps(stamps) if stamps else None
        if self._times is not None and len(self._times) > 1:
            self.fps = float(1 / np.median(np.diff(self._times)))

    def check(self, count: int, name: str) -> None:
        """Raise ConfigError unless there is a stamp for each of `count` images."""
        if self._times is not None and len(self._times) != count:
            raise ConfigError(
                f'{self.stamps}: has {len(self._times)} stamps, but {name} has '
                f'{count} images: one line for each image, dropped ones left out'
            )

    def read(self, fps: float) -> Iterator[float]:
        """Yield the times in s; `fps` counts where none is known."""
        if self._times is not None:
            return iter(self._times.tolist())
        return (k / (self.fps or fps) for k in itertools.count())


def read_stamps(path: str) -> np.ndarray:
    """Return the times (n,) in s of a text file with one mid-exposure time a line.

    A number with a decimal point or an exponent is in seconds; a whole number is in nanoseconds, as
    ROS stamps are. A file has one or the other. Empty lines, and what follows a #, are left out.

    Raises:
        DeviceMissing: no such file.
        ConfigError: what is no finite number, does not increase, mixes both units or lies closer
            together than images can; with file and line.
    """
    times: list[float] = []
    last: float = -math.inf  # in the unit of the file: whole numbers keep all their digits
    in_ns = False
    for row in text_table.rows(path, ('stamp',), ('stamp',), fits=bool):
        cell = row.cells['stamp'].partition('#')[0].strip()
        word = text_table.with_point(cell)
        whole = word.lstrip('+-').isdecimal()
        try:
            value: float = int(word) if whole and len(word) < 30 else float(word)
        except ValueError:
            value = math.nan
        if '_' in word:  # which Python takes between digits
            value = math.nan
        unit_s = 1e-9 if whole else 1.0
        if not abs(value * unit_s) < LATEST_S:  # nan, too
            wrong = 'is not a time: seconds with a decimal point, or whole nanoseconds'
        elif times and whole != in_ns:
            wrong = f'is in {"nanoseconds" if whole else "seconds"}, unlike the line before'
        elif value <= last:
            wrong = f'does not come after {last}, the line before'
        elif (value - last) * unit_s < 1 / FASTEST_FPS:
            wrong = f'is only {(value - last) * unit_s:.1g} s after the line before' + (
                '; seconds need a decimal point' if whole else ''
            )
        else:
            in_ns, last = whole, value
            times.append(value * unit_s)
            continue
        raise row.wrong('stamp', f'{cell} {wrong}')
    return np.array(times)


def open_source(path: str, fps: float | None = None, stamps: str | None = None) -> ImageSource:
    """Return the images at `path`; `fps` gives the times of all but a bag, i / fps.

    stamps: a file that gives the times instead, one a line; see `read_stamps`.

    Raises DeviceMissing when there is nothing, ConfigError when it is no source of grey images, or
    the stamps are not those of its images, UsageError when the rate is not a rate.
    """
    if fps is not None and not 0 < fps <= FASTEST_FPS:
        raise UsageError(f'--fps {fps:g}: a rate lies between 0 and {FASTEST_FPS:g} images/s')
    if stamps is not None and fps is not None:
        raise UsageError('--stamps says when each image was taken: leave out --fps')
    place = Path(path)
    if not place.exists() and '%' not in path:
        raise DeviceMissing(f'{path}: there is no such file or folder')
    check_file(place)
    files = '*.mcap', 'metadata.yaml'
    bags = any(place.glob('*/*.mcap')) and not _pictures(place)  # the newest is taken
    if place.suffix == '.mcap' or bags or any(any(place.glob(name)) for name in files):
        if stamps is not None:
            raise UsageError('--stamps: a bag has the stamps of its images: leave it out')
        return _bag(place)
    moments = Moments(fps, stamps)
    if place.suffix == '.npy':
        return _stack(place, moments)
    if place.is_dir():
        return _folder(place, moments)
    return _film(path, moments)


def _stack(path: Path, moments: Moments) -> ImageSource:
    try:
        stack = np.load(path, mmap_mode='r', allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        why = 'not numbers' if 'pickle' in str(error) else error  # NumPy: read it unsafely
        raise ConfigError(f'{path}: not a .npy array, or cut short ({why})') from None
    if stack.ndim == 2:
        stack = stack[None]
    if stack.ndim == 4 and stack.shape[3] == 1:
        stack = stack[..., 0]
    if stack.ndim != 3 or stack.dtype != np.uint8:
        raise ConfigError(
            f'{path}: has shape {stack.shape} and type {stack.dtype}; a stack of images is '
            '(count, height, width) uint8, grey'
        )

    return _series(str(path), moments, stack, np.ascontiguousarray)


def _pictures(folder: Path) -> list[Path]:
    return [f for f in visible(folder) if f.suffix.lower() in PICTURES]


def _folder(folder: Path, moments: Moments) -> ImageSource:
    files = _pictures(folder)
    if not files:
        raise DeviceMissing(
            f'{folder}: neither a bag nor an image in this folder ({" ".join(PICTURES)})'
        )

    return _series(
        str(folder), moments, files, lambda file: picture_file.load_grey(file, picture_file.GREY)
    )


def _series(
    name: str, moments: Moments, items: Sequence[Any], load: Callable[[Any], np.ndarray]
) -> ImageSource:
    """Return the images `load(item)` of `items`; unreadable ones are left out."""
    moments.check(len(items), name)

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        for time_s, item in zip(moments.read(DEFAULT_FPS), items, strict=False):
            try:
                image = load(item)
            except EolError as error:
                source.notes.append(f'{error}; left out')
                continue
            yield time_s, image

    return ImageSource(name, moments.fps or DEFAULT_FPS, len(items), images)


def _film(path: str, moments: Moments) -> ImageSource:
    import cv2

    from eol_ros.devices.camera.sources import VideoFile, open_video
    from eol_ros.settings import CameraSettings

    probe = open_video(path)
    if not probe.isOpened():
        raise ConfigError(
            f'{path}: OpenCV cannot open it as a video; give a video, a .npy stack, a folder of '
            'images or a bag'
        )
    width = int(probe.get(cv2.CAP_PROP_FRAME_WIDTH))
    height = int(probe.get(cv2.CAP_PROP_FRAME_HEIGHT))
    rate = moments.fps or probe.get(cv2.CAP_PROP_FPS) or DEFAULT_FPS
    count = max(int(probe.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
    if moments.stamps:  # what a container says of its length is an estimate
        count = sum(1 for _ in iter(probe.grab, False))
    probe.release()
    moments.check(count, path)
    film = VideoFile(CameraSettings(device=path, fps=rate, width=width, height=height))
    film.open()

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        uneven, begin_s = False, None
        for time_s in moments.read(rate):
            picture = film.read()
            if picture is None:
                break
            if not moments.fps and not moments.stamps:
                at_s = film.position_s()
                begin_s = at_s if begin_s is None else begin_s
                if not uneven and abs(at_s - begin_s - time_s) > 1 / rate:
                    uneven = True
                    source.notes.append(
                        f'{path}: its images are not evenly spaced: the times in the file count; '
                        '--stamps or --fps gives others'
                    )
                time_s = at_s - begin_s if uneven else time_s
            yield time_s, picture.image
        source.notes += film.notes
        film.close()

    return ImageSource(path, rate, count, images)


def _bag(path: Path) -> ImageSource:
    from eol_ros.devices.bag.reader import BagReader
    from eol_ros.streams.cdr import Decoder
    from eol_ros.streams.images import Codec
    from eol_ros.streams.taps import RECORD, to_core

    bag = BagReader(path)
    if not any('image' in name for name in bag.topics):
        raise ConfigError(f'{bag.path}: has no raw images; `recorder: {{images: all}}` keeps them')
    topic = bag.own(IMAGE_TOPIC)
    codec = Codec(bag.topics[topic].definition)

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        last_ns, last_log_ns, unstamped, odd = 0, 0, 0, 0
        for message in bag.messages([topic]):
            try:
                stamp_ns, image = codec.read(message.data)
            except ValueError as error:
                raise ConfigError(f'{path}: {error}') from None
            if not stamp_ns:
                unstamped += 1
                stamp_ns = message.log_ns
            ahead = last_ns and stamp_ns - last_ns > message.log_ns - last_log_ns + JUMP_NS
            if stamp_ns <= last_ns or ahead:
                odd += 1
                continue
            last_ns, last_log_ns = stamp_ns, message.log_ns
            yield stamp_ns * 1e-9, image
        if unstamped:
            source.notes.append(f'{unstamped} images have a stamp of 0: taken when received')
        if odd:
            source.notes.append(f'{odd} images whose stamps fall back or jump ahead are left out')
        source.notes += bag.cut_short

    source = ImageSource(str(bag.path), 0.0, bag.counts[topic], images, about=bag.about)
    try:
        taps = bag.own(TAPS_TOPIC)
    except ConfigError:
        return source
    read = Decoder(bag.topics[taps].type, bag.topics[taps].definition)
    rows = read.table([m.data for m in bag.messages([taps])])
    source.taps += map(to_core, RECORD.each(rows))
    return source
