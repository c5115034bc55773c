# SPDX-License-Identifier: Apache-2.0
"""`eol bench sweep`: what a sweep costs beside its tasks: time, and memory of who gives them away.

The tasks are runs of the automaton of some milliseconds each. *Ideal* is the sum of their seconds,
as the workers count them, over the number of workers.
"""

import argparse

from eol_ros.errors import UsageError

HELP = 'Compute many short tasks with `eol sweep`, and compare with their sum over the workers.'
EXAMPLES = ['eol bench sweep', 'eol bench sweep --tasks 100000 --workers 2 --json']
SIZE, ALPHA = 16, 0.2
TRIED = 200_000  # events, to see how many fill a task


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--tasks', type=int, default=5000, metavar='N', help='(5000)')
    parser.add_argument('--task-ms', type=float, default=10.0, metavar='MS', help='each (10)')
    parser.add_argument('--workers', type=int, default=2, metavar='N', help='processes (2)')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='of a Dask cluster, instead')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Compute, compare, print."""
    import resource
    import tempfile
    import time
    from pathlib import Path

    from benchmarks.machine import tell
    from eol_ros.lab.sweeps import crews, spec, work
    from eol_ros.lab.sweeps.run import Counts
    from eol_ros.lab.sweeps.run import run as run_sweep
    from eol_ros.lab.sweeps.table import Table
    from eol_ros.verbs.progress import track

    if args.tasks < 10 or not args.task_ms > 0 or args.workers < 1:
        raise UsageError('10 tasks at least, of more than 0 ms, and a worker')
    events = _events(args.task_ms / 1e3)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'sweep.yaml'
        file.write_text(
            f'model: ofc\nfixed: {{size: {SIZE}, alpha: {ALPHA}, events: {events}, warmup: 0, '
            f'bootstrap: 0}}\nvary: {{seed: {{from: 1, to: {args.tasks}}}}}\n'
        )
        given = spec.load(file)
        crew: crews.Crew = (
            crews.Cluster(args.scheduler) if args.scheduler else crews.Local(args.workers)
        )
        counts, workers = Counts(), max(crew.size(), 1)
        table = Table(Path(folder) / 'sweep.parquet', 'ofc', work.version())
        begin_s, used_s = time.perf_counter(), time.process_time()
        try:
            for _ in track(run_sweep(given, table, crew, counts), 'sweep', total=len(given)):
                pass
        finally:
            crew.close()
            table.close()
        seconds, used_s = time.perf_counter() - begin_s, time.process_time() - used_s
    ideal_s = counts.seconds / workers
    result = {
        'tasks': args.tasks, 'workers': workers, 'task_ms': 1e3 * counts.each_s,
        'seconds': seconds, 'ideal_s': ideal_s, 'ratio': seconds / ideal_s,
        'giving_us': 1e6 * used_s / args.tasks,
        'peak_MB': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }  # fmt: skip
    tell(result, args.json, _table)
    return 0


def _events(seconds: float) -> int:
    """Return how many events of the automaton take so long."""
    import time

    from eol_ros.lab.automaton.ofc import Automaton

    lattice = Automaton.random(SIZE, ALPHA, 1)
    lattice.run(1000, full=True)
    begin_s = time.perf_counter()
    lattice.run(TRIED, full=True)
    return max(1, int(TRIED * seconds / (time.perf_counter() - begin_s)))


def _table(result: dict) -> str:
    return (
        f'{result["tasks"]} tasks of {result["task_ms"]:.2f} ms on {result["workers"]} workers: '
        f'{result["seconds"]:.2f} s, start, table and end included; ideal {result["ideal_s"]:.2f} s'
        f': {result["ratio"]:.3f} times; the process that gives them: {result["peak_MB"]:.0f} MB, '
        f'{result["giving_us"]:.0f} us of processor a task'
    )
