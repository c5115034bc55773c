# SPDX-License-Identifier: Apache-2.0
"""eol mirror: let those with a read-only key hear the graph."""

import sys

from eol_ros.verbs import reach

HELP = (
    'Copy all topics of the graph into a DDS domain of its own, until Ctrl-C. Read-only keys '
    '(`eol keys add NAME --read-only`) reach that domain alone, and nothing is copied back. '
    'Run it on the machine of the work.'
)
EXAMPLES = ['eol mirror --secure']


def add_arguments(parser):
    """Declare the command line."""
    reach.add_arguments(parser)


def run(args):
    """Copy, and say what is read when that changes."""
    from eol_ros.ros.echo import Absence
    from eol_ros.ros.mirror import Mirror
    from eol_ros.ros.session import session
    from eol_ros.streams.graph import TOPICS, full_name

    network, namespace = reach.of(args)
    with session(reach=network, namespace=namespace) as visit:
        mirror = Mirror(visit.node)
        absence = Absence(visit.node, [full_name(topic, namespace) for topic in TOPICS])
        told = ['']

        def tell():
            if absent := absence.look():
                print(absent, file=sys.stderr, flush=True)
            now = ', '.join(mirror.read)
            if now != told[0]:
                told[0] = now
                print(f'read: {now or "nothing"}', file=sys.stderr, flush=True)
            return False

        try:
            visit.run(tell)
        finally:
            mirror.close()
    return 0
