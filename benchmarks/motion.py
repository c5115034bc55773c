# SPDX-License-Identifier: Apache-2.0
"""eol bench motion: onset error, latency, precision and recall of slips, and false alarms.

True slips come from a stick-slip table with its own integrator (support.stick_slip). A
detection is right when it names a slip that no other detection has named; a true slip counts as
found also when it was joined with one that ended less than the time of the stop test before. Slips
shorter than 20 sigma of the noise are not asked for. With `--minutes` or `--film-seconds` the
twin's slips are asked for instead, by a stricter definition (benchmarks.twin_slips).
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from support.paper import N_BLOCKS, rest_lattice

from benchmarks import held_out, plots
from eol_ros.settings import MotionSettings

HELP = 'Measure onset error, latency, recall and false alarms of slips at 60 and 120 images/s.'
EXAMPLES = [
    'eol bench motion --seconds 150 --json', 'eol bench motion --false-alarm-hours 10',
    'eol bench motion --minutes 10 --film-seconds 30 --false-alarm-hours 0',
]  # fmt: skip
PX_PER_M = 545.0
LEAST_SIGMAS = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=60.0, help='table time of each row')
    parser.add_argument('--seed', type=int, default=3, help='random seed')
    parser.add_argument('--fps', default='60,120', help='image rates, Hz, separated by commas')
    parser.add_argument(
        '--noise',
        default='0.002,0.007,0.035,0.1',
        help='position noise, px, separated by commas',
    )
    parser.add_argument(
        '--false-alarm-hours', type=float, default=0.5,
        help='simulated hours of rest, at 20 alarms an hour; 0 leaves it out',
    )  # fmt: skip
    parser.add_argument(
        '--minutes', type=float, default=0.0,
        help='minutes of the twin under visitors, in place of --seconds',
    )  # fmt: skip
    parser.add_argument(
        '--film-seconds',
        type=float,
        default=0.0,
        help='seconds of the twin rendered and tracked: visitors, and the rim led at 0.3 m/s',
    )
    held_out.add_argument(parser)
    parser.add_argument(
        '--plots', metavar='FOLDER', help='draw slips.png, figures by --noise, there'
    )
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    held_out.measure(
        args.seeds_from_time, args.seed, lambda seed: block(args, seed), args.json, _table
    )
    return 0


def block(args: argparse.Namespace, seed: int) -> dict[str, Any]:
    """Return the figures of one seed."""
    rates = [float(fps) for fps in args.fps.split(',')]
    rows: list[dict[str, Any]] = []
    if args.minutes or args.film_seconds:
        from benchmarks import twin_slips

        for fps in rates:
            if args.minutes:
                print(f'{fps:g} images/s, {args.minutes:g} minutes', file=sys.stderr, flush=True)
                rows += twin_slips.measure(fps, 60 * args.minutes, seed)
            for hands in ('visitors', 'sliding') if args.film_seconds else ():
                print(f'{fps:g} images/s, video, {hands}', file=sys.stderr, flush=True)
                rows += twin_slips.measure(fps, args.film_seconds, seed, hands, True)
    else:
        for fps in rates:
            for noise_px in map(float, args.noise.split(',')):
                print(f'{fps:g} images/s, {noise_px:g} px', file=sys.stderr, flush=True)
                rows.append(measure(fps, noise_px / PX_PER_M, args.seconds, seed))
        if args.plots and seed == args.seed:
            _draw(rows, Path(args.plots))
    result: dict[str, Any] = {'slips': rows}
    if args.false_alarm_hours:
        result['false_alarms'] = false_alarms(args.false_alarm_hours, 20.0, 60.0, seed)
    return result


def _draw(rows: list[dict[str, Any]], folder: Path) -> None:
    panels: dict[str, plots.Curves] = {}
    for row in rows:
        curves = panels.setdefault(f'{row["fps"]:g} images/s', {})
        for key, name in (('onset_rms', 'onset error RMS'), ('onset_median', 'onset error median'),
                          ('latency_p50', 'latency median')):  # fmt: skip
            curves.setdefault(name, []).append((row['noise_um'], row[key], 0.0, ''))
    plots.draw(folder / 'slips.png', panels, 'noise, µm', 'ms')


def _table(result: dict[str, Any]) -> str:
    lines = [' '.join(f'{key:>16}' for key in result['slips'][0])]
    lines += [
        ' '.join(f'{v:>16}' if isinstance(v, str) else f'{v:16.4g}' for v in row.values())
        for row in result['slips']
    ]
    lines += [f'{key:28} {value:.6g}' for key, value in result.get('false_alarms', {}).items()]
    return '\n'.join(lines)


@dataclasses.dataclass
class _Found:
    """One detected slip: START's stamp and onset, and what its STOP says."""

    block: int
    stamp_s: float
    first_s: float
    onset_s: float


def measure(fps: float, sigma_m: float, seconds: float, seed: int) -> dict[str, float]:
    """Return one row of figures; times in ms."""
    from support.stick_slip import Table

    from eol_ros.core.motion.motion import Motion
    from eol_ros.core.motion.slips import START

    table, random = Table(seed, fps, fine=True), np.random.default_rng([seed, 11])
    settings = MotionSettings()
    motion, seen = Motion(settings), np.ones(N_BLOCKS, bool)
    sigmas = np.full(N_BLOCKS, sigma_m)
    found: dict[int, _Found] = {}
    spent, cascades = [], 0
    for _ in range(round(seconds * fps)):
        moment = table.step()
        x, y = (moment.xy + random.normal(0, sigma_m, moment.xy.shape)).T
        begun = time.perf_counter()
        slips, closed = motion.update(moment.stamp_s, x, y, seen, sigmas)
        spent.append(time.perf_counter() - begun)
        cascades += len(closed)
        for slip in slips:
            event = slip.event
            if event.kind == START:
                found[event.slip] = _Found(event.block, event.stamp_s, event.onset_s, event.onset_s)
            else:
                found[event.slip].onset_s = event.onset_s
    still = [(table.onset[b], np.inf, int(b), 1.0) for b in np.flatnonzero(~table.stuck)]
    # Out of account: the first 2 s, in which the noise is learnt, and what is unfinished at the
    # end.
    span = (2.0, seconds - 1.5)
    first, last, latency, false, hit = _compare(found.values(), table.slips + still, span)
    asked = _asked(table.slips + still, settings.stop_s, LEAST_SIGMAS * sigma_m, span)
    recalled = sum(any((b, on) in hit for on in onsets) for b, onsets in asked)
    return {
        'fps': fps,
        'noise_um': 1e6 * sigma_m,
        'slips': len(asked),
        'recall': recalled / len(asked),
        'precision': len(first) / max(len(first) + false, 1),
        'latency_p50': float(np.median(latency)),
        'latency_p95': float(np.percentile(latency, 95)),
        'start_rms': float(np.sqrt(np.mean(np.square(first)))),
        'onset_rms': float(np.sqrt(np.mean(np.square(last)))),
        'onset_median': float(np.median(np.abs(last))),
        'cascades': cascades,
        'us_per_image': 1e6 * float(np.median(spent)),
    }


def _compare(found: Any, slips: list, span: tuple[float, float]) -> tuple:
    """Name a true slip for each detection: errors (ms) of START and STOP, latency, false, hits."""
    of_block: list[list[tuple[float, float]]] = [[] for _ in range(N_BLOCKS)]
    for on, end, block, _ in slips:
        of_block[block].append((on, end))
    first, last, latency, false = [], [], [], 0
    hit: set[tuple[int, float]] = set()
    for one in found:
        inside = span[0] < one.onset_s < span[1]
        fit = [
            on
            for on, end in of_block[one.block]
            if on - 0.05 <= one.onset_s <= end + 0.02 and (one.block, on) not in hit
        ]
        if not fit:
            false += inside
            continue
        on = min(fit, key=lambda t: abs(t - one.onset_s))
        hit.add((one.block, on))
        if not inside:
            continue
        first.append(1e3 * (one.first_s - on))
        last.append(1e3 * (one.onset_s - on))
        latency.append(1e3 * (one.stamp_s - on))
    return first, last, latency, false, hit


def _asked(slips: list, pause_s: float, least_m: float, span: tuple[float, float]) -> list:
    """Join slips that no detector with this stop test could part: (block, onsets) long enough."""
    joined: list[list] = []
    open_slip: dict[int, list] = {}
    for on, end, block, far in sorted(slips):
        last = open_slip.get(block)
        if last is not None and on - last[2] < pause_s:
            last[1].append(on)
            last[2] = end
            last[3] += far
        else:
            open_slip[block] = [block, [on], end, far]
            joined.append(open_slip[block])
    return [
        (block, onsets)
        for block, onsets, _, far in joined
        if far > least_m and span[0] < onsets[0] < span[1]
    ]


def false_alarms(hours: float, per_hour: float, fps: float, seed: int) -> dict[str, float]:
    """Return how many starts noise alone causes in `hours` of rest, against what was stated."""
    from eol_ros.core.motion.slips import START, SlipDetector

    settings = dataclasses.replace(MotionSettings(), false_alarms_per_hour=per_hour)
    detector = SlipDetector(settings)
    random = np.random.default_rng([seed, 13])
    rest, seen = rest_lattice(), np.ones(N_BLOCKS, bool)
    starts = 0
    images = round(hours * 3600 * fps)
    for k in range(images):
        x, y = (rest + random.normal(0, 13e-6, rest.shape)).T
        starts += sum(e.kind == START for e in detector.update(k / fps, x, y, seen))
    return {
        'hours': hours,
        'stated_per_hour': per_hour,
        'measured_per_hour': starts / hours,
        'ratio': starts / hours / per_hour,
    }
