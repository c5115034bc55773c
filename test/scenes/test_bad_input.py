# SPDX-License-Identifier: Apache-2.0
"""A user's mistake gets one clear line and the right exit code, never a traceback."""

import os
import subprocess
import sys

import pytest
from support.domains import next_domain

from eol_ros import cli

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def bringup(*words, cwd=None):
    return subprocess.run(
        [sys.executable, '-m', 'eol_ros.bringup', *words],
        cwd=cwd,
        timeout=90,
        env={**os.environ, 'ROS_DOMAIN_ID': str(next_domain())},
        capture_output=True,
        text=True,
    )


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
        (
            'sound: {osc_out: "a:1"}',
            'error sound.osc_out: a node has this now: write osc: {send_to: [HOST:PORT]}',
        ),
        (
            'sound: {osc_in: 9000}',
            'error sound.osc_in: a node has this now: write osc: {port: PORT}',
        ),
    ],
)
def test_a_setting_of_another_node_is_told_whose_it_is(nodes, told, tmp_path, capsys):
    assert cli.main(['run', scene(tmp_path, f'  twin: {{}}\n  {nodes}\n')]) == 78
    assert told in capsys.readouterr().err


def stopped_by(folder, nodes, *words):
    """Run a scene that cannot start; return its exit code and what it says."""
    result = bringup(scene(folder, nodes), '--for', '1', *words, cwd=folder)
    assert 'Traceback' not in result.stderr, result.stderr
    return result.returncode, result.stderr


NOT_RECORDED = 'not recorded: recorder is off in this scene'


def test_a_scene_without_a_recorder_says_so_once_and_bag_brings_it_back(tmp_path):
    (tmp_path / 'run.avi').write_text('not a video')  # ends the run as soon as it has begun
    nodes = '  camera: {device: run.avi}\n  tracker: {}\n  recorder: off\n'

    _, words = stopped_by(tmp_path, nodes)
    assert words.splitlines()[:2] == ['scene: camera, tracker', NOT_RECORDED]
    assert words.count('not recorded') == 1

    _, words = stopped_by(tmp_path, nodes, '--bag', str(tmp_path / 'bags'))
    assert words.splitlines()[0] == 'scene: camera, tracker, recorder'
    assert 'not recorded' not in words

    _, words = stopped_by(tmp_path, nodes.replace('off', '{}'), '--only', 'camera,tracker')
    assert words.count('not recorded: --only does not name the recorder') == 1


@pytest.mark.parametrize(
    'words, domain, said',
    [
        (['eol_ros', 'status'], 'abc', "eol status: ROS_DOMAIN_ID is 'abc'"),
        (['eol_ros', 'echo', 'slips'], '300', "eol echo: ROS_DOMAIN_ID is '300'"),
        (['eol_ros.bringup', 'lights'], '300', "eol run: ROS_DOMAIN_ID is '300'"),
        (['eol_ros.nodes', 'motion'], '300', "motion: ROS_DOMAIN_ID is '300'"),
        (
            ['eol_ros.nodes', 'motion', '--ros-args', '--params-file', 'absent.yaml'], '1',
            "motion: --ros-args: Couldn't parse params file: '--params-file absent.yaml'",
        ),
        (
            ['eol_ros.nodes', 'motion', '--ros-args', '-r', '__ns:=/9'], '1',
            "motion: --ros-args: Couldn't parse remap rule: '-r __ns:=/9'",
        ),
        (
            ['eol_ros.nodes', 'motion', '--ros-args', '--absent'], '1',
            "motion: --ros-args: ROS knows no ['--absent']",
        ),
    ],
)  # fmt: skip
def test_what_ros_itself_would_refuse_is_one_line(words, domain, said):
    done = subprocess.run(
        [sys.executable, '-m', *words], env={**os.environ, 'ROS_DOMAIN_ID': domain}, timeout=90,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    *logged, line = done.stderr.splitlines()  # of rcl; that it keeps to itself there is no asking
    assert said in line and all('[rcl]' in other for other in logged)
