# SPDX-License-Identifier: Apache-2.0
"""Arms over resting covers: what the bench calls a true slip, and a false one, is told rightly."""

import json

import numpy as np
import pytest

from benchmarks import vision_arms
from eol_ros import cli
from eol_ros.core.motion.slips import START, SlipEvent


def start(block, onset_s, stamp_s):
    return SlipEvent(START, 1, block, stamp_s, onset_s, 0.001, 0.0, 0.0, 0.1)


def test_a_slip_is_told_once_soon_or_when_it_is_in_sight_again():
    slip = vision_arms.Slip(7, 3.0, 0.1, np.array([0.002, 0.0]), 1.0, seen_s=3.0)
    assert not vision_arms._explained(start(8, 3.0, 3.02), [slip])
    assert not vision_arms._explained(start(7, 2.9, 2.95), [slip])
    assert vision_arms._explained(start(7, 3.01, 3.03), [slip])
    assert not vision_arms._explained(start(7, 3.01, 3.03), [slip])  # the same once more
    unseen = vision_arms.Slip(7, 5.0, 0.1, np.array([0.002, 0.0]), 0.1, seen_s=8.0)
    assert vision_arms._explained(start(7, 8.05, 8.1), [slip, unseen])
    late = vision_arms.Slip(7, 9.0, 0.1, np.array([0.002, 0.0]), 1.0, seen_s=9.0)
    assert not vision_arms._explained(start(7, 9.9, 9.95), [slip, unseen, late])


@pytest.mark.slow
@pytest.mark.parametrize('surface', ['flat', 'relief'])
def test_a_block_that_slides_is_seen_to_slide_as_far(surface, capsys):
    """Image and truth agree: no arm, nothing but true slips, and all of them."""
    line = f'bench vision --arms none --surfaces {surface} --seconds 6 --seeds 1 --json'
    assert cli.main(line.split()) == 0
    found = json.loads(capsys.readouterr().out)['arms'][surface]['none']

    assert found['false_slips'] == 0
    assert found['true_whole']['found'] == found['true_whole']['slips'] > 2
    assert found['true_whole']['size_error_mm'] < (0.03 if surface == 'flat' else 0.15)
    assert found['rms_px'] < (0.01 if surface == 'flat' else 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('surface', 'arms', 'seed'), [('flat', 'rough', 43), ('relief', 'dark', 1)]
)
def test_arms_over_resting_blocks_hardly_make_them_slip(surface, arms, seed, capsys):
    line = f'bench vision --arms {arms} --surfaces {surface} --seconds 4 --seeds 1'
    assert cli.main([*line.split(), '--first-seed', str(seed), '--json']) == 0
    found = json.loads(capsys.readouterr().out)['arms'][surface][arms]

    assert found['partly'] > 500
    assert found['false_slips'] <= (2 if arms == 'rough' else 8)
    seen = 0.95 if arms == 'rough' else 0.8 if surface == 'flat' else 0.65
    assert found['coverage_partly'] > seen
    assert found['partly_beyond_2px'] <= (1 if surface == 'relief' else 0)
