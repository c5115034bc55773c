# SPDX-License-Identifier: Apache-2.0
"""Each worker thread of each node, killed by an exception, and held up: neither goes unnoticed."""

import json
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.bag_samples import write_bag
from support.domains import next_domain
from support.fake_projector import FakeProjector
from support.spinning import Nodes

from eol_ros.bringup.child import Child
from eol_ros.bringup.plan import Process
from eol_ros.devices.rounds import Rounds
from eol_ros.ros.run import node_class
from eol_ros.scene import Scene

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
# Every worker thread by node: where it works when it is held up (a function; '': anywhere).
WORKERS = {
    'recorder': {'bag-writer': '', 'bag-housekeeper': '_repair'},
    'camera': {'reader': '', 'hand-over': 'on_image'},
    'tracker': {'preview': '_show'},
    'leds': {'board': '_hear', 'radio': 'send', 'fake': '_take'},
    'sound': {'sound watch': 'on_card', 'wav sink': '_clock_offset'},
    'twin': {'camera': 'expose'},
    'replay': {'replay': '_nap'},
    'panel': {'web': ''},
    'projectors': {'projector': 'converse'},
}
RESTING = ('tracker', 'projectors')  # with nothing due most of the time
PAIRS = [(node, worker) for node, workers in WORKERS.items() for worker in workers]
# Ends a thread by an exception that Python raises in it, wherever it is.
NODE = """
import ctypes, dataclasses, sys, threading, time
import numpy as np
from eol_ros import scene as scenes
from eol_ros.ros import run

alone = scenes.Scene.alone

def with_settings(*names):
    scene = alone(*names)
    settings = dataclasses.replace(scene.settings(NAME), **VALUES)
    return dataclasses.replace(scene, nodes={**scene.nodes, NAME: settings})

scenes.Scene.alone = with_settings

class Killed(Exception):
    pass

def kill():
    def found():
        return next((t for t in threading.enumerate() if t.name.startswith(WORKER)), None)
    while found() is None:
        time.sleep(0.05)
    time.sleep(1.0)
    names = sorted({t.name for t in threading.enumerate()} - {'MainThread', 'killer'})
    print('threads:', *names, sep='|', flush=True)
    thread = found()
    owner = getattr(thread._target, '__self__', None)
    while thread.is_alive():  # what loads compiled code takes an exception for a damaged file
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(thread.ident), ctypes.py_object(Killed))
        if WORKER == 'preview':  # it waits for an image
            owner.take(0, np.zeros((8, 8), np.uint8))
        if WORKER == 'projector':
            owner._change.set()
        if WORKER == 'bag-housekeeper':  # it sleeps for a minute
            thread._stopped.set()
        thread.join(2.0)

threading.Thread(target=kill, name='killer', daemon=True).start()
sys.exit(run.run([NAME], []))
"""


@pytest.fixture
def wanted(tmp_path):
    """The settings with which a node has all its workers."""
    fake = FakeProjector('one')
    film = tmp_path / 'film.avi'
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*'FFV1'), 30, (160, 120), False)
    for _ in range(3):
        writer.write(np.full((120, 160), 50, np.uint8))
    writer.release()
    write_bag(tmp_path / 'bag').close()
    yield {
        'recorder': {'folder': str(tmp_path / 'bags'), 'min_free_gb': 0.0},
        'camera': {'device': str(film), 'width': 160, 'height': 120, 'fps': 30.0},
        'leds': {'port': 'twin'},
        'sound': {'device': 'wav', 'wav': str(tmp_path / 'out.wav')},
        'replay': {
            'bag': str(tmp_path / 'bag'),
            'wait_s': 0.1,
            'loop': True,
            'topics': ('/eol/point',),
        },
        'panel': {'port': 0},
        'projectors': {'addresses': (fake.address,), 'password': 'one'},
    }
    fake.unplug()


def command(name, worker, values):
    script = f'NAME, WORKER, VALUES = {name!r}, {worker!r}, {values!r}\n{NODE}'
    return (sys.executable, '-c', script)


@pytest.mark.parametrize(
    ('name', 'worker'),
    [
        pytest.param(node, worker, marks=[pytest.mark.soak] if k else [])
        for node, workers in WORKERS.items()
        for k, worker in enumerate(workers)
    ],
)
def test_a_worker_that_dies_ends_its_process_with_one_line(name, worker, wanted, tmp_path):
    done = subprocess.run(
        command(name, worker, wanted.get(name, {})), capture_output=True, text=True, timeout=120,
        env={**os.environ, 'ROS_DOMAIN_ID': str(next_domain()), 'EOL_STATE': str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    last = done.stderr.splitlines()[-1]
    assert re.match(rf'{name}: (thread {worker}.*|\w+\(\)) failed with Killed: ', last), done.stderr
    assert last.endswith('its traceback is above')
    threads = done.stdout.split('threads:|')[1].split('\n')[0].split('|')
    found = {next((w for w in WORKERS[name] if t.startswith(w)), t) for t in threads}
    assert found == set(WORKERS[name])  # a new worker is to be named above, and watched


class Held:
    """Holds up a worker thread when it calls a function; a trace function of its thread."""

    def __init__(self, worker, function):
        self.worker, self.function = worker, function
        self.on, self.reached, self.free = False, threading.Event(), threading.Event()

    def __call__(self, frame, _event, _arg):
        if self.on and threading.current_thread().name.startswith(self.worker):
            code = frame.f_code
            here = self.function in ('', code.co_name)
            if here and not code.co_filename.endswith('rounds.py'):
                self.reached.set()
                self.free.wait(60)


@pytest.mark.parametrize(('name', 'worker'), PAIRS)
def test_a_worker_that_stands_still_shows_in_the_status(name, worker, wanted, tmp_path, ros):
    held = Held(worker, WORKERS[name][worker])
    held.on = worker == 'bag-housekeeper'  # it works right at the start, and then rests
    threading.settrace(held)
    try:
        node = node_class(name)(replace(Scene.alone(name).settings(name), **wanted.get(name, {})))
    finally:
        threading.settrace(None)
    with Nodes(node) as nodes:
        try:
            threading.settrace(held)  # the twin's begins later
            if worker != 'bag-housekeeper':
                nodes.until(lambda: node.health.level != 3 or name in ('tracker', 'leds', 'twin'))
                nodes.until(lambda: name in RESTING or watched_as(node, worker))
                count = node.health._workers[watched_as(node, worker)][0]
                seen = done(count)
                nodes.until(lambda: name in RESTING or done(count) not in (None, seen))
            held.on = True
            if worker == 'preview':
                node.preview.take(0, np.zeros((8, 8), np.uint8))
            if name == 'projectors':
                node.all[0]._change.set()
            if worker == 'fake':
                node.lights.board.light(1 << 3, 0)
            nodes.until(held.reached.is_set)
            count, watch = node.health._workers[watched_as(node, worker)]
            node.health._workers = {worker: (count, watch)}  # the others go on, at their own pace
            before = count()
            time.sleep(0.6)
            assert before is not None and count() == before
            begun_s = time.monotonic()
            for k in range(1000):  # what the clock would say, a second apart
                node.health.look_at_workers(begun_s + k)
                if watch.stalled or watch.hung:
                    break
            row = node.health.status()
            assert row['level'] == 2 and k <= (60 if worker == 'bag-housekeeper' else 30)
            assert row['text'] == f'{worker} has stood still for {watch.still_s:.0f} s'
            for later in range(k, k + 150):
                node.health.look_at_workers(begun_s + later)
            assert node.health.hung == (worker != 'bag-housekeeper')
        finally:
            threading.settrace(None)
            held.free.set()
            held.on = False


def watched_as(node, worker):
    """Return the name by which a worker is watched."""
    name = {'wav sink': 'sound output', 'fake': 'fake board'}.get(worker, worker)
    return name if name in node.health._workers else next(iter(node.health._workers), '')


def done(rounds):
    """Return how many rounds a worker has done, whether one is due or not."""
    return rounds.count if isinstance(rounds, Rounds) else rounds()


def test_what_is_said_of_a_hung_worker_is_no_heartbeat(tmp_path):
    child = Child(Process(('recorder',), (), {}))
    rows = [
        {'node': 'recorder', 'level': 2, 'text': 'x', 'hung': True},
        {'node': 'recorder', 'level': 0, 'text': 'x'},
    ]
    monotonic, lines = 5.0, [[json.dumps(row).encode()] for row in rows]
    child._lines = lambda kind, fd: lines.pop(0)
    child.beats(monotonic)
    assert child.policy.beat_s is None and child.status['recorder']['level'] == 2
    child.beats(monotonic)
    assert child.policy.beat_s == monotonic
