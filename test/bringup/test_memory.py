# SPDX-License-Identifier: Apache-2.0
"""What people asked of the nodes is there again after a power cut, and not after a proper end."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from support.domains import next_domain
from support.forgetful_disk import Clock, ForgetfulDisk
from support.waiting import wait_until

from eol_ros import scene as scenes
from eol_ros.bringup import status
from eol_ros.bringup.memory import Memory, words
from eol_ros.errors import EolError

KEPT = {
    'sound': {'muted': True, 'settings': {'gain_db': -9.0}},
    'grains': {'settings': {'radius': 0.11}},
    'leds': {'asleep': False},
    'motion': {},
    'tracker': {'covers': 'AAAA'},
}
SAME = {
    'sound': {'muted': True, 'settings': {'gain_db': -9.0}},
    'grains': {'settings': {'radius': 0.11}},
    'tracker': {'covers': 'AAAA'},
}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A function that reads a scene with these settings of grains."""
    monkeypatch.setenv('EOL_STATE', str(tmp_path / 'state'))

    def load(grains='{}', name='museum'):
        path = tmp_path / f'{name}.yaml'
        path.write_text(
            f'nodes:\n  twin: {{}}\n  tracker: {{}}\n  motion: {{}}\n  leds: {{port: twin}}\n'
            f'  grains: {grains}\n  sound: {{device: wav}}\n'
        )
        return scenes.load(path)

    return load


def cut_short(scene, kept, **options):
    """A run that noted `kept`, and then the power failed."""
    memory = Memory(scene, 0, **options)
    memory.note(kept)
    memory.end(asked=False)
    return memory


def test_opening_hours_that_were_heeded_are_remembered(scene, tmp_path):
    scene()
    path = tmp_path / 'museum.yaml'
    hours = '  hours: {time_zone: Asia/Taipei, open: [Tue-Sun 10:00-18:00]}\n'
    path.write_text(path.read_text() + hours)
    kept = {'hours': {'asleep': True, 'heeded_s': 1795800000.0}}
    cut_short(scenes.load(path), kept)

    assert Memory(scenes.load(path), 0).recall() == kept
    path.write_text(path.read_text().replace('18:00', '17:00'))
    assert Memory(scenes.load(path), 0).recall() == {}


def test_covers_of_another_table_are_left_out(scene, tmp_path):
    cut_short(scene(), KEPT)
    path = tmp_path / 'museum.yaml'
    path.write_text(path.read_text() + 'table: {absent: [12]}\n')  # as many places
    memory = Memory(scenes.load(path), 0)
    assert memory.recall() == {name: kept for name, kept in SAME.items() if name != 'tracker'}
    assert memory.left_out == 'learnt covers of another table'
    cut_short(scenes.load(path), KEPT)
    again = Memory(scenes.load(path), 0)
    assert (again.recall(), again.left_out) == (SAME, '')


def test_the_next_run_has_what_a_cut_one_kept(scene):
    cut_short(scene(), KEPT)

    assert Memory(scene(), 0).recall() == SAME
    assert words(SAME) == 'grains radius 0.11; sound muted, gain_db -9.0'
    assert Memory(scene(), 1).recall() == {}  # another graph
    assert Memory(scene(name='other'), 0).recall() == {}


def test_a_run_that_ended_as_asked_is_forgotten_but_where_it_starts_at_boot(scene):
    cut_short(scene(), KEPT)
    memory = Memory(scene(), 0)
    assert memory.recall() == SAME
    memory.end(asked=True)  # nothing was noted
    assert Memory(scene(), 0).recall() == {}

    memory = Memory(scene(), 0, always=True)
    memory.note(KEPT)
    memory.end(asked=True)
    assert Memory(scene(), 0).recall() == SAME


def test_a_node_whose_settings_changed_in_the_scene_begins_as_that_says(scene):
    cut_short(scene(), KEPT)

    assert Memory(scene('{radius: 0.05}'), 0).recall() == {n: SAME[n] for n in ('sound', 'tracker')}


def test_what_is_no_setting_or_out_of_range_is_left_out(scene):
    memory = cut_short(scene(), KEPT)
    rows = json.loads(memory.path.read_text())
    rows['grains']['kept'] = {'settings': {'radius': 99.0, 'colour': 'red', 'k': 5}, 'asleep': 'no'}
    memory.path.write_text(json.dumps(rows))
    assert Memory(scene(), 0).recall()['grains'] == {'settings': {'k': 5}}

    for damaged in ('', '{', '[]', '{"grains": 1}', '{"grains": {"scene": null}}', '\x00' * 300):
        memory.path.write_text(damaged)
        assert Memory(scene(), 0).recall() == {}


def test_a_cut_at_any_moment_leaves_what_was_asked_last_or_before(scene, tmp_path, monkeypatch):
    """On a disk that forgets what was not synchronised; never nothing, and never half of it."""
    clock, rng = Clock(), np.random.default_rng(5)
    disk, root = ForgetfulDisk(clock, rng, 0.05), tmp_path / 'state'
    done = []  # (when it was on the disk, what)
    for k in range(1, 41):
        clock.now_s = 1.0 * k
        cut_short(scene(), {'grains': {'settings': {'k': k}}}, disk=disk)
        done.append((clock.now_s, k))

    for cut in range(200):
        moment = rng.uniform(done[0][0], 41.0)
        out = tmp_path / f'cut{cut}' / 'eol'
        disk.after_cut(moment, root, out, rng)
        monkeypatch.setenv('EOL_STATE', str(out))
        safe = max(k for at, k in done if at <= moment)
        found = Memory(scene(), 0).recall()['grains']['settings']['k']
        assert found in (safe, safe + 1)


def test_a_disk_that_is_full_is_told_and_stops_nobody(scene):
    memory = Memory(scene(), 0)
    memory.path.parent.parent.joinpath('state').write_text('a file where the folder should be')
    memory.note(KEPT)
    memory.end(asked=False)
    assert 'a restart will forget it' in memory.trouble


@pytest.mark.slow
def test_walls_that_slept_sleep_again_after_everything_was_killed(tmp_path):
    scene = tmp_path / 'night.yaml'
    scene.write_text('nodes: {montage: {}, recorder: off}\nelsewhere: [motion]\n')
    domain = next_domain()
    environ = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'EOL_STATE': str(tmp_path / 'state')}
    started = []

    def start():
        words = [sys.executable, '-m', 'eol_ros.bringup', str(scene)]
        started.append(subprocess.Popen(words, env=environ, stderr=subprocess.PIPE, text=True))

    def says(what):
        def row():
            try:
                (node,) = status.ask(domain)['nodes']
            except EolError:
                return False
            return node['level'] in (0, 1) and what(node['text'])

        wait_until(row, 60)

    try:
        start()
        says(lambda text: 'asleep' not in text and text != 'starting')
        call = [sys.executable, '-m', 'eol_ros', 'call', 'sleep', 'montage']
        assert subprocess.run(call, env=environ, timeout=60).returncode == 0
        says(lambda text: 'asleep' in text)
        (file,) = (tmp_path / 'state').glob('kept-night-*.json')
        wait_until(lambda: '"asleep": true' in file.read_text(), 10)  # on the disk, too
        started[0].kill()
        started[0].wait()

        start()
        says(lambda text: 'asleep' in text)
        started[1].send_signal(signal.SIGINT)
        assert 'as people left it: montage asleep' in started[1].communicate(timeout=60)[1]

        start()  # that run had ended as it was asked to
        says(lambda text: 'asleep' not in text and text != 'starting')
    finally:
        for process in started:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)
