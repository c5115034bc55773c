# SPDX-License-Identifier: Apache-2.0
"""Closed stays closed, open is seen: two network namespaces joined by a cable, as two machines.

The other machine runs rclpy with stock transports, without a word of our configuration.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys

import pytest
from eol_msgs.msg import Slip
from rclpy.serialization import serialize_message
from support import needs

from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.ros.definitions import describe

OURS, THEIRS = f'eol-a-{os.getpid()}', f'eol-b-{os.getpid()}'
NET = f'10.77.{os.getpid() % 250}'
DOMAIN = '61'
# Nothing but rclpy: counts what it hears of slips in some seconds, and whom it sees. Names of nodes
# come on a topic of their own, some time after the first messages.
STRANGER = """
import json, sys, time, rclpy
from eol_msgs.msg import Slip
rclpy.init()
node, heard = rclpy.create_node('stranger'), []
node.create_subscription(Slip, '/eol/slips', heard.append, 10)
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end and (len(heard) < 5 or len(node.get_node_names()) < 2):
    rclpy.spin_once(node, timeout_sec=0.1)
print(json.dumps({'heard': min(len(heard), 5), 'nodes': node.get_node_names()}))
"""


def ip(*words):
    subprocess.run(['ip', *words], check=True, capture_output=True, text=True)


def inside(namespace, *command, **variables):
    """Start a command on the machine `namespace`; the other machine has other shared memory."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(('FASTRTPS', 'FASTDDS', 'ROS_'))}
    env |= {'ROS_DOMAIN_ID': DOMAIN, **variables}
    env.pop('RMW_IMPLEMENTATION', None)
    if namespace == THEIRS:
        private = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
        command = ('unshare', '-m', 'sh', '-c', private, 'sh', *command)
    return subprocess.Popen(
        ['ip', 'netns', 'exec', namespace, *command],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env,
    )  # fmt: skip


def answer(child, seconds=40):
    out, err = child.communicate(timeout=seconds)
    assert child.returncode == 0, err
    return out


@pytest.fixture(scope='module')
def cable():
    """Two namespaces with one cable between them."""
    needs.system('iproute2')
    try:
        ip('netns', 'add', OURS)
    except subprocess.CalledProcessError as error:
        pytest.skip(f'network namespaces are not permitted here: {error.stderr.strip()}')
    try:
        ip('netns', 'add', THEIRS)
        ip('-n', OURS, 'link', 'add', 'cable', 'type', 'veth', 'peer', 'cable', 'netns', THEIRS)
        for name, last in ((OURS, 1), (THEIRS, 2)):
            ip('-n', name, 'addr', 'add', f'{NET}.{last}/24', 'dev', 'cable')
            for link in ('lo', 'cable'):
                ip('-n', name, 'link', 'set', link, 'up')
        yield
    finally:
        for name in (OURS, THEIRS):
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """One second of slips."""
    path = tmp_path_factory.mktemp('bags') / 'run'
    writer = BagWriter(path, [BagTopic('/eol/slips', **describe('slips'))], {})
    for i in range(50):
        now = 1_700_000_000_000_000_000 + i * 20_000_000
        writer.write('/eol/slips', bytes(serialize_message(Slip(slip=i))), now, now)
    writer.close()
    return str(path)


@contextlib.contextmanager
def play(bag, *words):
    """The work on our machine: a bag that plays for ever."""
    child = inside(OURS, sys.executable, '-m', 'eol_ros', 'replay', bag, '--only', 'slips',
                   '--loop', '--wait', '0', *words)  # fmt: skip
    try:
        yield
    finally:
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=20)
    assert child.returncode == 0, err


def stranger(namespace, seconds, **variables):
    return inside(namespace, sys.executable, '-c', STRANGER, str(seconds), **variables)


@pytest.mark.slow
def test_closed_stays_closed_even_to_one_who_knows_the_address(cable, bag):
    peers = {'ROS_STATIC_PEERS': f'{NET}.1', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    with play(bag):
        outside = stranger(THEIRS, 6, **peers)
        # The work does run, and speaks: the same question on our own machine is answered.
        local = json.loads(answer(inside(OURS, *_echo('--once'))))
        assert local['slip'] in range(50)
        seen = json.loads(answer(outside))
        assert seen == {'heard': 0, 'nodes': ['stranger']}


@pytest.mark.slow
def test_open_is_heard_by_a_stock_peer_and_by_our_own_echo(cable, bag):
    with play(bag, '--lan'):
        # A stranger who begins before the publisher may never discover it (seen between two stock
        # participants too): so wait until it speaks, as somebody on our own machine hears it.
        assert json.loads(answer(inside(OURS, *_echo('--once', '--lan'))))['slip'] in range(50)
        plain, ours = stranger(THEIRS, 25), inside(THEIRS, *_echo('--once', '--lan'))
        seen = json.loads(answer(plain))
        assert seen['heard'] == 5
        assert 'replay' in seen['nodes']
        assert json.loads(answer(ours))['slip'] in range(50)


def _echo(*words):
    return [sys.executable, '-m', 'eol_ros', 'echo', 'slips', '--json', '--timeout', '25', *words]
