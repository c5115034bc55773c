# SPDX-License-Identifier: Apache-2.0
"""How strained each block is before it lets go: its springs' pull, from the places of the blocks.

The springs between blocks pull along the lines between them, by what these are longer than the
lattice's pitch. Their sum on a block, divided by the stretch at which a block lets go (mu_s m g /
k), is its stress: 0 where nothing pulls, 1 where friction is at its limit. A camera does not see
the rim, so what its springs pull at the outer blocks is left out.
"""

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.table import Table


def stress(at: np.ndarray, break_m: float, table: Table = Table()) -> np.ndarray:
    """Return the stress of each block, (cells,); NaN where a neighbour's place is not known.

    at: (cells, 2) places, m; break_m: stretch of one spring that breaks a block loose, m.
    """
    first, second = table.springs[table.springs[:, 1] >= 0].T
    pitch_m = np.where(second - first == 1, *table.pitch_m)  # along a row, or from row to row
    way = at[second] - at[first]
    length = elementary.hypot(*way.T)
    pull = way * ((length - pitch_m) / np.maximum(length, 1e-9))[:, None]
    total = np.zeros((table.cells, 2))
    np.add.at(total, first, pull)
    np.subtract.at(total, second, pull)
    return elementary.hypot(*total.T) / break_m
