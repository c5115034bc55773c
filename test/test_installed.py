# SPDX-License-Identifier: Apache-2.0
"""Without ROS or the messages: one line says what installs them, and nothing is started."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from eol_ros.ros import installed

ROOT = Path(__file__).parents[1]


@pytest.fixture
def without(tmp_path):
    """Return a function that runs a Python line where the packages named cannot be imported."""

    def run(names, *words):
        hidden = tmp_path / 'hidden'
        hidden.mkdir(exist_ok=True)
        (hidden / 'sitecustomize.py').write_text(
            f'import sys; sys.modules.update(dict.fromkeys({names!r}))'
        )
        path = os.pathsep.join([str(hidden), str(ROOT), os.environ.get('PYTHONPATH', '')])
        environment = {**os.environ, 'PYTHONPATH': path, 'EOL_STATE': str(tmp_path / 'state')}
        return subprocess.run(
            [sys.executable, *words], env=environment, capture_output=True, text=True, timeout=60
        )

    return run


NEEDS_ROS = [
    ('eol_msgs', '-m eol_ros run'),
    ('rclpy', '-m eol_ros topics'),
    ('eol_msgs', '-m eol_ros.nodes tracker'),
]


@pytest.mark.slow
@pytest.mark.parametrize('name, words', NEEDS_ROS)
def test_one_line_says_what_to_install(without, tmp_path, name, words):
    result = without([name], *words.split())

    assert result.returncode == 69
    [line] = result.stderr.splitlines()
    assert f'{name} not installed' in line
    command = shlex.split(line.partition('Install with: ')[2])
    assert command == [sys.executable, '-m', 'pip', 'install', str(ROOT / 'msg_defs' / 'eol_msgs')]
    assert not (tmp_path / 'state').exists()  # not even the event log was begun


@pytest.mark.slow
def test_without_ros_all_is_named(without):
    result = without(list(installed.PACKAGES), '-m', 'eol_ros', 'check', '--json')
    answer = json.loads(result.stdout)

    assert result.returncode == 69
    assert answer['ok'] is False
    assert answer['missing'] == list(installed.PACKAGES)
    assert shlex.split(answer['install'])[-1] == str(ROOT / 'msg_defs' / 'eol_msgs')


@pytest.mark.slow
@pytest.mark.parametrize('words', [
    'lattice --size 8 --events 10 --warmup 0', 'topics --help'
])  # fmt: skip
def test_what_needs_no_ros_goes_on(without, words):
    result = without(list(installed.PACKAGES), '-m', 'eol_ros', *words.split())

    assert result.returncode == 0, result.stderr


def test_ros_of_another_kind_is_built_upon(monkeypatch, tmp_path):
    """Where rclpy is not of this environment, the wheel would bring a second ROS."""
    stock = tmp_path / 'opt' / 'ros' / 'rclpy'
    stock.mkdir(parents=True)
    (stock / '__init__.py').touch()
    monkeypatch.syspath_prepend(stock.parent)
    monkeypatch.delitem(sys.modules, 'rclpy', raising=False)  # of a test before

    assert installed.command().startswith('colcon build --packages-select eol_msgs')


def test_a_package_that_is_there_but_broken_keeps_its_traceback():
    there = ModuleNotFoundError("No module named 'rclpy.nonsense'", name='rclpy.nonsense')
    other = ModuleNotFoundError("No module named 'nonsense'", name='nonsense')

    assert installed.explained(there) is None
    assert installed.explained(other) is None
