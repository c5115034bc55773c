# SPDX-License-Identifier: Apache-2.0
"""One file for those who help: what is in it, and what is not."""

import json
import os
import zipfile
from pathlib import Path

import pytest
from support.domains import next_domain

from eol_ros import cli, folders

PIN = 'kept-to-ourselves'
SCENE = f"""\
nodes:
  twin: {{}}
  tracker: {{}}
  panel: {{host: 0.0.0.0, pin: {PIN}}}
  recorder: {{folder: bags}}
"""


@pytest.fixture
def bundle(tmp_path, monkeypatch, capsys):
    """Write a bundle of this scene; return what is in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))
    monkeypatch.setenv('ROS_DOMAIN_ID', str(next_domain()))  # where nothing runs
    folders.state().joinpath('events.log').write_text(f'panel: somebody typed {PIN}\n')
    folders.state().joinpath('eol.log').write_text('x' * 6_000_000 + 'the end')

    def make(scene=SCENE):
        Path('scene.yaml').write_text(scene)
        assert cli.main(['bundle', 'scene.yaml', '-o', 'out.zip']) == 0
        assert capsys.readouterr().out == 'out.zip\n'
        with zipfile.ZipFile('out.zip') as file:
            return {name: file.read(name).decode() for name in file.namelist()}

    return make


def test_it_has_what_helps_and_no_secret(bundle, bag_cut_short):
    found = bundle()

    assert not [name for name, text in found.items() if PIN in text]
    assert 'pin: ***' in json.loads(found['scene.json'])['text']
    assert json.loads(found['scene.json'])['settings']['nodes']['panel']['pin'] == '***'
    assert json.loads(found['about.json'])['versions']['eol_ros']
    assert f'no graph runs on domain {os.environ["ROS_DOMAIN_ID"]}' in found['status.json']
    assert 'no mistakes' in found['check.txt'] and 'devices' in json.loads(found['devices.json'])
    (bag,) = json.loads(found['bags.json'])['newest']
    assert bag['bag'] == bag_cut_short.name and bag['cut_short']
    assert found['logs/events.log'] == 'panel: somebody typed ***\n'
    assert len(found['logs/eol.log']) == 5_000_000 and found['logs/eol.log'].endswith('the end')


def test_a_broken_scene_is_what_help_is_needed_for(bundle):
    found = bundle('nodes: {tracker: {nonsense: 1}}\n')

    assert 'no such key' in found['check.txt'] and 'exit code 78' in found['check.txt']
    assert 'no such key' in found['scene.json']
    assert json.loads(found['about.json'])['cores'] > 0


@pytest.fixture
def bag_cut_short(tmp_path):
    """A bag whose last half is not there any more."""
    whole = Path(__file__).parents[2] / 'bags' / 'sample' / 'sample_0.mcap'
    folder = tmp_path / 'bags' / 'museum_2026-11-22_10-00-00'
    folder.mkdir(parents=True)
    data = whole.read_bytes()
    (folder / 'museum_2026-11-22_10-00-00_0.mcap').write_bytes(data[: len(data) // 2])
    return folder


def test_a_file_that_cannot_be_written_is_said_before_the_work(bundle, capsys):
    assert cli.main(['bundle', '-o', '/nowhere/out.zip']) == 78
    assert '--output /nowhere/out.zip' in capsys.readouterr().err
