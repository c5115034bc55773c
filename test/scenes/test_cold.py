# SPDX-License-Identifier: Apache-2.0
"""A first start: what is not in the cache is compiled by a process of its own, which tells."""

import shutil
import subprocess
import sys
import time

import pytest
from support.running import Graph

from eol_ros import compiled
from eol_ros.errors import EolError

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
SCENE = 'nodes: {twin: {}, recorder: off}'


def test_a_cold_start_compiles_first_and_says_so(tmp_path, monkeypatch):
    """The cache has the solvers, which compile longest; `make setup` begins with an empty one."""
    known = compiled.folders()[0].glob('*.object')
    solvers = [path for path in known if path.name.startswith(('kernel.', 'step.', 'taylor.'))]
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    for path in solvers:
        shutil.copy(path, compiled.writable())
    path = tmp_path / 'cold.yaml'
    path.write_text(SCENE)
    assert compiled.cold(['twin', 'montage']) == ['twin']
    rows = []
    with Graph(path) as graph:
        while not rows or not rows[-1]['pid']:
            try:
                rows.append(graph.node('twin'))
            except EolError:
                assert graph.process.poll() is None
            time.sleep(0.1)
        graph.wait_until_ok()
        restarts = graph.status()['restarts']
        assert graph.stop() == 0
        log = graph.log.read_text()

    assert {row['text'].split(',')[0] for row in rows[:-1]} == {'compiling'}
    assert {row['level'] for row in rows[:-1]} == {3}
    percents = [int(row['text'].split()[1]) for row in rows[:-1]]
    assert percents == sorted(percents) and len(set(percents)) > 5
    assert 'compiling, 0 %' in log and restarts == 0

    # What was compiled is found by the next one, and by `eol compile`.
    assert compiled.cold(['twin']) == []
    warm = [sys.executable, '-m', 'eol_ros', 'compile', '--parts', 'twin']
    done = subprocess.run(warm, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')
    with Graph(path) as graph:
        graph.wait_until_ok()
        assert graph.stop() == 0
        assert 'compiling' not in graph.log.read_text()
