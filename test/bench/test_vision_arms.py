# SPDX-License-Identifier: Apache-2.0
"""Slips of a block that slides are found, and arms over resting covers make hardly any."""

import json

import pytest

from eol_ros import cli


@pytest.mark.slow
def test_a_block_that_slides_is_seen_to_slide_as_far(capsys):
    """Image and truth agree: no arm, nothing but true slips, and all of them."""
    line = 'bench vision --arms none --surfaces relief --seconds 6 --seeds 1 --json'
    assert cli.main(line.split()) == 0
    found = json.loads(capsys.readouterr().out)['arms']['relief']['none']

    assert found['false_slips'] == 0
    assert found['true_whole']['found'] == found['true_whole']['slips'] > 2
    assert found['true_whole']['size_error_mm'] < 0.15
    assert found['rms_px'] < 0.1


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
