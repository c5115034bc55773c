# SPDX-License-Identifier: Apache-2.0
"""Camera and table as the tracker maps pixels to metres: eol_msgs/Calibration."""

from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.streams.record import Record

if TYPE_CHECKING:
    from eol_ros.core.table import Table
    from eol_ros.core.vision.calibration.model import Calibration

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('digest', 'O'), ('date', 'O'), ('width', 'u4'), ('height', 'u4'),
     ('camera_matrix', 'f8', 9), ('distortion', 'f8', 5), ('homography', 'f8', 9), ('mirror', '?'),
     ('cover_height', 'f8'), ('residual_px', 'f8'), ('residual_mm', 'f8'), ('cover_rim', 'f8'),
     ('cover_land', 'O')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/Calibration', DTYPE, 'table')


def of(stamp_ns: int, calibration: 'Calibration') -> Any:
    """Return the row of a calibration that is used from `stamp_ns` on."""
    c, covers = calibration, calibration.covers
    return RECORD.row(
        stamp_ns, c.digest, c.date, c.image_width, c.image_height, c.camera_matrix.ravel(),
        c.distortion_coefficients.copy(), c.homography.ravel(), c.mirrored, float(c.cover_height_m),
        float(c.residual_px), float(c.residual_mm), float(covers.lower_mm) if covers else 0.0,
        covers.land_mm.ravel() if covers else np.zeros(0),
    )  # fmt: skip


def to_core(row: Any, table: 'Table') -> 'Calibration':
    """Return the calibration of a message or a row, at this table; raises ConfigError."""
    from eol_ros.core.vision.calibration.covers import CoverOutlines
    from eol_ros.core.vision.calibration.model import Calibration

    land, sides = np.array(row.cover_land, float), 4 * table.cells
    if land.size % sides:
        raise ConfigError(f'calibration: {land.size} heights for {sides} sides of covers')
    covers = CoverOutlines(row.cover_rim, land.reshape(table.cells, 4, -1)) if land.size else None
    return Calibration(
        int(row.width), int(row.height), np.reshape(row.camera_matrix, (3, 3)),
        np.array(row.distortion), np.reshape(row.homography, (3, 3)), row.cover_height,
        str(row.date), row.residual_px, row.residual_mm, covers, table,
    )  # fmt: skip
