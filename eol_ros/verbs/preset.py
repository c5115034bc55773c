# SPDX-License-Identifier: Apache-2.0
"""eol preset: keep the live settings of grains and sound by name, recall them, glide to them."""

import sys

from eol_ros.cli import within
from eol_ros.verbs import reach

HELP = 'Keep the live settings of grains and sound by name, recall them, glide to them.'
EXAMPLES = [
    'eol preset save calm',
    'eol preset list',
    'eol preset recall storm',
    'eol preset recall calm --over 30            # glide there in half a minute',
    'eol preset show calm > calm.yaml            # a scene can say: include: calm.yaml',
]


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('action', choices=('save', 'recall', 'list', 'show'))
    parser.add_argument('name', nargs='?', help='letters and digits of any script, - and _')
    parser.add_argument(
        '--over', type=within(0, 3600), default=0.0, metavar='S', help='glide time of recall'
    )
    parser.add_argument(
        '--json', action='store_true', help='the answers to save and recall as JSON'
    )
    reach.add_arguments(parser)


def run(args):
    """Do it; exit code 1 when the node refuses, 69 when it does not answer, 78: spoilt preset."""
    from eol_ros.ros import presets

    folder = presets.folder()
    if args.action == 'list':
        names = presets.names(folder)
        print(''.join(f'{name}\n' for name in names), end='')
        if not names:
            print(f'no presets in {folder}; `eol preset save NAME` keeps one', file=sys.stderr)
        return 0
    path = presets.path_of(args.name or '', folder)
    if args.action == 'show':
        presets.load(path)
        print(path.read_text('utf-8'), end='')
        return 0
    from eol_ros.streams.requests import Asked
    from eol_ros.verbs.call import answer

    values = {'preset': path.stem}
    if args.action == 'recall':
        values['over_s'] = args.over
    return answer(Asked(f'{args.action}_preset', 'sound', values, source='eol preset'), args)
