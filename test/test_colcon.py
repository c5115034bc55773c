# SPDX-License-Identifier: Apache-2.0
"""Both packages build with colcon, as in any ROS workspace, from the same files that pip reads."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def test_colcon_builds_both_packages(tmp_path):
    colcon = Path(sys.executable).with_name('colcon')
    if not colcon.exists():
        pytest.skip('colcon is not installed: pip install colcon-common-extensions')
    source = tmp_path / 'src'
    shutil.copytree(ROOT / 'msg_defs', source / 'msg_defs')
    package = source / 'eol_ros'
    package.mkdir()
    for name in ('package.xml', 'setup.py', 'setup.cfg'):
        shutil.copy(ROOT / name, package)
    for name in ('eol_ros', 'config', 'resource'):
        shutil.copytree(ROOT / name, package / name, ignore=shutil.ignore_patterns('__pycache__'))
    path = os.pathsep.join([str(colcon.parent), os.environ['PATH']])
    environment = {**os.environ, 'AMENT_PREFIX_PATH': sys.prefix, 'PATH': path}
    build = subprocess.run(
        [colcon, 'build', '--event-handlers', 'console_direct+', '--executor', 'sequential'],
        cwd=tmp_path, env=environment, capture_output=True, text=True,
    )
    assert build.returncode == 0, build.stdout[-3000:] + build.stderr[-3000:]

    script = (
        'import eol_msgs.msg, eol_ros, os;'
        'from rclpy.serialization import serialize_message as s, deserialize_message as d;'
        'm = eol_msgs.msg.Slip(block=7); assert d(s(m), eol_msgs.msg.Slip) == m;'
        'print(eol_msgs.__file__); print(eol_ros.__file__);'
        'from eol_ros import scene; print(len(scene.shipped()))'
    )
    result = subprocess.run(
        ['bash', '-c', f'. install/setup.bash && cd / && {sys.executable} -c "{script}"'],
        cwd=tmp_path, env=environment, capture_output=True, text=True,
    )
    assert result.returncode == 0, result.stderr
    messages, nodes, scenes = result.stdout.split()
    assert messages.startswith(str(tmp_path)) and nodes.startswith(str(tmp_path))
    assert int(scenes) >= 5
    libexec = tmp_path / 'install' / 'eol_ros' / 'lib' / 'eol_ros'
    assert {'tracker', 'bringup', 'eol'} <= {p.name for p in libexec.iterdir()}  # for `ros2 run`
