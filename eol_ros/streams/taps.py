# SPDX-License-Identifier: Apache-2.0
"""Knocks that the blocks' own accelerometers felt: eol_msgs/BlockTap."""

from typing import Any

import numpy as np

from eol_ros.core.motion.felt import Knock
from eol_ros.streams.record import Record

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('block', 'u1'), ('strength', 'f4'), ('board_time_us', 'u4'),
     ('sigma', 'f4')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/BlockTap', DTYPE)


def of(tap: Any) -> Any:
    """Return the row of a Tap of devices/board."""
    return RECORD.row(tap.stamp_ns, tap.block, tap.strength, tap.board_us, tap.sigma_s)


def to_core(row: Any) -> tuple[float, int, float]:
    """Return stamp in s, block and sigma in s, as the tracker takes them."""
    return row.stamp * 1e-9, row.block, row.sigma


def to_knock(row: Any) -> Knock:
    """Return it as motion takes it."""
    return Knock(row.stamp, row.block, row.sigma, row.strength)
