# SPDX-License-Identifier: Apache-2.0
"""Blocks as arrays, against the definition and against the serialiser of rclpy."""

from pathlib import Path

import numpy as np
import pytest

from eol_ros.core.vision import states
from eol_ros.core.vision.tracker import Tracked
from eol_ros.streams import blocks
from eol_ros.streams.cdr import Decoder
from eol_ros.streams.definition import parse

MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'eol_msgs' / 'msg'
NAMES = ('x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility')


@pytest.fixture
def messages():
    return pytest.importorskip('eol_msgs.msg')


@pytest.fixture
def codec(messages):
    from eol_ros.ros.definitions import definition

    return blocks.Codec(definition(blocks.TYPE))


@pytest.fixture
def rows():
    random = np.random.default_rng(4)
    rows = np.zeros(25, blocks.BLOCK)
    for name in NAMES:
        rows[name] = random.normal(size=25)
    rows['seen'] = random.random(25) < 0.5
    return rows


def test_the_dtypes_are_those_of_the_definition():
    text = (MESSAGES / 'Block.msg').read_text()
    decoder = Decoder('eol_msgs/msg/Block', text)
    assert decoder.dtype('eol_msgs/Block') == blocks.BLOCK
    whole = parse((MESSAGES / 'Blocks.msg').read_text(), blocks.TYPE)['eol_msgs/Blocks']
    assert blocks.dtype().names == ('stamp', *(f.name for f in whole.fields[1:]))


def test_the_states_are_those_of_the_definition(messages):
    for name in states.STATES:
        name = name.upper()
        assert getattr(states, name) == getattr(messages.Blocks, f'STATE_{name}')


def test_packed_bytes_are_what_rclpy_reads(codec, messages, rows):
    from rclpy.serialization import deserialize_message, serialize_message

    raw = codec.pack(12_000_000_345, messages.Blocks.STATE_TRACKING, True, 77, rows)
    message = deserialize_message(raw, messages.Blocks)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    assert message.header.frame_id == 'table'
    assert (message.state, message.symmetry_ambiguous, message.image) == (1, True, 77)
    assert [b.id for b in message.blocks] == list(range(25))
    for name in NAMES:
        assert [getattr(b, name) for b in message.blocks] == rows[name].tolist()
    assert [b.seen for b in message.blocks] == rows['seen'].tolist()
    assert len(raw) == len(serialize_message(message))  # it leaves what pads undefined


def test_reads_what_rclpy_writes(codec, messages, rows):
    from builtin_interfaces.msg import Time
    from rclpy.serialization import serialize_message

    message = messages.Blocks(state=2, image=5)
    message.header.frame_id = 'table'
    message.header.stamp = Time(sec=3, nanosec=9)
    message.blocks = [
        messages.Block(id=i, seen=bool(r['seen']), **{name: float(r[name]) for name in NAMES})
        for i, r in enumerate(rows)
    ]
    read = codec.read(serialize_message(message))
    assert (read.stamp_ns, read.state, read.symmetry_ambiguous, read.image) == (
        3_000_000_009, 2, False, 5,
    )  # fmt: skip
    for name in (*NAMES, 'seen'):
        assert np.array_equal(read.rows[name], rows[name])


def test_frames_of_any_namespace_are_read_and_written(codec, messages, rows):
    from rclpy.serialization import deserialize_message

    from eol_ros.ros.definitions import definition

    for k, prefix in enumerate(('north/', 'a/', 'museum/north/', 'x1/', 'x22/', 'x333/')):
        other = blocks.Codec(definition(blocks.TYPE), prefix)
        raw = other.pack(12_000_000_345, 1, False, k, rows)
        assert deserialize_message(raw, messages.Blocks).header.frame_id == f'{prefix}table'
        for reader in (codec, other):
            read = reader.read(raw)
            assert (read.stamp_ns, read.image) == (12_000_000_345, k)
            assert np.array_equal(read.rows['x'], rows['x'])
    assert codec.read(codec.pack(1, 1, False, 9, rows)).image == 9


@pytest.mark.parametrize(
    'raw',
    [b'', b'\0\1\0\0', bytes(17), b'\0\1\0\0' + b'\xff' * 40, ('floor', 25), ('mytable', 25),
     ('camera', 25), ('table', 24)],
)  # fmt: skip
def test_anything_else_is_refused(codec, messages, raw):
    from rclpy.serialization import serialize_message

    if isinstance(raw, tuple):
        message = messages.Blocks(blocks=[messages.Block()] * raw[1])
        message.header.frame_id = raw[0]
        raw = serialize_message(message)
    with pytest.raises(ValueError, match='25 blocks'):
        codec.read(raw)


def test_a_packed_message_stays_as_it_is_while_the_next_is_written(codec, rows):
    first = codec.pack(1, 1, False, 1, rows)
    read = codec.read(first)
    codec.rows['x'] = 7.0
    second = codec.pack(2, 1, False, 2, codec.rows)
    assert np.array_equal(read.rows['x'], rows['x'])
    assert (codec.read(second).rows['x'] == 7.0).all()
    assert np.array_equal(codec.read(second).rows['y'], rows['y'])


def answer(random, state):
    return Tracked(
        1.0, random.normal(size=(25, 2)), random.normal(size=25), random.normal(size=(25, 2)),
        random.random(25) < 0.5, random.random(25), random.random(25).astype('f4'), state, True,
    )  # fmt: skip


def test_live_and_offline_rows_are_the_same(codec, messages):
    """What the node sends and the bag's decoder reads is what `of` makes, field by field."""
    from eol_ros.ros.definitions import definition

    random, sent, made = np.random.default_rng(9), [], []
    for k in range(5):
        tracked = answer(random, k)
        rows = blocks.rows_of(tracked, codec.rows)
        stamp_ns = 1_700_000_000_123_456_789 + k
        sent.append(codec.pack(stamp_ns, tracked.state, tracked.symmetry_ambiguous, k, rows))
        made.append(blocks.of(stamp_ns, tracked, k))
        assert np.array_equal(made[-1]['blocks']['x'], tracked.world[:, 0])
        assert np.array_equal(made[-1]['blocks']['v'], tracked.px[:, 1])
    table = Decoder(blocks.TYPE, definition(blocks.TYPE)).table(sent)
    for name in blocks.dtype().names:
        assert np.array_equal(table[name], np.array(made)[name])
    for k, block in enumerate(blocks.each(table)):
        assert (block.stamp_ns, block.state, block.image) == (1_700_000_000_123_456_789 + k, k, k)
        seen = made[k]['blocks']['seen']
        assert np.array_equal(block.known, seen if k == states.TRACKING else np.zeros(25, bool))
