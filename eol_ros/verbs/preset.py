# SPDX-License-Identifier: Apache-2.0
"""eol preset: keep the live settings of grains and sound by name, recall them, glide to them."""

import dataclasses
import re
import time
from pathlib import Path

import yaml

from eol_ros import folders
from eol_ros.errors import ConfigError, DeviceMissing, EolError, UsageError
from eol_ros.verbs import reach

HELP = 'Keep the live settings of grains and sound by name, recall them, glide to them.'
EXAMPLES = [
    'eol preset save calm',
    'eol preset list',
    'eol preset recall storm',
    'eol preset recall calm --over 30            # glide there in half a minute',
    'eol preset show calm > calm.yaml            # a scene can say: include: calm.yaml',
]
NODES = ('grains', 'sound')
STEP_S = 0.1  # of a glide
NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_-]{0,63}')


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('action', choices=('save', 'recall', 'list', 'show'))
    parser.add_argument('name', nargs='?', help='letters, digits, - and _')
    add = parser.add_argument
    add('--over', type=float, default=0.0, metavar='S', help='with recall, glide for so long')
    add('--folder', metavar='DIR', help='where presets lie; else with the state of eol_ros')
    reach.add_arguments(parser)


def run(args):
    """Do it; exit code 1 when a node refuses, 69 when none answers, 78 for a spoilt preset."""
    folder = Path(args.folder) if args.folder else folders.state_path() / 'presets'
    if args.action == 'list':
        for path in sorted(folder.glob('*.yaml')):
            print(path.stem)
        return 0
    if not args.name or not NAME.fullmatch(args.name):
        raise UsageError(f'eol preset {args.action}: name the preset by letters, digits, - and _')
    if not 0 <= args.over <= 3600:
        raise UsageError(f'--over {args.over:g}: must lie in 0..3600')
    path = folder / f'{args.name}.yaml'
    if args.action == 'save':
        return _save(path, args)
    values = load(path)
    if args.action == 'show':
        print(path.read_text('utf-8'), end='')
        return 0
    return _recall(values, args)


def load(path: Path) -> dict:
    """Return the settings of a preset by node; raises ConfigError where they cannot be."""
    from eol_ros.scene import check_value
    from eol_ros.settings import live_fields
    from eol_ros.streams.graph import NODES as ALL

    try:
        data = yaml.safe_load(path.read_text('utf-8'))
    except FileNotFoundError:
        raise DeviceMissing(f'{path}: no such preset; eol preset list names them') from None
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise ConfigError(f'{path}: cannot be read ({type(error).__name__})') from None
    found = data.get('nodes') if isinstance(data, dict) else None
    if not isinstance(found, dict) or not found or not set(found) <= set(NODES):
        raise ConfigError(f'{path}: not a preset: no settings of {" and ".join(NODES)} in it')
    for node, values in found.items():
        kind = ALL[node].settings
        known = {f.name: f for f in dataclasses.fields(kind) if f.name in live_fields(kind)}
        if not isinstance(values, dict):
            raise ConfigError(f'{path}: {node}: no settings')
        for name, value in values.items():
            if name not in known:
                raise ConfigError(f'{path}: {node} has no live setting {name}')
            try:
                values[name] = check_value(known[name], value)
            except ConfigError as error:
                raise ConfigError(f'{path}: {node}.{name}: {error}') from None
    return found


def _save(path: Path, args) -> int:
    from eol_ros.ros.requests import visiting

    with visiting(*reach.of(args)) as visit:
        now = _now(visit)
    nodes = {
        node: {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
        for node, values in now.items()
    }
    part = path.with_name(f'.{path.name}')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(yaml.safe_dump({'nodes': nodes}, sort_keys=False, allow_unicode=True))
        part.replace(path)
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror})') from None
    print(path)
    return 0


def _recall(goal: dict, args) -> int:
    from eol_ros.core.sound.presets import between
    from eol_ros.devices.corpus.corpus_file import REMAKING
    from eol_ros.ros.requests import visiting
    from eol_ros.streams.graph import NODES as ALL
    from eol_ros.streams.requests import SET, Asked

    with visiting(*reach.of(args)) as visit:
        start = _now(visit)
        given = {node: dict(values) for node, values in start.items()}
        began, share = time.monotonic(), 0.0
        while share < 1.0 and not visit.stopped:
            share = min((time.monotonic() - began) / args.over, 1.0) if args.over else 1.0
            for node in [node for node in goal if node in start]:
                kind = ALL[node].settings
                now = between(kind, start[node], goal[node], share, REMAKING)
                changed = {k: v for k, v in now.items() if v != given[node][k]}
                if changed:
                    _set(visit, Asked(SET, node, changed, source='eol preset'))
                    given[node] |= changed
            visit.run(lambda: False, STEP_S if share < 1.0 else 0.0)
    for node, values in given.items():
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
    from eol_ros.streams.graph import NODES as ALL

    found = {}
    for node in NODES:
        values = visit.parameters(node, sorted(live_fields(ALL[node].settings)))
        if values is not None:
            found[node] = {k: v if _single(v) else tuple(v) for k, v in values.items()}
    if not found:
        raise DeviceMissing('neither grains nor sound runs here (--secure and --lan look further)')
    return found


def _single(value) -> bool:
    return isinstance(value, (str, bool, int, float))
