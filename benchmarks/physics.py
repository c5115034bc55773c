# SPDX-License-Identifier: Apache-2.0
"""`eol bench physics`: error against run time of solvers and peers."""

import argparse
import functools
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support import physics_rotating, random_scenes, scipy_solver, stepping
from support.physics_oracles import ORACLES
from support.scipy_solver import scipy_events, scipy_smooth

from benchmarks import physics_peers as peers
from benchmarks import plots
from benchmarks.machine import headed, machine, tell
from eol_ros.core.physics import builders
from eol_ros.core.physics.event import solver as event
from eol_ros.core.physics.result import Limits, sample_times
from eol_ros.core.physics.rotation import solver as rotation
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.table import Table
from eol_ros.errors import UsageError
from eol_ros.lab import choose, presets
from eol_ros.lab.exact import solver as exact
from eol_ros.verbs.progress import track

HELP = 'Measure error against run time of the spring-block solvers and their peers.'
EXAMPLES = [
    'eol bench physics --json > physics.json',
    'eol bench physics --part own',
    'eol bench physics --markdown --plots docs/img > physics.md',
]
PEER_S = 2.5  # slow peers run this far; we are timed on the same stretch beside them
LIMITS = Limits(events=200_000, steps=2_000_000)
SCIPY_S = {'S1': 20.0, 'S2': 12.0, 'S6a': 6.2, 'S6b': 6.0, 'S4L': 4.0, 'S4G': 6.0}
OTHERS_S = 8.0  # for so long SciPy follows the other scenes
ROTATION_S = 3.0  # for so long SciPy follows blocks that rotate
PARTS = ('own', 'convergence', 'rotation', 'peers', 'tolerance', 'live')
RANDOM_SCENES = ((False, 500), (True, 100))  # whether blocks rotate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--json', action='store_true', help='print the figures as JSON')
    form.add_argument(
        '--markdown', action='store_true', help='print the tables of the page on physics'
    )
    parser.add_argument('--plots', metavar='DIR', help='draw the results there')
    parser.add_argument(
        '--part', choices=PARTS, action='append', help='measure only this part; may be repeated'
    )


def cpu_s(work: Callable, repeat: int) -> tuple[Any, float]:
    """Return what `work` gives, and the least processor time of `repeat` calls (s)."""
    best = float('inf')
    for _ in range(repeat):
        begin = time.process_time()
        result = work()
        best = min(best, time.process_time() - begin)
    return result, best


def error_of(u: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest displacement error (m)."""
    return float(np.abs(u[: len(reference)] - reference[: len(u)]).max())


def reference_of(scene: Scene, times: np.ndarray) -> np.ndarray:
    """Return displacements to compare with: another order, or a much tighter tolerance."""
    if choose.along_x(scene):
        return exact.solve(scene, times, LIMITS, False, order=20).u
    return event.solve(scene, times, LIMITS, False, 1e-14).u


def _row(
    scene: str, method: str, timed: tuple, truth: np.ndarray, witness: np.ndarray, stretch: float
) -> dict:
    """Return the row of a run and its time, s; `witness`: by SciPy, first `stretch` s."""
    run, seconds = timed
    return {
        'scene': scene,
        'method': method,
        'seconds': float(run.t[-1]),
        'ms': seconds * 1e3,
        'error_m': error_of(run.u, truth),
        'scipy_s': stretch,
        'scipy_error_m': error_of(run.u[: len(witness)], witness),
        'events': len(run.event_t),
        'steps': run.steps,
        'status': run.status,
    }


def own_rows(name: str) -> list[dict]:
    """Return the rows of one named scene on every path of ours."""
    scene = from_mapping(presets.scene(name))
    times = sample_times(scene.duration_s, 0.1)
    truth = reference_of(scene, times)
    stretch = SCIPY_S.get(name, OTHERS_S)
    early = times[times <= stretch * (1 + 1e-12)]
    witness = ORACLES['SciPy DOP853, events'](scene, early)
    rows = []

    def add(method: str, solve: Callable, repeat: int) -> None:
        solve()
        rows.append(_row(name, method, cpu_s(solve, repeat), truth, witness, stretch))

    if choose.along_x(scene):
        add('exact', lambda: exact.solve(scene, times, LIMITS, False), 20)
    for tolerance in (1e-6, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12):
        if name == 'S6a':
            break  # the event path resolves the stiff mode: minutes, where the exact path has modes
        add(
            f'event {tolerance:g}',
            lambda tol=tolerance: event.solve(scene, times, LIMITS, False, tol),
            5,
        )
    for step_s in (1e-3, 1e-4, 1e-5):
        if np.sqrt(8 * scene.lattice.k.max() / scene.mass.min()) * step_s < 1.8:
            add(
                f'stepping {step_s:g}',
                lambda h=step_s: stepping.solve(scene, times, h),
                1,
            )
    return rows


FLOOR_M = 1e-17  # an error of exactly zero is drawn here
EQUAL = {'mu_s': 0.65, 'mu_k': 0.65}  # for engines that know one coefficient only


def peer_row(name: str, method: str, solve: Callable, seconds: float) -> dict:
    """Return the row of one peer, with our time on the same stretch beside it."""
    row, module = {'scene': name, 'method': method, 'seconds': seconds}, method.split()[0]
    if importlib.util.find_spec(module) is None:
        return row | {'status': f'{module} is not installed'}
    given = presets.scene(name.removesuffix(' equal')) | {'T': seconds}
    scene = from_mapping(given | EQUAL if name.endswith(' equal') else given)
    times = sample_times(seconds, 0.1)
    truth = reference_of(scene, times)
    u, took = cpu_s(lambda: solve(scene, times), 1)
    if len(u) < len(times):
        return row | {'status': f'gave up at {times[len(u) - 1]:g} s', 'ms': took * 1e3}
    if choose.along_x(scene):
        ours, own = cpu_s(lambda: exact.solve(scene, times, LIMITS, False), 10)
    else:
        tolerance = 1e-6 if name.endswith(' equal') else 1e-11
        ours, own = cpu_s(lambda: event.solve(scene, times, LIMITS, False, tolerance), 3)
    return row | {
        'status': 'ok',
        'ms': took * 1e3,
        'error_m': error_of(u, truth),
        'own_ms': own * 1e3,
        'own_error_m': error_of(ours.u, truth),
        'ratio': took / own,
    }


def peer_rows() -> list[dict]:
    """Return the rows of the peers, each on scenes that it can take."""
    with_events = (('S3G', PEER_S), ('S4L', 1.0))
    smooth = (('S1', 10.0), ('S3L', 3.0), ('S4L', 0.6))
    steps = ((1e-3, False), (1e-3, True), (1e-4, True))
    work: list[tuple[str, str, Callable, float]] = []
    for name, seconds in with_events:
        for rtol in (1e-7, 1e-10):
            solve = functools.partial(scipy_events, rtol=rtol)
            work.append((name, f'scipy DOP853 events {rtol:g}', solve, seconds))
    for name, seconds in smooth:
        for method in ('LSODA', 'Radau'):
            solve = functools.partial(scipy_smooth, method=method)
            work.append((name, f'scipy {method} smooth', solve, seconds))
    for name in ('S3E', 'S5 equal'):
        for step_s, stiff in steps:
            solve = functools.partial(peers.mujoco, step_s=step_s, stiff=stiff)
            work.append((name, f'mujoco {step_s:g}{" stiff" if stiff else ""}', solve, 10.0))
    plane = functools.partial(peers.mujoco_plane, step_s=1e-3)
    work.append(('S4L equal', 'mujoco contacts 0.001', plane, 5.0))
    for name in ('S3E', 'S5 equal', 'S4L equal'):
        solve = functools.partial(peers.pymunk, step_s=1e-3)
        work.append((name, 'pymunk 0.001', solve, 5.0))
    return [peer_row(*row) for row in track(work, 'peers')]


def rotation_rows() -> list[dict]:
    """Return error against time of blocks that rotate, against tolerance 1e-14 and SciPy."""
    rows = []
    for name in ('S4L', 'S4G'):
        scene = from_mapping(presets.scene(name) | {'rotation': {'side': 0.084}})
        times = sample_times(scene.duration_s, 0.1)
        truth = rotation.solve(scene, times, LIMITS, False, 1e-14).u
        early = times[times <= ROTATION_S * (1 + 1e-12)]
        witness, _, _ = physics_rotating.solve(scene, early)
        for tolerance in (1e-6, 1e-8, 1e-10, 1e-12):
            solve = functools.partial(rotation.solve, scene, times, LIMITS, True, tolerance)
            timed = cpu_s(solve, 3)
            row = _row(
                f'{name} rotation', f'event {tolerance:g}', timed, truth, witness, ROTATION_S
            )
            rows.append(row | {'residual_J': timed[0].energy.residual_J})
    return rows


def _circled(seconds: float, off_m: float, **more: Any) -> dict:
    offsets = builders.offsets(25, off_m, 4)
    return builders.table(presets.CIRCLE, seconds, geometric=True, u0=offsets, **more)


CONVERGENCE: dict[str, dict] = {
    'smooth: no friction, 5 s': _circled(5.0, 5e-3, mu_s=0.0, mu_k=0.0),
    'stiff: k = 1e6 N/m, 0.02 s': _circled(0.02, 1e-6, k=1e6),
}


def convergence_rows() -> list[dict]:
    """Return errors of each method against SciPy, by tolerance or step, with their order."""
    rows = []
    for name, plain in track(list(CONVERGENCE.items()), 'convergence'):
        scene = from_mapping(plain)
        rotating = from_mapping(plain | {'rotation': {'side': Table().block_side_m}})
        times = np.linspace(0.0, scene.duration_s, 11)
        truth = scipy_solver.scipy_run(scene, times, 1e-13, 1e-8, 1e-6)[0]
        truth_rotating = physics_rotating.solve(rotating, times, 1e-13)[0]
        shortest = 1.8 / np.sqrt(8 * scene.lattice.k.max() / scene.mass.min())
        tolerances = [10.0**-k for k in range(3, 13)]
        methods: dict[str, tuple[Callable, np.ndarray, list[float]]] = {
            'event': (
                lambda tol, s=scene, t=times: event.solve(s, t, LIMITS, False, tol),
                truth, tolerances,
            ),
            'event with rotation': (
                lambda tol, s=rotating, t=times: rotation.solve(
                    s, t, LIMITS, False, tol
                ),
                truth_rotating, tolerances,
            ),
            'stepping': (
                lambda h, s=scene, t=times: stepping.solve(s, t, h),
                truth, [shortest / 2**k for k in range(8)],
            ),
        }  # fmt: skip
        for method, (solve, against, settings) in methods.items():
            found = [cpu_s(lambda x=x, f=solve: f(x), 3) for x in settings]
            errors = [error_of(run.u, against) for run, _ in found]
            order = _order(settings, errors)
            rows += [
                {'scene': name, 'method': method, 'setting': x, 'error_m': error,
                 'ms': took * 1e3, 'order': order}
                for x, error, (_, took) in zip(settings, errors, found, strict=True)
            ]  # fmt: skip
    return rows


def _order(settings: list[float], errors: list[float]) -> float:
    """Return the slope of log error, over the four finest settings above the method's floor."""
    x, y = np.array(settings), np.array(errors)
    used = np.flatnonzero(y > 10 * y.min())[-4:]
    return float(np.polyfit(np.log(x[used]), np.log(y[used]), 1)[0])


def tolerance_rows() -> list[dict]:
    """Return, for each path, errors of random scenes in units of the tolerance asked for."""
    work = [(seed, rotates) for rotates, scenes in RANDOM_SCENES for seed in range(scenes)]
    found = [random_scenes.judge(*one) for one in track(work, 'random scenes')]
    rows = []
    for path in sorted({one.path for one in found}):
        of_path = [one for one in found if one.path == path]
        errors = np.array([one.error for one in of_path if np.isfinite(one.error)])
        rows.append(
            {
                'path': path,
                'scenes': len(of_path),
                'events': sum(one.events for one in of_path),
                'reference_certain': len(errors),
                'median': float(np.median(errors)),
                'worst': float(errors.max()),
                'above_10': int((errors > 10).sum()),
            }
        )
    return rows


def live_row(seconds: int = 60, rate_hz: int = 60, repeats: int = 5) -> dict:
    """Return what the twin's table costs under unattended hands: mean and busiest second.

    Of each second the median of the repeats: the motion is the same in all.
    """
    every = np.zeros((repeats, seconds))
    for spent in every:
        play = Play(1)
        table = play.table
        for image in range(seconds * rate_hz):
            begin = time.thread_time()
            play.advance(1 / rate_hz)
            spent[image // rate_hz] += time.thread_time() - begin
    spent = np.median(every, axis=0)
    return {
        'simulated_s': seconds,
        'mean_ms_per_s': spent.mean() * 1e3,
        'busiest_second_ms': spent.max() * 1e3,
        'slips': table.slips,
        'residual_J': table.energy_residual,
        'faults': table.faults,
    }


def run(args: argparse.Namespace) -> int:
    parts = args.part or PARTS
    if args.plots and not set(parts) & {'own', 'convergence', 'rotation', 'peers'}:
        raise UsageError(f'--plots: {", ".join(parts)} has no picture')
    result: dict[str, Any] = {part: [] for part in PARTS} | {'machine': machine()}
    if 'own' in parts:
        for name in track(list(presets.NAMED), 'scenes'):
            result['own'] += own_rows(name)
    if 'convergence' in parts:
        result['convergence'] = convergence_rows()
    if 'rotation' in parts:
        result['rotation'] = rotation_rows()
    if 'peers' in parts:
        result['peers'] = peer_rows()
    if 'tolerance' in parts:
        result['tolerance'] = tolerance_rows()
    if 'live' in parts:
        result['live'] = [live_row()]
    if args.plots:
        _draw(result, Path(args.plots))
    tell(result, args.json, _markdown if args.markdown else _table)
    print('times are processor time, compilation left out', file=sys.stderr)
    return 0


def _draw(result: dict, folder: Path) -> None:
    """Draw error against time by scene, and against tolerance or step."""
    by_scene: dict[str, plots.Curves] = {}
    for r in result['own'] + result['rotation'] + result['peers']:
        if 'error_m' in r:
            curves = by_scene.setdefault(r['scene'], {})
            point = (r['ms'] / r['seconds'], max(r['error_m'], FLOOR_M), 0.0, '')
            curves.setdefault(r['method'].rstrip('-.0123456789e '), []).append(point)
        if 'own_ms' in r:
            point = (r['own_ms'] / r['seconds'], max(r['own_error_m'], FLOOR_M), 0.0, '')
            by_scene[r['scene']]['ours beside peers'] = [point]
    if by_scene:
        plots.draw(
            folder / 'physics_error.png', by_scene, 'ms per simulated second', 'largest error, m'
        )
    by_method: dict[str, plots.Curves] = {}
    for r in result['convergence']:
        curves = by_method.setdefault(r['scene'], {})
        point = (r['setting'], max(r['error_m'], FLOOR_M), 0.0, '')
        curves.setdefault(f'{r["method"]}, slope {r["order"]:.2f}', []).append(point)
    if by_method:
        plots.draw(
            folder / 'physics_convergence.png', by_method, 'tolerance, or step in s',
            'largest error, m',
        )  # fmt: skip


SHOWN = ('exact', 'event 1e-08', 'event 1e-09', 'event 1e-10', 'event 1e-11', 'event 1e-12')
UNSHOWN = ('scipy DOP853 events 1e-10', 'mujoco 0.001', 'mujoco 0.001 stiff')  # the worse of two


def _markdown(result: dict[str, Any]) -> str:
    """Return the tables of docs/explanation/numerics/physics.md."""
    head, lines = functools.partial(headed, result['machine']), []
    lines += head(
        'scene | events | tolerance | ms | error against itself, m | against SciPy, m (for)'
    )
    for name, rows in _by('scene', result['own'] + result['rotation']).items():
        kept = [row for row in rows if row['method'] in SHOWN]
        if kept[0]['method'] == 'exact':
            kept = kept[:1]
        elif len(kept) > 3:
            kept.pop(2)
        base = name.removesuffix(' rotation')
        title = f'{base} {presets.NAMED[base][0]}{", rotating" if base != name else ""}'
        columns = [
            ', '.join(_plain(row[key], digits) for row in kept)
            for key, digits in (('ms', 2), ('error_m', 1), ('scipy_error_m', 1))
        ]
        lines.append(
            f'| {title}, {kept[0]["seconds"]:g} s | {kept[-1]["events"]} |'
            f' {", ".join(_plain(row["method"].removeprefix("event ")) for row in kept)} |'
            f' {" | ".join(columns)} ({kept[0]["scipy_s"]:g} s) |'
        )
    lines += ['', *head('peer | cases: error (m), ms, ratio to our time')]
    for method, rows in _by('method', result['peers']).items():
        cases = [
            f'{row["scene"]} {row["seconds"]:g} s: {_plain(row["error_m"])},'
            f' {_plain(row["ms"], 2)}, {_plain(row["ratio"], 2)}'
            for row in rows if row['status'] == 'ok'
        ]  # fmt: skip
        if cases and method not in UNSHOWN:
            lines.append(f'| {method} | {"; ".join(cases)} |')
    lines += ['', *head('scene | series: ms (error, m; tolerance) | stepping (error; step, s)')]
    for name, rows in _by('scene', result['convergence']).items():
        settings = _by('method', rows)
        pairs = [settings['event'][0:7:6], settings['stepping'][2:8:5]]
        cells = [
            ', '.join(
                f'{_plain(r["ms"], 2)} ({_plain(r["error_m"])}; {_plain(r["setting"])})'
                for r in pair
            )
            for pair in pairs
        ]
        lines.append(f'| {name} | {" | ".join(cells)} |')
    return '\n'.join(lines)


def _by(key: str, rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row[key], []).append(row)
    return found


def _plain(value: float | str, digits: int = 1) -> str:
    """Return a number of a table: 140, 0.058, 7e-10."""
    if value == 'exact':
        return value
    rounded = float(f'{float(value):.{digits}g}')
    return f'{rounded:g}'.replace('e-0', 'e-')


def _table(result: dict) -> str:
    lines = []
    for title, rows in result.items():
        if rows and title != 'machine':
            lines.append(f'\n{title}')
            lines += ['  ' + '  '.join(f'{k} {_short(v)}' for k, v in row.items()) for row in rows]
    return '\n'.join(lines)


def _short(value: object) -> str:
    return f'{value:.3g}' if isinstance(value, float) else str(value)
