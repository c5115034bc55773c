# SPDX-License-Identifier: Apache-2.0
"""eol bench sizes: what it asks is what the report asks, of a table of its own size."""

import numpy as np
import pytest

from benchmarks import sizes
from eol_ros.core.science import powerlaw


def test_a_small_table_has_cascades_light_and_no_law_of_nine_blocks():
    row = sizes.measure(3, 30.0, 2)
    assert row['blocks'] == 9 and row['cascades'] > 5 and 0 < row['all'] < 1
    assert 'no power law can be seen' in row['no_law'] or 'too few' in row['no_law']
    assert row['energy_1f'] == row['slips_1f'] == 'undecided' and 'too short' in row['slips_said']
    assert row['moments'] >= 30 and len(row['measures']) == 8


def test_the_law_is_that_of_the_size_of_the_table():
    areas = powerlaw.sample(1.6, 1, 64, 2000, np.random.default_rng(1)).tolist()
    found = sizes._law(areas, 64)
    assert found['b'] == pytest.approx(0.6, abs=0.05) and not found['rejected']
    assert 'no decade' in sizes._law(areas, 9)['no_law']


def test_rows_have_means_and_the_spread_of_one_run():
    said = {'energy_1f': 'no', 'slips_1f': 'undecided', 'cascades': 10, 'all': 0.5}
    runs = [
        said | {'side': side, 'blocks': side**2, 'b': b, 'rejected': b > 1}
        for side in sizes.SIDES
        for b in (0.5, 1.5)
    ]
    lines = sizes._table({'seconds': 1.0, 'seeds': [1, 2], 'runs': runs}).splitlines()
    assert len({line.count('|') for line in lines[1:]}) == 1
    assert '| 1.00±0.71 | 1 of 2 |' in lines[3] and '| 0/2/2 |' in lines[3]
