# SPDX-License-Identifier: Apache-2.0
"""The state of the work: each follows from nodes, and every surface without a browser shows it."""

import pytest
from support.work_states import STATES, row, running

from eol_ros.bringup import status
from eol_ros.bringup.notify import Message
from eol_ros.said import code_and_args, from_message, said, translated
from eol_ros.streams.work_state import DOWN, ERROR, STARTING, WARN, work_state


@pytest.mark.parametrize('code', STATES)
def test_each_state_follows_from_its_nodes(code):
    rows, english, chinese = STATES[code]
    state = work_state(rows)
    assert (state.parts[0][0], str(state)) == (code, english)
    assert translated(state, 'zh-Hant') == chinese


@pytest.mark.parametrize('code', STATES)
def test_status_and_notifications_show_it(code):
    rows, english, chinese = STATES[code]
    work = status.of_work(work_state(rows))
    nodes = [{'node': node, **one} for node, one in rows.items()]
    table = {'scene': 'museum', 'namespace': 'eol', 'running_s': 1.0, 'restarts': 0}
    shown = status.table({**table, 'work': work, 'nodes': nodes})
    assert shown.splitlines()[0] == f'museum: {english}'
    for language, words in (('en', english), ('zh-Hant', chinese)):
        message = Message('trouble', 'museum', 'a title', (), language, from_message(**work))
        assert message['work'] == words and message['text'].endswith(f'\n- {words}')


def test_the_more_important_state_comes_first():
    asleep = running(montage=row(values={'asleep': True}), sound=row(ERROR))
    assert work_state(asleep) == 'asleep'
    assert work_state(asleep | {'panel': row(values={'testing': True})}) == 'test running'
    assert work_state(asleep | {'twin': row(STARTING)}) == 'starting'
    broken = running(sound=row(DOWN, values={'muted': True, 'card_missing': True}))
    assert work_state(broken) == 'fault: sound does not run'
    silent = running(sound=row(values={'muted': True, 'card_missing': True}))
    assert work_state(silent) == 'no sound card'
    assert work_state(silent | {'twin': row(WARN, rate=0.0)}) == 'no camera image'


def test_nodes_that_nobody_sees_or_hears_change_nothing():
    for node in ('recorder', 'panel', 'hours', 'projectors'):
        for level in (WARN, ERROR, STARTING, DOWN):
            assert work_state(running(**{node: row(level)})) == 'awake'
    assert work_state(running(hours=row(values={'asleep': True}))) == 'awake'  # it has only asked
    assert work_state(running(tracker=row(WARN, rate=60.0))) == 'awake'  # images come


def test_an_opening_time_is_shown_without_what_the_node_says_beside():
    code, args = code_and_args(said('asleep_ever'))
    hours = row(values={'asleep': True}) | {'code': code, 'args': {**args, '1': 'and more'}}
    state = work_state(running(hours=hours, sound=row(values={'asleep': True})))
    assert state == 'asleep, and no opening ahead'


def test_latency_of_the_last_minute_stands_below_the_nodes():
    values = {'image_to_blocks_p50_ms': 8.1, 'image_to_blocks_p99_ms': 12.0, 'seen': 25}
    rows = [status.starting('tracker', said('starting')) | {'values': values}]
    rows.append(status.starting('leds', said('starting')))
    found = status.latencies(rows)
    assert found == {'image_to_blocks': {'p50_ms': 8.1, 'p99_ms': 12.0}}
    table = {
        'scene': 'museum', 'namespace': 'eol', 'running_s': 1.0, 'restarts': 0, 'nodes': rows,
        'work': {'text': 'awake'},
    }  # fmt: skip
    told = status.table(table | {'latency': found}).splitlines()
    assert told[-1] == 'latency, ms, p50 / p99 of the last minute: image to blocks 8.1 / 12.0'
    assert 'latency' not in status.table(table | {'latency': {}})
