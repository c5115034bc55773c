# SPDX-License-Identifier: Apache-2.0
"""eol preset: keep the live settings of grains and sound by name, recall them, glide to them."""

import sys
import time
from pathlib import Path

from eol_ros.cli import within
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.streams.graph import INSTRUMENT, NODES
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
    add = parser.add_argument
    add(
        '--over',
        type=within(0, 3600),
        default=0.0,
        metavar='S',
        help='glide time of recall',
    )
    add('--folder', metavar='DIR', help='where presets lie; else with the state of eol_ros')
    reach.add_arguments(parser)


def run(args):
    """Do it; exit code 1 when a node refuses, 69 when none answers, 78 for a spoilt preset."""
    from eol_ros.ros import presets

    folder = Path(args.folder) if args.folder else presets.folder()
    if args.action == 'list':
        names = presets.names(folder)
        print(''.join(f'{name}\n' for name in names), end='')
        if not names:
            print(f'no presets in {folder}; `eol preset save NAME` keeps one', file=sys.stderr)
        return 0
    path = presets.path_of(args.name or '', folder)
    if args.action == 'save':
        return _save(path, args)
    values = presets.load(path)
    if args.action == 'show':
        print(path.read_text('utf-8'), end='')
        return 0
    return _recall(values, args)


def _save(path: Path, args) -> int:
    from eol_ros.ros import presets
    from eol_ros.ros.requests import visiting

    with visiting(*reach.running(args)) as visit:
        now = _now(visit)
    presets.save(path, now)
    print(path)
    return 0


def _recall(goal: dict, args) -> int:
    from eol_ros.core.sound.presets import STEP_S, Glide
    from eol_ros.devices.corpus.corpus_file import REMAKING
    from eol_ros.ros.requests import visiting
    from eol_ros.streams.requests import SET, Asked

    with visiting(*reach.running(args)) as visit:
        start = _now(visit)
        kinds, began_s = {node: NODES[node].settings for node in INSTRUMENT}, time.monotonic()
        glide = Glide(kinds, start, goal, args.over, REMAKING)
        while not glide.over and not visit.stopped:
            for node, changed in glide.step(time.monotonic() - began_s).items():
                _set(visit, Asked(SET, node, changed, source='eol preset'))
            visit.run(lambda: False, 0.0 if glide.over else STEP_S)
    for node, values in glide.given.items():
        count = sum(v != start[node][k] for k, v in values.items())
        print(f'{node}: {count} of {len(values)} live settings changed')
    return 0


def _set(visit, asked) -> None:
    answers = visit.ask(asked)
    if answers.refusal:
        raise EolError(answers.refusal)
    if not answers.whole:
        raise DeviceMissing(answers.silent)


def _now(visit) -> dict:
    """Return the live settings of those of the two nodes that run."""
    from eol_ros.settings import live_fields

    found = {}
    for node in INSTRUMENT:
        values = visit.parameters(node, sorted(live_fields(NODES[node].settings)))
        if values is not None:
            single = str, bool, int, float
            found[node] = {k: v if isinstance(v, single) else tuple(v) for k, v in values.items()}
    if not found:
        raise DeviceMissing('neither grains nor sound runs here (--secure and --lan look further)')
    return found
