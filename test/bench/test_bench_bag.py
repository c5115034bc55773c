# SPDX-License-Identifier: Apache-2.0
"""The benchmark of decoding compares what it measures."""

import numpy as np
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


@pytest.mark.parametrize(
    ('column', 'change'),
    [
        ('x', lambda value: np.nextafter(value, 9.0)),
        ('kind', lambda value: 3 - value),
        ('onset', lambda value: value + np.timedelta64(1, 'ns')),
        ('stamp', lambda value: value - np.timedelta64(1, 'ns')),
        ('frame_id', lambda value: value[::-1]),
        ('tapped', lambda value: not value),
    ],
)
def test_one_wrong_value_is_told(sample, column, change):
    topic = sample.topics['/eol/slips']
    raw = [message.data for message in sample.messages(['/eol/slips'])][:20]
    decode = bench.rosbags(topic.type, topic.definition)
    columns = sample.decoder('/eol/slips').table(raw)
    peers = [decode(data) for data in raw]
    assert bench.agree(columns, peers)
    wrong = columns[column].copy()
    wrong[7] = change(wrong[7])
    assert not bench.agree(columns | {column: wrong}, peers)
