# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from eol_msgs.msg import Block, Blocks
from rclpy.serialization import deserialize_message, serialize_message

from eol_ros.ros.blocks import RECORD, blocks_from_cdr, pack_blocks

NAMES = ('x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility')


@pytest.fixture
def record():
    random = np.random.default_rng(4)
    record = np.zeros(25, RECORD)
    for name in NAMES:
        record[name] = random.normal(size=25)
    record['seen'] = random.random(25) < 0.5
    return record


def test_packed_bytes_are_what_rclpy_reads(record):
    raw = pack_blocks(12_000_000_345, Blocks.TRACKING, True, 77, record)
    message = deserialize_message(raw, Blocks)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    assert message.header.frame_id == 'table'
    assert (message.state, message.symmetry_ambiguous, message.image) == (1, True, 77)
    assert [b.id for b in message.blocks] == list(range(25))
    for name in NAMES:
        assert [getattr(b, name) for b in message.blocks] == record[name].tolist()
    assert [b.seen for b in message.blocks] == record['seen'].tolist()
    assert len(raw) == len(serialize_message(message))


def test_reads_what_rclpy_writes(record):
    message = Blocks(state=2, image=5)
    message.header.frame_id = 'table'
    message.header.stamp = Time(sec=3, nanosec=9)
    message.blocks = [
        Block(id=i, seen=bool(r['seen']), **{name: float(r[name]) for name in NAMES})
        for i, r in enumerate(record)
    ]
    read = blocks_from_cdr(serialize_message(message))
    assert (read.stamp_ns, read.state, read.symmetry_ambiguous, read.image) == (
        3_000_000_009, 2, False, 5,
    )  # fmt: skip
    for name in (*NAMES, 'seen'):
        assert np.array_equal(read.blocks[name], record[name])


def test_anything_else_is_refused():
    message = Blocks()
    message.header.frame_id = 'table'
    with pytest.raises(ValueError, match='25 blocks'):
        blocks_from_cdr(serialize_message(message))
