# SPDX-License-Identifier: Apache-2.0
"""eol bench taps: do blocks feel their slips? Missed against false per hour, by length of slip.

The twin under visitors; every accelerometer is sampled all the time, knocks of hands on the rim,
footsteps and the slips of other blocks included, and the firmware runs on the samples, once for
each threshold. Tables differ in how much friction falls when a block breaks loose: at the usual
0.25 slips are long, on worn grit they are short. A slip is found when its own block reports a knock
whose moment lies within 10 ms of its onset; every other report is false, and the block's own stops,
later parts of a slip, and whatever struck the platform are told apart.

`ideal` is the share missed by a detector that knows the slip's own shape and moment (a matched
filter in the sensor's noise alone) at 20 false reports an hour in all, from the whole slip and from
its first 12 ms: nothing can do better.

`told` is what motion makes of the reports at the firmware's threshold: which slips it tells at
their knocks, how many of these the images retract (and how many of those the twin let go within
10 ms of the knock), and how long before the START of the camera; `recall` and `precision` of the
camera's STARTs are those of `eol bench motion`.
"""

import argparse
import sys
from typing import Any

import numpy as np
from support.paper import N_BLOCKS
from support.true_slips import FPS, NEAR_S, Slip, Twin, compare

from benchmarks import held_out
from benchmarks.twin_slips import LEARN_S, NOISE_M, TAIL_S, TrueSlip
from benchmarks.twin_slips import compare as compare_images
from eol_ros.core.motion.felt import CONFIRMED, PROVISIONAL, RETRACTED, FeltSlip, Knock
from eol_ros.core.motion.motion import Motion, NumberedSlip
from eol_ros.core.motion.slips import START
from eol_ros.core.physics.twin.accelerometer import Accelerometers
from eol_ros.devices.board.block import FELT, TOLD, Detector, defaults
from eol_ros.devices.board.felt import LEARNT, FeltBlocks
from eol_ros.devices.board.twin import SIGMA_S
from eol_ros.errors import UsageError
from eol_ros.settings import MotionSettings, TwinSettings

HELP = 'Measure missed and false taps per hour by threshold and length of slip.'
EXAMPLES = [
    'eol bench taps --minutes 10',
    'eol bench taps --parts told --minutes 10 --seed 11',
    'eol bench taps --minutes 10 --seeds-from-time',
    'eol bench taps --drops 0.25 --minutes 60 --json',
]
PARTS = 'curve', 'told', 'sleep'
CHUNK = 120  # images whose samples are given to the firmware at once
DROP = TwinSettings.mu_static - TwinSettings.mu_kinetic


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--parts', default=','.join(PARTS), help='parts, separated by commas')
    parser.add_argument('--minutes', type=float, default=10.0, help='twin time of each table')
    parser.add_argument('--thresholds', default='10,16,24,36', help='in mg, separated by commas')
    parser.add_argument(
        '--drops',
        default=f'{DROP:.2g},0.1,0.04',
        help='mu_s - mu_k, separated by commas',
    )
    parser.add_argument('--seed', type=int, default=3, help='random seed')
    held_out.add_argument(parser)
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    thresholds = [float(t) for t in args.thresholds.split(',')]
    parts = args.parts.split(',')
    for part in parts:
        if part not in PARTS:
            raise UsageError(f'--parts {part}: there are {", ".join(PARTS)}')
    seconds, drops = 60 * args.minutes, [float(drop) for drop in args.drops.split(',')]

    def one(seed: int) -> dict[str, Any]:
        settings = TwinSettings(seed=seed)
        result: dict[str, Any] = {
            'default_mg': defaults().threshold / 16, 'curve': [], 'told': [], 'sleep': {},
        }  # fmt: skip
        for drop in drops:
            print(f'drop {drop:g}, {args.minutes:g} minutes', file=sys.stderr, flush=True)
            if 'curve' in parts:
                result['curve'] += curve(drop, seconds, settings, thresholds)
            if 'told' in parts:
                result['told'].append(told(drop, seconds, settings))
        if 'sleep' in parts:
            result['sleep'] = sleeping(seconds, seed)
        return result

    held_out.measure(args.seeds_from_time, args.seed, one, args.json, _table)
    return 0


def curve(
    drop: float, seconds: float, settings: TwinSettings, thresholds: list[float]
) -> list[dict[str, Any]]:
    """Return a row of figures for each threshold, mg."""
    twin, sensors = Twin(settings.seed, drop), Accelerometers(settings, always=True)
    learnt = sensors.at_rest(LEARNT)
    detectors = []
    for mg in thresholds:
        config = defaults()
        config.threshold = round(16 * mg)
        detectors.append([Detector(config) for _ in range(N_BLOCKS)])
        for detector, samples in zip(detectors[-1], learnt, strict=True):
            detector.feed(samples)
    told: list[list[tuple[float, int, float]]] = [[] for _ in thresholds]
    held: list[list[Any]] = [[] for _ in range(N_BLOCKS)]
    images = round(seconds * FPS)
    keep = np.ones(N_BLOCKS, bool)
    for k, (begin_s, end_s) in enumerate(twin.images(images)):
        moves = bool(twin.rim.velocity.any())
        for part in sensors.advance(begin_s, end_s, twin.table.trace, moves, keep):
            held[part.block].append(part)
        if (k + 1) % CHUNK and k + 1 < images:
            continue
        for block, parts in enumerate(held):
            samples = np.concatenate([part.xy for part in parts])
            first_s, period_s = parts[0].first_s, parts[0].period_s
            for found, row in zip(told, detectors, strict=True):
                felt_s = 0.0
                for event in row[block].feed(samples):
                    ended_s = first_s + event.sample * period_s
                    if event.what == FELT:
                        felt_s = ended_s
                    elif event.what == TOLD:
                        age_s = event.age_samples / sensors.sensing.rate_hz
                        found.append((ended_s - age_s, block, felt_s or ended_s))
            parts.clear()
    slips = twin.all_slips()
    return [
        {'drop': drop, 'threshold_mg': mg} | compare(slips, found, seconds)
        for mg, found in zip(thresholds, told, strict=True)
    ]


def told(drop: float, seconds: float, settings: TwinSettings) -> dict[str, Any]:
    """Return figures of the slips that motion tells at their knocks."""
    twin, blocks = Twin(settings.seed, drop), FeltBlocks(settings)
    motion, alone = Motion(MotionSettings()), Motion(MotionSettings())
    random, seen = np.random.default_rng([settings.seed, 17]), np.ones(N_BLOCKS, bool)
    found: list[FeltSlip] = []
    starts: dict[int, float] = {}  # stamp by number of the slip
    begun: list[tuple[int, float, float]] = []  # block, onset, stamp of each START
    same = True
    for begin_s, end_s in twin.images(round(seconds * FPS)):
        for k in blocks.advance(begin_s, end_s, twin.table.trace, twin.rim.velocity):
            knock = Knock(round(k.time_s * 1e9), k.block, SIGMA_S, k.strength_mps2)
            found += motion.tap(knock)
        x, y = np.stack([twin.table.x, twin.table.y])
        x, y = x + random.normal(0, NOISE_M, N_BLOCKS), y + random.normal(0, NOISE_M, N_BLOCKS)
        with_knocks, _ = motion.update(end_s, x, y, seen)
        by_camera, _ = alone.update(end_s, x, y, seen)
        found += motion.felt_slips()
        starts |= {s.event.slip: end_s for s in with_knocks if s.event.kind == START}
        begun += [
            (s.event.block, s.event.onset_s, end_s) for s in by_camera if s.event.kind == START
        ]
        same &= [_seen(s) for s in with_knocks] == [_seen(s) for s in by_camera]
    first = [one for one in found if one.kind == PROVISIONAL]
    slips = twin.all_slips()
    row = compare(slips, [(f.knock.stamp_s, f.block, f.knock.stamp_s) for f in first], seconds)
    onsets = [np.array([s.onset_s for s in slips if s.block == b]) for b in range(N_BLOCKS)]
    lost = [one for one in found if one.kind == RETRACTED]
    real = sum(bool((abs(onsets[f.block] - f.knock.stamp_s) < NEAR_S).any()) for f in lost)
    retracted = len(lost)
    ahead = [1e3 * (starts[f.slip] - f.knock.stamp_s) for f in found if f.kind == CONFIRMED]
    p50, p99 = np.percentile(ahead or [np.nan], [50, 99]).tolist()
    return {
        'drop': drop, 'told': len(first), 'retracted': retracted,
        'retracted_slips': real, 'retracted_per_h': retracted / (seconds / 3600),
        'over_1mm': row['over_1mm'], 'over_2mm': row['over_2mm'],
        'onset_rms_ms': row['onset_rms_ms'],
        'start_after_p50_ms': p50, 'start_after_p99_ms': p99, 'camera_the_same': same,
        **_by_camera(begun, slips, seconds),
    }  # fmt: skip


def _by_camera(
    begun: list[tuple[int, float, float]], slips: list[Slip], seconds: float
) -> dict[str, float]:
    """Return recall, precision and error of STARTs (block, onset, stamp, s) without knocks."""
    truth = []
    for slip in sorted(slips, key=lambda s: s.onset_s):
        images = 10**6
        if np.isfinite(slip.rest_s):
            first = np.ceil((slip.onset_s - slip.rest_s) * FPS - 1e-9)
            images = int(np.floor(slip.onset_s * FPS + 1e-9) - first) + 1
        truth.append(TrueSlip(slip.onset_s, slip.end_s, slip.block, slip.rest_s, images))
    row = compare_images(begun, truth, FPS, (LEARN_S, seconds - TAIL_S))
    return {name: row[name] for name in ('recall', 'precision', 'start_rms_ms')}


def _seen(slip: NumberedSlip) -> tuple[float, ...]:
    """Return what of a START or STOP is the camera's alone."""
    e = slip.event
    return (e.kind, e.slip, e.block, e.x, e.y, e.speed_mps, e.distance_m) + (
        (e.onset_s, e.onset_sigma_s) if e.kind == START else ()
    )


def sleeping(seconds: float, seed: int) -> dict[str, Any]:
    """Return figures of blocks that sleep: visitors come for 15 s every 90 s."""
    twin, blocks = Twin(seed, DROP, pauses=True), FeltBlocks(TwinSettings(seed=seed))
    first, later = [], []
    lit: dict[str, list[tuple[int, float]]] = {'first': [], 'later': []}
    for begin_s, end_s in twin.images(round(seconds * FPS)):
        for knock in blocks.advance(begin_s, end_s, twin.table.trace, twin.rim.velocity):
            (first if knock.woke else later).append((knock.time_s, knock.block, knock.time_s))
            which = 'first' if knock.woke else 'later'
            lit[which].append((knock.block, knock.time_s + knock.lit_s))
    alone = {'reported': len(first), 'of_reports': len(first) + len(later)}
    both = compare(twin.all_slips(), first + later, seconds)
    onsets: dict[int, list[float]] = {b: [] for b in range(N_BLOCKS)}
    for slip in twin.all_slips():
        onsets[slip.block].append(slip.onset_s)
    errors = [min((t - on for on in onsets[b]), key=abs, default=np.inf) for t, b, _ in first]
    near = [e for e in errors if abs(e) < 0.03]
    light = {}
    for which, told in lit.items():
        late = [min((t - on for on in onsets[b] if on < t), default=np.inf) for b, t in told]
        p50, p99 = np.percentile([1e3 * s for s in late if s < 0.05] or [np.nan], [50, 99])
        light |= {f'{which}_light_p50_ms': float(p50), f'{which}_light_p99_ms': float(p99)}
    return alone | {
        'first_of_a_slip': len(near),
        'first_rms_ms': 1e3 * float(np.sqrt(np.mean(np.square(near or [np.nan])))),
        'over_2mm_found': both['over_2mm']['found'],
        'false_per_h': both['false_per_h'],
        'onset_rms_ms': both['onset_rms_ms'],
        **light,
    }


def _table(result: dict[str, Any]) -> str:
    lines = [
        f'threshold of the firmware: {result["default_mg"]:g} mg; found of slips by length (slips;'
        ' missed by the ideal detector from the whole slip, from its first 12 ms);',
        'false an hour: all = stops + sliding + struck; onset RMS, felt p50 / p99 after onset, ms',
    ]
    for row in result['curve']:
        parts = []
        for name in ('0-1mm', '1-2mm', '2-5mm', '>5mm', 'over_1mm', 'over_2mm'):
            one = row[name]
            if one['slips']:
                parts.append(
                    f'{name} {one["found"]:.4f} ({one["slips"]}; {one["ideal_missed"]:.0e},'
                    f' {one["ideal_missed_12ms"]:.0e})'
                )
        false = [row[f'false_{name}_per_h'] for name in ('stops', 'sliding', 'struck')]
        lines.append(
            f'drop {row["drop"]:g}, {row["threshold_mg"]:g} mg: {"  ".join(parts)} | '
            f'{row["false_per_h"]:.0f} = {" + ".join(f"{x:.0f}" for x in false)} | '
            f'{row["onset_rms_ms"]:.2f}, {row["felt_p50_ms"]:.1f} / {row["felt_p99_ms"]:.1f}'
        )
    for row in result['told']:
        lines.append(
            f'drop {row["drop"]:g}: {row["told"]} provisional slips, {row["retracted"]} '
            f'retracted, {row["retracted_slips"]} of them slips ({row["retracted_per_h"]:.0f} an '
            f'hour, {row["retracted"] / max(row["told"], 1):.2%}); of slips over 1 mm '
            f'{row["over_1mm"]["found"]:.4f}, over 2 mm {row["over_2mm"]["found"]:.4f}; onset RMS '
            f'{row["onset_rms_ms"]:.2f} ms; START {row["start_after_p50_ms"]:.1f} / '
            f'{row["start_after_p99_ms"]:.1f} ms after the knock, recall {row["recall"]:.4f}, '
            f'precision {row["precision"]:.4f}, {row["start_rms_ms"]:.2f} ms RMS; slips of the '
            'camera '
            + ('the same without knocks' if row['camera_the_same'] else 'DIFFER without knocks')
        )
    lines += [f'asleep: {key:18} {value:.4g}' for key, value in result['sleep'].items()]
    return '\n'.join(lines)
