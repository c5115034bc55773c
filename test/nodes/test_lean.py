# SPDX-License-Identifier: Apache-2.0
"""Each node, started as its scene starts it, holds nothing that it does not use."""

import json
import os
import subprocess

import pytest
import yaml
from support.lean import ONLY, VERBS, node_faults, other_faults, verb_row

from eol_ros import scene as scenes

# Runs the node as bringup does; once it is made and has looked around, says what it has loaded.
PROBE = """
import gc, json, os, signal, sys, threading, time

def tell():
    while not gc.get_freeze_count():  # ros/run.py freezes what there is when all nodes are made
        time.sleep(0.05)
    time.sleep(1.0)
    files = {line.split()[5] for line in open('/proc/self/maps') if line.count('/')}
    modules = [name for name, module in sys.modules.items() if module]
    print('LOADED', json.dumps([modules, sorted(files)]), flush=True)
    os.kill(os.getpid(), signal.SIGTERM)

threading.Thread(target=tell, daemon=True).start()
from eol_ros.ros.run import run
sys.exit(run([sys.argv[1]], ['--scene', sys.argv[2]]))
"""
SCENE = {'camera': 'museum'}  # all others: rehearsal


@pytest.fixture(scope='module')
def loaded(python, tmp_path_factory):
    """Return (modules, mapped files) of a node as a function of its name; nodes run once."""
    known = {}

    def of(node):
        if node not in known:
            known[node] = probe(python, tmp_path_factory.mktemp(node), node)
            if 'numba.np.arraymath' in known[node][0]:  # it had to compile: now it need not
                known[node] = probe(python, tmp_path_factory.mktemp(node), node)
        return known[node]

    return of


def probe(python, folder, node):
    values = scenes.plain(scenes.load(SCENE.get(node, 'rehearsal')))
    nodes = values['nodes']
    if 'panel' in nodes:
        nodes['panel']['port'] = 0
    nodes['recorder']['folder'] = str(folder)
    if node == 'sacn':
        nodes['leds']['flash_limit'] = 'field'
    nodes.setdefault(node, {'send_to': ['127.0.0.1:9']} if node == 'osc' else {})
    file = folder / 'scene.yaml'
    file.write_text(yaml.safe_dump(values))
    run = subprocess.run(
        [python, '-c', PROBE, node, str(file)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, 'EOL_STATE': str(folder)},
    )
    lines = [line for line in run.stdout.splitlines() if line.startswith('LOADED')]
    assert run.returncode == 0 and lines, run.stderr[-2000:]
    modules, files = json.loads(lines[0].removeprefix('LOADED '))
    return set(modules), files


ALL = (
    'twin',
    'camera',
    'tracker',
    'motion',
    'leds',
    'grains',
    'sound',
    'montage',
    'osc',
    'midi',
    'sacn',
    'panel',
    'recorder',
)


@pytest.mark.slow
@pytest.mark.parametrize('node', ALL)
def test_a_node_loads_nothing_that_it_does_not_use(loaded, node):
    modules, files = loaded(node)
    assert 'rclpy' in modules and f'eol_ros.nodes.{node}' in modules
    assert node_faults([node], modules, files) == []
    assert node not in ONLY['numba'] or any('libllvmlite' in file for file in files)


@pytest.mark.parametrize(
    'words',
    [pytest.param(w, marks=[pytest.mark.soak] if w == 'topics' else []) for w in VERBS],  # 10 s
)
def test_a_verb_loads_nothing_that_it_does_not_use(words, tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    row = verb_row(words)
    assert row['modules'] > 50
    assert row['faults'] == []


def test_the_list_finds_what_a_node_must_not_have():
    modules = ['rclpy', 'numba', 'scipy', 'rich', 'cv2']
    assert node_faults(['motion', 'leds'], modules, []) == ['cv2', 'numba', 'rich', 'scipy']
    assert node_faults(['tracker'], modules, ['/lib/libavcodec.so']) == ['rich']
    assert node_faults(['motion'], [], ['/lib/libavcodec.so']) == ['/lib/libavcodec.so']
    assert other_faults({'yaml'}, ['yaml', 'numpy', 'json']) == ['numpy']
