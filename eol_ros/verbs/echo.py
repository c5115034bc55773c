# SPDX-License-Identifier: Apache-2.0
"""eol echo: print the messages of a topic, without a ROS install."""

import json
import sys
import time
from collections import deque

from eol_ros.cli import within
from eol_ros.errors import DeviceMissing, UsageError
from eol_ros.verbs import reach

HELP = 'Print the messages of a topic as YAML, as `ros2 topic echo` does, or their rate.'
EXAMPLES = [
    'eol echo slips',
    'eol echo blocks --once',
    'eol echo camera/image_raw --hz',
    'eol echo cascades --json >> cascades.jsonl',
    'eol echo slips --lan                           # from another machine',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('topic', help='with or without the namespace')
    parser.add_argument('--once', action='store_true', help='one message, then end')
    parser.add_argument('--hz', action='store_true', help='their rate, each second, like topic hz')
    parser.add_argument('--json', action='store_true', help='one JSON object a line')
    parser.add_argument('--full', action='store_true', help='all of long arrays and texts')
    parser.add_argument(
        '--timeout',
        type=within(1e-3, 1e9),
        metavar='S',
        help='give up (exit code 69) when S seconds bring no message',
    )
    reach.add_arguments(parser)


def run(args):
    """Print until stopped."""
    if args.once and args.hz:
        raise UsageError('--once and --hz: a rate needs more than one message')
    from eol_ros.ros.echo import Absence, Rate, listen, to_json, to_yaml
    from eol_ros.ros.session import session
    from eol_ros.streams.graph import full_name, topic_of

    network, namespace = reach.of(args)
    topic, rate, heard = full_name(args.topic, namespace), Rate(), 0
    if topic_of(topic, namespace) is None:  # its type must be asked for
        reach.running(args)
    waiting: deque = deque()  # printed outside the callback: a closed pipe must not raise in DDS

    def hear(message) -> None:
        if args.hz:
            rate.tick(time.monotonic())
        waiting.append(message)

    def shown() -> bool:
        """Print what has come; return whether that is all that was asked for."""
        nonlocal heard
        while waiting:
            message = waiting.popleft()
            heard += 1
            if args.hz:
                continue
            text = to_json(message) if args.json else f'{to_yaml(message, args.full)}---'
            print(text, flush=True)
            if args.once:
                return True
        return False

    with session(reach=network, namespace=namespace) as visit:
        listen(visit.node, topic, hear)
        before, absence, since_s = 0, Absence(visit.node, [topic]), time.monotonic()
        while not visit.stopped and not visit.run(shown, 1.0):
            if args.hz and heard != before and heard > 1:  # one message has no rate
                print(json.dumps(rate.numbers()) if args.json else rate.text(), flush=True)
            if absent := absence.look():
                print(absent, file=sys.stderr, flush=True)
            if heard != before:
                before, since_s = heard, time.monotonic()
            elif args.timeout and time.monotonic() - since_s > args.timeout:
                raise DeviceMissing(
                    f'{topic}: no message for {args.timeout:g} s; does the graph run?'
                )
    return 0
