# SPDX-License-Identifier: Apache-2.0
"""eol topics: what is on the graph."""

import json
import sys
import time
from collections import Counter

from eol_ros.cli import within
from eol_ros.errors import DeviceMissing, SupervisorSilent
from eol_ros.streams.graph import OF_ROS
from eol_ros.verbs import reach

DISCOVERED_S = 1.5  # without a new node, topic or end of one: the whole graph has been discovered
RATE_S = 3.0  # over which rates are measured
HELP = 'List the topics of the running graph, with type, publishers, subscribers and rates.'
EXAMPLES = [
    'eol topics',
    'eol topics --hz                                # subscribes to each for 3 s',
    'eol topics --json',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--json', action='store_true', help='print one JSON list')
    parser.add_argument(
        '--hz',
        action='store_true',
        help='subscribe to each topic for 3 s and measure its rate; this starts topics that are '
        'published on demand',
    )
    parser.add_argument(
        '--seconds',
        type=within(0.1, 3600),
        default=10.0,
        metavar='S',
        help='longest time to discover the graph (default 10)',
    )
    reach.add_arguments(parser)


def run(args):
    """Print the list."""
    from eol_ros.bringup import status
    from eol_ros.ros.echo import on_the_graph
    from eol_ros.ros.session import session

    try:
        network, namespace = reach.running(args)
    except DeviceMissing:
        if args.json:
            print('[]')
        raise
    with session(reach=network, namespace=namespace) as visit:
        discovered = _Discovery(visit.node)
        whole = visit.run(discovered, args.seconds) or visit.stopped
        rows = [row for row in on_the_graph(visit.node) if row['topic'] not in OF_ROS]
        if rows and not whole:
            missing = ', '.join(sorted(discovered.missing()))
            print(
                f'not the whole graph yet after {args.seconds:g} s'
                + (f': {missing} not found' if missing else ''),
                file=sys.stderr,
            )
        if args.hz:
            _measure(visit, rows)
    if not rows and visit.stopped:
        raise KeyboardInterrupt  # nobody knows yet whether a graph runs
    if args.json:
        print(json.dumps(rows, indent=2))
    if not rows:
        raise DeviceMissing(f'no topics: no graph runs here; {status.how_to_start()}')
    if args.json:
        return 0
    for row in rows:
        rate = f'{row["rate_hz"]:7.2f} Hz  ' if args.hz else ''
        print(
            f'{row["topic"]:28} {row["type"]:36} {row["publishers"]} -> {row["readers"]}  '
            f'{rate}{row["doc"]}'.rstrip()
        )
    return 0


class _Discovery:
    """Holds once all that runs here has been found, and nothing new has turned up for a while."""

    def __init__(self, node):
        self._node, self._seen, self._since_s = node, None, 0.0
        self._expected = _running(node.get_namespace()[1:])

    def missing(self) -> set[str]:
        """Return the nodes of the running scene that have not been discovered yet."""
        found = self._node.get_node_names_and_namespaces()
        space = self._node.get_namespace()
        return self._expected - {name for name, where in found if where == space}

    def __call__(self) -> bool:
        node = self._node
        names = [name for name, _ in node.get_topic_names_and_types()]
        seen = (sorted(node.get_node_names()), [
            (name, node.count_publishers(name), node.count_subscribers(name)) for name in names
        ])  # fmt: skip
        if seen != self._seen:
            self._seen, self._since_s = seen, time.monotonic()
        settled = time.monotonic() - self._since_s > DISCOVERED_S
        return settled and bool(set(names) - OF_ROS) and not self.missing()


def _running(namespace: str) -> set[str]:
    """Return the nodes that the supervisor of a graph says run; none where it is not here."""
    from eol_ros.bringup import status
    from eol_ros.ros import network
    from eol_ros.streams.work_state import DOWN

    try:
        rows = status.ask(network.domain(), namespace=namespace)['nodes']
    except (DeviceMissing, SupervisorSilent):
        return set()
    return {row['node'] for row in rows if row['level'] < DOWN and row['text'] != 'finished'}


def _measure(visit, rows) -> None:
    """Add `rate_hz` to each row: messages a second over RATE_S, once the subscriptions are met."""
    from eol_ros.ros.echo import listen

    counts: Counter[str] = Counter()
    for row in rows:
        if row['publishers']:
            listen(visit.node, row['topic'], lambda _, of=row['topic']: counts.update([of]), True)
    visit.run(lambda: False, 1.0)  # publishers discover the subscriptions; latched messages come
    counts.clear()
    begun_s = time.monotonic()
    visit.run(lambda: False, RATE_S)
    for row in rows:
        row['rate_hz'] = round(counts[row['topic']] / (time.monotonic() - begun_s), 2)
