# SPDX-License-Identifier: Apache-2.0
import json
import math

import numpy as np
import pytest
from support.vision_bound import position_bound_px

from benchmarks.vision_scenes import Film
from eol_ros import cli
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

pytestmark = pytest.mark.slow


@pytest.mark.parametrize('psf', [1.0, 1.6])
def test_the_bound_is_that_of_a_long_edge(psf):
    """Oracle: two edges of length L, variance 2 sqrt(pi) s var / (2 L A^2), var even (by hand)."""
    s, side, step = math.sqrt(psf**2 + 1 / 12), 0.084 * 545, 170.0
    by_hand = math.sqrt(2 * math.sqrt(math.pi) * s * (4 + 1 / 12) / (2 * side * step**2))
    assert position_bound_px(2.0, 0.0, psf) == pytest.approx(by_hand, rel=0.05)


def test_films_and_noise_levels_are_measured(capsys, tmp_path):
    line = 'bench vision --images 2 --seconds 0.5 --seeds 1 --levels ordinary --json --plots'
    assert cli.main([*line.split(), str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['machine']['vector_bits'] >= 128
    film = result['clutter']['ordinary']['seed 11']
    assert film['eol_ros']['coverage'] == 1
    assert film['eol_ros']['rms_px'] < 0.05
    for entry in result['noise'].values():
        ours = entry['methods']['eol_ros']
        assert ours['false_per_image'] == 0
        assert ours['coverage'] == 1
        # nobody beats the bound by more than chance allows: 100 numbers, 7 % each way
        assert all(m['rms_px'] > 0.75 * entry['bound_px'] for m in entry['methods'].values())
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        'vision_clutter.png',
        'vision_noise.png',
        'vision_time.png',
    ]
    assert all(np.isfinite(m['ms_median']) for m in film.values())


@pytest.mark.parametrize('seed', [50010, 50013])  # arms hide two borders, and sand glitters beyond
def test_a_glittering_table_is_named_right_from_the_first_image_on(seed):
    film = Film('glittering', 'L2', seed)
    tracker = Tracker(TrackerSettings(), film.calibration)
    image, pose, _ = film.image(0)
    found = tracker.update(0.0, image)
    assert found.seen.sum() > 15
    assert np.hypot(*(found.world - pose[:, :2]).T)[found.seen].max() < 0.01
