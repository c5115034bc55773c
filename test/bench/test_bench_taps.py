# SPDX-License-Identifier: Apache-2.0
"""eol bench taps: its comparison on reports made here, its bound, and one short run."""

import json

import pytest
from support.true_slips import Slip, compare

from benchmarks import taps
from eol_ros import cli
from eol_ros.devices.board import block


def slip(onset_s, block, length_mm=3.0, whole=400.0):
    return Slip(onset_s, block, onset_s + 0.15, 1e-3 * length_mm, 1.0, whole, whole)


def test_each_report_is_right_or_false_for_a_reason():
    slips = [slip(1.0, 3), slip(2.0, 3, 0.5), slip(3.0, 7, 1.5), slip(4.0, 8)]
    told = [
        (1.001, 3, 1.002), (1.0015, 3, 1.002),  # the second names a slip that has been named
        (1.08, 3, 1.08), (1.151, 3, 1.151),  # in mid-slip, and where it stops
        (2.5, 3, 2.5), (1.0, 4, 1.0),  # at rest; another block
        (2.999, 7, 3.004),
    ]  # fmt: skip
    row = compare(slips, told, 3600.0)

    assert (row['over_1mm']['slips'], row['over_1mm']['found']) == (3, pytest.approx(2 / 3))
    assert (row['0-1mm']['slips'], row['0-1mm']['found']) == (1, 0)
    false = [row[f'false_{name}_per_h'] for name in ('stops', 'sliding', 'struck')]
    assert false == [1, 2, 2] and row['false_per_h'] == 5
    assert row['onset_rms_ms'] == pytest.approx(1.0)
    assert row['felt_p50_ms'] == pytest.approx(3.0)


@pytest.mark.slow
@pytest.mark.skipif(not block.compiled(), reason='python setup.py build_ext --inplace')
def test_it_runs(capsys):
    words = ['--minutes', '0.4', '--drops', '0.25', '--thresholds', '16,1000', '--json']
    assert cli.run_verb(taps, 'eol bench taps', words) == 0
    found = json.loads(capsys.readouterr().out)
    usual, deaf = found['curve']
    assert usual['over_2mm']['slips'] > 50 and usual['over_2mm']['found'] > 0.97
    assert deaf['over_2mm']['found'] < 0.5
    assert found['default_mg'] == 16
