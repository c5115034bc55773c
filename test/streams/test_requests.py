# SPDX-License-Identifier: Apache-2.0
"""Requests as data: what they take, and what a recording says of them."""

import numpy as np
import pytest

from eol_ros.errors import UsageError
from eol_ros.settings import live_fields
from eol_ros.streams.graph import NODES, TOPICS
from eol_ros.streams.requests import (
    KINDS,
    PEOPLE,
    PROVED,
    Asked,
    Heeded,
    Number,
    ahead,
    recorded,
    value_of,
)

VALUE = np.dtype(
    [('type', 'u1'), ('bool_value', '?'), ('integer_value', 'i8'), ('double_value', 'f8'),
     ('string_value', object), ('byte_array_value', object), ('bool_array_value', object),
     ('integer_array_value', object), ('double_array_value', object),
     ('string_array_value', object)]
)  # fmt: skip
PARAMETER = np.dtype([('name', object), ('value', VALUE)])


def parameter(name, kind, field, value):
    row = np.zeros((), PARAMETER)
    row['name'], row['value']['type'], row['value'][field] = name, kind, value
    return row[()]


def column(items):
    out = np.empty(len(items), object)
    out[:] = items
    return out


def times(*values):
    return np.array(values, 'datetime64[ns]')


def test_who_heeds_requests_takes_the_topic_and_answers():
    for kind in KINDS.values():
        for node in kind.nodes:
            assert 'requests' in NODES[node].subscribes, (kind.name, node)
            assert node in TOPICS['request_results'].publishers
        assert not kind.answered_by or kind.answered_by in NODES
    live = {n for n, row in NODES.items() if live_fields(row.settings)}
    assert set(KINDS['set'].nodes) == live - {'replay'}  # it gives those of its bag
    assert set(PEOPLE) <= set(KINDS) and set(PROVED) <= set(KINDS['set'].nodes)


@pytest.mark.parametrize(
    ('kind', 'values', 'words'),
    [
        ('sleep', {'now': 1}, 'now: sleep takes nothing'),
        ('play_grain', {}, 'grain: missing'),
        ('play_grain', {'grain': 1.5}, 'grain: 1.5 is not a whole number'),
        ('play_grain', {'grain': True}, 'grain: True is not a number'),
        ('move_grain', {'grain': 1, 'x': 2, 'y': 0}, 'x: 2 is not within 0 to 1'),
        ('move_grain', {'grain': 1, 'x': float('nan'), 'y': 0}, 'x: nan is not a number'),
    ],
)
def test_what_a_request_takes_is_checked(kind, values, words):
    with pytest.raises(UsageError) as caught:
        KINDS[kind].check(values)
    assert str(caught.value) == words


def test_numbers_keep_their_kind():
    values = KINDS['move_grain'].check({'grain': 3.0, 'x': 1, 'y': 0.5})
    assert values == {'grain': 3, 'x': 1.0, 'y': 0.5}
    assert type(values['grain']) is int and type(values['x']) is float
    assert Number('n', 0, 1).check(1) == 1.0


@pytest.mark.parametrize(
    ('kind', 'field', 'value'),
    [(1, 'bool_value', True), (2, 'integer_value', 2**40), (3, 'double_value', 0.1),
     (4, 'string_value', 'ice'), (9, 'string_array_value', ('a', 'b'))],
)  # fmt: skip
def test_values_of_parameters(kind, field, value):
    row = parameter('x', kind, field, value if not isinstance(value, tuple) else list(value))
    got = value_of(row['value'])
    assert got == value and type(got) is type(value)
    assert value_of(np.zeros((), VALUE)[()]) is None  # not set


def test_a_recording_says_what_was_asked_and_what_was_accepted():
    radius = np.array([parameter('radius', 3, 'double_value', 0.1)])
    none = np.zeros(0, PARAMETER)
    requests = {
        'id': np.array(['a', 'b', 'c']), 'source': np.array(['panel', 'tracker', 'panel']),
        'node': np.array(['grains', 'tracker', '']),
        'kind': np.array(['set', 'background', 'sleep']),
        'values': column([radius, none, none]),
        'data': column([np.zeros(0, 'u1'), np.frombuffer(b'PNG', 'u1'), np.zeros(0, 'u1')]),
        'from_stamp': times(0, 7, 0), 'log_time': times(10, 20, 30),
    }  # fmt: skip
    results = {
        'id': np.array(['a', 'b', 'c', 'c', 'x']),
        'node': np.array(['grains', 'tracker', 'leds', 'sound', 'motion']),
        'kind': np.array(['set', 'background', 'sleep', 'sleep', 'set']),
        'values': column([radius, none, none, none, radius]),
        'accepted': np.array([True, True, True, False, False]),
        'from_stamp': times(12, 7, 0, 0, 0), 'log_time': times(11, 21, 31, 32, 33),
    }  # fmt: skip
    found = recorded(requests, results)
    accepted = [h.asked for h in found if h.accepted]
    assert [(a.node, a.kind, a.values, a.data, a.from_ns) for a in accepted] == [
        ('grains', 'set', {'radius': 0.1}, b'', 12),
        ('tracker', 'background', {}, b'PNG', 7),
        ('leds', 'sleep', {}, b'', 0),
    ]
    assert [h.log_ns for h in found] == sorted(h.log_ns for h in found)
    assert [h.asked.source for h in found if not h.accepted] == ['panel', 'tracker', 'panel']


def test_before_a_later_start_only_what_still_holds_is_asked():
    def heeded(log_ns, kind, node, **values):
        return Heeded(Asked(kind, node, values, from_ns=log_ns), log_ns, True)

    lines = [
        heeded(1, 'set', 'grains', radius=0.1),
        heeded(2, 'set', 'grains', radius=0.2),
        heeded(3, 'set', 'grains', gain=0.5),
        heeded(4, 'calibrate', 'tracker'),
        heeded(5, 'set', 'sound', gain_db=-3.0),
        heeded(6, 'set', 'motion', stop_mps=0.002),
        Heeded(Asked('set', 'motion', {'stop_mps': 9.0}), 7, False),
        heeded(8, 'move_grain', 'grains', grain=3, x=0.5, y=0.5),
    ]
    assert [a.from_ns for a in ahead(lines, 0)] == [1, 2, 3, 4, 6]
    assert [a.from_ns for a in ahead(lines, 5)] == [2, 3, 6]


def test_a_mask_of_the_largest_table_survives_a_message():
    from eol_ros.ros.requests import request_from_msg, request_to_msg

    mask = f'{(1 << 225) - 1 - (1 << 200):x}'
    asked = Asked('infrared', 'twin', {'mask': mask})
    kept = request_from_msg(request_to_msg(asked, 1)).values
    assert KINDS['infrared'].check(kept) == {'mask': mask}
    for wrong in (7, '', '0x7', 'FF', 'g', '-1', 'f' * 65, '7\n'):
        with pytest.raises(UsageError, match='mask: .* is not a number in hex'):
            KINDS['infrared'].check({'mask': wrong})
