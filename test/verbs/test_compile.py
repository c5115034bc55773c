# SPDX-License-Identifier: Apache-2.0
"""eol compile: two at once share one cache."""

import fcntl
import re
import shutil
import sys

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


def test_a_change_in_what_is_called_makes_the_caller_cold(tmp_path, monkeypatch):
    """Machine code of one package stands in that of those that call it."""
    names = {name for folders in compiled.PARTS.values() for name in folders}
    called = set()
    for name in names:
        for path in (compiled.ROOT / name).rglob(compiled._FILES.get(name, '*.py')):
            text = path.read_text()
            for module in re.findall(r'^from eol_ros\.([\w.]+) import', text, re.M):
                place = module.replace('.', '/')
                others = {o for o in names - {name} if place == o or place.startswith(f'{o}/')}
                if 'njit' in text or 'kernel' in text or 'cfunc' in text:
                    called |= {(name, other) for other in others}
    assert ('devices/audio', 'core/sound') in called
    missing = {pair for pair in called if pair[1] not in compiled._CALLS.get(pair[0], ())}
    assert missing == set()

    shutil.copytree(compiled.ROOT / 'core', tmp_path / 'core')
    shutil.copytree(compiled.ROOT / 'devices', tmp_path / 'devices')
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    monkeypatch.setattr(compiled, 'ROOT', tmp_path)
    compiled.stamp('sound')
    assert compiled.cold(['sound']) == []
    kept = compiled.cache_folder('devices/audio')
    kept.mkdir(parents=True)
    (kept / f'callback.turn-25.py{sys.version_info[0]}{sys.version_info[1]}.nbi').touch()
    (kept / 'callback.turn-25.py399.nbi').touch()
    with (tmp_path / 'core' / 'sound' / 'mixer.py').open('a') as file:
        file.write('\n')
    assert compiled.cold(['sound']) == ['sound']
    compiled.forget()
    assert [file.name for file in kept.iterdir()] == ['callback.turn-25.py399.nbi']
