# SPDX-License-Identifier: Apache-2.0
"""An exhibition finds how fast its readers are, and tells what was lost and what grew."""

import pytest

from benchmarks import soak, soak_faults
from benchmarks.soak import LOOK_S, Look
from benchmarks.soak_proof import Held
from benchmarks.soak_rate import Rate, Totals


@pytest.mark.parametrize('grows_mb', [0.0, 60.0])
def test_what_an_exhibition_has_shown(monkeypatch, grows_mb):
    seen = [
        Look(
            30.0 * k,
            {'lost': k // 99, 'late': 2},
            {'motion': Held(20, 8, 100 + grows_mb * k / 720)},
        )
        for k in range(1, 721)
    ]
    looked = iter([None, *seen])  # at first it does not answer
    monkeypatch.setattr(soak, '_look', lambda *_: next(looked))
    monkeypatch.setattr(soak.time, 'sleep', lambda _: None)
    looks = []
    assert len(list(soak._play(None, 60.0, 18_000.0, None, looks))) == 100
    assert looks == seen[:600]
    bags = {'count': 2, 'faults': ['a: damaged']}
    found = soak.figures(looks, 3000.0, bags, ['a fault'])
    assert (found['hours'], found['took_hours'], found['times_real_time']) == (5.0, 0.833, 6.0)
    assert (found['lost'], found['late'], found['underruns']) == (6, 2, 0)
    assert found['growth'][0]['flat'] == (grows_mb == 0) and found['bags'] == {'count': 2}
    assert found['faults'][0] == 'a fault' and found['faults'][-1] == 'a: damaged'
    assert [f.partition(':')[0] for f in found['faults'][1:-1]] == ['motion grows'] * (grows_mb > 0)


def test_what_is_counted_for_each_bag_adds_up():
    totals = Totals()
    for lost in (0, 3, 5, 0, 0, 2, 1):
        found = totals.add({'lost': lost, 'late': 7})
    assert found == {'lost': 5 + 2 + 1, 'late': 7}


def settle(can, loses_above, begin=3.0, minutes=60):
    """Return the rates that are asked for on a machine that reaches `can`, and what was lost."""
    now_s, played_s, lost = 0.0, 0.0, 0
    pace, rates = Rate(begin, lambda: now_s), [begin]
    for _ in range(int(minutes * 60 / LOOK_S)):
        now_s += LOOK_S
        reached = min(rates[-1], can)
        played_s += reached * LOOK_S
        lost += reached > loses_above
        changed = pace.look(played_s, lost)
        rates += [changed] if changed else []
    return rates


def test_the_rate_climbs_to_what_the_machine_reaches():
    rates = settle(can=20.0, loses_above=1e9)
    assert max(rates) <= 20 * Rate.ABOVE and rates[-1] >= 20
    assert settle(can=1e9, loses_above=1e9)[-1] == pytest.approx(Rate.MOST, rel=0.05)
    assert settle(can=2.0, loses_above=1e9, begin=30.0)[-1] == pytest.approx(2.5)


def test_the_rate_stays_about_where_nothing_is_lost():
    rates = settle(can=1e9, loses_above=12.0)
    assert min(rates[20:]) >= 12 * Rate.LESS and max(rates) <= 12 * Rate.MORE
    assert settle(can=1e9, loses_above=0.5)[-1] == pytest.approx(Rate.LEAST, rel=0.05)


def test_faults_that_last_or_take_others_along_are_told():
    events = [
        {'kind': 'kill -9 leds', 'back_s': 1.0, 'others': ['sound']},
        {'kind': 'kill -9 leds', 'back_s': 12.0, 'others': []},
        {'kind': 'page reloaded', 'back_s': 0.1, 'others': []},
    ]
    found = soak_faults.summary(events, ['exit code 1'])
    assert (found['count'], found['kills'], found['within_10_s'], found['disturbed']) == (
        3,
        2,
        2,
        1,
    )
    assert found['faults'] == [
        'kill -9 leds: back after 12 s', 'exit code 1', 'kill -9 leds: sound went with it'
    ]  # fmt: skip
