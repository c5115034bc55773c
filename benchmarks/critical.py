# SPDX-License-Identifier: Apache-2.0
"""eol bench critical: which table would be critical? A map over springs, friction, size and drive.

Runs the sweeps of a folder (examples/sweeps/critical) as `eol sweep` does, adds to what has been
computed, and asks of each cell of the map: is b between 0.8 and 1.2 over more than a decade, with a
power law not ruled out in more than half of the starts?
"""

import argparse
import contextlib
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import tell
from eol_ros.core.science import powerlaw
from eol_ros.errors import UsageError

HELP = 'Where on the map of springs, friction, size and drive b is that of earthquakes'
EXAMPLES = [
    'eol bench critical --plot docs/img',
    'eol bench critical --sweeps my_sweeps --out my_tables --json',
]
SWEEPS = Path(__file__).parents[1] / 'examples/sweeps/critical'
B_RANGE = (0.8, 1.2)
DECADES = 1.0
MODELS = ('table', 'plate')
CELL = ('model', 'drive', 'rows', 'speed_mps', 'disorder', 'stiffness_ratio', 'friction_drop')
Row = dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--sweeps', default=str(SWEEPS), metavar='DIR', help='of *.yaml')
    parser.add_argument('--out', default='build/critical', metavar='DIR', help='for the tables')
    parser.add_argument('--workers', type=int, default=2, metavar='N', help='processes (2)')
    parser.add_argument('--plot', metavar='DIR', help='draw critical.png there')
    parser.add_argument('--json', action='store_true')


def cells(rows: list[Row]) -> list[Row]:
    """Return the cells of the map: the starts of the same parameters as one.

    `b` is the mean of the starts; `b_low` and `b_high` are the least and the greatest b less and
    plus twice its error; `p` is the median.
    """
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in CELL), []).append(row)
    return [_cell(key, starts) for key, starts in sorted(found.items())]


def _cell(key: tuple, starts: list[Row]) -> Row:
    first = starts[0]
    blocks = first['rows'] * (first['columns'] or first['rows'])
    decades = math.log10((first['fit_to'] or max(blocks // 2, 2)) / first['fit_from'])
    fitted = [s for s in starts if s['b_value'] is not None and s['p_value'] is not None]
    there = sum(B_RANGE[0] <= s['b_value'] <= B_RANGE[1] for s in fitted)
    law = sum(
        s['p_value'] >= powerlaw.REJECTED and B_RANGE[0] <= s['b_value'] <= B_RANGE[1]
        for s in fitted
    )
    cell = dict(zip(CELL, key, strict=True)) | {
        'starts': len(starts), 'fitted': len(fitted), 'decades': decades,
        'cascades': int(sum(s['cascades'] or 0 for s in starts)),
        'system_wide': float(np.mean([s['system_wide'] or 0.0 for s in starts])),
        'in_range': 2 * there > len(starts),
        'critical': 2 * law > len(starts) and decades > DECADES,
    }  # fmt: skip
    if fitted:
        b, error = (np.array([s[name] for s in fitted]) for name in ('b_value', 'tau_error'))
        cell |= {
            'b': float(b.mean()), 'b_low': float((b - 2 * error).min()),
            'b_high': float((b + 2 * error).max()),
            'p': float(np.median([s['p_value'] for s in fitted])),
        }  # fmt: skip
    return cell


def run(args: argparse.Namespace) -> int:
    """Sweep, ask, print, draw."""
    from eol_ros import cli
    from eol_ros.analysis.sweeps import spec as specs
    from eol_ros.analysis.sweeps.table import rows_of

    files = sorted(Path(args.sweeps).glob('*.yaml'))
    if not files:
        raise UsageError(f'--sweeps {args.sweeps}: no sweep files (*.yaml) there')
    if args.workers < 1:
        raise UsageError(f'--workers {args.workers}: 1 or more')
    given = {file: specs.load(file) for file in files}
    for file, one in given.items():
        if one.model not in MODELS:
            raise UsageError(f'{file}: model {one.model} has no place on the map: table and plate')
    out = Path(args.out)
    rows: list[Row] = []
    begin_s = time.perf_counter()
    for file, one in given.items():
        table = out / f'{file.stem}.csv'
        words = ['sweep', str(file), '--out', str(table), '--workers', str(args.workers)]
        with contextlib.redirect_stdout(sys.stderr):
            status = cli.main(words)
        if status:
            return status
        rows += [row | {'model': one.model} for row in rows_of(table)]
    map_ = cells(rows)
    result = {
        'tasks': len(rows), 'seconds': time.perf_counter() - begin_s, 'cells': map_,
        'in_range': sum(c['in_range'] for c in map_), 'critical': sum(c['critical'] for c in map_),
    }  # fmt: skip
    (out / 'critical.json').write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
    if args.plot:
        draw(map_, Path(args.plot))
    tell(result, args.json, table_of)
    return 0


def table_of(result: Row) -> str:
    """Return what docs/science.md shows: the cells with such a b, and what speaks against each."""
    low, high = B_RANGE
    lines = [
        f'{len(result["cells"])} cells, {result["tasks"]} runs: b in {low} to {high} in '
        f'{result["in_range"]}, and a power law over more than a decade in {result["critical"]}',
        '| model, drive | blocks | mm/s | disorder | ratio | drop | b (band) | p | of half |',
        '| --- ' * 9 + '|',
    ]
    for c in result['cells']:
        if c['in_range'] or c['critical']:
            lines.append(
                f'| {c["model"]}, {c["drive"]} | {c["rows"]}x{c["rows"]} '
                f'| {1e3 * c["speed_mps"]:g} '
                f'| {c["disorder"]:g} | {c["stiffness_ratio"]:g} | {c["friction_drop"]:g} | '
                f'{c["b"]:.2f} ({c["b_low"]:.2f} to {c["b_high"]:.2f}) | {c["p"]:.2g} | '
                f'{100 * c["system_wide"]:.1f} % |'
            )
    return '\n'.join(lines)


def draw(map_: list[Row], folder: Path) -> None:
    """Write critical.png: b by ratio and friction drop, a panel for each model, size and drive."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    panels = list(dict.fromkeys((c['model'], c['rows'], c['drive']) for c in map_))
    speeds = {
        drive: list(dict.fromkeys((c['speed_mps'], c['disorder']) for c in map_
                                  if c['drive'] == drive))
        for drive in dict.fromkeys(c['drive'] for c in map_)
    }  # fmt: skip
    across = max(map(len, speeds.values()))
    figure, axes = plt.subplots(
        len(panels), across, figsize=(2.6 * across, 2.2 * len(panels)), squeeze=False,
        layout='constrained',
    )  # fmt: skip
    for line, (model, rows, drive) in zip(axes, panels, strict=True):
        for axis in line[len(speeds[drive]) :]:
            axis.set_axis_off()
        for axis, (speed, disorder) in zip(line, speeds[drive], strict=False):
            here = [
                c for c in map_
                if (c['model'], c['rows'], c['drive'], c['speed_mps'], c['disorder'])
                == (model, rows, drive, speed, disorder)
            ]  # fmt: skip
            ratios = sorted({c['stiffness_ratio'] for c in here})
            drops = sorted({c['friction_drop'] for c in here})
            grid = np.full((len(ratios), len(drops)), np.nan)
            for c in here:
                place = ratios.index(c['stiffness_ratio']), drops.index(c['friction_drop'])
                grid[place] = c.get('b', np.nan)
                words = f'{c["b"]:.2f}\n' if 'b' in c else 'no fit'
                if 'b' in c:
                    words += 'law' if c['p'] >= powerlaw.REJECTED else 'no law'
                axis.text(
                    *place[::-1], words, ha='center', va='center', fontsize=7,
                    fontweight='bold' if c['in_range'] else 'normal',
                )  # fmt: skip
            axis.imshow(grid, origin='lower', cmap='PiYG', vmin=0, vmax=2, aspect='auto')
            axis.set_xticks(range(len(drops)), labels=[f'{d:g}' for d in drops], fontsize=7)
            axis.set_yticks(range(len(ratios)), labels=[f'{r:g}' for r in ratios], fontsize=7)
            axis.set_title(
                f'{model} {rows}x{rows}, {drive} {1e3 * speed:g} mm/s, disorder {disorder:g}',
                fontsize=7,
            )
    figure.supxlabel('friction drop', fontsize=9)
    figure.supylabel('stiffness between blocks over that to rim or plate', fontsize=9)
    figure.savefig(folder / 'critical.png', dpi=100)
    plt.close(figure)
