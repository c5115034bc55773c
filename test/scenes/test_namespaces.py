# SPDX-License-Identifier: Apache-2.0
"""Two rehearsals in one DDS domain, each in a namespace of its own."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
from eol_msgs.msg import Blocks
from support.domains import next_domain

from eol_ros.analysis.bag import open_bag
from eol_ros.analysis.retrack import retrack
from eol_ros.bringup import status
from eol_ros.errors import EolError

pytestmark = [pytest.mark.slow, pytest.mark.timeout(420)]
DOMAIN = next_domain()
RECORDED = 100  # messages of each, after both are OK
SEEDS = {'north': 1, 'south': 2}


def eol(*words):
    return subprocess.run(
        [sys.executable, '-m', 'eol_ros', *words], capture_output=True, text=True, timeout=120,
        env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)}, check=False,
    )  # fmt: skip


def asked(namespace):
    """Return what `eol status` has of a namespace, or why it has nothing."""
    try:
        return status.ask(DOMAIN, namespace=namespace)
    except EolError as error:
        return str(error)


def messages(namespace):
    """Return how many messages the recorder has, once all is OK; 0 before, None to compile."""
    answer = asked(namespace)
    if isinstance(answer, str):
        return 0
    if any(row['text'].startswith('compiling') for row in answer['nodes']):
        return None
    if answer['all_ok_s'] is None:
        return 0
    return next(r['values']['messages'] for r in answer['nodes'] if r['node'] == 'recorder')


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Both, one named by its scene and one by a remapping rule; their bags and what `eol` said."""
    folder = tmp_path_factory.mktemp('namespaces')
    running, said = [], {}
    try:
        for namespace, seed in SEEDS.items():
            scene = {
                'scene': namespace, 'domain': DOMAIN,
                'together': [['tracker', 'motion']],
                'nodes': {
                    'twin': {'seed': seed, 'accelerometer': False}, 'tracker': {}, 'motion': {},
                },
            }  # fmt: skip
            words = ['--ros-args', '-r', '__ns:=/south']
            if namespace == 'north':
                scene['namespace'], words = 'north', []
            file = folder / f'{namespace}.yaml'
            file.write_text(yaml.safe_dump(scene))
            command = [sys.executable, '-m', 'eol_ros.bringup', str(file)]
            command += ['--bag', str(folder / namespace), *words]
            running.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        began, end = {}, time.monotonic() + 150
        while True:
            assert all(child.poll() is None for child in running)
            assert time.monotonic() < end, [asked(namespace) for namespace in SEEDS]
            now = {namespace: messages(namespace) for namespace in SEEDS}
            if None in now.values():
                end = time.monotonic() + 150  # a cold cache is no fault of the graph
            elif not began and all(now.values()):
                began = now
            elif began and all(now[n] - began[n] > RECORDED for n in SEEDS):
                break
            time.sleep(0.1)
        said['topics'] = eol('topics', '--json', '--namespace', 'south')
        said['status'] = eol('status')
        said['south'] = eol('status', '--namespace', 'south')
    finally:
        for child in running:
            child.send_signal(signal.SIGINT)
        codes = [child.wait(60) for child in running]
    assert codes == [0, 0]
    return {namespace: open_bag(folder / namespace) for namespace in SEEDS}, said


@pytest.mark.parametrize('namespace', SEEDS)
def test_no_message_crosses(run, namespace):
    bag = run[0][namespace]
    assert bag.namespace == namespace
    assert {name.split('/')[1] for name in bag.topics} == {namespace}
    assert f'seed: {SEEDS[namespace]}' in bag.about['settings']

    blocks, truth = bag.table('blocks'), bag.table('truth')
    blocks = blocks[blocks['stamp'] >= truth['stamp'][0]]  # no node waits for those who read it
    assert (blocks['stamp'] > truth['stamp'][-1]).sum() <= 1  # the end came before its truth
    blocks = blocks[blocks['stamp'] <= truth['stamp'][-1]]
    assert len(blocks) > 30
    assert (np.diff(blocks['image'].astype(int)) > 0).all()
    assert set(blocks['stamp']) <= set(truth['stamp'])
    assert set(blocks['frame_id']) == set(truth['frame_id']) == {f'{namespace}/table'}
    row = {stamp: k for k, stamp in enumerate(truth['stamp'].tolist())}
    where = [row[stamp] for stamp in blocks['stamp'].tolist()]
    seen = blocks['blocks']['seen'] & (blocks['state'] == Blocks.STATE_TRACKING)[:, None]
    error = np.hypot(
        blocks['blocks']['x'] - truth['x'][where], blocks['blocks']['y'] - truth['y'][where]
    )
    assert seen.any() and np.median(error[seen]) < 0.1e-3  # of its own twin
    assert retrack(bag).verdict != 'different'  # from its blocks on: it keeps no images


def test_the_command_line_means_one_of_them(run):
    said = run[1]
    rows = {row['topic']: row for row in json.loads(said['topics'].stdout)}
    assert rows['/south/blocks']['doc'] and not rows['/north/blocks']['doc']
    for name in ('/north/blocks', '/south/blocks'):
        assert rows[name]['publishers'] == 1
    assert '/eol/blocks' not in rows
    assert said['status'].returncode == 2
    assert '--namespace north or south' in said['status'].stderr
    assert said['south'].stdout.startswith('south: awake\nsouth in /south'), said['south'].stderr
