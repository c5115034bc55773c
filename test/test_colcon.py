# SPDX-License-Identifier: Apache-2.0
"""`git clone` into a workspace and `colcon build` find and build both packages."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.checkout import checkout

from eol_ros.streams.graph import NODES

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # 50 s of compiling, on a busy machine


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A ROS workspace with a clone in it, and nothing else done."""
    folder = tmp_path_factory.mktemp('ws')
    clone = checkout(folder / 'src' / 'eol_ros')
    if not (clone / 'workspace').is_dir():
        pytest.skip('an sdist has no folder `workspace`: only a clone builds with colcon at once')
    return folder


@pytest.fixture(scope='module')
def environment():
    colcon = Path(sys.executable).with_name('colcon')
    if not colcon.exists():
        pytest.skip('colcon is not installed: pip install colcon-common-extensions')
    path = os.pathsep.join([str(colcon.parent), os.environ['PATH']])
    found = {**os.environ, 'AMENT_PREFIX_PATH': sys.prefix, 'PATH': path}
    found.pop('PYTHONPATH', None)
    return found


def listed(folder, environment, *words):
    result = subprocess.run(
        ['colcon', 'list', *words], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    assert 'WARNING' not in result.stderr
    return {line.split()[0]: line.split()[1] for line in result.stdout.splitlines()}


def test_the_plain_command_finds_both(workspace, environment):
    both = {'eol_ros', 'eol_msgs'}
    side = workspace / 'src' / 'eol_ros' / 'workspace'

    assert set(listed(workspace, environment)) == both
    assert set(listed(side.parent, environment)) == both  # within the clone, too
    assert set(listed(workspace, environment, '--paths', *sorted(side.glob('eol_*')))) == both


def test_rosdep_and_bloom_find_both(workspace):
    """They look for packages with catkin_pkg, which goes no deeper than a package.xml."""
    packages = pytest.importorskip('catkin_pkg.packages')
    found = packages.find_packages(str(workspace / 'src' / 'eol_ros' / 'workspace'))

    assert {package.name for package in found.values()} == {'eol_ros', 'eol_msgs'}


@pytest.mark.soak
def test_colcon_builds_both_packages(workspace, environment):
    build = subprocess.run(
        ['colcon', 'build', '--event-handlers', 'console_direct+', '--executor', 'sequential'],
        cwd=workspace, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert build.returncode == 0, build.stdout[-3000:] + build.stderr[-3000:]

    script = (
        'import eol_msgs.msg, eol_ros, os;'
        'from rclpy.serialization import serialize_message as s, deserialize_message as d;'
        'm = eol_msgs.msg.Slip(block=7); assert d(s(m), eol_msgs.msg.Slip) == m;'
        'print(eol_msgs.__file__); print(eol_ros.__file__);'
        'from eol_ros import scene; print(len(scene.shipped()))'
    )
    result = in_workspace(workspace, environment, f'cd / && {sys.executable} -c "{script}"')
    assert result.returncode == 0, result.stderr
    messages, nodes, scenes = result.stdout.split()
    assert messages.startswith(str(workspace)) and nodes.startswith(str(workspace))
    assert int(scenes) >= 5
    share = workspace / 'install' / 'eol_ros' / 'share' / 'eol_ros'  # where `ros2 launch` looks
    assert (share / 'launch' / 'eol.launch.py').is_file()
    libexec = workspace / 'install' / 'eol_ros' / 'lib' / 'eol_ros'  # where `ros2 run` looks
    runnable = {p.name for p in libexec.iterdir() if os.access(p, os.X_OK)}
    assert runnable == {*NODES, 'bringup', 'eol'}
    for name, known in (('tracker', 'nodes.tracker'), ('bringup', 'eol run'), ('eol', 'VERB')):
        said = in_workspace(workspace, environment, f'cd / && {libexec / name} --help')
        assert said.returncode == 0 and known in said.stdout.splitlines()[0], said.stderr
    checked = in_workspace(workspace, environment, f'cd / && {libexec / "eol"} check museum')
    assert checked.returncode == 0, checked.stderr


def in_workspace(workspace, environment, line):
    return subprocess.run(
        ['bash', '-c', f'. install/setup.bash && {line}'],
        cwd=workspace, env=environment, capture_output=True, text=True,
    )  # fmt: skip
