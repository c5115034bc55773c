# SPDX-License-Identifier: Apache-2.0
"""`network: secure` between real machines: who has a key is in, nobody else, however they try.

Three network namespaces on one cable: the work, a laptop with a key, and a stranger. WireGuard is
the real one, in the kernel where that has it, else in user space.
"""

import contextlib
import json
import shlex
import signal
import sys
from pathlib import Path

import pytest
from support import needs
from support.machines import Machines, answer, ip
from support.played_slips import play, played_bag  # noqa: F401  a fixture

pytestmark = pytest.mark.slow
INSIDE = '10.77.0.1'  # the work's address in the tunnel
# Stock rclpy: counts what it hears of slips, and tries to have the work do something.
VISITOR = """
import json, sys, time, rclpy
from eol_msgs.msg import Request, Slip
rclpy.init()
node, heard = rclpy.create_node('visitor'), []
node.create_subscription(Slip, '/eol/slips', heard.append, 10)
ask = node.create_publisher(Request, '/eol/requests', 50)
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end and (len(heard) < 5 or ask.get_subscription_count() < 1):
    rclpy.spin_once(node, timeout_sec=0.1)
for _ in range(20):
    ask.publish(Request(kind='mute', source='visitor'))
    rclpy.spin_once(node, timeout_sec=0.05)
ask.wait_for_all_acked(rclpy.duration.Duration(seconds=5.0))
print(json.dumps({'heard': min(len(heard), 5), 'nodes': sorted(node.get_node_names())}))
"""
# On the work's machine: says how many requests have arrived by a second after it is asked.
EAR = """
import signal, time
from eol_ros.ros import network
network.configure('secure')
import rclpy
from eol_msgs.msg import Request
rclpy.init()
node, asked = rclpy.create_node('ear'), []
node.create_subscription(Request, '/eol/requests', asked.append, 50)
ends = [time.monotonic() + 200.0]
signal.signal(signal.SIGUSR1, lambda *_: ends.append(time.monotonic() + 1.0))
print('ready', flush=True)
while time.monotonic() < min(ends):
    rclpy.spin_once(node, timeout_sec=0.1)
print(len(asked))
"""
# Counts the packets on the cable: those for an address in the tunnel, and all (one is its own).
SNIFFER = """
import socket, sys, time
cable = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0003))
cable.bind(('cable', 0))
cable.settimeout(0.1)
socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'', (sys.argv[1], 9))
inside, count, end = 0, 0, time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    try:
        packet, (_, protocol, *_) = cable.recvfrom(65536)
    except TimeoutError:
        continue
    inside += protocol == 0x0800 and packet[16:18] == bytes([10, 77])
    count += 1
print(inside, count)
"""
ECHO = [sys.executable, '-m', 'eol_ros', 'echo', 'slips', '--json', '--once']


@pytest.fixture(scope='module')
def machines(tmp_path_factory):
    """The work and a laptop that it lets in, both with their tunnel up, and a stranger."""
    needs.system('wireguard-tools', 'wireguard-go', 'nftables')
    with Machines('work', 'laptop', 'stranger') as found:
        found.let_in('laptop', tmp_path_factory.mktemp('keys'))
        yield found


def visit(machines, machine, seconds, **variables):
    return machines.run(machine, sys.executable, '-c', VISITOR, str(seconds), **variables)


def echo(machines, machine, timeout_s=60):
    return machines.run(machine, *ECHO, '--secure', '--timeout', str(timeout_s))


@contextlib.contextmanager
def ear(machines):
    """Yield a function that says how many requests the work has heard."""
    child = machines.run('work', sys.executable, '-c', EAR)
    assert child.stdout.readline() == 'ready\n'

    def asked():
        child.send_signal(signal.SIGUSR1)
        return int(answer(child))

    try:
        yield asked
    finally:
        child.kill()


def test_who_has_a_key_is_in_with_our_tools_and_with_stock_ones(machines, bag):
    with play(machines, bag, '--secure'), ear(machines) as asked:
        assert json.loads(answer(echo(machines, 'work')))['slip'] in range(50)
        assert json.loads(answer(echo(machines, 'laptop')))['slip'] in range(50)
        exported = dict(
            line.removeprefix('export ').split('=', 1)
            for line in machines.eol('laptop', 'keys', 'env').splitlines()
        )
        assert exported['ROS_STATIC_PEERS'] == shlex.quote(f'127.0.0.1;{INSIDE}')
        stock = {name: shlex.split(value)[0] for name, value in exported.items()}
        seen = json.loads(answer(visit(machines, 'laptop', 8, **stock)))
        assert seen['heard'] == 5 and 'replay' in seen['nodes']
        assert asked() == 20


def test_a_stranger_hears_and_moves_nothing(machines, bag):
    """By the cable's address, and by the tunnel's routed over the cable, as if it were the laptop.

    Linux takes what is for any of its addresses from every cable.
    """
    name, cable = machines.names['stranger'], machines.address('work')
    ip('-n', name, 'route', 'add', INSIDE, 'via', cable)
    ip('-n', name, 'addr', 'add', '10.77.0.2/32', 'dev', 'cable')
    with play(machines, bag, '--secure'), ear(machines) as asked:
        stranger = visit(machines, 'stranger', 5, ROS_STATIC_PEERS=f'{cable};{INSIDE}')
        assert json.loads(answer(echo(machines, 'work')))['slip'] in range(50)  # it does speak
        assert json.loads(answer(stranger)) == {'heard': 0, 'nodes': ['visitor']}
        assert asked() == 0


def test_a_tunnel_that_goes_down_and_comes_up_again(machines, bag, tmp_path):
    """The work goes on, what is meant for the laptop takes no other way, and the laptop is back."""
    scene = tmp_path / 'secure.yaml'
    scene.write_text(
        'network: secure\nnodes:\n  recorder: off\n'
        f'  replay: {{bag: {bag}, topics: [slips], loop: true, wait_s: 0.0}}\n'
    )
    config = f'{machines.variables["work"]["EOL_CONFIG"]}/eol0.conf'
    way = ['default', 'via', machines.address('stranger')]
    bringup = machines.run('work', sys.executable, '-m', 'eol_ros.bringup', str(scene))
    try:
        answer(echo(machines, 'laptop'))  # so the work has somebody to speak to
        answer(machines.run('work', 'wg-quick', 'down', config))
        ip('-n', machines.names['work'], 'route', 'add', *way)
        sniffer = machines.run(
            'stranger', sys.executable, '-c', SNIFFER, machines.address('work'), '5'
        )
        local = machines.run('work', *ECHO, '--timeout', '60')
        assert json.loads(answer(local))['slip'] in range(50)
        for_the_tunnel, all_packets = map(int, answer(sniffer).split())
        ip('-n', machines.names['work'], 'route', 'del', *way)
        machines.up('work')
        assert json.loads(answer(echo(machines, 'laptop')))['slip'] in range(50)
    finally:
        bringup.send_signal(signal.SIGINT)
        _, lines = bringup.communicate(timeout=30)
    assert for_the_tunnel == 0 < all_packets
    for state in ('down', 'up'):
        assert f'network: secure: {INSIDE} is {state} now: all nodes are started again' in lines
    assert bringup.returncode == 0 and lines.splitlines()[-1].endswith(' 0 restarts')


def test_a_revoked_key_opens_nothing(machines, bag):
    config = Path(machines.variables['work']['EOL_CONFIG'], 'eol0.conf')
    before = config.read_text()
    machines.eol('work', 'keys', 'revoke', 'laptop')
    renew = f"wg syncconf eol0 <(wg-quick strip '{config}')"
    try:
        answer(machines.run('work', 'bash', '-c', renew))
        with play(machines, bag, '--secure'):
            assert json.loads(answer(echo(machines, 'work')))['slip'] in range(50)
            laptop = echo(machines, 'laptop', 6)
            out, _ = laptop.communicate(timeout=30)
            assert laptop.returncode != 0 and out == ''
    finally:
        config.write_text(before)
        answer(machines.run('work', 'bash', '-c', renew))
