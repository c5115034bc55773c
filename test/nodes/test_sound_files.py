# SPDX-License-Identifier: Apache-2.0
"""Audio files at the same path on two machines, whose contents differ."""

import threading

import pytest
from support.spinning import Nodes

from eol_ros.devices.corpus import corpus_file
from eol_ros.nodes.sound_files import KEY, SoundFiles
from eol_ros.ros.main_clock import MainClock
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


def test_a_file_with_another_content_is_told(pair, tmp_path):
    nodes, there, here, values = pair
    files = written(tmp_path, ['ice.wav', 'bell.wav'])
    assert values[KEY] == ''
    there.look(files)
    nodes.until(lambda: values[KEY])
    (tmp_path / 'ice.wav').write_bytes(b'as edited')
    here.look(files)
    nodes.until(lambda: here.trouble)
    assert here.trouble == 'audio files differ from those on show'
    there.look(files)
    nodes.until(lambda: not here.trouble)


def test_a_file_on_one_machine_only_is_for_its_node_to_tell(pair, tmp_path):
    nodes, there, here, values = pair
    files = [*written(tmp_path, ['ice.wav']), str(tmp_path / 'gone.wav')]
    there.look(files)
    nodes.until(lambda: values[KEY])
    written(tmp_path, ['gone.wav'])
    here.look(files)
    nodes.until(lambda: here._here and here._there)
    assert not here.trouble


def test_a_file_that_lies_elsewhere_here_is_found_by_its_name(ros, tmp_path, monkeypatch):
    """Paths of another user: of two files of that name, the one in a folder of the same name."""
    for folder in ('sea', 'wind'):
        (tmp_path / folder).mkdir()
        written(tmp_path / folder, ['1.wav', '2.wav'])
    more = GrainsSettings(more_sounds=(str(tmp_path / 'sea'), str(tmp_path / 'wind')))
    monkeypatch.setenv('EOL_CACHE', str(tmp_path / 'cache'))
    scene = Scene('two', {**NODES, 'grains': more}, network='lan', machines=APART)
    sound = Sound(NODES['sound'], scene=scene)
    with Nodes(sound):
        files = SoundFiles(sound)
        ice, near = corpus_file.ice_file(), str(tmp_path / 'sea' / '1.wav')
        told = ['wind/2.wav', 'rain/2.wav', 'sea/3.wav', f'.cache/eol_ros/ice/{ice.name}']
        told = [near, *(f'/home/ann/{name}' for name in told)]
        own = [near, *(str(tmp_path / name) for name in ('wind/2.wav', 'sea/2.wav'))]
        assert files.here(told) == [*own, '/home/ann/sea/3.wav', str(ice)]
        assert ice.is_relative_to(tmp_path) and ice.stat().st_size > 1e7


def test_of_two_corpora_the_newer_counts(pair, tmp_path, monkeypatch):
    nodes, there, _, values = pair
    read, go = [], threading.Event()

    def sha256(path):
        assert go.wait(30)
        read.append(path.name)
        return path.name

    monkeypatch.setattr(corpus_file, 'sha256', sha256)
    first, second = written(tmp_path, 'abcd'), written(tmp_path, 'efgh')
    there.look(first)
    there.look(second)
    go.set()
    nodes.until(lambda: values[KEY])
    assert set('efgh') <= set(read) and not set('bcd') & set(read)


def test_the_clock_and_the_files_share_one_subscription(pair, tmp_path):
    nodes, there, here, _ = pair
    sound, files = here._node, written(tmp_path, ['ice.wav'])
    sound.main_clock = MainClock(sound)
    assert [s.topic_name for s in sound.subscriptions].count('/eol/node_states') == 1
    there.look(files)
    nodes.until(lambda: here._there)


def test_on_one_machine_nothing_is_read(ros, tmp_path):
    node = Grains(NODES['grains'], scene=Scene('one', NODES))
    files = SoundFiles(node)
    with Nodes(node) as nodes:
        files.look([__file__])
        nodes.run(0.1)
        assert KEY not in node.health.values and not files.trouble
