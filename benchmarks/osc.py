# SPDX-License-Identifier: Apache-2.0
"""eol bench osc: what a thousand OSC packets a second cost the node `osc`, out and in.

The node runs in a process of its own over real DDS; this process sends the packets, publishes the
slips and stands for the nodes that answer. `out`: slips, twenty of an image. `subscriber`: the same
slips, in a process that has an rclpy subscription and does nothing with them. `setting`: one fader.
`settings`: eight faders in turn. `call`: the same request again and again. `calls`: each request
another one. The node lets 256 wait. Share of a core of the process, user and system time, less
that while nothing comes.
"""

import argparse
import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml
from support.running import free_udp_port, used_s

from benchmarks import machine
from eol_ros import parent_death
from eol_ros.errors import EolError

HELP = 'Measure the CPU time of the node osc at 1000 packets a second, sent and received.'
EXAMPLES = ['eol bench osc', 'eol bench osc --rate 200 --seconds 5 --json']
SUBSCRIBER = """
import rclpy
from eol_msgs.msg import Slip
from rclpy.experimental import EventsExecutor

rclpy.init()
node = rclpy.create_node('subscriber')
node.create_subscription(Slip, '/eol/slips', lambda slip: None, 600)
executor = EventsExecutor()
executor.add_node(node)
while True:
    executor.spin_once(timeout_sec=1.0)
"""
CHUNK = 20  # packets at once, each 20 ms at the usual rate
FADERS = ('radius', 'blend', 'gain', 'pan_width', 'k', 'overlap', 'gain_floor')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--rate', type=float, default=1000.0, help='number of packets a second')
    parser.add_argument('--seconds', type=float, default=10.0, help='duration of each part')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    result = {'machine': machine.machine(), 'rate_hz': args.rate, 'percent': measure(args)}
    machine.tell(result, args.json, _table)
    return 0


def _table(result: dict[str, Any]) -> str:
    found = result['percent']
    lines = [f'{name:10}{share:6.1f} % of a core' for name, share in found.items()]
    return '\n'.join([f'{result["rate_hz"]:g} packets a second', *lines])


def measure(args: argparse.Namespace) -> dict[str, float]:
    """Return the share of a core of each part, %, above that of `idle`."""
    with contextlib.ExitStack() as ending:
        folder = Path(ending.enter_context(tempfile.TemporaryDirectory()))
        port = free_udp_port()
        nodes = {name: {} for name in ('replay', 'grains', 'montage')}
        osc = {'send_to': ['127.0.0.1:9'], 'port': port, 'peer_rate_hz': 1e5}
        nodes |= {'osc': osc, 'recorder': False}
        scene = folder / 'osc.yaml'
        scene.write_text(yaml.safe_dump({'scene': 'osc', 'nodes': nodes}))
        process, subscriber = (
            ending.enter_context(_process(words))
            for words in (['-m', 'eol_ros.nodes', 'osc', '--scene', scene], ['-c', SUBSCRIBER])
        )
        slip, asked = ending.enter_context(_graph(process))
        sock = ending.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        found = {'idle': _share(process, lambda number: None, args)}
        for part, give in _givers(slip, sock, port).items():
            before, before_s = len(asked), used_s(subscriber.pid)
            found[part] = _share(process, give, args) - found['idle']
            if part == 'out':
                found['subscriber'] = 100 * (used_s(subscriber.pid) - before_s) / args.seconds
            elif len(asked) == before:
                raise EolError(f'{part}: no request arrived')
    return found


@contextlib.contextmanager
def _process(words: list[Any]) -> Iterator[subprocess.Popen]:
    found = subprocess.Popen(
        [sys.executable, *words], preexec_fn=parent_death.following(signal.SIGKILL)
    )
    try:
        yield found
    finally:
        found.kill()
        found.wait()


def _givers(
    slip: Callable[[int], None], sock: socket.socket, port: int
) -> dict[str, Callable[[int], Any]]:
    from eol_ros.devices.osc import encode

    def send(address: str, *values: Any) -> None:
        sock.sendto(encode(address, *values), ('127.0.0.1', port))

    def fader(count: int) -> Callable[[int], None]:
        def give(number: int) -> None:
            name = FADERS[number % count]
            send(
                f'/eol/set/grains/{name}', number % 9 + 1 if name == 'k' else 0.1 + number % 9 / 10
            )

        return give

    return {
        'out': lambda number: slip(number // CHUNK),
        'setting': fader(1),
        'settings': fader(len(FADERS)),
        'call': lambda number: send('/eol/call/sleep/montage'),
        'calls': lambda number: send('/eol/call/restore_grain/grains', number),
    }


@contextlib.contextmanager
def _graph(process: subprocess.Popen) -> Iterator[tuple[Callable[[int], None], list[str]]]:
    """Yield what publishes a slip of an image, and the kinds of all requests that have come."""
    import rclpy
    from eol_msgs.msg import Slip
    from rclpy.executors import SingleThreadedExecutor

    from eol_ros.ros.node import EolNode
    from eol_ros.ros.stamps import now_ns, to_msg
    from eol_ros.settings import GrainsSettings, MontageSettings

    asked: list[str] = []

    class Answers(EolNode):
        def __init__(self, name: str, settings: Any):
            self.NAME = name
            super().__init__(settings)
            take = lambda one: asked.append(one.kind)  # noqa: E731
            self.requests.serve(sleep=take, set=take, restore_grain=take)

    rclpy.init()
    nodes = [Answers('grains', GrainsSettings()), Answers('montage', MontageSettings())]
    slips = nodes[0].create_publisher(Slip, 'slips', 600)
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    over = threading.Event()

    def spin() -> None:
        while not over.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()

    stamps: dict[int, int] = {}

    def slip(image: int) -> None:
        message = Slip(block=3, kind=1, speed=0.5)
        stamp = stamps.setdefault(image, now_ns())
        message.header.stamp = message.onset = to_msg(stamp)
        slips.publish(message)

    try:
        end_s = time.monotonic() + 60
        while not (slips.get_subscription_count() and nodes[0].count_publishers('requests') > 2):
            if process.poll() is not None or time.monotonic() > end_s:
                raise EolError('the node osc did not start')
            time.sleep(0.1)
        time.sleep(2.0)
        yield slip, asked
    finally:
        over.set()
        thread.join(10)
        rclpy.shutdown()


def _share(process: subprocess.Popen, give: Callable[[int], Any], args: Any) -> float:
    before_s, began_s = used_s(process.pid), time.monotonic()
    count = round(args.rate * args.seconds)
    for number in range(0, count, CHUNK):
        time.sleep(max(0.0, began_s + number / args.rate - time.monotonic()))
        for one in range(number, min(number + CHUNK, count)):
            give(one)
    time.sleep(max(0.0, began_s + args.seconds - time.monotonic()))
    return 100 * (used_s(process.pid) - before_s) / (time.monotonic() - began_s)
