# SPDX-License-Identifier: Apache-2.0
"""The table of the paper under short names, for tests and benchmarks that need no other."""

import numpy as np

from eol_ros.core.table import Table
from eol_ros.settings import TwinSettings

TABLE = Table()
ROWS, COLS, N_BLOCKS = TABLE.rows, TABLE.columns, TABLE.cells
BLOCK_SIDE_M, BODY_HEIGHT_M = TABLE.block_side_m, TABLE.body_height_m
BLOCK_MASS_KG = TwinSettings.block_kg
SPRING_M, PITCH_M = TABLE.gap_m, TABLE.pitch_m[0]
RIM_SIDE_M, RIM_BAR_M = TABLE.rim_m()[0], TABLE.rim_width_m
PLATFORM_SIDE_M, RIM_REACH_M = TABLE.platform_m[0], TABLE.reach_m[0]
spring_ends, neighbours = TABLE.spring_ends, TABLE.neighbours


def rest_lattice() -> np.ndarray:
    """Return the places of the blocks at rest, (25, 2) m, to be changed at will."""
    return TABLE.rest.copy()


def turned(xy, angle):
    """Return places (n, 2) turned about the centre, anticlockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])
