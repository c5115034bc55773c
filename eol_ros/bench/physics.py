# SPDX-License-Identifier: Apache-2.0
"""`eol bench physics`: error against run time of solvers and peers, extremes, cost by size."""

import argparse
import functools
import importlib.util
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from eol_ros.bench import physics_peers as peers
from eol_ros.core.physics import builders, event2d, exact1d, named, plan
from eol_ros.core.physics.hands import Rim, Visitors
from eol_ros.core.physics.live import LiveTable
from eol_ros.core.physics.model import Model
from eol_ros.core.physics.run import Limits, sample_times
from eol_ros.core.physics.scene import Scene, from_mapping
from eol_ros.verbs.progress import track

HELP = 'error against run time of the spring-block solvers and their peers'
EXAMPLES = [
    'eol bench physics --json > physics.json',
    'eol bench physics --quick',
    'eol bench physics --plots docs/img',
]
PEER_S = 2.5  # slow peers run this far; we are timed on the same stretch beside them
SIZES = (1, 4, 25, 100, 400, 2500, 10_000)
LIMITS = Limits(events=200_000, steps=2_000_000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--json', action='store_true', help='everything as JSON')
    parser.add_argument('--quick', action='store_true', help='no peers, smaller sizes')
    parser.add_argument('--plots', metavar='DIR', help='draw the results there')


def cpu_s(work: Callable, repeat: int) -> tuple[object, float]:
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


def reference_of(scene: Scene, model: Model, times: np.ndarray) -> np.ndarray:
    """Return displacements to compare with: another order, or a much tighter tolerance."""
    if plan.along_x(scene):
        return exact1d.solve(scene, model, times, LIMITS, False, order=20).u
    return event2d.solve(scene, model, times, LIMITS, False, 1e-14, 22).u


def own_rows(name: str, quick: bool) -> list[dict]:
    """Return the rows of one named scene on every path of ours."""
    scene = from_mapping(named.scene(name))
    model, times = Model.of(scene), sample_times(scene.duration_s, 0.1)
    truth = reference_of(scene, model, times)
    rows = []

    def add(method: str, solve: Callable, repeat: int) -> None:
        solve()
        run, seconds = cpu_s(solve, repeat)
        rows.append({
            'scene': name, 'method': method, 'ms': seconds * 1e3, 'error_m': error_of(run.u, truth),
            'events': len(run.event_t), 'steps': run.steps, 'status': run.status,
        })

    if plan.along_x(scene):
        add('exact', lambda: exact1d.solve(scene, model, times, LIMITS, False), 20)
    for tolerance in (1e-6, 1e-8, 1e-10, 1e-12):
        if name == 'S6a':
            break  # the event path resolves the stiff mode: minutes, where the exact path has modes
        add(
            f'event {tolerance:g}',
            lambda tol=tolerance: event2d.solve(scene, model, times, LIMITS, False, tol), 5,
        )
    for step_s in (1e-3, 1e-4) if quick else (1e-3, 1e-4, 1e-5):
        if np.sqrt(8 * model.k.max() / model.mass.min()) * step_s < 1.8:
            from eol_ros.core.physics import stepping_run

            add(
                f'stepping {step_s:g}',
                lambda h=step_s: stepping_run.solve(scene, model, times, LIMITS, h), 1,
            )
    return rows


def peer_rows() -> list[dict]:
    """Return the rows of the peers, each with our time on the same stretch at its error or less."""
    rows = []

    def add(name: str, method: str, module: str, solve: Callable, seconds: float) -> None:
        if importlib.util.find_spec(module) is None:
            rows.append({'scene': name, 'method': method, 'status': f'{module} is not installed'})
            return
        scene = from_mapping(named.scene(name) | {'T': seconds})
        model, times = Model.of(scene), sample_times(seconds, 0.1)
        truth = reference_of(scene, model, times)
        u, took = cpu_s(lambda: solve(scene, times), 1)
        if plan.along_x(scene):
            ours, own = cpu_s(lambda: exact1d.solve(scene, model, times, LIMITS, False), 10)
        else:
            ours, own = cpu_s(lambda: event2d.solve(scene, model, times, LIMITS, False, 1e-11), 5)
        rows.append({
            'scene': name, 'method': method, 'seconds': seconds, 'ms': took * 1e3,
            'error_m': error_of(u, truth), 'own_ms': own * 1e3,
            'own_error_m': error_of(ours.u, truth), 'ratio': took / own, 'status': 'ok',
        })

    for name, seconds in (('S3G', PEER_S), ('S4L', 1.0)):
        for rtol in (1e-7, 1e-10):
            add(name, f'scipy DOP853 events {rtol:g}', 'scipy',
                lambda s, t, r=rtol: peers.scipy_events(s, t, r), seconds)
    for method in ('LSODA', 'Radau'):
        add('S1', f'scipy {method} smooth', 'scipy',
            lambda s, t, m=method: peers.scipy_smooth(s, t, m), 3.5)
    for step_s, stiff in ((1e-3, False), (1e-3, True), (1e-4, True)):
        add('S3E', f'mujoco {step_s:g}{" stiff" if stiff else ""}', 'mujoco',
            lambda s, t, h=step_s, f=stiff: peers.mujoco(s, t, h, f), 10.0)
    add('S3E', 'pymunk 0.001', 'pymunk', lambda s, t: peers.pymunk(s, t, 1e-3), 5.0)
    return rows


def extreme_scenes() -> dict[str, dict]:
    """Return scenes at the edge of what the model allows."""
    still = {'kind': 'none'}
    offsets = builders.offsets(25, 0.01, 1)
    step = [[1.0 if i == 12 else 0.0, 0.0] for i in range(25)]
    return {
        'K_C / K_L = 1e6': named.scene('S6a'),
        'mass x 1e-4': named.scene('S6b'),
        'mu = 0 over 1e8 s': builders.table(still, 1e8, mu_s=0.0, mu_k=0.0, u0=offsets),
        'mu = 1e9': builders.table(named.PULL, 1e5, mu_s=1e9, mu_k=1e9),
        'no drive, 1e5 s': builders.table(still, 1e5, u0=builders.offsets(25, 1e-3, 1)),
        'one-metre step of a block': builders.table(still, 2.0, geometric=True, u0=step),
        'one-metre step of the rim': builders.table(
            {'kind': 'poses', 'par': [[0, 1, 0, 0], [1, 1, 0, 0]]}, 3.0, geometric=True),
        'one block, 1e5 s': builders.single(named.PULL, 1e5),
        'simultaneous breaks': builders.plate(named.PULL, 10.0),
        'mu_s = mu_k, 1-D': named.scene('S3E'),
        'mu_s = mu_k, 2-D': builders.table(
            named.PULL, 10.0, geometric=True, mu_s=0.65, mu_k=0.65, u0=offsets),
    }


def extreme_rows() -> list[dict]:
    """Return how each extreme ends."""
    rows = []
    for name, given in track(extreme_scenes().items(), 'extremes', total=11):
        scene = from_mapping(given)
        sample_s = max(0.1, scene.duration_s / 100)
        limits = Limits(events=200_000, steps=200_000)
        if name == 'one block, 1e5 s':
            limits = LIMITS
        run, seconds = cpu_s(lambda s=scene, d=sample_s, m=limits: plan.simulate(s, d, limits=m), 1)
        rows.append({
            'case': name, 'path': run.path, 'status': run.status, 'events': len(run.event_t),
            'steps': run.steps, 'ms': seconds * 1e3, 't_reached': run.t_reached,
            'residual_J': run.energy.residual_J, 'work_J': run.energy.work_J,
        })
    return rows


def size_rows(sizes: tuple[int, ...]) -> list[dict]:
    """Return cost and memory of plates of n blocks, from their first breaks on."""
    rows = []
    for n in track(sizes, 'sizes'):
        side = int(round(n**0.5))
        given = builders.plate(named.PULL, 6.5, side, side, u0=builders.offsets(n, 0.005, 5, True))
        scene = from_mapping(given)
        model, times = Model.of(scene), np.array([0.0, 6.5])
        limits = Limits(events=1000, steps=100_000)
        _reset_peak()
        job = functools.partial(exact1d.solve, scene, model, times, limits, False)
        run, seconds = cpu_s(job, 2)
        rows.append({
            'n': n, 'ms': seconds * 1e3, 'events': len(run.event_t), 'steps': run.steps,
            'us_per_event': seconds * 1e6 / max(1, len(run.event_t)), 'peak_mb': _peak_mb(),
            't_reached': run.t_reached, 'status': run.status,
        })
    return rows


def live_row(seconds: int = 60, rate_hz: int = 60) -> dict:
    """Return what the twin's table costs under unattended hands: mean and busiest second."""
    table, visitors, rim = LiveTable(1), Visitors(1), Rim()
    spent = np.zeros(seconds)
    for image in range(seconds * rate_hz):
        now = (image + 1) / rate_hz
        rim.advance(1 / rate_hz, visitors.velocity(now, rim.pose), np.zeros(3))
        begin = time.process_time()
        table.advance(image / rate_hz, now, rim.pose, rim.velocity)
        spent[image // rate_hz] += time.process_time() - begin
    return {
        'simulated_s': seconds, 'mean_ms_per_s': spent.mean() * 1e3,
        'busiest_second_ms': spent.max() * 1e3, 'slips': table.slips,
        'residual_J': table.energy_residual, 'faults': table.faults,
    }


def _reset_peak() -> None:
    try:
        Path('/proc/self/clear_refs').write_text('5')
    except OSError:
        pass  # the peak is then the process's own so far


def _peak_mb() -> float:
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith('VmHWM'):
            return int(line.split()[1]) / 1024
    return float('nan')


def run(args: argparse.Namespace) -> int:
    result = {'own': [], 'peers': [], 'extremes': [], 'sizes': [], 'live': []}
    for name in track(list(named.NAMED), 'scenes'):
        result['own'] += own_rows(name, args.quick)
    if not args.quick:
        result['peers'] = peer_rows()
    result['extremes'] = extreme_rows()
    result['sizes'] = size_rows(SIZES[:5] if args.quick else SIZES)
    result['live'] = [live_row()]
    if args.plots:
        from eol_ros.bench import physics_plots

        physics_plots.draw(result, Path(args.plots))
    if args.json:
        print(json.dumps(result, indent=1))
        return 0
    for title, rows in result.items():
        if rows:
            print(f'\n{title}')
            for row in rows:
                print('  ' + '  '.join(f'{k} {_short(v)}' for k, v in row.items()))
    print('times are processor time, compilation left out', file=sys.stderr)
    return 0


def _short(value: object) -> str:
    return f'{value:.3g}' if isinstance(value, float) else str(value)
