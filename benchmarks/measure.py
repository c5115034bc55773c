# SPDX-License-Identifier: Apache-2.0
"""eol bench measure: does `eol measure` find what a table is like, and are its errors true?

Each twin has values that nobody tells (benchmarks/measure_twins.py), and is measured by what runs
in `eol measure` too. Of 100 the 68 % interval should hold the true value for 68, the 95 % one for
95.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from benchmarks.measure_twins import Hung
from eol_ros.core.measure import springs
from eol_ros.core.measure.estimate import Estimate
from eol_ros.errors import EolError, UsageError
from eol_ros.verbs.progress import track

HELP = 'Measure twins with unknown springs and friction: error, and how often intervals hold.'
EXAMPLES = ['eol bench measure', 'eol bench measure --parts springs --twins 20 --plot docs/img']


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--parts', default=','.join(PARTS), help='parted by commas (default: all)')
    parser.add_argument('--twins', type=int, default=100, metavar='N', help='of each (100)')
    parser.add_argument('--first', type=int, default=0, metavar='SEED', help='of the first (0)')
    parser.add_argument('--plot', type=Path, metavar='FOLDER', help='write measure_*.png there')
    parser.add_argument('--json', action='store_true')


def of_springs(seed: int) -> dict[str, tuple[float, Estimate]]:
    """Return the true stiffness of a twin, and the measured one."""
    twin = Hung(seed)
    return {'stiffness': (twin.stiffness, measured_springs(twin).stiffness)}


def measured_springs(twin: Hung) -> springs.Springs:
    """Return what weights on a twin say."""
    rests = springs.Rests(twin.block)
    for image in twin.images():
        rests.add(*image)
    return springs.fit(rests.found, twin.weights_kg, twin.block, twin.natural_m)


PARTS: dict[str, Callable[[int], dict[str, tuple[float, Estimate]]]] = {'springs': of_springs}


def run(args: argparse.Namespace) -> int:
    """Measure, count, print."""
    parts = args.parts.split(',')
    for part in parts:
        if part not in PARTS:
            raise UsageError(f'--parts {part}: there are {", ".join(PARTS)}')
    if args.twins < 2:
        raise UsageError(f'--twins {args.twins}: 2 or more')
    rows = []
    for part in parts:
        rows += study(part, range(args.first, args.first + args.twins))
    if args.plot:
        draw(args.plot, args.first, rows)
    tell({'twins': args.twins, 'rows': rows}, args.json, _table)
    return 0


def study(part: str, seeds: range) -> list[dict[str, Any]]:
    """Return a row for each value that `part` measures."""
    found: dict[str, list[tuple[float, Estimate]]] = {}
    refused, begun = [], time.perf_counter()
    for seed in track(seeds, part):
        try:
            for name, pair in PARTS[part](seed).items():
                found.setdefault(name, []).append(pair)
        except EolError as error:
            refused.append(str(error))
    spent_s = (time.perf_counter() - begun) / len(seeds)
    return [
        row(name, pairs) | {'refused': refused, 'seconds': spent_s} for name, pairs in found.items()
    ]


def row(name: str, pairs: list[tuple[float, Estimate]]) -> dict[str, Any]:
    """Return how far the measured are from the true, and how often their intervals hold them."""
    off = np.array([e.value / truth - 1 for truth, e in pairs])
    held = {
        level: sum(low <= truth <= high for truth, (low, high) in (
            (truth, e.interval(0.01 * level)) for truth, e in pairs
        ))
        for level in (68, 95)
    }  # fmt: skip
    return {
        'value': name, 'measured': len(pairs),
        'held_68': held[68], 'held_95': held[95],
        'rms': float(np.sqrt(np.mean(off**2))), 'bias': float(off.mean()),
        'worst': float(np.abs(off).max()),
        'sigma': float(np.median([e.sigma / truth for truth, e in pairs])),
        'each': [(truth, e.value, e.sigma, *e.interval(0.95)) for truth, e in pairs],
    }  # fmt: skip


def draw(folder: Path, seed: int, rows: list[dict[str, Any]]) -> None:
    """Write measure_springs.png, the fit of one twin, and measure_coverage.png, all intervals."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    from eol_ros.analysis import measured

    folder.mkdir(parents=True, exist_ok=True)
    if any(r['value'] == 'stiffness' for r in rows):
        measured.save(folder / 'measure_springs.png', measured_springs(Hung(seed)))
    figure, axes = plt.subplots(
        len(rows), 1, figsize=(9, 1.8 * len(rows) + 0.4), layout='constrained', squeeze=False
    )
    for axis, r in zip(axes[:, 0], rows, strict=True):
        truth, _, _, low, high = np.array(r['each']).T
        holds = (low <= truth) & (truth <= high)
        for which, colour in ((holds, 'C0'), (~holds, 'C3')):
            at = np.flatnonzero(which)
            span = [100 * (ends[which] / truth[which] - 1) for ends in (low, high)]
            axis.vlines(at, *span, color=colour)
        axis.axhline(0, color='0.5', linewidth=0.8)
        axis.set(ylabel=f'{r["value"]}\n95 %, off by %', xlim=(-1, len(truth)))
    axes[-1, 0].set_xlabel('twin')
    figure.savefig(folder / 'measure_coverage.png', dpi=110)
    plt.close(figure)


def _table(result: dict[str, Any]) -> str:
    lines = ['value          twins  in 68 %  in 95 %  rms off   bias  worst  median error  s each']
    for r in result['rows']:
        lines.append(
            f'{r["value"]:14} {r["measured"]:5}  {r["held_68"]:7}  {r["held_95"]:7}'
            f'  {100 * r["rms"]:5.2f} %  {100 * r["bias"]:+5.2f}  {100 * r["worst"]:5.2f}'
            f'  {100 * r["sigma"]:10.2f} %  {r["seconds"]:6.2f}'
        )
        lines += [f'  refused: {words}' for words in sorted(set(r['refused']))]
    return '\n'.join(lines)
