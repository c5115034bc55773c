# SPDX-License-Identifier: Apache-2.0
"""Days of exhibition and hours of faults: nothing lost uncounted, nothing grows, all comes back.

`make soak` runs these; EOL_SOAK_HOURS sets how much exhibition (72), EOL_FAULTS_HOURS how long
things are broken (2). `eol bench soak` prints the figures.
"""

import os
import time

import pytest
from support.running import Graph, stand_in

from benchmarks import soak, soak_faults
from eol_ros.analysis import open_bag

HOURS = float(os.environ.get('EOL_SOAK_HOURS', '72'))
FAULTS_HOURS = float(os.environ.get('EOL_FAULTS_HOURS', '2'))
pytestmark = [pytest.mark.soak, pytest.mark.live, pytest.mark.timeout(86400)]


def test_a_minute_with_every_image_kept_loses_none(tmp_path):
    path = stand_in('rehearsal', tmp_path, film=None, bag=None)
    path.write_text(path.read_text().replace('around_slips', 'all'))
    with Graph(path, tmp_path / 'bags') as graph:
        graph.wait_until_ok()
        graph.mark()
        time.sleep(60)
        figures = graph.figures()
        assert graph.stop() == 0
    assert figures['lost'] == {'tracker': 0, 'recorder': 0}
    assert figures['images_per_s'] == pytest.approx(60, abs=0.02)
    bag = open_bag(next(p for p in (tmp_path / 'bags').iterdir() if p.is_dir()))
    assert bag.counts['/eol/camera/image_raw'] >= 3600


def test_days_of_exhibition(tmp_path):
    assert soak.exhibition(tmp_path, HOURS)['faults'] == []


def test_hours_of_faults(tmp_path):
    assert soak_faults.measure(tmp_path, FAULTS_HOURS, 7)['faults'] == []
