# SPDX-License-Identifier: Apache-2.0
"""eol param: the settings of running nodes, without a ROS install."""

import dataclasses
import json

from eol_ros.errors import UsageError, nearest
from eol_ros.verbs import reach

HELP = 'List, read and change the settings of a running node.'
EXAMPLES = [
    'eol param list grains',
    'eol param get grains radius',
    'eol param set grains radius 0.05',
    'eol param set sound gain_db -12',
    'eol param set grains grain_s 0.1               # shorter grains; the corpus is cut again',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument(
        'action',
        choices=('list', 'get', 'set'),
        help='list: all settings of the node; get: one value; set: change it',
    )
    parser.add_argument('node', help='node of the graph, such as grains')
    parser.add_argument('name', nargs='?', help='setting of the node')
    parser.add_argument('value', nargs='?', help='the new value, as YAML')
    parser.add_argument('--json', action='store_true', help='print JSON')
    reach.add_arguments(parser)


def run(args):
    """Do it; exit code 1 when the node refuses, 69 when it does not answer."""
    from eol_ros.streams.graph import NODES

    if args.node not in NODES:
        raise UsageError(f'{args.node}: no such node. {nearest(args.node, NODES)}')
    fields = {f.name: f for f in dataclasses.fields(NODES[args.node].settings)}
    if args.action != 'list' and not args.name:
        raise UsageError(f'{args.action} {args.node}: name a setting')
    if args.name and args.name not in fields:
        hint = nearest(args.name, fields)
        raise UsageError(f'{args.node} has no setting {args.name}. {hint}')
    if args.action == 'set':
        return _set(args, fields[args.name])
    from eol_ros.ros.parameters import read
    from eol_ros.ros.session import session

    names = [args.name] if args.name else list(fields)
    with reach.asking(args.node, args), session(None, *reach.running(args)) as visit:
        values = read(visit, args.node, names)
    if args.json:
        print(json.dumps(values if args.action == 'list' else values[args.name]))
    elif args.action == 'get':
        print(values[args.name])
    else:
        for name, value in values.items():
            meta = fields[name].metadata
            live = ' (live)' if meta.get('live') else ''
            unit = f' [{meta["unit"]}]' if meta.get('unit') else ''
            print(f'{name:28} {value!r:16}{live:8} {meta.get("doc", "")}{unit}')
    return 0


def _set(args, field) -> int:
    from eol_ros.ros.request_words import value_of
    from eol_ros.ros.requests import REQUESTS
    from eol_ros.streams.graph import NODES
    from eol_ros.streams.requests import KINDS, SET, Asked
    from eol_ros.verbs.call import answer

    if args.value is None:
        raise UsageError(f'set {args.node} {args.name}: the value is missing')
    if not field.metadata.get('live'):
        raise UsageError(
            f'{args.node}.{args.name} cannot change while the node runs: write it into the '
            'scene, and start that again'
        )
    values = KINDS[SET].check({args.name: value_of(args.value, field.type)})
    if REQUESTS not in NODES[args.node].subscribes:
        return _write(args, values[args.name])
    return answer(Asked(SET, args.node, values, source='eol param'), args)


def _write(args, value) -> int:
    """Change a setting of a node that takes no requests; a refusal is an error."""
    from eol_ros.ros.parameters import write
    from eol_ros.ros.session import session

    with reach.asking(args.node, args), session(None, *reach.running(args)) as visit:
        write(visit, args.node, {args.name: value})
    reason = f'{args.name} is {value}'
    row = {'node': args.node, 'accepted': True, 'reason': reason}
    print(json.dumps([row]) if args.json else f'{args.node}: done, {reason}')
    return 0
