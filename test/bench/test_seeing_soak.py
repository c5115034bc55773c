# SPDX-License-Identifier: Apache-2.0
"""The long figures of seeing; minutes each."""

import pytest

from eol_ros.bench import identity, identity_ties, motion
from eol_ros.bench.vision_scenes import RATE_HZ, run_film

pytestmark = pytest.mark.soak


def test_ten_hours_of_arms_bring_no_wrong_name_that_was_not_told():
    figures = identity.measure({'lattice': identity.make('lattice')}, 10.0, 60.0, 21)['lattice']
    assert figures['undeclared_per_hour'] == 0
    assert figures['lasting_failures_per_hour'] <= 1
    assert figures['switches_per_hour'] <= 50
    assert figures['mislabelled_percent'] <= 0.02


def test_ten_thousand_ties_are_never_settled_wrongly():
    figures = identity_ties.measure(10_000, 1, 0.001)
    assert figures['wrong_decisions'] == 0
    assert figures['decided_by_5_slips_percent'] >= 98


def test_a_minute_of_hard_film_loses_no_block_and_invents_none():
    ours = run_film('hard', 'L2', 11, round(60 * RATE_HZ), peers=False)['eol_ros']
    assert ours['coverage'] >= 0.995
    assert ours['false_per_image'] == 0
    assert ours['hidden_reported'] == 0
    assert ours['rms_partly_px'] < 0.25


def test_ten_hours_of_rest_bring_the_stated_false_alarms():
    assert 1 / 1.5 < motion.false_alarms(10.0, 20.0, 60.0, 3)['ratio'] < 1.5
