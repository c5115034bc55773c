# SPDX-License-Identifier: Apache-2.0
"""eol bench: every benchmark by its name."""

import importlib
from pathlib import Path

from eol_ros import bench, cli
from eol_ros.errors import UsageError

HELP = 'Measure error against run time, and speed against peers; `eol bench NAME --help` says more.'
EXAMPLES = ['eol bench graph --seconds 30', 'eol bench physics --json > physics.json']


def names() -> list[str]:
    """Return the benchmarks that there are."""
    files = sorted(Path(bench.__file__).parent.glob('[a-z]*.py'))
    return [f.stem for f in files if 'def add_arguments' in f.read_text()]


def add_arguments(parser):
    """Take the name; the rest belongs to the benchmark."""
    parser.add_argument('name', choices=names(), help='which')
    parser.add_argument('rest', nargs='...', help='its options')



def run(args):
    """Hand over to the benchmark."""
    if args.name not in names():
        raise UsageError(f'{args.name}: no such benchmark; there are {", ".join(names())}')
    module = importlib.import_module(f'eol_ros.bench.{args.name}')
    words = args.rest
    return cli.run_verb(module, f'eol bench {args.name}', words)
