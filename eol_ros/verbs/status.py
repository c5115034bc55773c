# SPDX-License-Identifier: Apache-2.0
"""eol status: how is the running graph?"""

import json

from eol_ros.bringup import status
from eol_ros.verbs import reach

HELP = (
    'Print the state of the running graph. Exit code 0: all OK; 1: a warning or no answer; 2: an '
    'error; 69: no graph runs.'
)
EXAMPLES = ['eol status', 'eol status --json', 'eol status --namespace north']


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('--json', action='store_true', help='print one JSON object')
    parser.add_argument('--namespace', metavar='NAME', help=reach.NAMESPACE_HELP)


def run(args):
    """Print the table."""
    answer = reach.status_of(args)
    print(json.dumps(answer, indent=2) if args.json else status.table(answer))
    worst = max((row['level'] for row in answer['nodes']), default=0)
    return min(worst, 2)
