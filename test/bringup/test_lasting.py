# SPDX-License-Identifier: Apache-2.0
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.bringup.lasting import (
    SETTLED_S,
    Fault,
    Lasting,
    RestartStorms,
    Sums,
    of_disk,
    of_nodes,
)


def row(node, level=0, text='fine', **values):
    return {'node': node, 'level': level, 'text': text, 'code': '', 'args': {}, 'values': values}


class Run:
    """Steps through a run second by second, and keeps what is told and when."""

    def __init__(self, pause_s=300.0):
        self.lasting, self.now_s, self.told = Lasting(pause_s), 0.0, []

    def go(self, seconds, *wrong, patience_s=60.0):
        for _ in range(seconds):
            self.now_s += 1
            news = self.lasting.look(self.now_s, [Fault(w, 'WARN', patience_s) for w in wrong])
            if news:
                self.told.append((self.now_s, news.lasting, news.over))


def test_what_lasts_is_told_once_and_so_is_its_end():
    run = Run()
    run.go(59, 'sound')
    run.go(100)
    assert run.told == []  # a minute was not full
    run.go(1000, 'sound')
    run.go(1000)
    assert run.told == [
        (220.0, ('sound: WARN, for 60 s',), ()),
        (1160.0 + SETTLED_S, (), ('sound',)),
    ]


def test_what_flaps_lasts_and_is_told_once():
    run = Run()
    for _ in range(100):
        run.go(5, 'camera')
        run.go(5)
    assert [lasting for _, lasting, _ in run.told] == [('camera: WARN, for 60 s',)]


def test_two_messages_are_never_closer_than_the_pause():
    run = Run(pause_s=600.0)
    run.go(60, 'leds')
    for name in ('sound', 'camera', 'tracker'):
        run.go(100, 'leds', name)  # all within the pause; two of them are over at its end
    run.go(301, 'leds', 'tracker')
    assert run.told == [
        (61.0, ('leds: WARN, for 60 s',), ()),
        (661.0, ('leds: WARN, for 11 min', 'tracker: WARN, for 7 min'), ()),
    ]


@given(
    st.lists(st.tuples(st.integers(1, 400), st.sets(st.sampled_from('abc'))), max_size=30),
    st.sampled_from([10.0, 300.0]),
)
def test_whatever_happens_the_last_message_says_how_it_is(steps, pause_s):
    run = Run(pause_s)
    for seconds, wrong in steps:
        run.go(seconds, *wrong)
    last = steps[-1][1] if steps else set()
    run.go(1000, *last)
    assert [line[0] for line in run.told[-1][1]] == sorted(last) if run.told else not last
    times = [at for at, _, _ in run.told]
    assert all(b - a >= pause_s for a, b in itertools.pairwise(times))
    for (_, before, _), (_, after, _) in itertools.pairwise(run.told):
        assert {line[0] for line in before} != {line[0] for line in after}


def test_a_node_that_starts_has_more_time():
    rows = [row('a'), row('b', 1, 'no card'), row('c', 3, 'starting')]
    assert of_nodes(rows, 60.0) == [
        Fault('b', 'WARN, no card', 60.0),
        Fault('c', 'starting, starting', 240.0),
    ]


def test_a_process_that_is_started_again_and_again_though_each_time_it_is_well():
    storms, found = RestartStorms(), []
    for minute in range(10):
        found.append(bool(storms.look(60.0 * minute, {'leds': minute, 'sound': minute // 4})))
    assert found == [False] * 5 + [True] * 5
    (storm,) = storms.look(541.0, {'leds': 9, 'sound': 2})
    assert (storm.what, storm.text) == (
        'leds restarts',
        'restarted 5 times within 10 min',
    )
    assert storms.look(1200.0, {'leds': 9, 'sound': 2}) == []


def test_a_disk_that_is_nearly_full():
    assert of_disk(None, 2.0, 60.0) == of_disk(4e9, 2.0, 60.0) == []
    (fault,) = of_disk(3.94e9, 2.0, 60.0)
    assert fault == Fault('disk', '3.9 GB free; recording stops at 2 GB', 60.0)


def test_the_sum_of_a_day():
    sums, restarts = Sums(), 0
    for second in range(36_001):
        slips = second if second < 20_000 else second - 20_000  # motion dies once
        restarts = int(second >= 20_000)
        rows = [row('motion', slips=slips), row('recorder', lost=0), row('sound', asleep=False)]
        sums.take(float(second), rows, restarts)
    for second in range(36_001, 40_000):  # asleep
        sums.take(float(second), [row('sound', asleep=True)], restarts)
    assert sums.words() == 'open 10.0 h, restarts 1, slips 35 999, messages lost 0'
    sums.begin(1.0)
    assert sums.words() == 'open 0.0 h, restarts 0, slips 0, messages lost 0'
    sums.take(40_000.0, [row('motion', slips=16_001)], 1)
    assert sums.words() == 'open 0.0 h, restarts 0, slips 1, messages lost 0'


def test_sums_are_taken_up_by_the_next_run():
    sums, again = Sums(since_s=5.0, open_s=7.0, restarts=1, slips=2, lost=3), Sums()
    again.resume(sums.kept())
    assert again == sums


@pytest.mark.parametrize('damage', [{'since_s': -1.0}, {'lost': 'x'}, {'slips': True}])
def test_damaged_sums_are_not_taken_up(damage):
    whole = Sums(since_s=5.0, open_s=7.0, restarts=1, slips=2, lost=3).kept()
    again = Sums()
    for kept in (None, [], {'open_s': 3}, whole | damage):
        again.resume(kept)
    assert again == Sums()
