# SPDX-License-Identifier: Apache-2.0

from benchmarks import tables


def test_a_small_table_is_seen_and_its_slips_are_found():
    row = tables.measure(3, 6.0, 2)
    assert row['blocks'] == 9 and row['start'] == 0
    assert row['whole'] == 1.0 and row['names'] == 0 and row['mm'] < 0.05
    assert row['slips'] > 3 and row['recall'] > 0.9 and row['precision'] > 0.9
    text = tables.table_of({'rows': [row]}).splitlines()
    assert len({line.count('|') for line in text}) == 1
