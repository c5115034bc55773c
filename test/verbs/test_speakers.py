# SPDX-License-Identifier: Apache-2.0
import json
import time

import numpy as np
import pytest
import soundfile

from eol_ros import cli
from eol_ros.devices.audio import outputs

RING = """
scene: ring
nodes:
  camera: {}
  tracker: {}
  grains: {}
  sound:
    channels: 4
    sub_output: true
    speakers: [front 0 2, left 120 1, right -120 2 -3]
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / 'ring.yaml').write_text(RING)
    return str(tmp_path / 'ring.yaml')


def test_lists_them_with_delay_and_trim(scene, capsys):
    assert cli.main(['speakers', scene, '--json']) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row['name'] for row in rows] == ['front', 'left', 'right', 'sub']
    assert rows[1]['delay_ms'] == pytest.approx(1e3 / 343.2, abs=0.02)
    assert [row['trim_db'] for row in rows[:3]] == [0, -6.02, -3]
    assert rows[3] == {'output': 4, 'name': 'sub'}
    assert cli.main(['speakers', scene]) == 0
    assert capsys.readouterr().out.splitlines()[3].split() == ['4', 'sub']


def test_writes_noise_for_each_in_turn(scene, tmp_path, capsys):
    out = tmp_path / 'test.wav'
    words = ['--test', 'sub,left', '--seconds', '0.5', '--output', str(out)]
    assert cli.main(['speakers', scene, *words]) == 0
    sound, rate = soundfile.read(out)
    half = len(sound) // 2
    heard = [(np.abs(part).max(axis=0) > 0.1).tolist() for part in (sound[:half], sound[half:])]
    assert (rate, sound.shape[1]) == (48000, 4)
    assert heard == [[False, False, False, True], [False, True, False, False]]


def test_says_which_one_plays_while_it_plays(scene, capsys, monkeypatch):
    done = []

    class PortAudio:
        def play(self, sound, rate, device):
            done.append((sound.shape[1], rate, device, (np.abs(sound).max(axis=0) > 0.1).tolist()))

        def wait(self):
            done.append('waited')

    def sleep(seconds):
        done.append((capsys.readouterr().err, seconds))

    monkeypatch.setattr(outputs, 'find', lambda device, channels: 5)
    monkeypatch.setattr(outputs, 'portaudio', PortAudio)
    monkeypatch.setattr(time, 'sleep', sleep)
    assert cli.main(['speakers', scene, '--test', 'sub,left', '--seconds', '0.5']) == 0
    assert done == [
        (4, 48000, 5, [False, True, False, True]),
        ('noise from sub\n', 0.7), ('noise from left\n', 0.7), 'waited',
    ]  # fmt: skip


def test_refuses_a_name_that_is_not_there(scene, capsys):
    assert cli.main(['speakers', scene, '--test', 'middle']) == 2
    assert 'there are front, left, right, sub' in capsys.readouterr().err
    assert cli.main(['speakers', scene, '--output', 'x.wav']) == 2


def test_check_tells_what_does_not_fit(scene, tmp_path, capsys):
    text = RING.replace('channels: 4', 'channels: 3').replace('left 120 1', 'left 0.5 1')
    (tmp_path / 'ring.yaml').write_text(text + '    sub_low_hz: 70\n')
    assert cli.main(['check', scene]) == 78
    words = capsys.readouterr().err
    assert 'sound.speakers' in words and 'front stands in that direction already' in words
    assert 'sound.sub_low_hz: is 70, sub_high_hz is 60' in words.replace('error ', '')
    (tmp_path / 'ring.yaml').write_text(RING.replace('channels: 4', 'channels: 3'))
    assert cli.main(['check', scene]) == 78
    assert 'is 3; 3 speakers and one for the sub voice make 4' in capsys.readouterr().err
