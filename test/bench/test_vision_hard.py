# SPDX-License-Identifier: Apache-2.0
"""Hard videos: covers are found among sparkling grains, lamps and arms."""

import json

import pytest

from benchmarks.vision_scenes import OURS
from eol_ros import cli


@pytest.mark.slow
def test_flat_covers_are_found_among_sparkling_grains_and_lamps_are_not(capsys):
    line = 'bench vision --hard glittering --surfaces flat --seconds 1 --seeds 1 --json'
    assert cli.main(line.split()) == 0
    found = json.loads(capsys.readouterr().out)['hard']['flat']['glittering'][OURS]

    assert found['coverage'] > 0.98 and found['whole_beyond_2px'] == 0
    assert found['false_per_image'] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ('seed', 'coverage', 'whole', 'partly'), [(1200, 0.9, 0, 1), (1228, 0.999, 2, 20)]
)
def test_arms_hardly_lead_a_printed_cover_that_rests(capsys, seed, coverage, whole, partly):
    """Lamps beside blocks from the first image on keep some from being learned (seed 1200)."""
    line = 'bench vision --hard brutal --surfaces relief --seconds 3 --seeds 1 --no-peers --json'
    assert cli.main([*line.split(), '--first-seed', str(seed)]) == 0
    found = json.loads(capsys.readouterr().out)['hard']['relief']['brutal'][OURS]

    assert found['whole_beyond_2px'] <= whole and found['partly_beyond_2px'] <= partly
    assert found['coverage'] > coverage
