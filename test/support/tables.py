# SPDX-License-Identifier: Apache-2.0
"""Tables beside that of the paper, for tests of what must work on any."""

import pytest

from eol_ros.core.table import Table

RING = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))
OBLONG = Table(rows=3, columns=4)
UNEVEN = Table(rows=4, columns=4, gap_m=0.06, gap_y_m=0.1, absent=(12,))
SMALL = Table(rows=3, columns=3, block_side_m=0.06, gap_m=0.06, platform_m=(0.7, 0.7))
LARGE = Table(rows=8, columns=8, platform_m=(1.8, 1.8))
TABLES = {'5x5': Table(), 'ring': RING, '3x4': OBLONG, 'uneven': UNEVEN, 'small': SMALL}

THREE = '5x5', '3x4', 'ring'
on_tables = pytest.mark.parametrize('table', [TABLES[name] for name in THREE], ids=THREE)
