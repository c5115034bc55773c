# SPDX-License-Identifier: Apache-2.0
"""Background models as grey images, so that a person can look at what the tracker leaves out."""

from pathlib import Path

from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.devices.files import picture_file


def save(path: str | Path, background: BackgroundModel) -> None:
    """Write the map as a PNG; raises ConfigError where it cannot be written."""
    picture_file.save(path, background.light)


def load(path: str | Path) -> BackgroundModel:
    """Return the map in a PNG; raises DeviceMissing, ConfigError as `picture_file.load_grey`."""
    return BackgroundModel(picture_file.load_grey(path, picture_file.GREY))
