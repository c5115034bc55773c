# SPDX-License-Identifier: Apache-2.0
"""The camera that a twin simulates; apart from what a tracker keeps, which needs OpenCV."""

from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.settings import TwinSettings


def twin_camera(settings: TwinSettings, table: Table = Table()) -> Calibration:
    """Return the camera that a twin with these settings simulates above a table.

    Without a calibration file it is an ideal one that shows the whole platform.

    Raises:
        ConfigError, DeviceMissing: a file that cannot be read, of another image size, mirror or
            table.
    """
    if not settings.calibration:
        size = settings.width, settings.height
        return Calibration.ideal(*size, mirror=settings.mirror, table=table)
    from eol_ros.devices.files import calibration_file

    found = calibration_file.load(settings.calibration, settings.mirror, table)
    if (found.image_width, found.image_height) != (settings.width, settings.height):
        raise ConfigError(
            f'{settings.calibration}: is for images of {found.image_width}x{found.image_height}, '
            f'the twin draws {settings.width}x{settings.height}: set its width and height so'
        )
    return found
