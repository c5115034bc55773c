# SPDX-License-Identifier: Apache-2.0
"""Starts and stops of slips: eol_msgs/Slip."""

from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.core.motion.slips import START, STOP
from eol_ros.streams.record import Record, seconds

if TYPE_CHECKING:
    from eol_ros.core.motion.motion import NumberedSlip

__all__ = ['DTYPE', 'RECORD', 'START', 'STOP', 'of', 'to_json']

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('kind', 'u1'), ('slip', 'u4'), ('block', 'u1'), ('onset', 'M8[ns]'),
     ('onset_sigma', 'f8'), ('x', 'f8'), ('y', 'f8'), ('speed', 'f8'), ('distance', 'f8'),
     ('duration', 'f8'), ('cascade', 'u4'), ('tapped', '?')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/Slip', DTYPE, 'table')


def of(stamp_ns: int, slip: 'NumberedSlip') -> Any:
    """Return the row of a slip that the image of `stamp_ns` decided."""
    e = slip.event
    return RECORD.row(
        stamp_ns, e.kind, e.slip, e.block, round(e.onset_s * 1e9), e.onset_sigma_s, e.x, e.y,
        e.speed_mps, e.distance_m, e.duration_s, slip.cascade, slip.tapped,
    )  # fmt: skip


def to_json(message: Any) -> dict[str, Any]:
    """Return a Slip message as pages read it."""
    return {
        't': 'slip', 'start': message.kind == START, 'block': message.block,
        'slip': message.slip, 'cascade': message.cascade, 'stamp': seconds(message.header.stamp),
        'onset': seconds(message.onset), 'x': message.x, 'y': message.y,
        'speed': message.speed, 'distance': message.distance, 'duration': message.duration,
    }  # fmt: skip
