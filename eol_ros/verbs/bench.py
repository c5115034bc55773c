# SPDX-License-Identifier: Apache-2.0
"""eol bench: every benchmark by its name."""

import importlib
import os
import sys
from pathlib import Path

from eol_ros import cli
from eol_ros.errors import UsageError, nearest

HELP = 'Measure error against run time, and speed against peers; `eol bench NAME --help` says more.'
EXAMPLES = ['eol bench graph --seconds 30', 'eol bench physics --json > physics.json']
ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / 'benchmarks'


def names() -> list[str]:
    """Return the benchmarks that there are: none without a checkout of the repository."""
    files = sorted(FOLDER.glob('[a-z]*.py'))
    return [f.stem for f in files if 'def add_arguments' in f.read_text()]


def add_arguments(parser):
    """Take the name; the rest belongs to the benchmark."""
    parser.add_argument('name', help=f'benchmark: {", ".join(names())}')
    parser.add_argument('rest', nargs='...', help='options of the benchmark')


def run(args):
    """Hand over to the benchmark."""
    known = names()
    if not known:
        raise UsageError(
            'benchmarks are no part of the installed package: clone the repository, and start'
            ' `eol bench` from its own environment (make setup)'
        )
    if args.name not in known:
        raise UsageError(f'{args.name}: no such benchmark. {nearest(args.name, known)}')
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    # some measure in processes of their own
    paths = [str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]
    os.environ['PYTHONPATH'] = os.pathsep.join(paths)
    module = importlib.import_module(f'benchmarks.{args.name}')
    return cli.run_verb(module, f'eol bench {args.name}', args.rest)
