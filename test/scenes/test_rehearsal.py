# SPDX-License-Identifier: Apache-2.0
"""The whole work as its user starts it: every node a process, real DDS, a real pty, a real bag."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from support.bags import counted_losses
from support.running import Graph, stand_in
from support.waiting import GENEROUS_S, wait_until

from eol_ros import scene as scenes
from eol_ros.analysis import open_bag
from eol_ros.devices.bag.reader import BagReader
from eol_ros.streams.cdr import stamp_ns

pytestmark = [pytest.mark.slow, pytest.mark.timeout(420)]
EVERY = ('truth', 'blocks', 'slips', 'led_commands', 'grain_triggers', 'wall', 'cascades')


def rehearsal(folder, **changes):
    """Write a rehearsal scene that needs no sound card and no fixed port; return its path."""
    path = stand_in('rehearsal', folder, film=None, bag=None)
    values = yaml.safe_load(path.read_text())
    values['nodes']['sound']['device'] = 'wav'
    for node, settings in changes.items():
        values['nodes'][node].update(settings)
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path


def orphans(pids):
    """Return which of `pids` still run; a zombie only looks alive."""
    alive = []
    for pid in pids:
        try:
            state = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0]
        except OSError:
            continue
        if state != 'Z':
            alive.append(pid)
    return alive


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """One rehearsal of some seconds with all images kept; what it left behind."""
    folder = tmp_path_factory.mktemp('rehearsal')
    path = rehearsal(folder, recorder={'images': 'all'})
    bags = folder / 'bags'
    graph = Graph(path, bags, EVERY, keep=('truth', 'blocks', 'slips', 'wall'))
    try:
        graph.wait_until_ok()
        graph.mark()
        seen = graph.watch.seen
        wait_until(lambda: all(seen[topic] for topic in ('slips', 'grain_triggers', 'cascades')))
        wait_until(lambda: len(seen['blocks']) > 320)
        figures = graph.figures()
        pids = list(graph.pids())
        led_stamps = {a.stamp_us for a in graph.arrivals() if a.stamp_us}
    finally:
        code = graph.stop()
    return {
        'graph': graph,
        'figures': figures,
        'pids': pids,
        'code': code,
        'bag': next(p for p in bags.iterdir() if p.is_dir()),
        'led_stamps': led_stamps,
    }


def no_time(run):
    """Whether the machine had next to no processor left for more."""
    return run['figures']['idle_percent'] < 30


@pytest.mark.live
def test_it_stops_clean_and_leaves_nothing(run):
    assert run['code'] == 0
    assert orphans(run['pids']) == []


@pytest.mark.live
def test_no_image_is_lost_unless_the_machine_has_no_time_and_then_it_is_counted(run):
    counted_losses(open_bag(run['bag']))
    lost = {node: run['figures']['lost'].get(node, 0) for node in ('tracker', 'recorder')}
    assert no_time(run) or not any(lost.values()), lost


@pytest.mark.live
def test_the_stamp_of_the_image_passes_unchanged(run):
    """Oracle: the bag's images, and the truth that the twin publishes beside each."""
    bag = open_bag(run['bag'])
    images = {stamp_ns(m.data) for m in BagReader(run['bag']).messages(['/eol/camera/image_raw'])}
    truth = set(bag.table('truth')['stamp'].tolist())
    assert len(images & truth) > 100
    taken = images | truth  # a recorder that has no time leaves images out
    last = max(taken)  # of the image after it the truth may not have come before the end
    for topic in ('blocks', 'slips', 'cascades', 'grain_triggers', 'led_commands'):
        stamps = set(bag.table(topic)['stamp'].tolist())
        if topic == 'led_commands':
            stamps.discard(0)  # a fading flash is a light of its own time
            felt = set(bag.table('block_taps')['stamp'].tolist())
            assert stamps & felt  # the blocks' own flashes; what is left was seen
            assert stamps - felt <= taken
        else:
            assert stamps and {stamp for stamp in stamps if stamp <= last} <= taken, topic
            assert len({stamp for stamp in stamps if stamp > last}) <= 1, topic
    wire = {stamp // 1000 % 2**32 for stamp in taken}
    assert run['led_stamps'] <= wire


RETRACK = """
import json, sys
from eol_ros.analysis import open_bag
from eol_ros.analysis.retrack import retrack
result = retrack(open_bag(sys.argv[1]))
print(json.dumps([result.holes, {t.topic: [t.proved, t.recomputed, t.different, t.first]
                                 for t in result.topics.values()}]))
"""


@pytest.mark.live
def test_replay_is_exact(run):
    # In a process of its own, as `eol report BAG --retrack`: a library that another test has loaded
    # may have changed how this process rounds.
    done = subprocess.run(
        [sys.executable, '-c', RETRACK, str(run['bag'])], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    holes, topics = json.loads(done.stdout)

    assert set(topics) >= {'blocks', 'slips', 'grain_triggers'}
    assert topics['blocks'][1] > 0
    # A proof ends at the first image that is missing from the bag.
    whole = not (holes and no_time(run))
    if whole:
        assert topics['blocks'][1] >= 300
        assert topics['slips'][1] > 0 and topics['grain_triggers'][1] > 0
    for topic, (proved, recomputed, different, first) in topics.items():
        assert not different, f'{topic}: {different} differ, {first}'
        assert proved == recomputed or not whole, topic


def eol(graph, *words):
    """Run a command of `eol` on the graph; return what it prints."""
    done = subprocess.run(
        [sys.executable, '-m', 'eol_ros', *words],
        capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_killed_nodes_come_back_and_no_other_is_started_again(tmp_path):
    """Kill every second node, then the others: each is killed, and loses its neighbours."""
    path = rehearsal(tmp_path, recorder={'images': 'none'})
    with Graph(path, tmp_path / 'bags') as graph:
        graph.wait_until_ok()
        eol(graph, 'call', 'mute')
        eol(graph, 'call', 'sleep', 'montage')
        eol(graph, 'param', 'set', 'grains', 'radius', '0.11')
        nodes = list(scenes.load(path).nodes)
        for killed in (nodes[::2], nodes[1::2]):
            before = {row['node']: row['pid'] for row in graph.status()['nodes']}
            for name in killed:
                os.kill(before[name], signal.SIGKILL)

            def back(killed=killed, before=before):
                rows = [row for row in graph.status()['nodes'] if row['node'] in killed]
                return all(
                    row['pid'] != before[row['node']]
                    and row['level'] in (0, 1)
                    and row['text'] != 'starting'
                    for row in rows
                )

            wait_until(back)
            after = {row['node']: row['pid'] for row in graph.status()['nodes']}
            assert {n for n in before if before[n] != after[n]} == set(killed)
        count = len(graph.watch.seen['blocks'])
        wait_until(lambda: len(graph.watch.seen['blocks']) > count + 60)
        # What people had asked for outlives the processes that they asked.
        wait_until(lambda: graph.node('sound')['values'].get('muted') is True)
        assert eol(graph, 'param', 'get', 'grains', 'radius') == '0.11'
        wait_until(lambda: 'asleep' in graph.node('montage')['text'])
        assert graph.stop() == 0
    for bag in (p for p in (tmp_path / 'bags').iterdir() if p.is_dir()):
        assert '/eol/blocks' in open_bag(bag).topics


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_starts(tmp_path, number):
    path = tmp_path / 's.yaml'
    path.write_text('nodes: {twin: {}, tracker: {}, motion: {}}')
    graph = Graph(path)
    time.sleep(0.7)
    graph.process.send_signal(number)
    try:
        assert graph.process.wait(GENEROUS_S) == 0
    finally:
        graph.stop()
    assert 'Traceback' not in graph.log.read_text()
