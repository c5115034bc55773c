# SPDX-License-Identifier: Apache-2.0
"""eol bench chaos: is the table at the edge of chaos? Lyapunov exponents against drive and springs.

By the tangent of the exact solver (`core/physics/exact/tangent.py`), over the second half of a
pull. Divided by the speed of the drive, it is how often a small change grows by e in a metre.
"""

import argparse
import itertools
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import picture
from benchmarks.machine import tell
from eol_ros.core.physics import builders
from eol_ros.core.physics.exact.tangent import tangent
from eol_ros.core.physics.scene import from_mapping
from eol_ros.errors import UsageError
from eol_ros.verbs.progress import track

HELP = 'Largest Lyapunov exponent of table and plate against drive speed and stiffness ratio'
EXAMPLES = ['eol bench chaos --seeds 2 --travel 0.6', 'eol bench chaos --plot docs/img --json']
MODELS = ('table', 'plate')
STIFFNESS = 40.0  # N/m between blocks
OFFSET_M = 0.005


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    for name, values, words in (
        ('speeds', '2e-4,1e-3,5e-3,0.02,0.1', 'of the drive, m/s'),
        ('ratios', '0.25,1,2,8', 'stiffness between blocks over that to the rim or plate'),
    ):
        parser.add_argument(f'--{name}', default=values, metavar='LIST', help=f'{words} ({values})')
    parser.add_argument('--travel', type=float, default=1.2, metavar='M', help='of the drive (1.2)')
    parser.add_argument('--seeds', type=int, default=3, metavar='N', help='starts of each (3)')
    parser.add_argument('--side', type=int, default=5, metavar='N', help='blocks (5)')
    parser.add_argument('--plot', metavar='DIR', help='draw lyapunov.png there')
    parser.add_argument('--json', action='store_true')


def exponent(
    model: str, speed_mps: float, ratio: float, seed: int, travel_m: float, side: int
) -> dict[str, Any]:
    """Return the exponent of one start, 1/m of the drive, and what happened meanwhile."""
    pull = {'kind': 'constant_velocity', 'par': [speed_mps, 0.0]}
    more: dict[str, Any] = {
        'u0': builders.offsets(side * side, OFFSET_M, seed, True), 'dim1': True,
    }  # fmt: skip
    seconds = travel_m / speed_mps
    if model == 'table':
        scene = builders.table(pull, seconds, side, side, k=STIFFNESS, **more)
        for spring in scene['springs_to_frame']:
            spring['k'] = STIFFNESS / ratio
    else:
        scene = builders.plate(pull, seconds, side, side, STIFFNESS / ratio, STIFFNESS, **more)
    rng = np.random.default_rng(seed)
    found = tangent(from_mapping(scene), rng.normal(size=side * side), np.zeros(side * side))
    rate_hz, error_hz = found.exponent()
    return {
        'model': model, 'speed_mps': speed_mps, 'ratio': ratio, 'seed': seed,
        'per_m': rate_hz / speed_mps, 'error_per_m': error_hz / speed_mps, 'per_s': rate_hz,
        'slips_per_m': found.events / 2 / travel_m, 'reversals': found.reversals,
    }  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, print, draw."""
    lists = {}
    for name in ('speeds', 'ratios'):
        try:
            lists[name] = [float(value) for value in getattr(args, name).split(',')]
        except ValueError:
            lists[name] = []
        if not lists[name] or not all(np.isfinite(v) and v > 0 for v in lists[name]):
            raise UsageError(f'--{name} {getattr(args, name)}: numbers above 0, parted by commas')
    if args.seeds < 1 or args.side < 1 or not args.travel > 0:
        raise UsageError('--seeds and --side: 1 or more; --travel: more than 0')
    cases = list(itertools.product(MODELS, lists['speeds'], lists['ratios']))
    rows = []
    for model, speed, ratio in track(cases, 'starts'):
        each = [
            exponent(model, speed, ratio, seed, args.travel, args.side)
            for seed in range(1, args.seeds + 1)
        ]
        rows.append(_mean(each))
    result = {'travel_m': args.travel, 'seeds': args.seeds, 'side': args.side, 'rows': rows}
    if args.plot:
        draw(result, Path(args.plot))
    tell(result, args.json, table)
    return 0


def _mean(each: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the mean of the starts; its error from their spread, or of one from its parts."""
    per_m = [one['per_m'] for one in each]
    spread = np.std(per_m, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.0
    parts = np.sqrt(np.mean([one['error_per_m'] ** 2 for one in each]) / len(each))
    means = {name: float(np.mean([one[name] for one in each]))
             for name in ('per_m', 'per_s', 'slips_per_m', 'reversals')}  # fmt: skip
    named = {name: each[0][name] for name in ('model', 'speed_mps', 'ratio')}
    return {**named, **means, 'error_per_m': float(max(spread, parts))}


def table(result: dict[str, Any]) -> str:
    """Return the table of docs/science.md: 1/m of the drive."""
    ratios = sorted({r['ratio'] for r in result['rows']})
    head = ' | '.join(f'ratio {ratio:g}' for ratio in ratios)
    lines = [f'| model, drive | {head} |', '| --- ' * (len(ratios) + 1) + '|']
    for model, speed in dict.fromkeys((r['model'], r['speed_mps']) for r in result['rows']):
        cells = [
            f'{r["per_m"]:.3g} +- {r["error_per_m"]:.2g}'
            for ratio in ratios
            for r in result['rows']
            if (r['model'], r['speed_mps'], r['ratio']) == (model, speed, ratio)
        ]
        lines.append(f'| {model}, {1e3 * speed:g} mm/s | {" | ".join(cells)} |')
    return '\n'.join(lines)


def draw(result: dict[str, Any], folder: Path) -> None:
    """Write lyapunov.png."""
    figure, grid = picture.axes(1, 2, (9, 3.8), sharey=True)
    axes = grid[0]
    for axis, model in zip(axes, MODELS, strict=True):
        rows = [r for r in result['rows'] if r['model'] == model]
        for ratio in sorted({r['ratio'] for r in rows}):
            here = sorted((r for r in rows if r['ratio'] == ratio), key=lambda r: r['speed_mps'])
            axis.errorbar(
                [1e3 * r['speed_mps'] for r in here], [r['per_m'] for r in here],
                [2 * r['error_per_m'] for r in here], marker='o', capsize=2, label=f'{ratio:g}',
            )  # fmt: skip
        axis.axhline(0, color='#777777', linewidth=0.8)
        axis.set(xscale='log', xlabel='drive (mm/s)', title=model)
    axes[0].set_ylabel('largest Lyapunov exponent (1/m of the drive)')
    axes[1].legend(title='stiffness ratio')
    said = (
        f'eol bench chaos --seeds {result["seeds"]} --travel {result["travel_m"]:g}: '
        'mean and twice its error'
    )
    picture.save(figure, folder, 'lyapunov', said)
