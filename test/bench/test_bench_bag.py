# SPDX-License-Identifier: Apache-2.0
"""The benchmark of decoding compares what it measures."""

import pytest

from benchmarks import bag as bench
from eol_ros.analysis.bag import open_bag


@pytest.fixture(scope='module')
def sample():
    return open_bag(bench.SAMPLE)


def test_both_peers_find_the_values_of_every_topic(sample):
    for name, count in sample.counts.items():
        if 0 < count < 600:  # a row each; the long topics have the same types of fields
            row = bench.measure_topic(sample, name, 1)
            assert row['messages'] == count
            assert row['mcap_ros2_agrees'] and row['rosbags_agrees'], name
