# SPDX-License-Identifier: Apache-2.0
"""Physics scenes on disk, and the command that solves them."""

import json
import os

import numpy as np
import pytest

from eol_ros import cli
from eol_ros.devices.files.physics_file import load_scene, save_scene
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.lab import presets


def test_saved_scene_is_the_same_scene(tmp_path):
    save_scene(tmp_path / 's.json', presets.scene('S4G'))
    scene = load_scene(tmp_path / 's.json')
    assert scene.source == json.loads(json.dumps(presets.scene('S4G')))


@pytest.mark.parametrize(
    'text, words',
    [
        ('{"n": 1,', ':1:'),
        ('[1, 2]', 'an object'),
        ('{"n": 1, "n": 2}', "'n' stands twice"),
        ('{"n": 1}', "lacks the key 'mass'"),
        ('{"n": 1' + '0' * 5000 + '}', 'thousands of digits'),
    ],
)
def test_a_broken_file_is_named_with_its_mistake(tmp_path, capsys, text, words):
    path = tmp_path / 'broken.json'
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_scene(path)
    assert 'broken.json' in str(caught.value)
    assert words in str(caught.value)
    assert cli.main(['simulate', str(path)]) == os.EX_CONFIG
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_place_that_cannot_be_written_is_no_missing_device(tmp_path):
    with pytest.raises(ConfigError, match='No such file'):
        save_scene(tmp_path / 'no' / 's.json', {})


def test_a_missing_file_is_a_missing_device(tmp_path):
    with pytest.raises(DeviceMissing):
        load_scene(tmp_path / 'none.json')


def test_the_json_of_a_run_that_overflows_has_no_nan(tmp_path, capsys):
    path = tmp_path / 'far.json'
    save_scene(path, presets.scene('S3G') | {'v0': [[1e40, 1e40]] * 25})
    assert cli.main(['simulate', str(path), '--json']) == 1
    report = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert report['status'] == 'not finite'
    assert report['energy']['residual_J'] is None


def test_simulate_writes_what_it_promises(tmp_path, capsys):
    out = tmp_path / 'r.npz'
    code = cli.main(['simulate', 'S1', '--json', '--output', str(out), '--sample', '0.5'])
    report = json.loads(capsys.readouterr().out)
    assert code == 0
    assert report['path'] == 'exact'
    assert report['status'] == 'ok'
    assert report['events'] == 64
    assert set(report['energy']) == {
        'work_J',
        'kinetic_J',
        'elastic_J',
        'friction_J',
        'residual_J',
    }
    with np.load(out) as data:
        assert data['t'].shape == (121,)
        assert data['u'].shape == data['v'].shape == (121, 1, 2)
        assert data['event_start'].tolist() == [1, 0] * 32
        assert len(data['event_t']) == len(data['event_block']) == 64


def test_a_stopped_run_says_so(capsys):
    assert cli.main(['simulate', 'S3L', '--max-steps', '10', '--json']) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out)['status'] == 'step limit'
    assert 'step limit' in printed.err


@pytest.mark.parametrize('words', [['--path', 'exact'], ['--tol', '0.5'], ['--sample', '0']])
def test_what_cannot_be_done_is_a_usage_error(words, capsys):
    assert cli.main(['simulate', 'S3G', *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
