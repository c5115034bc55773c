# SPDX-License-Identifier: Apache-2.0
"""The rehearsal for a long time: nothing lost, nothing grows, kills by the dozen are lived with.

`make soak` runs these; EOL_SOAK_MINUTES sets how long (30).
"""

import os
import random
import signal
import time
from pathlib import Path

import pytest

from benchmarks.running import Graph, stand_in
from eol_ros.analysis import open_bag

MINUTES = float(os.environ.get('EOL_SOAK_MINUTES', '30'))
pytestmark = [pytest.mark.soak, pytest.mark.live, pytest.mark.timeout(600 + 180 * MINUTES)]


def scene(folder):
    path = stand_in('rehearsal', folder, film=None, bag=None)
    path.write_text(path.read_text().replace('around_slips', 'none'))
    return path


def held(graph):
    """Return open files, threads and PSS in MB, by process."""
    result = {}
    for pid, names in graph._pids().items():
        proc = Path('/proc', str(pid))
        pss = next(r for r in (proc / 'smaps_rollup').read_text().splitlines() if 'Pss:' in r)
        result['+'.join(names)] = (
            len(list((proc / 'fd').iterdir())),
            len(list((proc / 'task').iterdir())),
            int(pss.split()[1]) / 1024,
        )
    return result


def test_a_minute_with_every_image_kept_loses_none(tmp_path):
    path = stand_in('rehearsal', tmp_path, film=None, bag=None)
    path.write_text(path.read_text().replace('around_slips', 'all'))
    with Graph(path, tmp_path / 'bags') as graph:
        graph.wait_until_ok()
        graph.mark()
        time.sleep(60)
        figures = graph.figures()
        assert graph.stop() == 0
    assert figures['lost'] == {'tracker': 0, 'recorder': 0}
    assert figures['images_per_s'] == pytest.approx(60, abs=0.02)
    bag = open_bag(next(p for p in (tmp_path / 'bags').iterdir() if p.is_dir()))
    assert bag.counts['/eol/camera/image_raw'] >= 3600


def test_nothing_grows(tmp_path):
    with Graph(scene(tmp_path), tmp_path / 'bags') as graph:
        graph.wait_until_ok()
        time.sleep(60)  # caches and rings fill
        graph.mark()
        before = held(graph)
        time.sleep(60 * MINUTES)
        after, figures = held(graph), graph.figures()
        status = graph.status()
        assert graph.stop() == 0
    assert status['restarts'] == 0
    assert figures['lost'] == {'tracker': 0, 'recorder': 0}
    for name, (files, threads, mb) in before.items():
        assert after[name][0] <= files + 4, f'{name} keeps files open'
        assert after[name][1] <= threads + 2, f'{name} keeps threads'
        assert after[name][2] <= mb * 1.05 + 8, f'{name} grows'


def test_kills_at_random_are_lived_with(tmp_path):
    """A SIGKILL to some node every 20 s: it is back, the others have gone on, every bag reads."""
    chance = random.Random(7)
    with Graph(scene(tmp_path), tmp_path / 'bags') as graph:
        graph.wait_until_ok()
        killed = 0
        end = time.monotonic() + 60 * MINUTES
        while time.monotonic() < end:
            pids = {row['node']: row['pid'] for row in graph.status()['nodes']}
            node = chance.choice(sorted(pids))
            os.kill(pids[node], signal.SIGKILL)
            killed += 1
            back = time.monotonic() + 45  # the wait grows for one that dies often
            while graph.node(node)['level'] or graph.node(node)['pid'] == pids[node]:
                assert time.monotonic() < back, f'{node} did not come back'
                time.sleep(0.2)
            for name, pid in pids.items():
                alone = pid != pids[node]  # not in the process that was killed
                assert not alone or graph.node(name)['pid'] == pid, f'{name} went with {node}'
            time.sleep(20)
        status = graph.status()
        assert graph.stop() == 0
    assert status['restarts'] == killed
    for bag in (p for p in (tmp_path / 'bags').iterdir() if p.is_dir()):
        assert '/eol/blocks' in open_bag(bag).topics
