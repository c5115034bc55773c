# SPDX-License-Identifier: Apache-2.0
"""eol echo: print the messages of a topic, without a ROS install."""

import sys
import time
from collections import deque

from eol_ros.cli import within
from eol_ros.errors import DeviceMissing
from eol_ros.verbs import reach

HELP = 'Print the messages of a topic as YAML, as `ros2 topic echo` does.'
EXAMPLES = [
    'eol echo slips',
    'eol echo blocks --once',
    'eol echo cascades --json >> cascades.jsonl',
    "eol echo blocks --json | jq -c '.blocks[7] | [.x, .y]'      # one block: entry N is block N",
    'eol echo slips --lan                           # from another machine',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('topic', help='topic, with or without its namespace')
    parser.add_argument('--once', action='store_true', help='print one message and end')
    parser.add_argument('--json', action='store_true', help='print one JSON object a line')
    parser.add_argument('--full', action='store_true', help='print long arrays and texts in full')
    parser.add_argument(
        '--timeout',
        type=within(1e-3, 1e9),
        metavar='S',
        help='end with exit code 69 after S seconds without a message',
    )
    reach.add_arguments(parser)


def run(args):
    """Print until stopped."""
    from eol_ros.ros.echo import Absence, listen, to_json, to_yaml
    from eol_ros.ros.session import session
    from eol_ros.streams.graph import full_name, topic_of

    network, namespace = reach.of(args)
    topic, heard_s = full_name(args.topic, namespace), time.monotonic()
    if topic_of(topic, namespace) is None:  # its type must be asked for
        reach.running(args)
    waiting: deque = deque()  # printed outside the callback: a closed pipe must not raise in DDS

    def shown() -> bool:
        """Print what has come; return whether that is all that was asked for."""
        nonlocal heard_s
        while waiting:
            message, heard_s = waiting.popleft(), time.monotonic()
            text = to_json(message) if args.json else f'{to_yaml(message, args.full)}---'
            print(text, flush=True)
            if args.once:
                return True
        return False

    with session(reach=network, namespace=namespace) as visit:
        listen(visit.node, topic, waiting.append)
        absence = Absence(visit.node, topic)
        while not visit.stopped and not visit.run(shown, 1.0):
            if absent := absence.look():
                print(absent, file=sys.stderr, flush=True)
            if args.timeout and time.monotonic() - heard_s > args.timeout:
                raise DeviceMissing(
                    f'{topic}: no message for {args.timeout:g} s; does the graph run?'
                )
    return 0
