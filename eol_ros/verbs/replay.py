# SPDX-License-Identifier: Apache-2.0
"""eol replay: play a bag into the graph."""

import contextlib
import dataclasses
import select
import sys
from pathlib import Path

from eol_ros.cli import within
from eol_ros.errors import UsageError
from eol_ros.verbs import reach

HELP = 'Play a bag and its time on /clock into the graph. Space pauses, Ctrl-C stops.'
EXAMPLES = [
    'eol replay bags                                # the newest run in bags/',
    'eol replay bags/rehearsal_2026-11-21_10-00-00 --rate 0.25',
    'eol replay run_0.mcap --only camera/image_raw --loop',
    'eol replay bags --only all --start 120',
    'eol replay bags --namespace north              # whatever namespace it was recorded in',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('bag', help='bag folder, .mcap file, or a folder of bags: its newest run')
    speed = parser.add_mutually_exclusive_group()
    speed.add_argument(
        '--rate', type=within(0.01, 100), default=1.0, help='speed, 0.01 to 100; 0.5 is half'
    )
    speed.add_argument(
        '--fast', action='store_true', help='play as fast as the subscribers acknowledge'
    )
    parser.add_argument('--loop', action='store_true', help='start again at the end')
    parser.add_argument(
        '--start', type=within(0, 1e9), default=0.0, metavar='S', help='start at S seconds'
    )
    parser.add_argument(
        '--only',
        metavar='TOPICS',
        help='topics to play, separated by commas; all: every topic but diagnostics (default: the '
        'images if all were kept, else blocks; with their taps and requests)',
    )
    parser.add_argument(
        '--wait',
        type=within(0, 1e9),
        default=3.0,
        metavar='S',
        help='wait up to S seconds for a first subscriber (default 3)',
    )
    reach.add_arguments(parser)


def run(args):
    """Play it."""
    from eol_ros.devices.bag.reader import BagReader

    bag = BagReader(args.bag)
    for line in bag.cut_short:
        print(line, file=sys.stderr)
    if args.start and args.start > bag.duration_s:
        raise UsageError(f'--start {args.start:g}: the bag has {bag.duration_s:.1f} s')
    topics: tuple[str, ...] = ()
    if args.only:
        topics = _all(bag) if args.only == 'all' else tuple(map(bag.find, args.only.split(',')))
    return _play(args, topics)


def _all(bag) -> tuple[str, ...]:
    """Return all topics with messages, but those on which today's processes speak for themselves.

    Old diagnostics among the live ones would tell of nodes that do not run.
    """
    from eol_ros.ros.played import OF_PROCESSES

    theirs = {bag.name(topic) for topic in OF_PROCESSES}
    return tuple(name for name, count in bag.counts.items() if count and name not in theirs)


def _play(args, topics) -> int:
    from eol_ros.ros.run import node_class
    from eol_ros.ros.session import session
    from eol_ros.scene import Scene
    from eol_ros.settings import ReplaySettings

    settings = ReplaySettings(
        bag=str(Path(args.bag)), topics=topics, rate=args.rate, fast=args.fast, loop=args.loop,
        start_s=args.start, wait_s=args.wait,
    )  # fmt: skip
    network, namespace = reach.of(args)
    scene = dataclasses.replace(Scene.alone('replay'), namespace=namespace)
    replay = node_class('replay')
    with (
        session(lambda: replay(settings, scene=scene), network, images=True) as visit,
        _keys() as key,
    ):
        node = visit.node
        print(f'{node.bag.path}: {", ".join(node.names)}', file=sys.stderr)

        def over() -> bool:
            if key() == ' ':
                node.player.pause()
            _show(node)
            return node.state == 'over'

        visit.run(over)
        if node.fault is not None:
            raise node.fault
        if sys.stderr.isatty():
            print(file=sys.stderr)
        print(f'{node.player.played} messages played', file=sys.stderr)
    return 0


def _show(node) -> None:
    if sys.stderr.isatty():
        state = 'paused' if node.player.paused else node.state
        text = f'{node.player.position_s:8.1f} of {node.bag.duration_s:.1f} s  {state}'
        print(f'\r{text:60}', end='', file=sys.stderr, flush=True)


@contextlib.contextmanager
def _keys():
    """Yield a function that returns the key pressed since the last call, without waiting."""
    if not sys.stdin.isatty():
        yield lambda: ''
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield lambda: sys.stdin.read(1) if select.select([sys.stdin], [], [], 0)[0] else ''
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
