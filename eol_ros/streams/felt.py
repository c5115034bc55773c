# SPDX-License-Identifier: Apache-2.0
"""Slips that the blocks felt, until images confirm or retract them: eol_msgs/FeltSlip."""

from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.core.motion.felt import CONFIRMED, PROVISIONAL, RETRACTED
from eol_ros.streams.record import Record

if TYPE_CHECKING:
    from eol_ros.core.motion.felt import FeltSlip

__all__ = ['CONFIRMED', 'DTYPE', 'IMAGE', 'KNOCK', 'PROVISIONAL', 'RECORD', 'RETRACTED', 'of']

KNOCK, IMAGE = 1, 2  # `sense`
DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('kind', 'u1'), ('sense', 'u1'), ('block', 'u1'), ('onset', 'M8[ns]'),
     ('onset_sigma', 'f8'), ('x', 'f8'), ('y', 'f8'), ('strength', 'f4'), ('probability', 'f4'),
     ('slip', 'u4')]
)  # fmt: skip
RECORD = Record('eol_msgs/msg/FeltSlip', DTYPE, 'table')


def of(felt: 'FeltSlip', image_ns: int = 0) -> Any:
    """Return the row of what was told of a knock; a verdict is that of the image of `image_ns`."""
    knock, told = felt.knock, felt.kind == PROVISIONAL
    return RECORD.row(
        knock.stamp_ns if told else image_ns, felt.kind, KNOCK if told else IMAGE, knock.block,
        knock.stamp_ns, knock.sigma_s, felt.x, felt.y, knock.strength_mps2, felt.probability,
        felt.slip,
    )  # fmt: skip
