# SPDX-License-Identifier: Apache-2.0
"""The camera that a twin simulates; apart from what a tracker keeps, which needs OpenCV."""

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import IDEAL_PX_PER_M, Calibration
from eol_ros.errors import ConfigError
from eol_ros.settings import TwinSettings

SHOWN_M = 2.24, 1.4  # what 1280 x 800 pixels of an ideal camera show of the paper's platform


def ideal_px_per_m(table: Table, width: int, height: int) -> float:
    """Return the scale at which images of this size show the whole platform of a table."""
    share = max(mine / shown for mine, shown in zip(table.platform_m, SHOWN_M, strict=True))
    return IDEAL_PX_PER_M * min(width / 1280, height / 800) / share


def twin_camera(settings: TwinSettings, table: Table = Table()) -> Calibration:
    """Return the camera that a twin with these settings simulates above a table.

    Without a calibration file it is an ideal one that shows the whole platform.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read, of another image size or mirror.
    """
    if not settings.calibration:
        size = settings.width, settings.height
        return Calibration.ideal(*size, ideal_px_per_m(table, *size), settings.mirror)
    from eol_ros.devices.files import calibration_file

    found = calibration_file.load(settings.calibration, settings.mirror)
    if (found.image_width, found.image_height) != (settings.width, settings.height):
        raise ConfigError(
            f'{settings.calibration}: is for images of {found.image_width}x{found.image_height}, '
            f'the twin draws {settings.width}x{settings.height}: set its width and height so'
        )
    if found.covers is not None and len(found.covers.land_mm) != table.cells:
        raise ConfigError(
            f'{settings.calibration}: has covers of {len(found.covers.land_mm)} blocks, and the'
            f' table {table.cells} places: calibrate again with the covers of this table'
        )
    return found
