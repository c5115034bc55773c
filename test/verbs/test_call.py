# SPDX-License-Identifier: Apache-2.0
"""What words of `eol call` and `eol param` mean."""

import pytest

from eol_ros.streams.requests import KINDS
from eol_ros.verbs.call import _types, _values, value_of


@pytest.mark.parametrize(
    ('text', 'kind', 'value'),
    [
        ('off', str, 'off'),  # a filter; YAML has it for false
        ('', str, ''),  # no sound: the ice
        ('120', str, '120'),
        ("'low-pass'", str, 'low-pass'),
        ('off', bool, False),
        ('3', float, 3.0),
        ('3', int, 3),
        ('true', float, True),  # refused by the node, not made 1.0 here
        ('[a 0.5, b 0]', tuple, ['a 0.5', 'b 0']),
        ('a: b: c', str, 'a: b: c'),
    ],
)
def test_text_is_taken_as_it_stands(text, kind, value):
    found = value_of(text, kind)
    assert found == value and type(found) is type(value)


def test_the_types_are_those_of_the_settings_and_requests():
    values = _values(['filter=off', 'gain_db=-3', 'filter_q=2'], _types(KINDS['set'], 'sound'))
    assert values == {'filter': 'off', 'gain_db': -3.0, 'filter_q': 2.0}
    assert _values(['preset=on'], _types(KINDS['save_preset'], '')) == {'preset': 'on'}
