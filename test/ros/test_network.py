# SPDX-License-Identifier: Apache-2.0
"""Closed stays closed, open is seen: two network namespaces joined by a cable, as two machines.

The other machine runs rclpy with stock transports, without a word of our configuration.
"""

import json
import os
import signal
import sys

import pytest
from support import needs
from support.machines import Machines, answer, ip
from support.played_slips import play, played_bag  # noqa: F401  a fixture
from support.waiting import wait_until

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


@pytest.fixture(scope='module')
def machines():
    """The work and somebody else, on one cable."""
    needs.system('iproute2')
    with Machines('work', 'other') as found:
        yield found


@pytest.mark.slow
def test_closed_stays_closed_even_to_one_who_knows_the_address(machines, bag):
    peers = {
        'ROS_STATIC_PEERS': machines.address('work'),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
    }
    with play(machines, bag):
        outside = machines.run('other', sys.executable, '-c', STRANGER, '6', **peers)
        # The work does run, and speaks: the same question on our own machine is answered.
        local = json.loads(answer(machines.run('work', *_echo('--once'))))
        assert local['slip'] in range(50)
        seen = json.loads(answer(outside))
        assert seen == {'heard': 0, 'nodes': ['stranger']}


@pytest.mark.slow
def test_open_is_heard_by_a_stock_peer_and_by_our_own_echo(machines, bag):
    with play(machines, bag, '--lan'):
        # A stranger who begins before the publisher may never discover it (seen between two stock
        # participants too): so wait until it speaks, as somebody on our own machine hears it.
        local = answer(machines.run('work', *_echo('--once', '--lan')))
        assert json.loads(local)['slip'] in range(50)
        plain = machines.run('other', sys.executable, '-c', STRANGER, '25')
        ours = machines.run('other', *_echo('--once', '--lan'))
        seen = json.loads(answer(plain))
        assert seen['heard'] == 5
        assert 'replay' in seen['nodes']
        assert json.loads(answer(ours))['slip'] in range(50)


def _echo(*words):
    return [sys.executable, '-m', 'eol_ros', 'echo', 'slips', '--json', '--timeout', '25', *words]


@pytest.mark.slow
def test_a_machine_with_other_addresses_starts_all_again_with_the_first_that_is(
    machines, bag, tmp_path
):
    """Else that one would take images over UDP: Fast DDS knows its own machine by its addresses."""
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        'nodes:\n  recorder: off\n'
        f'  replay: {{bag: {bag}, topics: [slips], loop: true, wait_s: 0.0}}\n'
        '  panel: {port: 0}\n'
    )
    cable = machines.names['work'], f'{machines.address("work")}/24'
    bringup = machines.run('work', sys.executable, '-m', 'eol_ros.bringup', str(scene))

    def pids():
        rows = machines.status('work')
        return {n: r['pid'] for n, r in rows.items() if r['level'] == 0 and r['pid']}

    try:
        wait_until(lambda: len(pids()) == 2)
        before = pids()
        ip('-n', cable[0], 'addr', 'add', '192.0.2.7/24', 'dev', 'cable')
        os.kill(before['panel'], signal.SIGKILL)
        wait_until(lambda: len(found := pids()) == 2 and not {*found.items()} & {*before.items()})
    finally:
        ip('-n', cable[0], 'addr', 'del', '192.0.2.7/24', 'dev', 'cable')
        bringup.send_signal(signal.SIGINT)
        _, lines = bringup.communicate(timeout=30)
    assert 'this machine has other addresses than before: all nodes are started again' in lines
    assert lines.splitlines()[-1].endswith(' 1 restarts')
