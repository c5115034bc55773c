# SPDX-License-Identifier: Apache-2.0
"""Images on disk as arrays."""

from pathlib import Path

import cv2
import numpy as np

from eol_ros.errors import ConfigError, DeviceMissing


def load_grey(path: str | Path) -> np.ndarray:
    """Return an image as (h, w) grey values, 8 or 16 bit; raises DeviceMissing where
    there is no file and ConfigError where it is no image.
    """
    if not Path(path).is_file():
        raise DeviceMissing(f'{path}: no such file')
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise ConfigError(f'{path}: not an image that can be read')
    return picture


def save(path: str | Path, picture: np.ndarray) -> None:
    """Write an image in the format that the name ends with; raises ConfigError."""
    if not cv2.imwrite(str(path), picture):
        raise ConfigError(f'{path}: cannot be written')
