# SPDX-License-Identifier: Apache-2.0
"""`eol bench extremes`: stiff and extreme cases: error, time, status, and a peer beside."""

import argparse
import importlib.util
import itertools
import json
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.physics_oracles import ORACLES, modes_of_mpmath
from support.scipy_solver import scipy_events, scipy_sliding, scipy_smooth

from benchmarks import extreme_parts
from benchmarks import physics_peers as peers
from benchmarks.extreme_scenes import Case, cases
from benchmarks.machine import headed, machine, tell
from eol_ros.cli import within
from eol_ros.core.physics.result import Limits, Run, sample_times
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.errors import ConfigError, UsageError
from eol_ros.lab import choose, presets
from eol_ros.verbs.progress import track

HELP = 'Measure error, run time and status of stiff and extreme cases, with a peer beside each.'
EXAMPLES = [
    'eol bench extremes',
    'eol bench extremes --case "mu_s = mu_k"',
    'eol bench extremes --json > extremes.json',
    'eol bench extremes --with extremes.json --markdown > docs/explanation/numerics/extremes.md',
]
PATIENCE_S = 60  # an oracle or a peer that takes longer is left, and the row says so
SAMPLES = 50
NO_PEER = 'none'
ORDINARY = Case('ordinary table', 'plane', lambda: presets.scene('S3G') | {'T': 5.0})
PEERS: dict[str, tuple[str, str, Callable[[Scene, np.ndarray], np.ndarray]]] = {
    'dop853': ('SciPy DOP853 events', 'scipy', lambda s, t: scipy_events(s, t, 1e-7)),
    'sliding': ('SciPy DOP853 1e-9', 'scipy', lambda s, t: scipy_sliding(s, t, 1e-9)),
    'radau': ('SciPy Radau, smooth', 'scipy', lambda s, t: scipy_smooth(s, t, 'Radau')),
    'mujoco': ('MuJoCo 1e-4 stiff', 'mujoco', lambda s, t: peers.mujoco(s, t, 1e-4, True)),
    'mujoco plane': ('MuJoCo contacts 1e-3', 'mujoco', lambda s, t: peers.mujoco_plane(s, t, 1e-3)),
}
INTRODUCTION = """
# Stiff and extreme cases

Made by `eol bench extremes --markdown`. Times are processor time of one core, without energy ledger
and compilation; *times ordinary* is in units of an ordinary table (S3G, 5 s). *Error* is the
largest displacement error against a formula, mpmath, SciPy (DOP853 between its own events,
tolerance 3e-13, stops below 1e-8 m/s) or the tests' stepping, none by the solver's method. Status
ok: the run *reached* its whole duration. *Covered* is the part that the reference covers, a fifth
at least. A peer runs on the same part (SciPy's events: at 1e-7): its error, its time, ours in
brackets. K_C is the stiffness between blocks, K_L that to the plate."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--case', default='', metavar='TEXT', help='measure only rows whose name contains TEXT'
    )
    parser.add_argument(
        '--hours',
        type=within(0, 1000),
        default=24.0,
        help='hours of the live clock (24)',
    )
    parser.add_argument('--markdown', action='store_true', help='print the tables of extremes.md')
    parser.add_argument(
        '--with',
        dest='earlier',
        metavar='FILE.json',
        action='append',
        default=[],
        help='measure nothing: take the rows of earlier --json runs',
    )
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def judge(run: Run, duration_s: float, limits: Limits) -> list[str]:
    """Return what is wrong with how a run ended: nothing, whatever the scene was.

    It has no NaN, has kept within its limits, and says how far it came where that is not the end.
    """
    wrong = []
    for name in ('t', 'u', 'v', 'event_t'):
        if not np.isfinite(getattr(run, name)).all():
            wrong.append(f'{name} is not finite')
    if run.steps > limits.steps or len(run.event_t) > limits.events:
        wrong.append(f'{run.steps} steps and {len(run.event_t)} events are above the limits')
    if not 0 <= run.t_reached <= duration_s:
        wrong.append(f'reached {run.t_reached} of {duration_s} s')
    if np.any(np.diff(run.event_t) < 0):
        wrong.append('events do not rise')
    early = run.status != 'ok'
    if not early and run.t_reached != duration_s:
        wrong.append('ok, but not at its end')
    if early and (len(run.t) and run.t[-1] > run.t_reached):
        wrong.append('samples of what was not reached')
    if early and not any(run.status in note and ':' in note for note in run.notes):
        wrong.append('ends early and does not say what would let it go on')
    return wrong


def ended(case: Case, ledger: bool = False) -> tuple[Run, list[str]]:
    """Return the run of a case within its limits, and what is wrong with how it ended."""
    scene, limits = from_mapping(case.build()), Limits()
    sample_s = max(scene.duration_s / SAMPLES, 1e-12)
    run = choose.simulate(scene, sample_s, tolerance=case.tolerance, limits=limits, ledger=ledger)
    wrong = judge(run, scene.duration_s, limits)
    if run.status != case.ends:
        wrong.append(f'status {run.status}, where {case.ends} was known')
    return run, wrong


def row(case: Case) -> dict[str, Any]:
    """Return the row of a spring-block scene."""
    run, wrong = ended(case, ledger=True)
    assert run.energy is not None
    scale = max(abs(run.energy.work_J), abs(run.energy.friction_J), abs(run.energy.elastic_J))
    found = {
        'case': case.name,
        'where': case.where,
        'path': run.path,
        'status': '; '.join(wrong) or run.status,
        't_reached': run.t_reached,
        'duration_s': from_mapping(case.build()).duration_s,
        'events': len(run.event_t),
        'steps': run.steps,
        'ms': _least_ms(case),
        'residual_J': run.energy.residual_J,
        'of_J': scale,
        'notes': '; '.join(filter(None, [case.holds, *run.notes])),
    }
    if case.oracle:
        found |= _measured(case)
    return found


def _least_ms(case: Case) -> float:
    timed = [_cpu_ms(lambda: ended(case))]
    while len(timed) < (1 if timed[0] > 1e4 else 2 if min(timed) > 100 else 5):
        timed.append(_cpu_ms(lambda: ended(case)))
    return min(timed)


def _measured(case: Case) -> dict[str, Any]:
    """Return error on a stretch against what shares no code, and that of a peer."""
    given = case.build()
    stretch = case.stretch_s or given['T']
    scene = from_mapping(given | {'T': stretch})
    limits = Limits()
    sample_s = max(stretch / SAMPLES, 1e-12)
    times = sample_times(stretch, sample_s)

    def ours() -> Run:
        return choose.simulate(
            scene, sample_s, tolerance=case.tolerance, limits=limits, ledger=False
        )

    found: dict[str, Any] = {'against': case.oracle, 'stretch_s': stretch}
    oracle = ORACLES[case.oracle]
    truth, _ = patiently(lambda: oracle(scene, times))
    if truth is None:
        return found | {'against': f'{case.oracle}: not done in {PATIENCE_S} s'}
    run, own_ms = ours(), min(_cpu_ms(ours) for _ in range(3))
    u = run.u[-1:] if oracle is modes_of_mpmath else run.u
    found |= {'error_m': _error(u, truth), 'own_ms': own_ms}
    if not case.peer:
        return found
    name, module, solve = PEERS[case.peer]
    if importlib.util.find_spec(module) is None:
        return found | {'peer': f'{name}: not installed'}
    try:
        u, took = patiently(lambda: solve(scene, times))
    except RuntimeError as error:
        return found | {'peer': f'{name}: {error}'}
    if u is None or len(u) < len(times):
        reached = f'{times[len(u) - 1]:.3g} s' if u is not None else f'{PATIENCE_S} s'
        return found | {'peer': f'{name}: gave up after {reached}', 'peer_ms': took}
    return found | {'peer': name, 'peer_ms': took, 'peer_error_m': _error(u, truth)}


def _error(u: np.ndarray, truth: np.ndarray) -> float:
    both = min(len(u), len(truth))
    return float(np.abs(u[:both] - truth[:both]).max())


def _cpu_ms(work: Callable[[], Any]) -> float:
    begin = time.process_time()
    work()
    return (time.process_time() - begin) * 1e3


def patiently(
    work: Callable[[], np.ndarray], seconds: float = PATIENCE_S
) -> tuple[np.ndarray | None, float]:
    """Return what `work` gives and its processor time, ms; None where it takes more than `seconds`.

    It runs in a process of its own, which can be ended wherever it is.
    """
    context = multiprocessing.get_context('fork')
    ours, theirs = context.Pipe(duplex=False)

    def send() -> None:
        os.dup2(2, 1)  # MuJoCo warns there
        begin = time.process_time()
        u = work()
        theirs.send((u, (time.process_time() - begin) * 1e3))

    child = context.Process(target=send)
    child.start()
    theirs.close()
    try:
        if not ours.poll(seconds):
            return None, seconds * 1e3
        return ours.recv()
    except EOFError:
        child.join()
        raise RuntimeError(f'it ended with exit code {child.exitcode}') from None
    finally:
        child.kill()
        child.join()


def run(args: argparse.Namespace) -> int:
    """Measure, then print."""
    if args.earlier:
        results = [_earlier(file) for file in args.earlier]
        merged = {'machine': results[-1]['machine']}
        merged['rows'] = list(itertools.chain.from_iterable(r['rows'] for r in results))
        tell(merged, args.json, markdown if args.markdown else table)
        return 0
    scenes = [case for case in cases() if args.case in case.name]
    parts = {name: part for name, part in extreme_parts.PARTS.items() if args.case in name}
    if not scenes and not parts:
        raise UsageError(f'--case {args.case!r}: no row has that in its name')
    ordinary = [_least_ms(ORDINARY)]
    rows = [row(case) for case in track(scenes, 'scenes')]
    ordinary.append(_least_ms(ORDINARY))
    for found in rows:
        found['times_ordinary'] = found['ms'] / min(ordinary)
    for name, part in track(parts.items(), 'live parts', total=len(parts)):
        rows.append(extreme_parts.live_day(args.hours) if name == 'clock' else part())
    found = {'machine': machine(), 'rows': rows}
    tell(found, args.json, markdown if args.markdown else table)
    print('times are processor time, compilation and energy ledger left out', file=sys.stderr)
    return 0


def _earlier(file: str) -> dict[str, Any]:
    """Return the results in `file`; raises ConfigError if it is no output of --json."""
    try:
        found = json.loads(Path(file).read_text())
    except ValueError:
        found = None
    if not isinstance(found, dict) or not {'machine', 'rows'} <= found.keys():
        raise ConfigError(f'--with {file}: the output of eol bench extremes --json is wanted')
    return found


def table(result: dict[str, Any]) -> str:
    """Return the rows for a terminal."""
    return '\n'.join(
        '  '.join(f'{key} {_short(value)}' for key, value in row.items() if value not in ('', None))
        for row in result['rows']
    )


def markdown(result: dict[str, Any]) -> str:
    """Return the page docs/explanation/numerics/extremes.md."""
    lines = [INTRODUCTION]
    for where, title in (('line', 'Along a line'), ('plane', 'In the plane')):
        rows = [row for row in result['rows'] if row['where'] == where]
        if not rows:
            continue
        lines += [
            f'\n## {title}\n',
            conclusion(rows) + '\n',
            *headed(
                result['machine'],
                'case | status | reached, s | ms | times ordinary | error, m | against | covered |'
                ' peer: error, m; ms (ours on the same part)',
            ),
        ]
        for r in rows:
            against = r.get('against', 'none')
            share = r['stretch_s'] / r['t_reached'] if r['t_reached'] else 1.0  # of no time: all
            covered = f'{share:.0%}' if 'error_m' in r else '-'
            peer = r.get('peer', NO_PEER)
            if 'peer_error_m' in r:
                peer += f': {r["peer_error_m"]:.0e}; {r["peer_ms"]:.3g} ({r["own_ms"]:.2g})'
            reached = f'{r["t_reached"]:.4g}'
            if r['t_reached'] != r['duration_s']:
                reached += f' of {r["duration_s"]:g}'
            lines.append(
                f'| {r["case"]} | {r["status"]} | {reached} | {r["ms"]:.3g} |'
                f' {r["times_ordinary"]:.2g} | {_exponent(r.get("error_m"))} |'
                f' {against.replace(" DOP853", "")} | {covered} |'
                f' {peer.replace(" DOP853", "")} |'
            )
        told: dict[str, list[str]] = {}
        for row in rows:
            told.setdefault(row['notes'], []).append(f'**{row["case"]}**')
        told.pop('', None)
        lines += ['', *(f'- {", ".join(cases)}: {note}.' for note, cases in told.items())]
    live = [row for row in result['rows'] if row['where'] == 'live']
    if live:
        lines += [
            '\n## Live parts\n',
            *headed(result['machine'], 'case | status | error | against | ms | what holds'),
        ]
        lines += [
            f'| {r["case"]} | {r["status"]} | {r["error"] or "-"} | {r["against"] or "-"} |'
            f' {r.get("ms", math.nan):.3g} | {r["notes"]} |'
            for r in live
        ]
    return '\n'.join(lines)


def conclusion(rows: list[dict[str, Any]]) -> str:
    """Return the line above a table: its largest error, longest row, and rows that end early."""
    known = [row for row in rows if 'error_m' in row]
    worst = max(known, key=lambda row: row['error_m'], default=None)
    slowest = max(rows, key=lambda row: row['times_ordinary'])
    early = [f'{row["case"]} ({row["status"]})' for row in rows if row['status'] != 'ok']
    return (
        (f'Largest error: {_exponent(worst["error_m"])} m ({worst["case"]}). ' if worst else '')
        + f'Longest: {slowest["times_ordinary"]:.2g} ordinary tables ({slowest["case"]}). '
        + f'Early end: {", ".join(early) or "none"}.'
    )


def _exponent(value: float | None) -> str:
    return '-' if value is None else '0' if value == 0 else f'{value:.0e}'


def _short(value: object) -> str:
    return f'{value:.3g}' if isinstance(value, float) else str(value)
