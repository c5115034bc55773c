# SPDX-License-Identifier: Apache-2.0
"""Audio files at the same path on two machines, whose contents differ."""

import threading

import pytest
from support.spinning import Nodes

from eol_ros.devices.corpus import corpus_file
from eol_ros.nodes.sound_files import KEY, SoundFiles
from eol_ros.ros.node import EolNode
from eol_ros.scene import Machine, Scene
from eol_ros.settings import GrainsSettings, SoundSettings

NODES = {'grains': GrainsSettings(), 'sound': SoundSettings()}
APART = {'show': Machine('10.0.0.1', ('grains',)), 'audio': Machine('10.0.0.2', ('sound',))}


class Grains(EolNode):
    NAME = 'grains'


class Sound(EolNode):
    NAME = 'sound'


@pytest.fixture
def pair(ros):
    scene = Scene('two', NODES, network='lan', machines=APART)
    grains, sound = Grains(NODES['grains'], scene=scene), Sound(NODES['sound'], scene=scene)
    with Nodes(grains, sound) as nodes:
        nodes.meet()
        yield nodes, SoundFiles(grains), SoundFiles(sound), grains.health.values


def written(folder, names):
    for name in names:
        (folder / name).write_bytes(b'as recorded')
    return [str(folder / name) for name in names]


def test_a_file_with_another_content_is_named(pair, tmp_path):
    nodes, there, here, values = pair
    files = [*written(tmp_path, ['ice.wav', 'bell.wav']), str(tmp_path / 'gone.wav')]
    assert values[KEY] == ''
    there.look(files)
    nodes.until(lambda: values[KEY])
    written(tmp_path, ['gone.wav'])  # on one machine only: its node says so
    (tmp_path / 'ice.wav').write_bytes(b'as edited')
    here.look(files)
    nodes.until(lambda: here.trouble)
    assert here.trouble == 'not the same as on show: ice.wav'
    there.look(files)
    nodes.until(lambda: not here.trouble)


def test_a_state_stays_small_with_many_files(pair, tmp_path):
    nodes, there, here, values = pair
    files = written(tmp_path, [f'{number:04}.wav' for number in range(1000)])
    there.look(files)
    nodes.until(lambda: values[KEY])
    assert len(values[KEY]) < 600
    (tmp_path / '0500.wav').write_bytes(b'as edited')
    here.look(files)
    nodes.until(lambda: here.trouble)
    assert here.trouble == 'not the same as on show: 0496.wav … 0511.wav'
    for file in files:
        (tmp_path / file).write_bytes(b'all edited')
    there.look(files)
    nodes.until(lambda: here.trouble.endswith(', … (63)'))
    assert len(here.trouble) < 300


def test_a_file_is_read_once_and_by_one_thread(pair, tmp_path, monkeypatch):
    nodes, there, _, values = pair
    read, threads, go = [], set(), threading.Event()

    def sha256(path):
        assert go.wait(30)
        read.append(path.name)
        threads.add(threading.get_ident())
        return path.name

    monkeypatch.setattr(corpus_file, 'sha256', sha256)
    first, second = written(tmp_path, 'abcd'), written(tmp_path, 'efgh')
    there.look(first)
    there.look(first)
    there.look(second)  # of `first`, the file that is being read is the last
    go.set()
    nodes.until(lambda: values[KEY])
    there.look(second)
    nodes.run(0.1)
    assert read in (['a', *'efgh'], [*'efgh']) and len(threads) == 1


def test_on_one_machine_nothing_is_read(ros, tmp_path):
    node = Grains(NODES['grains'], scene=Scene('one', NODES))
    files = SoundFiles(node)
    with Nodes(node) as nodes:
        files.look([__file__])
        nodes.run(0.1)
        assert KEY not in node.health.values and not files.trouble
