# SPDX-License-Identifier: Apache-2.0
import pytest

from benchmarks import twin_slips
from benchmarks.twin_slips import TrueSlip


def test_recall_asks_for_slips_that_follow_a_short_rest():
    truth = [
        TrueSlip(3.0, 3.2, 7, float('inf'), 10**6),
        TrueSlip(3.24, 3.5, 7, 0.04, 2),  # found by the old definition only
        TrueSlip(3.51, 3.7, 7, 0.01, 1),  # nobody asks for it
        TrueSlip(4.0, 4.2, 8, float('inf'), 10**6),
    ]
    found = [(7, 3.001, 3.02), (8, 4.003, 4.02), (8, 6.0, 6.02)]
    row = twin_slips.compare(found, truth, 60.0, (2.0, 9.0))
    assert row['slips'] == 3
    assert row['recall'] == pytest.approx(2 / 3)
    assert row['precision'] == pytest.approx(2 / 3)
    assert row['start_rms_ms'] == pytest.approx((5.0) ** 0.5)
    assert row['recall_low'] < 2 / 3
