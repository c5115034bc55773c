# SPDX-License-Identifier: Apache-2.0
"""A soak in pieces counts what one in one piece would, and finds how fast its readers are."""

import json
import random
from types import SimpleNamespace

import pytest
from test_soak_proof import bag

from benchmarks import soak_faults
from benchmarks.soak_pieces import LOOK_S, Look, Pieces, Rate, Totals
from benchmarks.soak_proof import Held
from eol_ros import cli
from eol_ros.errors import EolError

MB = 100.0


class Machine:
    """A graph that plays at `rate`, and holds `grows_mb` more each hour, by a clock of its own."""

    def __init__(self, rate=6.0, grows_mb=0.0):
        self.now_s, self.begun_s = 50.0, 50.0
        self.rate, self.grows_mb, self.dumb = rate, grows_mb, False

    def clock(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds

    def look(self):
        if self.dumb:
            return None
        since_s = self.now_s - self.begun_s
        counts = {'lost': int(since_s // 1000), 'restarts': 0, 'underruns': 1, 'late': 2}
        held = {'motion': Held(20, 8, MB + self.grows_mb * since_s / 3600)}
        return Look(self.rate * since_s, counts, held)

    def play(self, pieces, until_s, longest_s=None):
        self.begun_s = self.now_s
        pieces.begin()
        return pieces.play(self.look, until_s, longest_s, self.clock, self.sleep)


def test_two_pieces_come_to_what_was_asked_for(tmp_path):
    first, machine = Pieces(tmp_path / 'soak', resume=False), Machine()
    assert list(machine.play(first, 36_000, 1500))[-1] == pytest.approx(9000)
    (tmp_path / 'soak' / 'bags').mkdir()
    bag(tmp_path / 'soak' / 'bags' / 'a', [0, 1, 5], counted=3)
    first.end(['a fault'])
    first.prove_bags()

    second = Pieces(tmp_path / 'soak', resume=True)
    assert second.rate == pytest.approx(6.0)
    seen = list(machine.play(second, 36_000))
    assert seen[0] == pytest.approx(9000 + 6 * LOOK_S) and seen[-1] == pytest.approx(36_000)
    bag(tmp_path / 'soak' / 'bags' / 'b', [0, 1, 4], counted=2)
    second.end([])
    second.prove_bags()

    found = Pieces(tmp_path / 'soak', resume=True).figures()
    assert (found['hours'], found['took_hours'], found['pieces']) == (10.0, 1.667, 2)
    assert found['times_real_time'] == [6.0, 6.0]
    assert (found['lost'], found['underruns'], found['late']) == (1 + 4, 2, 4)
    assert (found['bags']['count'], found['bags']['missing']) == (2, 5)  # each was proved once
    assert found['faults'] == ['piece 1: a fault']


def test_memory_that_grows_in_any_piece_is_told(tmp_path):
    pieces = Pieces(tmp_path / 'soak', resume=False)
    for grows_mb in (0.0, 60.0):
        list(Machine(grows_mb=grows_mb).play(pieces, 1e9, 1800))
        pieces.end([])
    rows = pieces.figures()['growth']
    assert [(row['piece'], row['name'], row['flat']) for row in rows] == [
        (1, 'motion', True), (2, 'motion', False),
    ]  # fmt: skip
    assert pieces.figures()['faults'][0].startswith('piece 2: motion grows')


def test_a_piece_that_was_killed_counts_as_far_as_it_was_kept(tmp_path):
    pieces, machine = Pieces(tmp_path / 'soak', resume=False), Machine()
    looks = machine.play(pieces, 1e9)
    for _ in range(40):
        next(looks)
    looks.close()
    with (tmp_path / 'soak' / 'piece-1' / 'looks.jsonl').open('a') as file:
        file.write('{"motion": [20, 8')  # the line that was being written

    found = Pieces(tmp_path / 'soak', resume=True).figures()
    assert found['hours'] == pytest.approx(40 * LOOK_S * 6 / 3600, abs=0.005)
    assert (found['cut_off'], found['faults']) == (1, [])
    assert found['growth'][0]['pss_mb'] == [MB, MB]


def test_a_graph_that_does_not_answer_is_looked_at_again(tmp_path):
    pieces, machine = Pieces(tmp_path / 'soak', resume=False), Machine()
    machine.dumb = True
    assert list(machine.play(pieces, 1e9, 100)) == []
    machine.dumb = False
    assert len(list(pieces.play(machine.look, 1e9, 100, machine.clock, machine.sleep))) == 20


def test_what_cannot_be_gone_on_with_is_told(tmp_path):
    with pytest.raises(EolError, match='--resume: .*pieces.json'):
        Pieces(tmp_path / 'none', resume=True)
    pieces = Pieces(tmp_path / 'soak', resume=False)
    pieces.begin()
    assert json.loads((tmp_path / 'soak' / 'pieces.json').read_text())['pieces']
    with pytest.raises(EolError, match='say --resume to go on'):
        Pieces(tmp_path / 'soak', resume=False)


def test_what_is_counted_for_each_bag_adds_up():
    totals = Totals()
    for lost in (0, 3, 5, 0, 0, 2, 1):
        found = totals.add({'lost': lost, 'late': 7})
    assert found == {'lost': 5 + 2 + 1, 'late': 7}


def settle(can, loses_above, begin=3.0, minutes=60):
    """Return the rates that are asked for on a machine that reaches `can`, and what was lost."""
    machine, played_s, lost = Machine(), 0.0, 0
    pace, rates = Rate(begin, machine.clock), [begin]
    for _ in range(int(minutes * 60 / LOOK_S)):
        machine.sleep(LOOK_S)
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


def broken(hours, kinds, **other):
    events = [{'kind': kind, 'back_s': back_s, 'others': []} for kind, back_s in kinds]
    bags = {'count': 2, 'unreadable': 0, 'cut': 1, 'missing': 3, 'uncounted': 0}
    piece = {'hours': hours, 'events': events, 'left_out': [], 'growth': [], 'bags': bags}
    return {**piece, 'faults': [], **other}


def test_pieces_of_faults_add_up():
    first = broken(0.5, [('kill -9 leds', 1.0), ('kill -9 leds', 12.0)], left_out=['disk full: no'])
    second = broken(0.7, [('page reloaded', 0.1)], faults=['exit code 1'])
    found = soak_faults.figures([first, second])
    assert (found['hours'], found['pieces'], found['cut_off']) == (1.2, 2, 0)
    assert (found['count'], found['kills'], found['within_10_s']) == (3, 2, 2)
    assert (found['bags']['count'], found['bags']['missing']) == (4, 6)
    assert found['left_out'] == ['disk full: no']
    assert found['faults'] == ['kill -9 leds: back after 12 s', 'piece 2: exit code 1']


def test_a_piece_of_faults_that_was_killed_counts_as_far_as_it_was_kept():
    found = soak_faults.figures([broken(0.2, [('kill -9 leds', 1.0)], bags={})])
    assert (found['count'], found['cut_off'], found['bags']['count']) == (1, 1, 0)


def test_faults_go_on_only_where_some_are_kept(tmp_path):
    with pytest.raises(EolError, match=r'--resume: .*pieces\.json'):
        soak_faults.measure(tmp_path, 1.0, 1, resume=True)
    (tmp_path / 'faults').mkdir()
    (tmp_path / 'faults' / 'pieces.json').write_text(json.dumps({'pieces': [broken(2.0, [])]}))
    with pytest.raises(EolError, match='say --resume to go on'):
        soak_faults.measure(tmp_path, 2.0, 1)
    assert soak_faults.measure(tmp_path, 2.0, 1, resume=True)['hours'] == 2.0  # it was over


def test_one_part_at_a_time_goes_on(capsys):
    assert cli.main(['bench', 'soak', '--resume']) == 2
    assert 'say one of --parts, and --keep its folder' in capsys.readouterr().err


def test_faults_that_could_not_begin_are_no_hindrance_to_the_next(tmp_path, monkeypatch):
    def no_card(folder, seed):
        raise EolError('jackd does not start')

    monkeypatch.setattr(soak_faults, 'Soak', no_card)
    for resume in False, True:
        with pytest.raises(EolError, match='jackd does not start'):
            soak_faults.measure(tmp_path, 1.0, 1, resume=resume)
    kept = json.loads((tmp_path / 'faults' / 'pieces.json').read_text())['pieces']
    assert [piece['hours'] for piece in kept] == [0.0, 0.0]


def test_a_later_piece_goes_on_with_the_next_step_of_the_clock():
    done = []
    others = soak_faults.EXTRAS_IN_2_H.keys() - {'clock steps'}
    soak = SimpleNamespace(
        left_out=[f'{kind}: not here' for kind in others],
        chance=random.Random(1), looks=[],
        extra=lambda kind, count: done.append((kind, count)), strike=lambda number: None,
    )  # fmt: skip
    earlier = broken(0.7, [('clock steps', 1.0), ('kill -9 leds', 1.0)])
    pieces = [earlier, broken(0.7, [('clock steps', 1.0)]), broken(0.0, [])]

    list(soak_faults._steps(soak, 1e-4, lambda: None, pieces))  # a third of a second

    assert done == [('clock steps', 2)]
