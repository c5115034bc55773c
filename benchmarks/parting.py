# SPDX-License-Identifier: Apache-2.0
"""eol bench parting: how long a motion can be foretold, and two methods agree event by event.

The largest distance between two runs whose starts differ by 1e-10 m grows as exp(t / T_L) where a
scene is chaotic; T_L is the Lyapunov time. Where blocks go along x the tangent of the exact solver
(`core/physics/exact/tangent.py`) says the same of infinitely small distances, and over the whole
run. SciPy's own event code is the other method for events.
"""

import argparse
import time
from typing import Any

import numpy as np

from benchmarks import physics_peers as peers
from benchmarks.machine import tell
from benchmarks.physics_oracles import ARM_S, CAPTURE_MPS
from eol_ros.core.physics import presets
from eol_ros.core.physics.choose import along_x, simulate
from eol_ros.core.physics.exact.tangent import tangent
from eol_ros.core.physics.result import Run, sample_times
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import UsageError
from eol_ros.verbs.progress import track

HELP = 'Lyapunov time of each named scene, and how many events SciPy gives in the same order'
EXAMPLES = ['eol bench parting', 'eol bench parting --scenes S3L,S5 --seconds 40 --no-scipy']
PUSH_M, FAR_M = 1e-10, 1e-6
LINEAR_M = (1e-9, 1e-4)  # distances between which growth is measured
SAMPLE_S = 0.05
TANGENT_DRIVES = ('none', 'constant_velocity')
LOG_MOST = 50.0  # far beyond the end of the growth, and no overflow
SCIPY_S = {'S1': 20.0, 'S2': 12.0, 'S6a': 6.2, 'S6b': 6.0, 'S4L': 4.0, 'S4G': 6.0}
OTHERS_S = 8.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--scenes', default=','.join(presets.NAMED), help='parted by commas')
    parser.add_argument('--seconds', type=float, default=30.0, help='simulated (30)')
    parser.add_argument('--starts', type=int, default=5, help='neighbours of each start (5)')
    parser.add_argument('--no-scipy', action='store_true', help='Lyapunov times only')
    parser.add_argument('--markdown', action='store_true', help='the table as docs/numerics has it')
    parser.add_argument('--json', action='store_true')


def growth(t: np.ndarray, distance: np.ndarray) -> float | None:
    """Return the time in which `distance` (k,) grows by e, s; None where it does not grow.

    By least squares from where it first exceeds the lower of LINEAR_M to where it exceeds the
    upper, or to the end.
    """
    low, high = LINEAR_M
    if not (distance > low).any():
        return None
    first = int(np.argmax(distance > low))
    last = int(np.argmax(distance > high)) if (distance > high).any() else len(t) - 1
    if distance[last] < 10 * low or last - first < 5:
        return None
    part = slice(first, last + 1)
    rate = np.polyfit(t[part], np.log(np.maximum(distance[part], 1e-16)), 1)[0]
    return float(1 / rate) if rate > 1 / (4 * t[-1]) else None


def same_events(run: Run, found: list[tuple[float, int, int]]) -> int:
    """Return how many events agree from the first on: which block, and whether it breaks."""
    ours = list(zip(run.event_block.tolist(), run.event_start.tolist(), strict=True))
    theirs = [(block, start) for _, block, start in found]
    differ = [k for k, (a, b) in enumerate(zip(ours, theirs, strict=False)) if a != b]
    return differ[0] if differ else min(len(ours), len(theirs))


def row(name: str, seconds: float, starts: int, with_scipy: bool) -> dict[str, Any]:
    """Return the Lyapunov time of a scene, and its agreement with SciPy."""
    given = presets.scene(name) | {'T': seconds}
    base = simulate(from_mapping(given), SAMPLE_S, ledger=False)
    rng = np.random.default_rng(9)
    times, parts, tangents, rates = [], [], [], []
    by_tangent = along_x(from_mapping(given)) and given['drive']['kind'] in TANGENT_DRIVES
    for _ in range(starts):
        push = rng.uniform(-PUSH_M, PUSH_M, (given['n'], 2))
        if given['dim1'] or not np.any(np.asarray(given['u0'])[:, 1]):
            push[:, 1] = 0.0  # it stays on its line
        near = given | {'u0': (np.asarray(given['u0']) + push).tolist()}
        run = simulate(from_mapping(near), SAMPLE_S, ledger=False)
        distance = np.abs(run.u - base.u).max(axis=(1, 2))
        times.append(growth(base.t, distance))
        if by_tangent:
            small = tangent(from_mapping(given), push[:, 0], 0 * push[:, 0])
            size_m = np.linalg.norm(push) * np.exp(np.minimum(small.log_du, LOG_MOST))
            tangents.append(growth(base.t, np.interp(base.t, small.t, size_m)))
            rates.append(small.exponent())
        far = distance > FAR_M
        parts.append(float(base.t[np.argmax(far)]) if far.any() else None)
    grown = [t for t in times if t is not None]
    parted = [t for t in parts if t is not None]
    found = {
        'scene': name,
        'seconds': seconds,
        'events': len(base.event_t),
        'lyapunov_s': float(np.median(grown)) if 2 * len(grown) > starts else None,
        'parted_s': float(np.median(parted)) if 2 * len(parted) > starts else None,
        'parted': len(parted),
        'starts': starts,
    }
    if by_tangent:
        both = [(a, b) for a, b in zip(times, tangents, strict=True) if a and b]
        rate, error = np.mean(rates, axis=0)
        found |= {
            'tangent_s': float(np.median([b for _, b in both])) if both else None,
            'tangent_off': max((abs(a / b - 1) for a, b in both), default=None),
            'exponent_hz': rate,
            'exponent_error_hz': error,
        }
    if with_scipy:
        stretch = SCIPY_S.get(name, OTHERS_S)
        scene = from_mapping(given | {'T': stretch})
        grid = sample_times(stretch, SAMPLE_S)
        begin = time.process_time()
        u, events = peers.scipy_run(scene, grid, 3e-13, CAPTURE_MPS, ARM_S)
        took = time.process_time() - begin
        run = simulate(scene, SAMPLE_S, ledger=False)
        same = same_events(run, events)
        late = [abs(run.event_t[k] - events[k][0]) for k in range(same)]
        found |= {
            'scipy_s': stretch,
            'own_events': len(run.event_t),
            'scipy_events': len(events),
            'same_events': same,
            'events_off_s': max(late, default=0.0),
            'error_m': float(np.abs(run.u - u).max()),
            'scipy_ms': took * 1e3,
        }
    return found


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    names = args.scenes.split(',')
    for name in names:
        if name not in presets.NAMED:
            raise UsageError(f'--scenes {name}: not one of {", ".join(presets.NAMED)}')
    rows = [
        row(name, args.seconds, args.starts, not args.no_scipy) for name in track(names, 'scenes')
    ]
    tell({'rows': rows}, args.json, markdown if args.markdown else table)
    return 0


def table(result: dict[str, Any]) -> str:
    """Return the rows for a terminal."""
    return '\n'.join('  '.join(f'{k} {_short(v)}' for k, v in r.items()) for r in result['rows'])


def markdown(result: dict[str, Any]) -> str:
    """Return the table of docs/numerics/physics.md."""
    lines = [
        '| scene | events in 30 s | Lyapunov time, s | by the tangent | exponent of all, 1/s |'
        ' 1e-10 m is 1e-6 m after, s | SciPy: first |'
        ' events alike | their times differ by, s | places differ by, m |',
        '| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |',
    ]
    for r in result['rows']:
        lyapunov = 'no growth' if r['lyapunov_s'] is None else f'{r["lyapunov_s"]:.2g}'
        parted = 'not in it' if r['parted_s'] is None else f'{r["parted_s"]:.3g}'
        scipy = '- | - | - | -'
        if 'scipy_s' in r:
            scipy = (
                f'{r["scipy_s"]:g} s | {r["same_events"]} of {r["own_events"]} |'
                f' {r["events_off_s"]:.0e} | {r["error_m"]:.0e}'
            )
        small = whole = '-'
        if 'exponent_hz' in r:
            small = 'no growth' if r['tangent_s'] is None else f'{r["tangent_s"]:.2g}'
            whole = f'{r["exponent_hz"]:.2f} +- {r["exponent_error_hz"]:.2f}'
        cells = (r['scene'], r['events'], lyapunov, small, whole, parted, scipy)
        lines.append(f'| {" | ".join(map(str, cells))} |')
    return '\n'.join(lines)


def _short(value: object) -> str:
    return f'{value:.3g}' if isinstance(value, float) else str(value)
