# SPDX-License-Identifier: Apache-2.0
"""Each node, started as its scene starts it, holds nothing that it does not use."""

import json
import os
import subprocess
import sys

import pytest
import yaml
from support.lean import ONLY, VERBS, node_faults, other_faults, verb_row

from eol_ros import scene as scenes

# Runs nodes as bringup does; once all are made and have looked around, says what they have loaded.
PROBE = """
import gc, json, os, signal, sys, threading, time

def tell():
    while not gc.get_freeze_count():  # ros/run.py freezes what there is when all nodes are made
        time.sleep(0.05)
    time.sleep(0.5)
    files = {line.split()[5] for line in open('/proc/self/maps') if line.count('/')}
    modules = [name for name, module in sys.modules.items() if module]
    print('LOADED', json.dumps([modules, sorted(files)]), flush=True)
    os.kill(os.getpid(), signal.SIGTERM)

threading.Thread(target=tell, daemon=True).start()
from eol_ros.ros.run import run
sys.exit(run(sys.argv[1].split(), ['--scene', sys.argv[2]]))
"""
SCENE = {'camera': 'museum'}  # all others: rehearsal


@pytest.fixture(scope='module')
def loaded(python, tmp_path_factory):
    """Return (modules, mapped files) of a process as a function of the names of its nodes."""

    def of(names):
        found = probe(python, tmp_path_factory.mktemp('lean'), names)
        if 'numba.np.arraymath' in found[0]:  # it had to compile: now it need not
            found = probe(python, tmp_path_factory.mktemp('lean'), names)
        return found

    return of


def probe(python, folder, names):
    values = scenes.plain(scenes.load(SCENE.get(names, 'rehearsal')))
    nodes = values['nodes']
    if 'panel' in nodes:
        nodes['panel']['port'] = 0
    nodes['recorder']['folder'] = str(folder)
    nodes['leds']['flash_limit'] = 'field'  # which sacn needs
    for node in names.split():
        nodes.setdefault(node, {'send_to': ['127.0.0.1:9']} if node == 'osc' else {})
    file = folder / 'scene.yaml'
    file.write_text(yaml.safe_dump(values))
    run = subprocess.run(
        [python, '-c', PROBE, names, str(file)],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, 'EOL_STATE': str(folder)},
    )
    lines = [line for line in run.stdout.splitlines() if line.startswith('LOADED')]
    assert run.returncode == 0 and lines, run.stderr[-2000:]
    modules, files = json.loads(lines[0].removeprefix('LOADED '))
    return set(modules), files


# Together, nodes that may have none of ONLY are barred from as much as alone.
ALL = ('twin', 'camera', 'tracker', 'motion grains montage sacn', 'leds', 'sound', 'osc', 'midi',
       'panel', 'recorder')  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('names', ALL)
def test_a_node_loads_nothing_that_it_does_not_use(loaded, names):
    modules, files = loaded(names)
    assert 'rclpy' in modules and {f'eol_ros.nodes.{node}' for node in names.split()} <= modules
    assert node_faults(names.split(), modules, files) == []
    assert names not in ONLY['numba'] or any('libllvmlite' in file for file in files)


@pytest.mark.parametrize(
    'words',
    [pytest.param(w, marks=[pytest.mark.soak] if w == 'topics' else []) for w in VERBS],  # 10 s
)
def test_a_verb_loads_nothing_that_it_does_not_use(words, tmp_path, monkeypatch):
    monkeypatch.setenv('EOL_STATE', str(tmp_path))
    row = verb_row(words)
    assert row['modules'] > 50
    assert row['faults'] == []


def test_bringup_loads_no_numpy():
    code = 'import sys, eol_ros.bringup.run; sys.exit("numpy" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code]).returncode == 0


def test_the_list_finds_what_a_node_must_not_have():
    modules = ['rclpy', 'numba', 'scipy', 'rich', 'cv2']
    assert node_faults(['motion', 'leds'], modules, []) == ['cv2', 'numba', 'rich', 'scipy']
    assert node_faults(['tracker'], modules, ['/lib/libavcodec.so']) == ['rich']
    assert node_faults(['motion'], [], ['/lib/libavcodec.so']) == ['/lib/libavcodec.so']
    assert other_faults({'yaml'}, ['yaml', 'numpy', 'json']) == ['numpy']
