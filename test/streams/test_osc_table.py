# SPDX-License-Identifier: Apache-2.0
"""The table of OSC messages, and requests by OSC."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.table import Table
from eol_ros.errors import EolError
from eol_ros.settings import OSC_MESSAGES
from eol_ros.streams.osc import AGAIN_S, ROWS, Changes, addresses, asked_of, strains
from eol_ros.streams.requests import KINDS, Asked


def test_a_scene_shortens_the_table():
    assert addresses((), 'north')['slip'] == '/north/slip'
    assert tuple(addresses((), '')) == OSC_MESSAGES == tuple(ROWS)
    assert addresses(('slip', 'grain'), 'eol') == {'slip': '/eol/slip', 'grain': '/eol/grain'}


def test_changes_alone_are_told_and_all_again_after_a_while():
    changes = Changes(10.0, np.array([0.5, 0.1]))
    values = np.zeros((4, 2))
    values[3] = math.nan
    assert changes.rows(values, 0.0).tolist() == [0, 1, 2, 3]
    values[0, 0], values[1, 1], values[2] = 0.5, 0.2, math.nan
    assert changes.rows(values, 0.05).tolist() == []  # too soon
    assert changes.rows(values, 0.1).tolist() == [1, 2]
    assert changes.rows(values, 0.3).tolist() == []
    values[0, 0] = 0.51  # in small steps, too
    assert changes.rows(values, 0.5).tolist() == [0]
    assert changes.rows(values, AGAIN_S).tolist() == [0, 1, 2, 3]
    silence = np.array([[-math.inf, 1.0]])
    assert Changes(10.0).rows(silence, 0.0).tolist() == [0]


def test_stress_of_a_table_with_a_hole():
    ring = Table(absent=(12,))
    poses = np.column_stack([ring.rest, np.zeros(25)])
    poses[12] = np.nan
    poses[6, 0] += 0.01
    found = strains(poses, 0.04, ring)
    assert math.isnan(found[12]) and found[6] == pytest.approx(0.5, abs=0.05)
    assert np.isfinite(np.delete(found, 12)).all()


@pytest.mark.parametrize(
    'address, values, asked',
    [
        ('/eol/call/sleep', (), Asked('sleep')),
        ('/eol/call/sleep/sound', (1.0,), Asked('sleep', 'sound')),
        ('/eol/call/mute', (True,), Asked('mute')),
        ('/eol/call/mute', (0.0,), None),
        ('/eol/call/move_grain', (12.0, 0.25, 1),
         Asked('move_grain', '', {'grain': 12, 'x': 0.25, 'y': 1.0})),
        ('/eol/call/morph_presets', ('calm', 'storm', 0.5),
         Asked('morph_presets', '', {'from': 'calm', 'to': 'storm', 'share': 0.5})),
        ('/eol/set/sound/gain_db', (-12,), Asked('set', 'sound', {'gain_db': -12.0})),
        ('/eol/set/grains/k', (4.0,), Asked('set', 'grains', {'k': 4})),
        ('/eol/set/grains/rearm_at_rest', (0,), Asked('set', 'grains', {'rearm_at_rest': False})),
        ('/eol/set/grains/weights', ('ice 0.5', 'sea 0'),
         Asked('set', 'grains', {'weights': ['ice 0.5', 'sea 0']})),
        ('/eol/set/grains/weights', (), Asked('set', 'grains', {'weights': []})),
        ('/eol/set/twin/hands', ('nobody',), Asked('set', 'twin', {'hands': 'nobody'})),
    ],
)  # fmt: skip
def test_requests(address, values, asked):
    found = asked_of(address, values, 'eol')
    assert found == asked and repr(found) == repr(asked)  # 1.0, not 1


@pytest.mark.parametrize(
    'address, values, why',
    [
        ('/other/x', (1,), 'no such address; there are /eol/call/KIND and /eol/set/NODE/NAME'),
        ('/eol/call', (), 'no such address'),
        ('/eol/call/a/b/c', (), 'no such address'),
        ('/eol/set/a/b/c', (), 'no such address'),
        ('', (), 'no such address'),
        ('/eol/call/slep', (), 'Did you mean sleep?'),
        ('/eol/call/infrared', ('ff',), 'no such request'),  # nodes ask it of each other
        ('/eol/call/set', ('x',), 'no such request'),
        ('/eol/call/sleep/tracker', (), 'tracker does not heed it'),
        ('/eol/call/sleep', (2,), 'takes no value but 1'),
        ('/eol/call/sleep', (b'\1',), 'takes no value but 1'),
        ('/eol/call/sleep', (1, 1), 'sleep takes no values, not 2 values'),
        ('/eol/call/play_grain', (), 'play_grain takes grain, not 0 values'),
        ('/eol/call/play_grain', ('x',), 'grain'),
        ('/eol/call/play_grain', (math.nan,), 'grain'),
        ('/eol/call/play_grain', (1.5,), 'grain'),
        ('/eol/call/save_preset', ('../x',), 'preset'),
        ('/eol/set/gain_db', (-3,), 'write /eol/set/sound/gain_db'),
        ('/eol/set/gain', (1,), 'write /eol/set/grains/gain'),
        ('/eol/set/nowhere', (1,), 'no node has this live setting'),
        ('/eol/set/recorder/folder', ('/',), 'no node has this live setting'),
        ('/eol/set/sound/gain', (1,), 'Did you mean gain_db'),
        ('/eol/set/sound/gain_db', (), 'gain_db takes one value, not 0'),
        ('/eol/set/sound/gain_db', (1.0, 2.0), 'gain_db takes one value, not 2'),
        ('/eol/set/sound/channels', (1,), 'sound has no such live setting'),
    ],
)  # fmt: skip
def test_refusals_say_what_to_write(address, values, why):
    with pytest.raises(EolError) as raised:
        asked_of(address, values, 'eol')
    assert why in str(raised.value)


ANYTHING = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(), st.binary(), st.none(),
    st.lists(st.integers()), st.tuples(st.integers(), st.integers()),
)  # fmt: skip
WORDS = st.sampled_from(
    ['call', 'set', 'sound', 'grains', 'gain_db', 'weights', 'k', '', 'eol', *KINDS, '\n', 'ü' * 99]
)


@given(st.lists(WORDS, max_size=5), st.lists(ANYTHING, max_size=4))
def test_nothing_else_is_raised(words, values):
    try:
        asked = asked_of('/' + '/'.join(words), values, 'eol')
    except EolError:
        return
    assert asked is None or asked.kind in KINDS
