# SPDX-License-Identifier: Apache-2.0
"""A user's mistake gets one clear line and the right exit code, never a traceback."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from support.domains import next_domain

from eol_ros import cli
from eol_ros.bringup import run

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def scene(folder, nodes):
    path = folder / 'scene.yaml'
    path.write_text(f'nodes:\n{nodes}')
    return str(path)


@pytest.mark.parametrize(
    'words, code, hint',
    [
        (['musuem'], 78, 'Did you mean museum?'),
        (['no/such.yaml'], 78, 'no such scene'),
        (['/'], 78, '/: is a folder; name the YAML file of a scene in it'),
        (['lights', '--only', 'trakcer'], 2, 'Did you mean tracker?'),
        (['lights', '--only', 'camera', '--bag', '/tmp'], 2, '--only leaves the recorder out'),
        (['--for', '-3'], 2, '-3 is outside'),
        (['--fro', '3'], 2, 'no such option. Did you mean --for?'),
    ],
)
def test_command_line(words, code, hint, capsys):
    assert cli.main(['run', *words]) == code
    assert hint in capsys.readouterr().err


@pytest.mark.parametrize(
    ('nodes', 'told'),
    [
        ('tracker: {tuio: ["a:1"]}', 'tracker.tuio: no such key; nodes.osc has it'),
        ('tracker: {pairs: x}', 'tracker.pairs: no such key; nodes.montage has it'),
    ],
)
def test_a_setting_of_another_node_is_told_whose_it_is(nodes, told, tmp_path, capsys):
    assert cli.main(['run', scene(tmp_path, f'  twin: {{}}\n  {nodes}\n')]) == 78
    assert told in capsys.readouterr().err


def test_a_scene_without_a_recorder_says_so_once_and_bag_brings_it_back(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(next_domain()))
    monkeypatch.setattr(run, 'Supervisor', lambda *_: SimpleNamespace(run=lambda _: 0))
    monkeypatch.setattr(run.thread_faults, 'install', lambda: None)  # for the whole process
    nodes = '  twin: {}\n  tracker: {}\n  recorder: off\n'

    def said(nodes, *words):
        assert cli.main(['run', scene(tmp_path, nodes), *words]) == 0
        return capfd.readouterr().err.splitlines()

    not_recorded = 'not recorded: recorder is off in this scene'
    assert said(nodes) == ['scene: twin, tracker', not_recorded]
    assert said(nodes, '--bag', str(tmp_path)) == ['scene: twin, tracker, recorder']
    assert said(nodes.replace('off', '{}'), '--only', 'twin,tracker') == [
        'scene: twin, tracker', 'not recorded: --only does not name the recorder'
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('words', 'domain'),
    [(['status'], 'abc'), (['echo', 'slips'], '300'), (['run', 'lights'], '300')],
)
def test_a_domain_that_cannot_be_is_one_line(words, domain, monkeypatch, capsys):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    monkeypatch.setattr(run.thread_faults, 'install', lambda: None)
    assert cli.main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"eol {words[0]}: ROS_DOMAIN_ID is '{domain}'")


@pytest.mark.parametrize(
    'words, domain, said',
    [
        ([], '300', "motion: ROS_DOMAIN_ID is '300'"),
        (
            ['--ros-args', '--params-file', 'absent.yaml'], '1',
            "motion: --ros-args: Couldn't parse params file: '--params-file absent.yaml'",
        ),
        (['--ros-args', '-r', '__ns:=/9'], '1', "Couldn't parse remap rule: '-r __ns:=/9'"),
        (['--ros-args', '--absent'], '1', "motion: --ros-args: ROS knows no ['--absent']"),
    ],
)  # fmt: skip
def test_what_ros_itself_would_refuse_is_one_line(words, domain, said):
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros.nodes', 'motion', *words], timeout=90,
        env={**os.environ, 'ROS_DOMAIN_ID': domain}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    *logged, line = done.stderr.splitlines()  # of rcl; that it keeps to itself there is no asking
    assert said in line and all('[rcl]' in other for other in logged)
