# SPDX-License-Identifier: Apache-2.0
"""eol compile: two at once share one cache, and what is damaged or stale is not taken for done."""

import json
import os
import subprocess
import sys
import time
from itertools import pairwise

import pytest

from eol_ros import cli, compiled
from eol_ros.core.compiled import FIXED
from eol_ros.verbs import compile as verb

# Another process holds the lock until its standard input ends.
HOLD = (
    'import sys; from eol_ros import compiled\n'
    'with compiled.alone(print): print(1, flush=True); sys.stdin.read()'
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    monkeypatch.setattr(compiled, '_used', set())
    return compiled.folders()[0]


def test_who_comes_second_waits_and_compiles_nothing_again(monkeypatch, capsys):
    made = []

    def make(parts):
        made.append(list(parts))
        for part in parts:
            compiled.stamp(part)

    monkeypatch.setattr(verb, '_compile', make)
    first = subprocess.Popen([sys.executable, '-c', HOLD],
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip
    assert first.stdout.readline() == b'1\n'

    def first_is_done():  # while the second waits
        made.append('waits')
        compiled.stamp('sound')
        first.communicate()

    monkeypatch.setattr(verb, '_say_waiting', first_is_done)
    assert cli.main(['compile', '--parts', 'sound']) == 0
    assert made == ['waits']
    assert cli.main(['compile', '--parts', 'sound,ice']) == 0
    assert made == ['waits', ['ice']]
    assert cli.main(['compile', '--parts', 'sound,ice', '--force']) == 0
    assert made[2:] == [['sound', 'ice']]
    assert cli.main(['compile', '--parts', 'trumpet']) == 2
    assert 'trumpet: no such part' in capsys.readouterr().err


@pytest.mark.parametrize('damage', [
    lambda data: b'',
    lambda data: data[: len(data) // 2],
    lambda data: bytes(len(data)),
    lambda data: data[:-1] + b'?',
    lambda data: b'?' + data[1:],
    lambda data: data + b'\0',
], ids=['emptied', 'halved', 'zeroed', 'another end', 'another begin', 'longer'])  # fmt: skip
@pytest.mark.parametrize('name', ['loop.object', 'sound.json'])
def test_a_damaged_file_is_not_taken_for_done(cache, damage, name):
    compiled.store('loop.object', {}, b'machine code')
    compiled.stamp('sound')
    compiled.stamp('ice')
    assert compiled.cold(['sound', 'ice']) == []
    path = cache / name
    path.write_bytes(damage(path.read_bytes()))
    assert compiled.cold(['sound', 'ice']) == (['sound', 'ice'] if name[0] == 'l' else ['sound'])
    compiled.forget()
    assert (cache / 'loop.object').exists() == (name[0] == 's')


def test_a_change_in_a_source_makes_its_objects_stale_and_no_others(cache, tmp_path, monkeypatch):
    for name in ('mixer', 'outline'):
        (tmp_path / f'{name}.py').write_text('1')
        path = str(tmp_path / f'{name}.py')
        compiled.store(f'{name}.object', {path: compiled.content(path)}, b'machine code')
    monkeypatch.setattr(compiled, '_SOURCES', ('mixer',))
    monkeypatch.setitem(sys.modules, 'mixer', type(sys)('mixer'))
    sys.modules['mixer'].__file__ = str(tmp_path / 'mixer.py')
    compiled.stamp('sound')
    assert compiled.cold(['sound']) == []
    (tmp_path / 'mixer.py').write_text('2')
    assert compiled.cold(['sound']) == ['sound']
    other = cache.with_name(cache.name[:-3] + 'old')  # of other versions
    other.mkdir()
    (other / 'outline.object').touch()
    (cache / 'mixer.object.1.new').touch()  # by a process that writes it now
    compiled.forget()
    assert list(cache.parent.iterdir()) == [cache]
    left = {'mixer.object.1.new', 'outline.object', 'sound.json'}
    assert {path.name for path in cache.iterdir()} == left


def test_a_part_depends_on_all_modules_that_it_was_compiled_with(cache):
    code = (
        'import eol_ros.core.sound.mixer, eol_ros.cli\n'
        'from eol_ros import compiled\n'
        'compiled.stamp("sound")\n'
    )
    subprocess.run([sys.executable, '-c', code], check=True)
    sources = json.loads((cache / 'sound.json').read_text())['sources']
    assert {'core/sound/mixer.py', 'core/compiled.py', 'core/sound/lanes.py'} <= sources.keys()
    assert 'cli.py' not in sources and 'core/vision/tracker.py' not in sources


def test_the_bar_moves_for_as_long_as_a_slower_processor_needs():
    shares = [verb._share(used / 10) for used in range(31)]
    assert shares[:9] == [used / 10 for used in range(9)]
    assert all(later > sooner for sooner, later in pairwise(shares)) and shares[-1] < 1
    began_s = verb._used_s(os.getpid())
    sum(range(3_000_000))
    assert began_s <= verb._used_s(os.getpid()) < time.process_time() + 1


def test_what_of_the_processor_decides_is_told_without_numba():
    assert (compiled._processor() == []) == FIXED
