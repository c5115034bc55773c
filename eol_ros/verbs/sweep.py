# SPDX-License-Identifier: Apache-2.0
"""`eol sweep`: the law of cascades over all combinations of parameters, as a table."""

import argparse
import json
import os
import sys
from pathlib import Path

from eol_ros import interrupts
from eol_ros.cli import within

HELP = """Run a table, plate, automaton or any scene over all combinations of parameters.

The results are a CSV table, with FILE.json about its columns. A repeated command computes only
missing rows; new values in the sweep file add rows. --parameters MODEL lists its keys and
columns."""
EXAMPLES = [
    'eol sweep examples/sweeps/friction.yaml',
    'eol sweep examples/sweeps/friction.yaml --output mine.csv --workers 4',
    'eol sweep sweep.yaml --scheduler tcp://host:8786',
    'eol sweep sweep.yaml --count',
    'eol sweep --parameters plate',
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('spec', metavar='SPEC.yaml', nargs='?', help='sweep file')
    parser.add_argument(
        '-o',
        '--output',
        metavar='FILE',
        help='the table, .csv (default: named as the sweep file, here)',
    )
    crew = parser.add_mutually_exclusive_group()
    crew.add_argument(
        '--workers',
        type=within(1, 1000, int),
        metavar='N',
        help='number of processes on this machine (default: its cores)',
    )
    crew.add_argument(
        '--scheduler',
        metavar='tcp://HOST:8786',
        help='address of a Dask cluster to use instead',
    )
    parser.add_argument(
        '--count', action='store_true', help='check the sweep file, count its tasks and end'
    )
    parser.add_argument('--parameters', metavar='MODEL', help='list the parameters of a model')
    parser.add_argument('--json', action='store_true', help='print the summary as JSON')


def run(args: argparse.Namespace) -> int:
    from eol_ros.errors import UsageError
    from eol_ros.lab.sweeps import spec as specs
    from eol_ros.lab.sweeps import work
    from eol_ros.lab.sweeps.run import Counts, missing
    from eol_ros.lab.sweeps.table import Table

    if args.parameters:
        return _parameters(args.parameters)
    if not args.spec:
        raise UsageError('name a sweep file; --parameters MODEL lists what can stand in it')
    spec = specs.load(args.spec)
    if args.count:
        print(json.dumps({'tasks': len(spec)}) if args.json else f'{len(spec)} tasks')
        return 0
    out = Path(args.output or f'{Path(args.spec).stem}.csv')
    table = Table(out, spec.model, work.version())
    counts, stopped = Counts(), False
    try:
        lacks = missing(spec, table)
        _compute(args, spec, table, counts, lacks)
    except KeyboardInterrupt:
        interrupts.caught()
        stopped = True
    finally:
        table.close()
    words = {
        'table': str(out), 'tasks': len(spec), 'computed': counts.done,
        'missing': lacks - counts.done, 'rows': len(table), 'seconds': counts.seconds,
    }  # fmt: skip
    if args.json:
        print(json.dumps(words))
    else:
        print(
            f'{out}: {len(table)} rows; {counts.done} of {len(spec)} tasks computed now, in '
            f'{counts.seconds:.3g} s of work'
        )
    if stopped:
        left = words['missing']
        print(f'stopped; {left} tasks are left: the same command goes on', file=sys.stderr)
    return 0


def _compute(args, spec, table, counts, lacks: int) -> None:
    from eol_ros.lab.sweeps import crews
    from eol_ros.lab.sweeps.run import run as run_sweep
    from eol_ros.verbs import compile
    from eol_ros.verbs.progress import track

    if not lacks:
        return
    if spec.model != 'ofc' and not args.scheduler:
        compile.ensure(['simulate'])
    workers = args.workers or min(len(os.sched_getaffinity(0)), lacks)
    opened = crews.cluster(args.scheduler) if args.scheduler else crews.local(workers)
    with opened as crew:
        if not crew.size():
            print(f'no worker at {args.scheduler} yet: waiting for one', file=sys.stderr)
        for other in crew.others:
            print(
                f'worker {other} has another processor than this machine: chaotic models will '
                'agree in their laws only, not to the bit',
                file=sys.stderr,
            )
        for _ in track(run_sweep(spec, table, crew, counts), 'sweep', total=lacks):
            pass


def _parameters(model: str) -> int:
    import dataclasses

    from eol_ros.errors import UsageError
    from eol_ros.lab.science.sweep import MODELS, RESULTS
    from eol_ros.lab.sweeps.table import columns

    if model not in MODELS:
        raise UsageError(f'--parameters {model}: not one of {", ".join(MODELS)}')
    defaults = {f.name: f.default for f in dataclasses.fields(MODELS[model])}
    there = columns(model)
    print(f'{model}: {(MODELS[model].__doc__ or "").splitlines()[0]}')
    for name, default in sorted(defaults.items(), key=lambda item: list(there).index(item[0])):
        unit = f' {there[name].unit}' if there[name].unit else ''
        shown = f'{default:.6g}' if isinstance(default, float) else default
        print(f'  {name:17} {shown!s:>9}{unit:7} {there[name].text}')
    print('columns of the table besides:')
    for name in RESULTS:
        unit = f' [{there[name].unit}]' if there[name].unit else ''
        print(f'  {name:17} {there[name].text}{unit}')
    return 0
