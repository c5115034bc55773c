# SPDX-License-Identifier: Apache-2.0
"""eol compile: two at once share one cache."""

import fcntl

from eol_ros import cli, compiled
from eol_ros.verbs import compile as verb


def test_who_comes_second_waits_and_compiles_nothing_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    made = []

    def make(parts):
        made.append(list(parts))
        with open(compiled._stamp('lock').with_suffix('.lock'), 'ab') as other:
            try:
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                made.append('alone')
        for part in parts:
            compiled.stamp(part)

    monkeypatch.setattr(verb, '_compile', make)

    def first_is_done():  # while the second waits
        print('waits')
        made.append('waits')
        compiled.stamp('sound')
        fcntl.flock(held, fcntl.LOCK_UN)

    monkeypatch.setattr(verb, '_say_waiting', first_is_done)
    lock = compiled._stamp('lock').with_suffix('.lock')
    lock.parent.mkdir(parents=True)
    with lock.open('ab') as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert cli.main(['compile', '--parts', 'sound']) == 0
        assert made == ['waits']
    assert cli.main(['compile', '--parts', 'sound,ice']) == 0
    assert made == ['waits', ['ice'], 'alone']
    assert cli.main(['compile', '--parts', 'sound,ice', '--force']) == 0
    assert made[3:] == [['sound', 'ice'], 'alone']
    assert cli.main(['compile', '--parts', 'trumpet']) == 2
    assert 'trumpet: not one of' in capsys.readouterr().err
