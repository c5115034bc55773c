# SPDX-License-Identifier: Apache-2.0
"""What `eol bench soak` calls growth, loss and damage is that, and nothing else is."""

import json
import struct

import pytest
from support.bag_samples import HASH, QOS, T0

from benchmarks.soak_proof import Held, growth, prove
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter

TRIGGERS = BagTopic('/eol/grain_triggers', 'test_msgs/msg/Trigger', 'uint64 sequence\n', HASH, QOS)


def looks(last, count=200, noise=0.5):
    """Looks at a process that goes evenly from (20, 10, 100) to `last`, once it is warm."""
    first = (20.0, 10.0, 100.0)
    for k in range(count):
        share = max(k / count - 0.1, 0) / 0.9
        values = [a + share * (b - a) for a, b in zip(first, last, strict=True)]
        warming = -40.0 if k < count / 20 else noise * (-1) ** k
        yield {'tracker': Held(values[0], values[1], values[2] + warming)}


@pytest.mark.parametrize(
    ('last', 'flat'),
    [((20, 10, 100), True), ((20, 10, 104), True), ((20, 10, 115), False), ((30, 10, 100), False),
     ((20, 20, 100), False), ((10, 5, 50), True)],
)  # fmt: skip
def test_growth(last, flat):
    [row] = growth(list(looks(last)))
    assert (row['name'], row['flat']) == ('tracker', flat)
    assert row['pss_mb'][1] == pytest.approx(last[2], abs=3)
    grown_mb, low_mb, high_mb = row['growth_mb']
    assert low_mb <= grown_mb <= high_mb
    assert grown_mb == pytest.approx(last[2] - 100, abs=3)


def bag(folder, numbers, counted=0, whole=True):
    writer = BagWriter(folder, [TRIGGERS], {'scene': 'scene: test'})
    for k, number in enumerate(numbers):
        data = b'\0\1\0\0' + struct.pack('<Q', number)
        writer.write('/eol/grain_triggers', data, T0 + k * 10_000_000, T0, k + 1)
    if whole:
        counts = {'lost_before_recorder': {'/eol/grain_triggers': counted}}
        writer.gaps = {name: json.dumps(value) for name, value in counts.items()}
        writer.close()
    else:
        writer.flush()
        writer.abandon()


def test_what_is_missing_is_told_from_what_was_counted(tmp_path):
    bag(tmp_path / 'a', range(100))
    bag(tmp_path / 'b', [0, 1, 5, 6, 0, 1, 4], counted=5)  # its node was started again on the way
    bag(tmp_path / 'c', [0, 1, 2], whole=False)
    found = prove(tmp_path)
    assert found['faults'] == []
    assert (found['count'], found['missing'], found['uncounted'], found['cut']) == (3, 5, 0, 1)
    bag(tmp_path / 'd', [0, 10], counted=4)
    found = prove(tmp_path)
    assert found['uncounted'] == 5
    assert found['faults'] == ['d: 9 triggers missing, 4 counted']
