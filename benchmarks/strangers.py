# SPDX-License-Identifier: Apache-2.0
"""eol bench strangers: what a flood of packets costs a graph with `network: secure`.

Three network namespaces on one cable: the work, a laptop with a key, a stranger without. Two nodes
of the work exchange a message at 60 Hz while the stranger sends, to one target after another;
`generator alone` sends as much to the stranger's own machine, for on two cores the generator takes
its share of them. Latency is from before publish to the callback.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from support.machines import Machines, NoMachines, answer, ip

from benchmarks.machine import tell
from eol_ros.errors import DeviceMissing

HELP = 'Latency of a graph with network: secure while a stranger floods it with packets.'
EXAMPLES = ['eol bench strangers', 'eol bench strangers --rate 100000 --seconds 20 --json']
INSIDE = '10.77.0.1'
PING = """
import json, sys, time
from eol_ros.ros import network
network.configure('secure')
import rclpy
from eol_msgs.msg import Slip
rclpy.init()
node = rclpy.create_node('ping')
publisher = node.create_publisher(Slip, '/eol/slips', 10)
while publisher.get_subscription_count() < 1:
    rclpy.spin_once(node, timeout_sec=0.05)
end, due = time.monotonic() + float(sys.argv[1]), time.monotonic()
while due < end:
    now = time.time_ns()
    message = Slip()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
    publisher.publish(message)
    due += 1 / 60
    time.sleep(max(due - time.monotonic(), 0))
time.sleep(0.5)
"""
PONG = """
import json, sys, time
from eol_ros.ros import network
network.configure('secure')
import rclpy
from eol_msgs.msg import Slip
rclpy.init()
node, late = rclpy.create_node('pong'), []
def hear(m):
    late.append(time.time_ns() - m.header.stamp.sec * 10**9 - m.header.stamp.nanosec)
node.create_subscription(Slip, '/eol/slips', hear, 10)
end = time.monotonic() + float(sys.argv[1]) + 20
while time.monotonic() < end and (not late or node.count_publishers('/eol/slips')):
    rclpy.spin_once(node, timeout_sec=0.1)
print(json.dumps(late))
"""
FLOOD = """
import os, random, socket, sys, time
address, ports, rate, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])
first, last = map(int, ports.split('-'))
lines = []
for port in range(first, last + 1):
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect((address, port))
    lines.append(line)
random.seed(1)
# Some are noise, some begin as what the port expects: a WireGuard handshake, an RTPS header.
packets = [os.urandom(148) for _ in range(50)]
packets += [b'\\1\\0\\0\\0' + os.urandom(144) for _ in range(50)]
packets += [b'RTPS\\2\\4\\1\\17' + os.urandom(200) for _ in range(50)]
sent, begun = 0, time.monotonic()
while (passed := time.monotonic() - begun) < seconds:
    for _ in range(min(int(passed * rate) - sent, 1000)):
        try:
            lines[sent % len(lines)].send(packets[sent % 150])
        except OSError:
            pass  # refused or unreachable: told by the one before
        sent += 1
    time.sleep(0.0005)
print(sent / seconds)
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--rate', type=float, default=100_000, help='packets a second')
    parser.add_argument('--seconds', type=float, default=15.0, help='per target')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    machines = Machines('work', 'laptop', 'stranger')
    with tempfile.TemporaryDirectory(prefix='eol-bench-') as place:
        try:
            machines.start()
            machines.let_in('laptop', Path(place))
            found = measure(machines, args.rate, args.seconds)
        except NoMachines as error:
            raise DeviceMissing(str(error)) from None
        finally:
            machines.stop()
    tell({'rate': args.rate, 'targets': found}, args.json, table)
    return 0


def measure(machines: Machines, rate: float, seconds: float) -> list[dict[str, Any]]:
    """Return the latency at rest and under each flood."""
    cable = machines.address('work')
    ip('-n', machines.names['stranger'], 'route', 'add', INSIDE, 'via', cable)
    dds = f'{7400 + 250 * 61}-{7400 + 250 * 61 + 40}'  # of the first participants of the domain
    rows = []
    for name, target in {
        'nobody sends': None,
        'generator alone': (machines.address('stranger'), '9000-9000'),
        'the tunnel': (cable, '51820-51820'),
        'ports of DDS': (cable, dds),
        'ports of DDS, address in the tunnel': (INSIDE, dds),
    }.items():
        print(name, file=sys.stderr, flush=True)
        pong = machines.run('work', sys.executable, '-c', PONG, str(seconds))
        ping = machines.run('work', sys.executable, '-c', PING, str(seconds))
        sent = 0.0
        if target:
            words = [*target, str(rate), str(seconds + 3)]
            flood = machines.run('stranger', sys.executable, '-c', FLOOD, *words)
            sent = float(answer(flood, seconds + 60))
        answer(ping, seconds + 60)
        late = sorted(json.loads(answer(pong, seconds + 60)))
        rows.append(
            {'target': name, 'sent_per_s': round(sent), 'heard': len(late)}
            | {f'p{p}_ms': round(late[min(len(late) * p // 100, len(late) - 1)] / 1e6, 3)
               for p in (50, 99)}
        )  # fmt: skip
    return rows


def table(results: dict[str, Any]) -> str:
    """Return the results for people."""
    lines = [f'{"a stranger sends to":36} {"per s":>8} {"heard":>6} {"p50 ms":>8} {"p99 ms":>8}']
    for row in results['targets']:
        lines.append(
            f'{row["target"]:36} {row["sent_per_s"]:8} {row["heard"]:6}'
            f' {row["p50_ms"]:8.3f} {row["p99_ms"]:8.3f}'
        )
    return '\n'.join(lines)
