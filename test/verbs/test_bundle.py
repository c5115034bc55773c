# SPDX-License-Identifier: Apache-2.0
"""One file for those who help: what is in it, and what is not."""

import json
import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.domains import next_domain

from eol_ros import cli, folders
from eol_ros.verbs import bundle as verb

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


def test_a_scene_with_mistakes_gives_no_secret_away(bundle):
    found = bundle(SCENE.replace('twin: {}', 'twin: {fps: many}'))
    assert 'many' in found['check.txt'] and not [n for n, text in found.items() if PIN in text]
    assert found['logs/events.log'] == 'panel: somebody typed ***\n'


def test_it_has_what_helps_and_no_secret(bundle, bag_cut_short):
    found = bundle()

    assert not [name for name, text in found.items() if PIN in text]
    assert "pin: '***'" in json.loads(found['scene.json'])['text']
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


def test_bags_are_those_of_the_recorder_that_runs(bundle, bag_cut_short, monkeypatch):
    """Its folder may be another than that of the scene here, and relative to where it runs."""
    other = bag_cut_short.parent.rename(bag_cut_short.parents[1] / 'other')
    row = {'node': 'recorder', 'pid': os.getpid(), 'values': {'bag': f'other/{bag_cut_short.name}'}}
    monkeypatch.setattr(verb.reach, 'status_of', lambda _args: {'nodes': [row]})
    found = json.loads(bundle()['bags.json'])
    assert found['folder'] == str(other) and len(found['newest']) == 1


def test_a_file_that_cannot_be_written_is_said_before_the_work(bundle, capsys):
    assert cli.main(['bundle', '-o', '/nowhere/out.zip']) == 78
    assert '--output /nowhere/out.zip' in capsys.readouterr().err


def test_a_scene_that_is_not_there_is_said_and_nothing_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    assert cli.main(['bundle', 'musuem', '-o', 'out.zip']) == 78
    assert capsys.readouterr().err == 'eol bundle: musuem: no such scene. Did you mean museum?\n'
    assert not Path('out.zip').exists()


def test_a_part_that_fails_is_told_in_its_place(bundle, monkeypatch):
    monkeypatch.setattr(verb, '_bags', lambda _scene: 1 // 0)

    found = bundle()

    assert 'ZeroDivisionError' in found['bags.json']
    assert found['logs/eol.log'].endswith('the end')


def test_a_program_that_hangs_is_named_with_what_it_said(monkeypatch):
    monkeypatch.setattr(verb, 'COMMAND_S', 0.5)
    code, text = verb._asked(['sh', '-c', 'echo half; exec sleep 600'])

    assert (code, text) == (1, 'half\nsh did not answer within 0.5 s\n')


def test_ctrl_c_stops_it_and_leaves_nothing(bundle):
    """As a terminal sends it: to the command and to all that it has started."""
    bundle()
    child = subprocess.Popen(
        [sys.executable, '-m', 'eol_ros', 'bundle', 'scene.yaml', '-o', 'stopped.zip'],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        while child.stderr.readline() not in ('eol bundle: scene.json\n', ''):
            pass
        os.killpg(child.pid, signal.SIGINT)  # `eol check` runs now, which ends by itself
        said = child.communicate(timeout=60)[1]
    finally:
        child.kill()

    assert said.endswith('eol bundle: stopped\n') and 'journal.txt' not in said
    assert (child.returncode, Path('stopped.zip').exists()) == (0, False)
