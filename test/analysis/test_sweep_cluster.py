# SPDX-License-Identifier: Apache-2.0
"""A sweep on a real Dask scheduler and its workers, started as docs/guides/sweep.md says."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.sweeps import computed

import eol_ros
from eol_ros import cli
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError
from eol_ros.lab.sweeps import crews, spec, work

pytestmark = pytest.mark.slow

SWEEP = """
model: ofc
fixed: {events: 100000, warmup: 2000, bootstrap: 20}
vary:
  size: [8, 12]
  alpha: [0.15, 0.2]
  seed: {from: 1, to: 4}
"""
DASK = [sys.executable, '-m', 'dask']


class Cluster:
    def __init__(self, folder):
        self.folder, self.processes = folder, {}
        file = folder / 'scheduler.json'
        scheduler = ['scheduler', '--host', '127.0.0.1', '--port', '0', '--no-dashboard']
        self.start('scheduler', *scheduler, '--scheduler-file', str(file))
        self.address = None
        end_s = time.monotonic() + 60
        while self.address is None and time.monotonic() < end_s:
            time.sleep(0.05)
            if file.exists() and file.read_text():
                self.address = json.loads(file.read_text())['address']

    def start(self, name, *words, path=Path(eol_ros.__file__).parents[1]):
        environment = os.environ | {'PYTHONPATH': str(path), work.THREADS: '1'}
        log = open(self.folder / f'{name}.log', 'wb')  # noqa: SIM115  the process writes to it
        self.processes[name] = subprocess.Popen(
            [*DASK, *words], env=environment, stdout=log, stderr=log, cwd=self.folder
        )
        log.close()

    def worker(self, name, **more):
        host = ['--host', '127.0.0.1', '--no-dashboard', '--name', name]
        only = ['--nthreads', '1', '--no-nanny']
        self.start(name, 'worker', self.address, *host, *only, **more)

    def close(self):
        for process in self.processes.values():
            process.kill()
            process.wait()


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    cluster = Cluster(tmp_path_factory.mktemp('dask'))
    try:
        assert cluster.address
        cluster.worker('one')
        cluster.worker('two')
        yield cluster
    finally:
        cluster.close()


@pytest.fixture
def given(tmp_path, monkeypatch):
    monkeypatch.setenv(work.THREADS, '1')
    path = tmp_path / 'sweep.yaml'
    path.write_text(SWEEP)
    return spec.load(path)


def test_a_worker_of_a_cluster_killed_in_mid_task_loses_nothing(cluster, given, tmp_path):
    with crews.cluster(cluster.address) as crew:
        end_s = time.monotonic() + 60
        while crew.size() < 2 and time.monotonic() < end_s:
            time.sleep(0.05)
        sizes = []

        def kill(count):
            sizes.append(crew.size())
            if count == 3:
                cluster.processes['one'].send_signal(signal.SIGKILL)

        there = computed(tmp_path / 'cluster.csv', given, contextlib.nullcontext(crew), kill)
    here = computed(tmp_path / 'here.csv', given, crews.local(1))

    assert there == here
    assert sizes[0] == 2 and sizes[-1] == 1


def test_the_command_uses_the_cluster(cluster, given, tmp_path, capsys):
    words = ['sweep', str(tmp_path / 'sweep.yaml'), '--output', str(tmp_path / 'out.csv'), '--json']

    assert cli.main([*words, '--scheduler', cluster.address]) == 0
    assert json.loads(capsys.readouterr().out)['computed'] == 16


def test_many_bags_are_read_on_the_cluster(cluster, given, tmp_path, capsys):
    sample = BagReader(Path(eol_ros.__file__).parents[1] / 'bags' / 'sample')
    kept = [name for name in sample.topics if name.endswith(('/slips', '/cascades', '/block_taps'))]
    for later_s in (0, 3600):
        bag = BagWriter(tmp_path / 'bags' / f'run{later_s}', [sample.topics[n] for n in kept], {})
        for m in sample.messages(kept):
            more_ns = later_s * 10**9  # of the reception alone
            bag.write(m.topic, m.data, m.log_ns + more_ns, m.publish_ns + more_ns)
        bag.close()
    words = ['report', str(tmp_path / 'bags'), '--all', '--json', '--output', str(tmp_path / 'out')]

    assert cli.main(words) == 0
    here = json.loads(capsys.readouterr().out)
    assert cli.main([*words, '--scheduler', cluster.address]) == 0
    there = json.loads(capsys.readouterr().out)
    assert here == there and here['bags'] == 2 and here['cascades']['count'] > 50


def test_a_cluster_of_another_version_is_refused_with_both(cluster, given, tmp_path):
    """The worker's own sources differ; one that comes in mid-sweep is refused, too."""
    other = tmp_path / 'other'
    ignored = shutil.ignore_patterns('__pycache__', 'static', 'walls')
    shutil.copytree(Path(eol_ros.__file__).parent, other / 'eol_ros', ignore=ignored)
    changed = other / 'eol_ros' / 'lab' / 'science' / 'sweep.py'
    changed.write_text(changed.read_text() + '\n_RUN |= {}  # another version\n')
    pattern = r'has eol_ros .*\(sources (\w+)\), here is eol_ros .*\(sources (?!\1)\w+\)'
    with crews.cluster(cluster.address) as crew, pytest.raises(ConfigError, match=pattern):
        cluster.worker('stranger', path=other)
        cluster.processes['two'].kill()
        computed(tmp_path / 'late.csv', given, contextlib.nullcontext(crew))
    with (
        pytest.raises(ConfigError, match=f'worker tcp.* {pattern}'),
        crews.cluster(cluster.address),
    ):
        pass


def test_nobody_at_the_address_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(crews, 'REACH_S', 0.5)
    path = tmp_path / 'sweep.yaml'
    path.write_text('model: ofc')
    words = ['sweep', str(path), '--output', str(tmp_path / 'a.csv'), '--scheduler']

    assert cli.main([*words, 'tcp://127.0.0.1:9']) == os.EX_UNAVAILABLE
    assert 'no Dask scheduler answers there' in capsys.readouterr().err
    assert cli.main([*words, 'nonsense://x']) == os.EX_UNAVAILABLE
