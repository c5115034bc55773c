# SPDX-License-Identifier: Apache-2.0
"""A first start: no clock that was ever set, and folders that cannot be written."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from support.checkout import ROOT
from support.domains import next_domain
from support.fake_clock import FakeClock
from support.waiting import wait_until

from eol_ros import compiled
from eol_ros.bringup import status
from eol_ros.bringup.policy import START_S
from eol_ros.errors import ConfigError, EolError

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
NOWHERE = '/proc/1/nothing'  # can be written by nobody, root included
LIGHT = """\
nodes:
  montage: {}
  hours: {time_zone: UTC, open: [2026-01-01 10:00-11:00]}
  panel: {port: 0}
  recorder: {folder: bags, min_free_gb: 0}
elsewhere: [motion]
"""
WHOLE = """\
scene: scene
include: rehearsal.yaml
nodes:
  panel: {port: 0}
  sound: {device: wav}
  hours: {time_zone: UTC, open: ['Mon-Sun 0:00-24:00']}
  recorder: {folder: bags, min_free_gb: 0, images: none}
"""


def environment(tmp_path, **changes):
    values = {**os.environ, 'EOL_STATE': str(tmp_path / 'state'), **changes}
    return {name: value for name, value in values.items() if value is not None}


def bringup(path, *words):
    return [sys.executable, '-m', 'eol_ros.bringup', str(path), *words]


@pytest.mark.parametrize(
    'scene', [LIGHT, pytest.param(WHOLE, marks=pytest.mark.soak)], ids=['light', 'whole']
)
def test_a_start_in_1970_and_then_a_jump_of_decades(tmp_path, scene):
    (tmp_path / 'scene.yaml').write_text(scene)
    shutil.copy(ROOT / 'config' / 'rehearsal.yaml', tmp_path)
    clock, domain = FakeClock(tmp_path, int((60 - time.time()) * 1e9)), next_domain()
    process = subprocess.Popen(
        bringup('scene.yaml'), cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        env=environment(tmp_path, ROS_DOMAIN_ID=str(domain), **clock.environment),
    )  # fmt: skip

    def rows(*levels):
        """Return the text of each node, once all are of one of these levels."""
        try:
            nodes = status.ask(domain)['nodes']
        except EolError:
            return None
        well = all(row['level'] in levels for row in nodes)
        return {row['node']: row['text'] for row in nodes} if well else None

    try:
        texts = wait_until(lambda: rows(0, 1), 180)
        assert 'the clock says 1970-01-01 00:0' in texts['hours']
        assert 'stays open' in texts['hours'] and 'asleep' not in texts['montage']
        assert 'scene_1970-01-01' in texts['recorder']
        clock.set(0)
        asleep = scene == LIGHT
        wait_until(lambda: rows(0) and asleep == rows(0)['hours'].startswith('asleep'), 60)
        wait_until(lambda: asleep == ('asleep' in rows(0, 1)['montage']), 60)
        wait_until(lambda: len(list((tmp_path / 'bags').glob('scene_*'))) == 2, 60)
        assert status.ask(domain)['restarts'] == 0
    finally:
        process.send_signal(signal.SIGINT)
        told = process.communicate(timeout=90)[1]
    assert process.returncode == 0, told
    names = sorted(path.name for path in (tmp_path / 'bags').glob('scene_*'))
    assert names[0].startswith('scene_1970-01-01') and names[1] > 'scene_2026'
    assert 'Traceback' not in (tmp_path / 'state' / 'eol.log').read_text()


def test_a_museum_without_its_camera_ends_after_its_time(tmp_path):
    """A fault as long as `--for` ends the run, though other nodes still wait for images."""
    shutil.copy(ROOT / 'config' / 'museum.yaml', tmp_path)
    scene = 'include: museum.yaml\nnodes: {camera: {device: /dev/no-camera}, recorder: off}\n'
    (tmp_path / 'scene.yaml').write_text(scene)
    done = subprocess.run(
        bringup('scene.yaml', '--for', '5', '--only', 'camera,tracker,motion'), cwd=tmp_path,
        capture_output=True, text=True, timeout=300,
        env=environment(tmp_path, ROS_DOMAIN_ID=str(next_domain())),
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    lines = done.stderr.splitlines()
    [last] = [line for line in lines if line.startswith('not all OK within')]
    assert 5 <= int(last.split()[4]) < START_S and 'camera /dev/no-camera is not there' in last
    assert lines[-1].endswith(' 0 restarts') and 'Traceback' not in done.stderr


def test_a_home_and_a_state_folder_that_cannot_be_written(tmp_path):
    """Only the cache must be writable: a warning names the state folder; no home is needed."""
    (tmp_path / 'scene.yaml').write_text(LIGHT)
    (tmp_path / 'file').write_text('')
    nothing = {'HOME': NOWHERE, 'XDG_CACHE_HOME': None, 'XDG_STATE_HOME': None}
    done = subprocess.run(
        bringup('scene.yaml', '--for', '0.5'), cwd=tmp_path, capture_output=True, text=True,
        env=environment(tmp_path, ROS_DOMAIN_ID=str(next_domain()),
                        EOL_STATE=str(tmp_path / 'file' / 'state'),
                        EOL_CACHE=str(tmp_path / 'cache'), **nothing),
    )  # fmt: skip
    assert done.returncode == 0 and 'all OK' in done.stderr, done.stderr
    [line] = [line for line in done.stderr.splitlines() if line.startswith('WARN ')]
    assert 'no log is written and nothing is remembered' in line
    assert 'Traceback' not in done.stderr

    done = subprocess.run(
        bringup('scene.yaml'), cwd=tmp_path, capture_output=True, text=True,
        env=environment(tmp_path, ROS_DOMAIN_ID=str(next_domain()), EOL_CACHE=None, **nothing),
    )  # fmt: skip
    assert done.returncode == 78
    last = done.stderr.splitlines()[-1]
    assert '; set EOL_CACHE to a folder that can be written' in last and NOWHERE in last


@pytest.fixture
def package(tmp_path):
    """A copy of the package in which nothing can be kept beside the sources."""
    shutil.copytree(ROOT / 'eol_ros', tmp_path / 'eol_ros',
                    ignore=shutil.ignore_patterns('__pycache__'))  # fmt: skip
    root = tmp_path / 'eol_ros'
    for folder in [root, *(path for path in root.rglob('*') if path.is_dir())]:
        (folder / '__pycache__').touch()  # a file: no folder of this name can be made
    return tmp_path


def test_no_folder_for_compiled_loops(package):
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros.nodes', 'twin'],
        cwd=package, capture_output=True, text=True,
        env=environment(package, PYTHONPATH=str(package), HOME=NOWHERE, XDG_CACHE_HOME=None,
                        NUMBA_CACHE_DIR=None, EOL_CACHE=str(package / 'cache')),
    )  # fmt: skip
    assert done.returncode in (78, 1), done.stderr
    assert 'Traceback' not in done.stderr
    line = next(line for line in done.stderr.splitlines() if 'NUMBA_CACHE_DIR' in line)
    assert f'{NOWHERE}/.cache/numba/' in line and '; set NUMBA_CACHE_DIR to a folder' in line


def test_a_folder_for_compiled_loops_that_is_named_and_cannot_be_written(monkeypatch):
    monkeypatch.setenv('NUMBA_CACHE_DIR', NOWHERE)
    with pytest.raises(ConfigError, match='set NUMBA_CACHE_DIR to a folder that can be written'):
        compiled.stamp('ice')
