# SPDX-License-Identifier: Apache-2.0
"""Images on disk as arrays. Bytes cross OpenCV, not names: it takes no name that is not UTF-8."""

import io
import warnings
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from eol_ros.disk import DISK, content, said
from eol_ros.errors import ConfigError, DeviceMissing, writing

MOST = 1_000_000_000  # bytes of a file (chosen)
GREY = cv2.IMREAD_GRAYSCALE


def load_grey(path: str | Path, flags: int = GREY | cv2.IMREAD_ANYDEPTH) -> np.ndarray:
    """Return an image as (h, w) grey values, 8 or 16 bit; with the flags GREY 8 bit alone.

    Raises DeviceMissing where there is no file and ConfigError where it is no image.
    """
    try:
        data = content(path, MOST)
    except FileNotFoundError:
        raise DeviceMissing(f'{path}: no such file') from None
    except OSError as error:
        raise DeviceMissing(f'{path}: cannot be read ({error.strerror})') from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            with Image.open(io.BytesIO(data)) as image:
                image.verify()  # libpng would print what it finds
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except UnidentifiedImageError:
        raise ConfigError(f'{path}: not an image that can be read') from None
    except Image.DecompressionBombError:
        raise ConfigError(f'{path}: too large: hundreds of megapixels') from None
    except (OSError, SyntaxError, EOFError, ValueError, cv2.error) as error:
        raise ConfigError(f'{path}: cut off before its end, or damaged ({said(error)})') from None
    if picture is None:
        raise ConfigError(f'{path}: not an image that can be read')
    return picture


def save(path: str | Path, picture: np.ndarray) -> None:
    """Write an image in the format that the name ends with; raises ConfigError."""
    try:
        done, data = cv2.imencode(Path(path).suffix, picture)
    except cv2.error:
        done = False
    if not done:
        raise ConfigError(f'{path}: no format of images has this ending; name a .png')
    with writing(path):
        DISK.write(Path(path), data.tobytes())
