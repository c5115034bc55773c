# SPDX-License-Identifier: Apache-2.0
"""Slips joined in time and neighbourhood: eol_msgs/Cascade."""

from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.streams.record import Record, seconds

if TYPE_CHECKING:
    from eol_ros.core.motion.cascades import CascadeEvent

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('cascade', 'u4'), ('onset', 'M8[ns]'), ('duration', 'f8'),
     ('nucleus', 'u1'), ('area', 'u1'), ('size', 'u2'), ('blocks', object), ('distance', 'f8')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/Cascade', DTYPE, 'table')


def of(stamp_ns: int, event: 'CascadeEvent') -> Any:
    """Return the row of a cascade that the image of `stamp_ns` closed."""
    return RECORD.row(
        stamp_ns, event.cascade, round(event.onset_s * 1e9), event.duration_s, event.nucleus,
        event.area, event.size, np.array(event.blocks, 'u1'), event.distance_m,
    )  # fmt: skip


def to_json(message: Any) -> list[Any]:
    """Return a Cascade message as pages read it: onset, nucleus, area, size, duration, blocks."""
    return [
        seconds(message.onset), message.nucleus, message.area, message.size, message.duration,
        list(message.blocks),
    ]  # fmt: skip
