# SPDX-License-Identifier: Apache-2.0
"""eol call: ask the running graph for something, and print what its nodes answer."""

import json
import sys
from dataclasses import replace

from eol_ros.errors import DeviceMissing, EolError, UsageError
from eol_ros.verbs import reach

HELP = 'Send a request to the nodes, as the panel does, and print their answers.'
EXAMPLES = [
    'eol call --list',
    'eol call sleep',
    'eol call mute',
    'eol call calibrate                             # waits for the result of the tracker',
    'eol call play_grain grain=12',
    'eol call move_grain grain=12 x=0.25 y=0.5',
    'eol call set grains radius=0.05',
    'eol call sleep sound                           # only this node',
    'eol call cue name=evening                      # of the cues of the scene',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('kind', nargs='?', help='kind of request; --list prints all kinds')
    parser.add_argument(
        'words',
        nargs='*',
        metavar='NODE | NAME=VALUE',
        help='send it to this node only; arguments of the request',
    )
    parser.add_argument('--list', action='store_true', help='list the kinds of request and end')
    parser.add_argument('--json', action='store_true', help='print the answers as one JSON list')
    reach.add_arguments(parser)


def run(args):
    """Ask and wait; exit code 1 when a node refuses, 69 when none answers."""
    from eol_ros.ros.request_words import asked_of
    from eol_ros.streams.requests import KINDS

    if args.list:
        print(_list(KINDS, args.json))
        return 0
    if args.kind is None:
        raise UsageError('name a kind of request; --list shows all')
    asked = replace(asked_of([args.kind, *args.words]), source='eol call')
    return answer(asked, args)


def answer(asked, args) -> int:
    """Ask the graph; print the answers and return the exit code."""
    where = reach.running(args)  # fails without a graph, before messages are imported (0.3 s)
    from eol_ros.ros.requests import visiting
    from eol_ros.streams.requests import KINDS

    alone = KINDS[asked.kind].nodes if not asked.node else ()
    only = asked.node or (alone[0] if len(alone) == 1 else '')
    with reach.asking(only, args), visiting(*where, asked.node) as visit:
        answers = visit.ask(asked)
    rows = [
        {'node': node, 'accepted': accepted, 'reason': reason}
        for node, (accepted, reason) in answers.found.items()
    ]
    if args.json:
        print(json.dumps(rows, ensure_ascii=False))
    for row in () if args.json else rows:
        done = 'done' if row['accepted'] else 'refused'
        print(f'{row["node"]}: {done}' + (f', {row["reason"]}' if row['reason'] else ''))
    if answers.refusal:
        if args.json:
            print(f'eol: {answers.refusal}', file=sys.stderr)
        return EolError.exit_code
    if not answers.whole:
        raise DeviceMissing(answers.silent)
    return 0


def _list(kinds, as_json: bool) -> str:
    rows = [
        {
            'kind': k.name,
            'takes': [item.name for item in k.takes],
            'nodes': [k.answered_by] if k.answered_by else list(k.whom('')),
            'doc': k.doc,
        }
        for k in kinds.values()
        if not k.internal
    ]
    if as_json:
        return json.dumps(rows)
    return '\n'.join(
        f'{" ".join([row["kind"], *(f"{name}=" for name in row["takes"])]):32} {row["doc"]}\n'
        f'{"":32} answered by {", ".join(row["nodes"])}'
        for row in rows
    )
