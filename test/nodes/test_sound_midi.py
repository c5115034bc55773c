# SPDX-License-Identifier: Apache-2.0
"""A MIDI instrument, over JACK's dummy server, plays the live settings of grains and sound."""

import dataclasses
import threading

import pytest
from support import needs
from support.jack import served
from support.spinning import Nodes
from support.waiting import wait_until

from eol_ros.cli import main
from eol_ros.core.sound.midi import event_of
from eol_ros.nodes.hours import HoursNode
from eol_ros.nodes.sound import SoundNode
from eol_ros.nodes.sound_midi import Midi
from eol_ros.ros import presets
from eol_ros.scene import Scene, load
from eol_ros.settings import HoursSettings, SoundSettings
from eol_ros.streams.requests import Asked

jack = needs.marker('jackd2')


@pytest.fixture
def server(monkeypatch):
    yield from served('eolmidi', monkeypatch)


class Hand:
    """What turns knobs: a port of its own that connects to the input."""

    def __init__(self, name):
        import rtmidi

        self.out = rtmidi.MidiOut(rtmidi.API_UNIX_JACK, 'hand')
        wait_until(lambda: any(name in port for port in self.out.get_ports()), 10.0)
        self.out.open_port(next(i for i, p in enumerate(self.out.get_ports()) if name in p))

    def send(self, *message):
        self.out.send_message(message)

    def close(self):
        self.out.close_port()
        self.out.delete()


MAP = (
    'cc 74 sound.filter_hz 200 3200', 'note 36 grains.mode chain', 'program 3 recall storm',
    'cc 1 morph calm storm', 'cc 2:7 sound.filter',
)  # fmt: skip


@jack
@pytest.mark.slow
def test_controllers_keys_and_programs_play_settings(ros, server, tmp_path, monkeypatch):
    pytest.importorskip('rtmidi')
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    for name, gain_db, radius in (('calm', -30.0, 0.05), ('storm', -10.0, 0.25)):
        values = {'sound': {'gain_db': gain_db}, 'grains': {'radius': radius}}
        presets.save(presets.path_of(name, presets.folder()), values)
    settings = SoundSettings(
        device='wav', wav=str(tmp_path / 'o.wav'), midi='jack:virtual', midi_map=MAP
    )
    node = SoundNode(settings)
    hand = None
    try:
        asked: list[Asked] = []
        monkeypatch.setattr(
            node.requests, 'ask', lambda one: one.node != 'sound' and asked.append(one)
        )
        node.midi.look()
        hand = Hand('eol_ros')

        def until(what):
            wait_until(what, 10.0, turn=node.midi.look)

        for value in (3, 90, 127):
            hand.send(0xB0, 74, value)
        until(lambda: node.settings.filter_hz == 3200.0)
        hand.send(0xB0, 7, 127)  # of another channel: nothing
        hand.send(0xB1, 7, 127)
        until(lambda: node.settings.filter == 'band-pass')
        hand.send(0x99, 36, 80)
        until(lambda: asked)
        assert asked[-1].values == {'mode': 'chain'}
        hand.send(0xC0, 3)
        until(lambda: node.settings.gain_db == -10.0)
        assert asked[-1].values == {'radius': 0.25}
        hand.send(0xB0, 1, 0)
        until(lambda: node.settings.gain_db == -30.0)
        hand.send(0xB0, 1, 127)
        until(lambda: node.settings.gain_db == -10.0)
        assert [a.values['radius'] for a in asked[-2:]] == [0.05, 0.25]
        hand.send(0xC0, 0)  # no line names it: the first preset
        until(lambda: node.settings.gain_db == -30.0)
        expected = dataclasses.replace(
            settings, filter_hz=3200.0, filter='band-pass', gain_db=-30.0
        )
        assert node.settings == expected
    finally:
        if hand:
            hand.close()
        node.close()
        node.destroy_node()


def test_a_cue_is_given_and_what_comes_of_it_is_heard(ros, tmp_path, monkeypatch, capfd):
    settings = SoundSettings(
        device='wav',
        wav=str(tmp_path / 'o.wav'),
        midi_map=('note 37 cue evening', 'note 38 cue dawn'),
    )
    hours = HoursSettings('UTC', ('Mon-Sun 00:00-24:00',), cues=('evening mute',))
    scene = Scene('cued', {'sound': settings, 'hours': hours})
    sound = SoundNode(settings, scene=scene)
    midi = Midi(sound, sound.instrument)
    monkeypatch.setattr(midi, '_messages', lambda: [])
    press = lambda key: midi._do(event_of([0x90, key, 80]))  # noqa: E731
    with Nodes(sound) as nodes:
        hours = nodes.add(HoursNode(hours, scene=scene))
        nodes.meet()
        press(37)
        nodes.until(lambda: sound.muted and not midi._client.waiting)
        assert 'MIDI' not in capfd.readouterr().err
        press(38)
        nodes.until(lambda: not midi._client.waiting)
        assert 'MIDI note 1:38: hours: dawn: no such cue' in capfd.readouterr().err
        nodes.end(hours)
        press(37)
        for answers in midi._client._open.values():
            answers.until_s = 0.0
        nodes.until(lambda: not midi._client.waiting)
        assert 'MIDI note 1:37: hours does not answer' in capfd.readouterr().err
    alone = SoundNode(settings, scene=Scene('alone', {'sound': settings}))
    with Nodes(alone):
        Midi(alone, alone.instrument)._do(event_of([0x90, 37, 80]))
        assert 'MIDI note 1:37: hours does not run' in capfd.readouterr().err


@jack
@pytest.mark.slow
def test_a_controller_is_learnt_into_a_scene(server, tmp_path, capfd):
    pytest.importorskip('rtmidi')
    scene = tmp_path / 's.yaml'
    scene.write_text(
        'scene: s\nnodes:\n  twin:\n  tracker:\n  grains:\n  sound:\n    midi_map:  # keys\n'
        '      - note 1:36 recall storm\n      - cc 1:20 sound.gain_db\n    gain_db: -6.0\n'
    )

    def turn():
        hand = Hand('eol_ros')
        hand.send(0x80, 20, 0)  # a key that was let go is no word
        hand.send(0xB0, 20, 99)
        hand.close()

    hand = threading.Thread(target=turn)
    hand.start()
    words = ['midi', 'learn', 'sound.filter_hz 200 800', str(scene), '--input', 'jack:virtual']
    assert main([*words, '--for', '10']) == 0
    hand.join()
    assert capfd.readouterr().out == 'cc 1:20 sound.filter_hz 200 800\n'
    learnt = load(scene).settings('sound')
    wanted = ('note 1:36 recall storm', 'cc 1:20 sound.filter_hz 200 800')
    assert learnt.midi_map == wanted and learnt.gain_db == -6.0
    assert main(['midi', 'learn', 'sound.channels', '--input', 'jack:virtual']) == 78
    assert 'no live setting sound.channels' in capfd.readouterr().err
    assert main(['midi', 'watch', '--input', 'jack:nobody']) == 69
    assert 'no such input' in capfd.readouterr().err
