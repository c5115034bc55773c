# SPDX-License-Identifier: Apache-2.0
"""Background models as grey images, so that a person can look at what the tracker leaves out."""

from pathlib import Path

import cv2

from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.errors import ConfigError, DeviceMissing


def save(path: str | Path, background: BackgroundModel) -> None:
    """Write the map as a PNG.

    Raises:
        ConfigError: it cannot be written there.
    """
    try:
        done = cv2.imwrite(str(path), background.light)
    except cv2.error:
        done = False
    if not done:
        raise ConfigError(
            f'{path}: cannot write the background model; name a .png in a folder that exists'
        )


def load(path: str | Path) -> BackgroundModel:
    """Return the map in a PNG.

    Raises:
        DeviceMissing: no such file.
        ConfigError: not an image.
    """
    if not Path(path).exists():
        raise DeviceMissing(f'{path}: no such background model')
    light = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if light is None:
        raise ConfigError(f'{path}: not an image that can be read')
    return BackgroundModel(light)
