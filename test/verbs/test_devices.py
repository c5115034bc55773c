# SPDX-License-Identifier: Apache-2.0
import json
import sys

import pytest
import yaml

from eol_ros.cli import main
from eol_ros.devices import inventory
from eol_ros.devices.inventory import Found, find_all
from eol_ros.devices.ports import Port
from eol_ros.streams.graph import NODES

CAMERA = Port('/dev/v4l/by-id/usb-OV9281_1-video-index0', '/dev/video0', 'OV9281')
BOARD = Port('/dev/serial/by-id/usb-Teensy_12', '/dev/ttyACM0', 'Teensy')


class Sound:
    """sounddevice with two cards, one of them for recording only."""

    @staticmethod
    def query_hostapis():
        return [{'name': 'ALSA'}]

    @staticmethod
    def query_devices():
        card = {'hostapi': 0, 'default_samplerate': 48000.0}
        return [
            card | {'index': 0, 'name': 'USB Audio: "main"', 'max_output_channels': 2},
            card | {'index': 1, 'name': 'Microphone', 'max_output_channels': 0},
        ]


@pytest.fixture
def plugged(tmp_path, monkeypatch):
    """A camera, a board and a screen."""
    for name, status, modes in (
        ('card0-HDMI-A-1', 'connected', '1920x1080\n1280x720\n'),
        ('card0-DP-1', 'disconnected', ''),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'status').write_text(status + '\n')
        (tmp_path / name / 'modes').write_text(modes)
    monkeypatch.setattr(inventory, 'DRM', tmp_path)
    monkeypatch.setattr(inventory, 'list_cameras', lambda: [CAMERA])
    monkeypatch.setattr(inventory, 'list_ports', lambda: [BOARD])


@pytest.fixture
def portaudio(monkeypatch):
    """PortAudio with two cards."""
    monkeypatch.setitem(sys.modules, 'sounddevice', Sound)


def test_all_kinds_are_found(plugged, portaudio):
    found, remarks = find_all()

    assert [(f.kind, f.name) for f in found] == [
        ('camera', CAMERA.name),
        ('board', BOARD.name),
        ('sound card', 'USB Audio: "main"'),
        ('screen', 'HDMI-A-1'),
    ]
    assert remarks == []
    for device in found:  # each line is what a scene takes
        if device.scene_line:
            ((node, values),) = yaml.safe_load(device.scene_line).items()
            settings = NODES[node].settings(**values)
            assert device.name in vars(settings).values()


def test_without_portaudio_the_rest_is_still_listed(plugged, monkeypatch):
    class Missing:
        def find_spec(self, name, path=None, target=None):
            if name == 'sounddevice':
                raise OSError('PortAudio library not found')

    monkeypatch.delitem(sys.modules, 'sounddevice', raising=False)
    monkeypatch.setattr(sys, 'meta_path', [Missing(), *sys.meta_path])
    found, remarks = find_all()

    assert [f.kind for f in found] == ['camera', 'board', 'screen']
    assert 'sudo apt install libportaudio2' in remarks[0]


def test_the_verb_on_this_machine(capsys):
    assert main(['devices', '--json']) == 0
    report = json.loads(capsys.readouterr().out)
    assert all(set(d) == set(Found.__annotations__) for d in report['devices'])


def test_the_verb_for_people(capsys, monkeypatch):
    found = [Found('camera', 'cam', 'OV9281', 'camera: {device: "cam"}')]
    monkeypatch.setattr(inventory, 'find_all', lambda: (found, ['a remark']))

    assert main(['devices']) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == (
        'usable: plug in a board, a sound card, a screen (no board and no sound card and no screen:'
        ' the scene runs without it)'
    )
    assert out.startswith('cameras\n  cam  OV9281\n      camera: {device: "cam"}\nboards: none')
    assert err == 'a remark\n'
