# SPDX-License-Identifier: Apache-2.0
"""What was sent to the blocks' LEDs: eol_msgs/LedCommand."""

from typing import Any

import numpy as np

from eol_ros.streams.record import Record

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('white', 'O'), ('infrared', '?'), ('sequence', 'u4'),
     ('sent', 'M8[ns]')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/LedCommand', DTYPE)


def of(sent: Any, sent_ns: int) -> Any:
    """Return the row of a Sent of devices/board, written at `sent_ns` of ROS time."""
    return RECORD.row(
        sent.stamp_ns, np.frombuffer(sent.white, 'u1'), sent.infrared, sent.sequence, sent_ns
    )
