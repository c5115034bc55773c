# SPDX-License-Identifier: Apache-2.0
"""The parser of message definitions, on text and against what rclpy says of the same types."""

import re
from pathlib import Path

import pytest

from eol_ros.streams.definition import PRIMITIVES, parse, references

MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'eol_msgs' / 'msg'
TEXT = """
# geometry_msgs/Point not_a_field
uint8 KIND=1            # a constant
string WORD="a # b"
bool ON = true
float32 HALF=0.5
int8 BELOW=-3
std_msgs/Header header  # of the message
Point[4] corners
eol_msgs/Block[<=25] blocks   ## all of them
string<=5 word "as given"
byte[<=9] data # d
float64[] x
"""


def test_fields_and_types_that_they_refer_to():
    message = parse(TEXT, 'geometry_msgs/msg/Made')['geometry_msgs/Made']
    assert message.fields == [
        ('header', 'std_msgs/Header', None, 'of the message'),
        ('corners', 'geometry_msgs/Point', 4, ''),
        ('blocks', 'eol_msgs/Block', -1, 'all of them'),
        ('word', 'string', None, ''),
        ('data', 'byte', -1, 'd'),
        ('x', 'float64', -1, ''),
    ]
    assert [f.plain for f in message.fields] == [False, False, False, False, True, True]
    assert references(message) == [
        'std_msgs/msg/Header',
        'geometry_msgs/msg/Point',
        'eol_msgs/msg/Block',
    ]


def test_a_schema_holds_several_types():
    line = '=' * 80
    text = f'Part part\n{line}\nMSG: a_msgs/Part\nint8 ONE=1\nuint8 id  # 0..24\n'
    types = parse(text, 'a_msgs/msg/Whole')
    assert list(types) == ['a_msgs/Whole', 'a_msgs/Part']
    assert types['a_msgs/Part'].fields == [('id', 'uint8', None, '0..24')]


@pytest.mark.parametrize('path', sorted(MESSAGES.glob('*.msg')), ids=lambda path: path.stem)
def test_ours_are_read_as_the_generator_of_ros_read_them(path):
    """rclpy's classes, made from the same files by rosidl, are the witness."""
    messages = pytest.importorskip('eol_msgs.msg')
    kind = getattr(messages, path.stem)
    message = parse(path.read_text(), f'eol_msgs/msg/{path.stem}')[f'eol_msgs/{path.stem}']
    theirs = kind.get_fields_and_field_types()
    names = {'float32': 'float', 'float64': 'double', 'bool': 'boolean'}
    for field, (name, text) in zip(message.fields, theirs.items(), strict=True):
        ours = names.get(field.type, field.type)
        if field.length is not None:
            ours = f'sequence<{ours}>' if field.length < 0 else f'{ours}[{field.length}]'
        assert (field.name, ours) == (name, re.sub(r', \d+>', '>', text))  # without its bound
        assert field.plain == (field.type in PRIMITIVES)


def test_only_line_ends_of_ascii_end_a_line():
    text = 'float64 x  # far\u2028int32 y\x85int32 z\r\nuint8 k\r\n===\r\nMSG: a/B\r\nbool c\r\n'
    types = parse(text, 'a/msg/A')
    assert [f.name for f in types['a/A'].fields] == ['x', 'k']
    assert [f.name for f in types['a/B'].fields] == ['c']
