# SPDX-License-Identifier: Apache-2.0
"""Packets, read back with the struct module alone."""

import datetime
import json
import struct
from types import SimpleNamespace

import numpy as np
import pytest
from eol_msgs.msg import NodeState

from eol_ros.analysis import report
from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table
from eol_ros.ros.requests import parameter_messages
from eol_ros.said import code_and_args, said
from eol_ros.streams import corpus
from eol_ros.web import notices, wire


def head(packet):
    kind, own, stamp = struct.unpack_from('<B7sd', packet)
    return kind, own, stamp


def test_blocks_packet():
    names = ('x', 'y', 'yaw', 'u', 'v', 'sigma', 'visibility', 'seen')
    rows = np.zeros(25, [(n, 'f8') for n in names])
    for i, name in enumerate(names):
        rows[name] = np.arange(25) + i / 8
    packet = wire.blocks(1.75e9 + 0.25, 1, True, rows)
    assert head(packet) == (1, b'\x01\x01' + bytes(5), 1.75e9 + 0.25)
    body = np.frombuffer(packet, '<f4', offset=16).reshape(25, 8)
    assert np.array_equal(body, np.arange(25)[:, None] + np.arange(8) / 8)


def test_truth_packet_is_where_the_page_looks():
    pose = np.arange(75.0).reshape(3, 25)
    packet = wire.truth(5.0, (0.1, 0.2, 0.3), pose, [i % 2 == 0 for i in range(25)])
    assert np.frombuffer(packet, '<f4', 3, 16) == pytest.approx([0.1, 0.2, 0.3])
    assert np.array_equal(np.frombuffer(packet, '<f4', 75, 28), pose.ravel())
    assert list(packet[16 + 312 :]) == [1, 0] * 12 + [1]


def test_meter_packet_survives_silence_and_nonsense():
    low, high = np.full(1024, -0.5), np.full(1024, 2.0)
    bands = np.array([-np.inf, np.nan, -300.0, -60.2, 0.0] + [-90.0] * 123)
    packet = wire.meter(1.0, low, high, bands, {'peak_dbfs': float('-inf'), 'voices': 3})
    kind, own, _ = head(packet)
    assert kind == 4 and struct.unpack_from('<HH', own) == (1024, 128)
    body = np.frombuffer(packet, 'i1', 2048 + 128, 16)
    assert set(body[:1024]) == {-64} and set(body[1024:2048]) == {127}
    assert list(body[2048:2053]) == [-127, -127, -127, -60, 0]
    assert json.loads(packet[16 + 2176 :]) == {'peak_dbfs': None, 'voices': 3}


def test_sound_packet_clips_and_keeps_the_order():
    samples = np.array([0.0, 1.0, -1.0, 3.0, np.nan, 0.5], '<f4')
    packet = wire.sound(2.5, 48000, 2, 10**12, samples)
    kind, own, stamp = head(packet)
    assert (kind, stamp, own[0]) == (5, 2.5, 2)
    assert struct.unpack_from('<I', own, 3) == (48000,)
    assert struct.unpack_from('<Q', packet, 16) == (10**12,)
    assert list(np.frombuffer(packet, '<i2', offset=24)) == [0, 32767, -32767, 32767, 0, 16383]


def test_leds_packet():
    packet = wire.leds(1.0, np.arange(25, dtype=np.uint8) * 10, True)
    assert head(packet)[:2] == (6, b'\x01' + bytes(6))
    assert list(packet[16:]) == [10 * i for i in range(25)]


def test_text_is_json_for_every_browser():
    text = wire.text({'a': float('nan'), 'b': [float('inf'), 1 / 3], 'c': {'d': '冰'}})
    assert 'NaN' not in text and 'Infinity' not in text
    assert json.loads(text) == {'a': None, 'b': [None, 0.333333], 'c': {'d': '冰'}}


def stamp(seconds):
    return SimpleNamespace(sec=int(seconds), nanosec=int((seconds % 1) * 1e9))


def cascade(onset_s, area):
    return SimpleNamespace(
        onset=stamp(onset_s), nucleus=3, area=area, size=area + 1, duration=0.5, blocks=[3, 4]
    )


NOON = datetime.datetime(2026, 11, 21, 12).timestamp()


def test_the_day_counts_areas_and_begins_anew_at_midnight():
    day = notices.Day()
    for i, area in enumerate([1, 1, 2, 25, 1]):
        day.add(cascade(NOON + i, area), NOON + i)
    notice = day.notice()
    assert notice['date'] == '2026-11-21' and sum(notice['areas']) == 5
    assert [notice['areas'][a] for a in (1, 2, 25)] == [3, 1, 1]
    assert len(notice['recent']) == 5 and notice['recent'][-1][2] == 1
    assert notice['greatest'] == notice['recent'][3]
    midnight = datetime.datetime(2026, 11, 22).timestamp()
    assert not day.turn(midnight - 1) and sum(day.notice()['areas']) == 5
    assert day.turn(midnight)  # without any cascade
    assert sum(day.notice()['areas']) == 0 and not day.notice()['recent']
    assert not day.notice()['greatest']
    day.add(cascade(midnight - 2, 4), midnight + 1)  # counts when it is told, also in a replay
    assert sum(day.notice()['areas']) == 1 and day.notice()['date'] == '2026-11-22'


def test_a_day_goes_on_after_a_restart():
    day = day_of((1, 1, 7))
    again = notices.Day(json.loads(json.dumps(day.kept())))
    assert again.notice() == day.notice()
    assert not again.turn(NOON + 60) and sum(again.notice()['areas']) == 3
    assert again.turn(NOON + 86400) and sum(again.notice()['areas']) == 0
    row = [0.0] * 6
    for broken in (None, [], {}, {'date': 'x', 'areas': [1], 'recent': []},
                   {'date': 'x', 'order': [-1] * 26, 'recent': []},
                   {'date': 'x', 'order': [26], 'recent': []},
                   {'date': 'x', 'order': ['1'] * 26, 'recent': [row]},
                   {'date': 'x', 'order': [1], 'recent': [[1]]},
                   {'date': 'x', 'order': [1], 'recent': [], 'greatest': [1]}):  # fmt: skip
        assert sum(notices.Day(broken).notice()['areas']) == 0


def day_of(areas):
    """Return a day of cascades of these areas, fitted."""
    day = notices.Day()
    for area in areas:
        day.add(cascade(NOON, int(area)), NOON)
    assert day.fit()
    return day


def test_the_law_of_the_day_is_that_of_the_report():
    areas = powerlaw.sample(1.6, 1, 25, 300, np.random.default_rng(3))
    few = powerlaw.FEWEST_CASCADES - 1
    day = day_of(areas[:few])
    assert not day.fit()
    assert day.notice()['law'] == {'fitted': few, 'fewest': few + 1}
    assert 'why' in report.law(areas[:few], 25)
    for area in areas[few:]:
        day.add(cascade(NOON, int(area)), NOON)
    assert day.fit()
    law, found = day.notice()['law'], report.law(areas, 25)
    assert (law['b'], law['error'], law['from'], law['count']) == (
        found['b_value'],
        found['b_error'],
        found['area_min'],
        found['fitted'],
    )
    # The curve that the page draws: P(A >= a), summed here one by one.
    support = np.arange(law['from'], 26.0)
    weights = support ** -found['tau']
    expected = [weights[support >= a].sum() / weights.sum() for a in support]
    assert law['exceedance'] == pytest.approx(expected, rel=1e-12)


def test_areas_of_one_size_have_no_law():
    law = day_of([1] * 260).notice()['law']
    assert law == {'fitted': 260, 'fewest': powerlaw.FEWEST_CASCADES}


def test_a_law_that_its_test_rejects_is_called_so_in_panel_and_report():
    areas = np.minimum(np.random.default_rng(1).geometric(0.2, 400), 25)
    law, found = day_of(areas).notice()['law'], report.law(areas, 25)
    assert law['rejected'] and found['rejected'] and 'b' not in law
    assert (law['ks'], law['p'], law['count']) == (found['ks'], found['p_value'], found['fitted'])
    assert found['sentence'].startswith('not a power law: KS 0.')


def test_corpus_values_become_columns():
    message = SimpleNamespace(
        name='ice',
        digest='d',
        radius=0.06,
        x=[0, 1],
        y=[0, 1],
        x_name='a',
        y_name='b',
        start=[0.0, 1.0],
        duration=[1.0, 1.0],
        files=['/a/ice.wav', '/b/low tide.flac'],
        file=[0, 1],
        bounds=[-1, -1, 1, 1],
        descriptors=['a', 'b', 'c'],
        values=[1, 2, 3, 4, 5, 6],
    )
    found = corpus.to_json(message)
    assert found['values'] == [[1, 4], [2, 5], [3, 6]]
    assert (found['files'], found['file']) == (['ice', 'low tide'], [0, 1])
    assert found['folders'] == ['a', 'b']


def state(**fields):
    return NodeState(node='tracker', text='well', rate=59.9, pid=12, **fields)


def test_health_has_typed_values_and_codes():
    told = {'seen': 25, 'asleep': False, 'files': ('a', 'b'), 'share': 0.5, 'name': '7'}
    why = said('lost', why=said('out_of_sight'))
    code, args = code_and_args(why)
    typed = {'values': parameter_messages(told), 'args': parameter_messages(args), 'code': code}
    notice = notices.health(state(level=NodeState.LEVEL_WARN, **typed))
    assert (notice['node'], notice['level'], notice['rate']) == ('tracker', 'warn', 59.9)
    assert (notice['pid'], notice['values'], notice['said']) == (12, told, why.parts)
    assert notices.health(state(level=NodeState.LEVEL_STARTING))['level'] == 'warn'


def test_the_roster_knows_who_gives_signs_of_life():
    roster = notices.Roster()
    assert not roster.runs('tracker', 100.0)
    notice = roster.take(state(), 100.0, 1.7e9)
    assert (notice['text'], notice['at']) == ('well', 1.7e9)
    assert roster.runs('tracker', 104.0) and not roster.runs('tracker', 106.0)
    (found,) = roster.states(104.0).values()
    assert (found['level'], found['age_s']) == ('ok', 4.0)
    found = roster.states(106.0)['tracker']
    assert (found['level'], found['age_s'], found['text']) == ('silent', 6.0, 'well')


def test_a_day_is_of_one_table():
    """Its law ends at all blocks, no automaton is beside it, and another table's day is none."""
    table = Table(rows=3, columns=4)
    areas = powerlaw.sample(1.6, 1, 12, 400, np.random.default_rng(3)).tolist()
    day = notices.Day({'date': 'x', 'order': areas, 'recent': []} | kept_at(table), table)
    law = day.notice()['law']

    assert len(day.notice()['areas']) == 13 and sum(day.notice()['areas']) == 400
    assert law['from'] + len(law['exceedance']) == 13 and 'automaton' not in law
    assert sum(notices.Day(day.kept()).notice()['areas']) == 0
    assert sum(notices.Day(day.kept(), table).notice()['areas']) == 400


def kept_at(table):
    return {'table': notices.Day(table=table).kept()['table']}
