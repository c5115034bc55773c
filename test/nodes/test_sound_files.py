# SPDX-License-Identifier: Apache-2.0
"""Audio files at the same path on two machines, whose contents differ."""

from support.spinning import Nodes

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


def test_a_file_with_another_content_is_named(ros, tmp_path):
    scene = Scene('two', NODES, network='lan', machines=APART)
    ice, bell, gone = (str(tmp_path / f'{name}.wav') for name in ('ice', 'bell', 'gone'))
    for name in (ice, bell):
        (tmp_path / name).write_bytes(b'as recorded')
    grains, sound = Grains(NODES['grains'], scene=scene), Sound(NODES['sound'], scene=scene)
    there, here = SoundFiles(grains), SoundFiles(sound)
    with Nodes(grains, sound) as nodes:
        nodes.meet()
        there.look([ice, bell, gone])
        nodes.until(lambda: KEY in grains.health.values)
        (tmp_path / ice).write_bytes(b'as edited')
        here.look([ice, bell, gone])
        nodes.until(lambda: here.trouble)
        assert here.trouble == 'not the same as on show: ice.wav'
        there.look([ice, bell])
        nodes.until(lambda: not here.trouble)


def test_on_one_machine_nothing_is_read(ros, tmp_path):
    node = Grains(NODES['grains'], scene=Scene('one', NODES))
    files = SoundFiles(node)
    with Nodes(node) as nodes:
        files.look([__file__])
        nodes.run(0.1)
        assert KEY not in node.health.values and not files.trouble
