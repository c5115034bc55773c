# SPDX-License-Identifier: Apache-2.0
"""Size and shape of the table: eol_msgs/Table."""

from typing import Any

import numpy as np

from eol_ros.core.table import Table
from eol_ros.streams.record import Record

# fmt: off
DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('rows', 'u1'), ('columns', 'u1'), ('block_side', 'f8'), ('gap_x', 'f8'),
     ('gap_y', 'f8'), ('rim_width', 'f8'), ('platform_x', 'f8'), ('platform_y', 'f8'),
     ('body_height', 'f8'), ('absent', 'O')]
)
# fmt: on
RECORD = Record('eol_msgs/msg/Table', DTYPE, 'table')


def of(stamp_ns: int, table: Table) -> object:
    """Return the row of a table that is published at `stamp_ns`."""
    return RECORD.row(
        stamp_ns, table.rows, table.columns, table.block_side_m, *table.gaps_m, table.rim_width_m,
        *table.platform_m, table.body_height_m, np.array(table.absent, 'u1'),
    )  # fmt: skip


def table(row: Any) -> Table:
    """Return the table of a message or a row."""
    return Table(
        rows=int(row.rows), columns=int(row.columns), block_side_m=float(row.block_side),
        gap_m=float(row.gap_x), gap_y_m=float(row.gap_y), rim_width_m=float(row.rim_width),
        platform_m=(float(row.platform_x), float(row.platform_y)),
        body_height_m=float(row.body_height), absent=tuple(map(int, row.absent)),
    )  # fmt: skip
