# SPDX-License-Identifier: Apache-2.0
"""Images to be followed afterwards: a .npy stack, a film, a folder of pictures, or a bag."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.errors import ConfigError, DeviceMissing, UsageError

PICTURES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm')
IMAGE_TOPIC = 'camera/image_raw'
TAPS_TOPIC = 'block_taps'
DEFAULT_FPS = 60.0


@dataclass
class ImageSource:
    """Images with their times: `read()` yields (stamp_s, (h, w) uint8), in order.

    count: how many to expect, 0 where unknown. notes: what went wrong on the way, one line each,
    known when all are read. taps: (stamp_s, block, sigma_s) of the blocks' accelerometers, from a
    bag.
    """

    name: str
    fps: float
    count: int
    _images: Any
    notes: list[str] = field(default_factory=list)
    taps: list[tuple[float, int, float]] = field(default_factory=list)

    def read(self) -> Iterator[tuple[float, np.ndarray]]:
        """Yield the images; call once."""
        yield from self._images(self)


def open_source(path: str, fps: float | None = None) -> ImageSource:
    """Return the images at `path`; `fps` gives the times of all but a bag, i / fps.

    Raises DeviceMissing when there is nothing, ConfigError when it is no source of grey images,
    UsageError when the rate is not a rate.
    """
    if fps is not None and not 0 < fps <= 10000:
        raise UsageError(f'--fps {fps:g}: a rate lies between 0 and 10000 images a second')
    place = Path(path)
    if not place.exists() and '%' not in path:
        raise DeviceMissing(f'{path}: there is no such file or folder')
    if place.suffix == '.npy':
        return _stack(place, fps or DEFAULT_FPS)
    if place.suffix == '.mcap' or (place.is_dir() and _is_bag(place)):
        return _bag(place)
    if place.is_dir():
        return _folder(place, fps or DEFAULT_FPS)
    return _film(path, fps)


def _is_bag(folder: Path) -> bool:
    return any(folder.glob('*.mcap')) or (folder / 'metadata.yaml').exists()


def _stack(path: Path, fps: float) -> ImageSource:
    try:
        stack = np.load(path, mmap_mode='r', allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise ConfigError(f'{path}: not a .npy array, or cut short ({error})') from None
    if stack.ndim == 2:
        stack = stack[None]
    if stack.ndim == 4 and stack.shape[3] == 1:
        stack = stack[..., 0]
    if stack.ndim != 3 or stack.dtype != np.uint8:
        raise ConfigError(
            f'{path}: has shape {stack.shape} and type {stack.dtype}; a stack of images is '
            '(count, height, width) uint8, grey'
        )

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        for k in range(len(stack)):
            yield k / fps, np.ascontiguousarray(stack[k])

    return ImageSource(str(path), fps, len(stack), images)


def _folder(folder: Path, fps: float) -> ImageSource:
    import cv2

    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in PICTURES)
    if not files:
        raise DeviceMissing(
            f'{folder}: neither a bag nor a picture in this folder ({" ".join(PICTURES)})'
        )

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        for k, file in enumerate(files):
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            if image is None:
                source.notes.append(f'{file}: not a picture that can be read; left out')
                continue
            yield k / fps, image

    return ImageSource(str(folder), fps, len(files), images)


def _film(path: str, fps: float | None) -> ImageSource:
    import cv2

    from eol_ros.devices.camera_sources import VideoFile
    from eol_ros.settings import CameraSettings

    probe = cv2.VideoCapture(path)
    if not probe.isOpened():
        raise ConfigError(f'{path}: OpenCV cannot open it as a film')
    width = int(probe.get(cv2.CAP_PROP_FRAME_WIDTH))
    height = int(probe.get(cv2.CAP_PROP_FRAME_HEIGHT))
    rate = fps or probe.get(cv2.CAP_PROP_FPS) or DEFAULT_FPS
    count = max(int(probe.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
    probe.release()
    film = VideoFile(CameraSettings(device=path, fps=rate, width=width, height=height))
    film.open()

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        k = 0
        while (picture := film.read()) is not None:
            yield k / rate, picture.image
            k += 1
        source.notes += film.notes
        film.close()

    return ImageSource(path, rate, count, images)


def _bag(path: Path) -> ImageSource:
    from eol_ros.devices.bag_reader import BagReader
    from eol_ros.devices.cdr import Decoder

    bag = BagReader(path)
    topic = bag.find(IMAGE_TOPIC)
    decoder = Decoder(bag.topics[topic].type, bag.topics[topic].definition)

    def images(source: ImageSource) -> Iterator[tuple[float, np.ndarray]]:
        for message in bag.messages([topic]):
            row = decoder.table([message.data])
            encoding = str(row['encoding'][0])
            if encoding not in ('mono8', '8UC1'):
                raise ConfigError(f'{path}: images are {encoding}, not mono8')
            shape = int(row['height'][0]), int(row['width'][0])
            image = np.ascontiguousarray(row['data'][0], np.uint8).reshape(shape)
            yield int(row['stamp'][0].astype(np.int64)) * 1e-9, image
        source.notes += bag.cut_short

    source = ImageSource(str(path), 0.0, bag.counts[topic], images)
    try:
        taps = bag.find(TAPS_TOPIC)
    except ConfigError:
        return source
    read = Decoder(bag.topics[taps].type, bag.topics[taps].definition)
    rows = read.table([m.data for m in bag.messages([taps])])
    for stamp, block, sigma in zip(rows['stamp'], rows['block'], rows['sigma']):
        source.taps.append((int(stamp.astype(np.int64)) * 1e-9, int(block), float(sigma)))
    return source
