# SPDX-License-Identifier: Apache-2.0
"""The decoder against bytes packed by hand, and against mcap-ros2-support as a witness."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros.errors import ConfigError
from eol_ros.streams.cdr import NS, Decoder, Fixed, stamp_ns

HEADER = """\
std_msgs/Header header   # of the message
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: made_msgs/Part
uint8 id       # 0..24
float64 x      # m
string name
uint16[] codes
bool on
"""
KINDS = {
    'bool': st.booleans(),
    'uint8': st.integers(0, 255),
    'int16': st.integers(-(2**15), 2**15 - 1),
    'uint32': st.integers(0, 2**32 - 1),
    'int64': st.integers(-(2**63), 2**63 - 1),
    'float32': st.floats(width=32, allow_nan=False),
    'float64': st.floats(allow_nan=False),
    'string': st.text(max_size=9).filter(lambda s: '\0' not in s),
}
LENGTHS = ('', '[3]', '[]', '[<=5]')


def definition(fields):
    return HEADER.format(fields='\n'.join(fields))


@st.composite
def made_types(draw):
    """A definition, and messages of it as plain data."""
    chosen = draw(
        st.lists(
            st.tuples(st.sampled_from([*KINDS, 'made_msgs/Part']), st.sampled_from(LENGTHS)),
            max_size=6,
        )
    )
    fields = [f'{kind}{length} f{i}' for i, (kind, length) in enumerate(chosen)]
    part = st.fixed_dictionaries(
        {
            'id': KINDS['uint8'],
            'x': KINDS['float64'],
            'name': KINDS['string'],
            'codes': st.lists(st.integers(0, 65535), max_size=4),
            'on': KINDS['bool'],
        }
    )

    def value(kind, length):
        one = part if kind == 'made_msgs/Part' else KINDS[kind]
        if not length:
            return one
        return st.lists(one, min_size=3 if length == '[3]' else 0, max_size=3)

    message = st.fixed_dictionaries({f'f{i}': value(*c) for i, c in enumerate(chosen)})
    head = st.fixed_dictionaries(
        {
            'stamp': st.fixed_dictionaries(
                {'sec': st.integers(0, 2**31 - 1), 'nanosec': st.integers(0, 999_999_999)}
            ),
            'frame_id': KINDS['string'],
        }
    )
    rows = draw(st.lists(st.tuples(head, message), min_size=1, max_size=6))
    return definition(fields), [{'header': h, **m} for h, m in rows]


def plain(value):
    """Arrays and records as lists and dictionaries."""
    if isinstance(value, np.void):
        return {name: plain(value[name]) for name in value.dtype.names}
    if isinstance(value, (np.ndarray, list)):
        return [plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


@settings(max_examples=25, deadline=None)
@given(made_types())
def test_any_type_reads_back_what_an_independent_writer_wrote(made):
    dynamic = pytest.importorskip('mcap_ros2._dynamic')
    text, messages = made
    write = dynamic.serialize_dynamic('made_msgs/msg/Made', text)['made_msgs/msg/Made']
    written = [write(m) for m in messages]
    columns = Decoder('made_msgs/msg/Made', text).table(written)
    for row, message in enumerate(messages):
        stamp = message['header']['stamp']
        assert columns['stamp'][row].astype('i8') == stamp['sec'] * 10**9 + stamp['nanosec']
        assert columns['frame_id'][row] == message['header']['frame_id'].rstrip('\0')
        for name, value in message.items():
            if name != 'header':
                assert plain(columns[name][row]) == value


def test_bytes_packed_by_hand():
    text = 'uint8 a\nfloat64 b # m, of it\nuint16[] c\n'
    row = b'\0\1\0\0' + struct.pack('<B7xdI3H', 5, 2.5, 3, 7, 8, 9)
    columns = Decoder('x_msgs/msg/X', text).table([row, row])
    assert columns['a'].tolist() == [5, 5]
    assert columns['b'].tolist() == [2.5, 2.5]
    assert columns['c'].tolist() == [[7, 8, 9]] * 2


def test_comments_come_with_their_names():
    decoder = Decoder('made_msgs/msg/Made', definition(['made_msgs/Part[] parts  # all of them']))
    assert decoder.comments['parts'] == 'all of them'
    assert decoder.comments['parts.x'] == 'm'
    assert decoder.comments['stamp'] == 'of the message'


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + struct.pack('<dI', 1, 99)])
def test_a_message_that_is_too_short_is_said(data):
    decoder = Decoder('x_msgs/msg/X', 'float64 a\nuint16[] c\n')
    with pytest.raises(ConfigError, match='x_msgs/msg/X'):
        decoder.table([data])


def test_big_endian_is_refused():
    with pytest.raises(ConfigError, match='little-endian'):
        Decoder('x_msgs/msg/X', 'uint32 a\n').table([b'\0\0\0\0\0\0\0\1'])


def test_no_messages_have_columns_all_the_same():
    columns = Decoder('made_msgs/msg/Made', definition(['float64[4] f'])).table([])
    assert columns['f'].shape == (0, 4)
    assert list(columns) == ['stamp', 'frame_id', 'f']


def test_the_stamp_of_a_serialised_message():
    data = b'\0\1\0\0' + struct.pack('<iI', 1_700_000_000, 123)
    assert stamp_ns(data) == 1_700_000_000 * NS + 123


def test_fixed_reads_and_writes_in_place_and_refuses_another_layout():
    dynamic = pytest.importorskip('mcap_ros2._dynamic')
    text = definition(['uint8 a', 'float64 b', 'uint16[] c'])
    write = dynamic.serialize_dynamic('made_msgs/msg/Made', text)['made_msgs/msg/Made']

    def made(sec, nanosec, **values):
        head = {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': 'table'}
        return write({'header': head, 'a': 7, 'b': 2.5, 'c': [8, 9], **values})

    raw = made(12, 34)
    layout = Decoder('made_msgs/msg/Made', text).layout(raw)
    fixed = Fixed(layout, ('header.stamp', 'header.frame_id', 'b', 'a'))
    assert fixed.values(raw) == ((12, 34), b'table', 2.5, 7)

    template = bytearray(raw)
    fixed.writer(template)((56, 78), b'table', -1.0, 9)
    assert bytes(template) == made(56, 78, a=9, b=-1.0)

    longer = made(12, 34, c=[8, 9, 10])
    assert len(longer) > len(raw) and fixed.values(longer) is None
    assert fixed.values(raw[:-1]) is None
    assert fixed.values(b'\0\0' + raw[2:]) is None  # big-endian
