# SPDX-License-Identifier: Apache-2.0
"""eol bench critical: which table would be critical? A map over springs, friction, size and drive.

Runs the sweeps of a folder (examples/sweeps/critical) as `eol sweep` does, adds to what has been
computed, and asks of each cell of the map: is b between 0.8 and 1.2 over more than a decade, with a
power law not ruled out in more than half of the starts? Are its slips, and the power of the sound
that they make (`core/science/sounding.py`), 1/f? The paper's table has a frame on the map.

A second folder (examples/sweeps/parts) holds tables that can be built of parts that can be bought:
of them N(>= A) with the band of 95 % over starts and over what is not known of the friction.
"""

import argparse
import contextlib
import hashlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import picture
from benchmarks.machine import tell
from eol_ros import parent_death
from eol_ros.core.science import powerlaw
from eol_ros.errors import EolError, UsageError

HELP = 'Where on the map of springs, friction, size and drive b is that of earthquakes'
EXAMPLES = [
    'eol bench critical --plot docs/img',
    'eol bench critical --sweeps my_sweeps --output my_tables --json',
]
SWEEPS = Path(__file__).parents[1] / 'examples/sweeps/critical'
PARTS = SWEEPS.with_name('parts')
SPENT = 'processor_s'  # beside the tables, which stay: what all runs took
SHOWN = (1, 2, 3, 5, 8, 12, 18, 25)
PAPER = {'stiffness_ratio': 1.0, 'friction_drop': 0.28}  # 5x5, all springs alike
B_RANGE = (0.8, 1.2)
DECADES = 1.0
MODELS = ('table', 'plate')
CELL = ('model', 'drive', 'rows', 'speed_mps', 'disorder', 'stiffness_ratio', 'friction_drop')
Row = dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--sweeps', default=str(SWEEPS), metavar='DIR', help='of *.yaml')
    parser.add_argument('--parts', default=str(PARTS), metavar='DIR', help='of tables to build')
    parser.add_argument(
        '-o', '--output', metavar='DIR',
        help='for the tables (build/critical/ and a digest of what computes them)',
    )  # fmt: skip
    parser.add_argument('--workers', type=int, default=2, metavar='N', help='processes (2)')
    parser.add_argument('--plot', metavar='DIR', help='draw critical.png and parts.png there')
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
        'slips_one_over_f': sum(s['slips_one_over_f'] == 'yes' for s in starts),
        'sound_one_over_f': sum(s['sound_one_over_f'] == 'yes' for s in starts),
        'slips_slope': _mean(starts, 'slips_slope'), 'sound_slope': _mean(starts, 'sound_slope'),
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


def _mean(starts: list[Row], name: str) -> float | None:
    known = [s[name] for s in starts if s[name] is not None]
    return float(np.mean(known)) if known else None


def predicted(rows: list[Row]) -> list[Row]:
    """Return N(>= A) / N of the tables to build: median and band of 95 % over their runs.

    A table is a stiffness ratio under a drive; runs are its starts and frictions.
    """
    found: dict[tuple, list[Row]] = {}
    for row in rows:
        if row['areas']:
            key = row['model'], row['drive'], row['speed_mps'], row['rows'], row['stiffness_ratio']
            found.setdefault(key, []).append(row)
    tables = []
    for (model, drive, speed, side, ratio), runs in sorted(found.items()):
        shares = np.array([_at_least(run['areas'], side * side) for run in runs])
        low, middle, high = np.percentile(shares, [2.5, 50, 97.5], axis=0)
        b = [run['b_value'] for run in runs if run['b_value'] is not None]
        p = [run['p_value'] for run in runs if run['p_value'] is not None]
        tables.append({
            'model': model, 'drive': drive, 'speed_mps': speed, 'rows': side,
            'stiffness_ratio': ratio, 'runs': len(runs),
            'drops': sorted({run['friction_drop'] for run in runs}),
            'share': middle.tolist(), 'low': low.tolist(), 'high': high.tolist(),
            'cascades_per_m': float(np.median([r['rate_hz'] / r['speed_mps'] for r in runs])),
            'b': float(np.mean(b)) if b else None,
            'b_low': float(min(b)) if b else None, 'b_high': float(max(b)) if b else None,
            'rejected': int(sum(one < powerlaw.REJECTED for one in p)), 'fitted': len(b),
        })  # fmt: skip
    return tables


def _at_least(areas: str, blocks: int) -> np.ndarray:
    """Return the share of cascades of 1 to `blocks` at least, of `areas` as a sweep writes them."""
    counts = np.zeros(blocks + 1)
    for pair in areas.split():
        area, count = pair.split(':')
        counts[int(area)] = int(count)
    return counts[::-1].cumsum()[::-1][1:] / counts.sum()


def run(args: argparse.Namespace) -> int:
    """Sweep, ask, print, draw."""
    if args.workers < 1:
        raise UsageError(f'--workers {args.workers}: 1 or more')
    out = Path(args.output) if args.output else _own_folder()
    with _counted(out):
        rows = _swept('--sweeps', args.sweeps, out, args.workers)
        parts = _swept('--parts', args.parts, out / 'parts', args.workers)
    map_ = cells(rows)
    result = {
        'tasks': len(rows), 'processor_s': spent_s(out), 'cells': map_,
        'in_range': sum(c['in_range'] for c in map_), 'critical': sum(c['critical'] for c in map_),
        'parts': predicted(parts),
    }  # fmt: skip
    (out / 'critical.json').write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
    if args.plot:
        draw(map_, Path(args.plot))
        draw_parts(result['parts'], Path(args.plot))
    tell(result, args.json, table_of)
    return 0


@contextlib.contextmanager
def _counted(out: Path) -> Iterator[None]:
    """Add the processor time of this run and its workers to that of the runs before."""
    before_s = spent_s(out) if any(out.rglob('*.csv*')) else 0.0
    begin_s = _processor_s()
    try:
        yield
    finally:
        if before_s is not None and out.is_dir():
            (out / SPENT).write_text(f'{before_s + _processor_s() - begin_s:.1f}\n')


def spent_s(out: Path | None = None) -> float | None:
    """Return the processor time of all runs that computed the tables in `out`, s.

    None where some of them were computed without counting.
    """
    try:
        return float(((out or _own_folder()) / SPENT).read_text())
    except FileNotFoundError:
        return None


def _processor_s() -> float:
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _own_folder() -> Path:
    """Return where tables are that these sources and versions have computed."""
    from eol_ros.analysis.sweeps import work

    made_by = json.dumps(work.version(), sort_keys=True).encode()
    return Path('build/critical', hashlib.blake2b(made_by, digest_size=6).hexdigest())


def _swept(option: str, folder: str, out: Path, workers: int) -> list[Row]:
    """Return the rows of all sweeps of a folder, of which only what is missing is computed."""
    from eol_ros.analysis.sweeps import spec as specs
    from eol_ros.analysis.sweeps.table import rows_of

    files = sorted(Path(folder).glob('*.yaml'))
    if not files:
        raise UsageError(f'{option} {folder}: no sweep files (*.yaml) there')
    given = {file: specs.load(file) for file in files}
    for file, one in given.items():
        if one.model not in MODELS:
            raise UsageError(f'{file}: model {one.model} has no place on the map: table and plate')
    rows: list[Row] = []
    for file, one in given.items():
        table = out / f'{file.stem}.csv'
        words = ['sweep', str(file), '--output', str(table), '--workers', str(workers)]
        command = [sys.executable, '-m', 'eol_ros', *words]
        done = subprocess.run(
            command, stdout=sys.stderr, check=False, preexec_fn=parent_death.following()
        )
        if done.returncode:
            raise EolError(f'{file}: the sweep ended early; the same command goes on with it')
        rows += [row | {'model': one.model} for row in rows_of(table)]
    return rows


def table_of(result: Row) -> str:
    """Return what docs/science.md shows: the cells with such a b, and what speaks against each."""
    low, high = B_RANGE
    slips, sound = (
        sum(c[f'{what}_one_over_f'] > 0 for c in result['cells']) for what in ('slips', 'sound')
    )
    took = 'processor time not known'
    if result['processor_s'] is not None:
        took = f'{result["processor_s"]:.0f} s of processor, all runs together'
    lines = [
        f'{len(result["cells"])} cells, {result["tasks"]} runs: b in {low} to {high} in '
        f'{result["in_range"]}, and a power law over more than a decade in {result["critical"]}; '
        f'slips 1/f in a start of {slips} cells, sound in one of {sound}; {took}',
        '| model, drive | blocks | mm/s | disorder | ratio | drop | b (band) | p | of half |'
        ' slope of slips, sound |',
        '| --- ' * 10 + '|',
    ]
    for c in result['cells']:
        if c['in_range'] or c['critical'] or c['drive'] == 'hands':
            b = f'{c["b"]:.2f} ({c["b_low"]:.2f} to {c["b_high"]:.2f})' if 'b' in c else 'no fit'
            p = f'{c["p"]:.2g}' if 'p' in c else ''
            slopes = ', '.join(
                'not asked' if c[f'{what}_slope'] is None else f'{c[f"{what}_slope"]:.2f}'
                for what in ('slips', 'sound')
            )
            lines.append(
                f'| {c["model"]}, {c["drive"]} | {c["rows"]}x{c["rows"]} '
                f'| {1e3 * c["speed_mps"]:g} '
                f'| {c["disorder"]:g} | {c["stiffness_ratio"]:g} | {c["friction_drop"]:g} | '
                f'{b} | {p} | {100 * c["system_wide"]:.1f} % | {slopes} |'
            )
    if result['parts']:
        heads = ' | '.join(f'>= {a}' for a in SHOWN)
        lines += [
            '', f'| table, drive | runs | cascades a metre | {heads} | b of runs | rejected |',
            '| --- ' * (len(SHOWN) + 5) + '|',
        ]  # fmt: skip
    for t in result['parts']:
        shares = ' | '.join(
            f'{100 * t["share"][a - 1]:.3g} ({100 * t["low"][a - 1]:.2g} to '
            f'{100 * t["high"][a - 1]:.2g})'
            for a in SHOWN
        )
        b = 'no fit' if t['b'] is None else f'{t["b"]:.2f} ({t["b_low"]:.2f} to {t["b_high"]:.2f})'
        lines.append(
            f'| ratio {t["stiffness_ratio"]:g}, {t["drive"]} {1e3 * t["speed_mps"]:g} mm/s | '
            f'{t["runs"]} | {t["cascades_per_m"]:.3g} | {shares} | {b} | '
            f'{t["rejected"]} of {t["fitted"]} |'
        )
    return '\n'.join(lines)


def draw(map_: list[Row], folder: Path) -> None:
    """Write critical.png: b by ratio and friction drop, a panel for each model, size and drive."""
    lines = list(dict.fromkeys((c['model'], c['rows']) for c in map_))
    each = {
        line: list(dict.fromkeys(
            (c['drive'], c['speed_mps'], c['disorder']) for c in map_
            if (c['model'], c['rows']) == line
        ))
        for line in lines
    }  # fmt: skip
    across = max(map(len, each.values()))
    figure, axes = picture.axes(len(lines), across, (2.6 * across, 2.3 * len(lines)))
    for row, (model, rows) in zip(axes, lines, strict=True):
        for axis in row[len(each[model, rows]) :]:
            axis.set_axis_off()
        for axis, (drive, speed, disorder) in zip(row, each[model, rows], strict=False):
            here = [
                c for c in map_
                if (c['model'], c['rows'], c['drive'], c['speed_mps'], c['disorder'])
                == (model, rows, drive, speed, disorder)
            ]  # fmt: skip
            _panel(axis, here)
            words = f'{model} {rows}x{rows}, {drive} {1e3 * speed:g} mm/s'
            axis.set_title(f'{words}\nfriction differs by {100 * disorder:g} %', fontsize=7)
    figure.supxlabel('friction drop', fontsize=9)
    figure.supylabel('stiffness between blocks over that to rim or plate', fontsize=9)
    said = (
        'eol bench critical: b (colour, number), whether a power law is not ruled out, slopes of '
        'slips and sound in time (!: 1/f); frame: the paper'
    )
    picture.save(figure, folder, 'critical', said, timed=False)


def _panel(axis: Any, here: list[Row]) -> None:
    """Draw the cells of one drive."""
    ratios = sorted({c['stiffness_ratio'] for c in here})
    drops = sorted({c['friction_drop'] for c in here})
    grid = np.full((len(ratios), len(drops)), np.nan)
    for c in here:
        at = drops.index(c['friction_drop']), ratios.index(c['stiffness_ratio'])
        grid[at[::-1]] = c.get('b', np.nan)
        words = 'no fit'
        if 'b' in c:
            law = 'law' if c['p'] >= powerlaw.REJECTED else 'no law'
            words = f'{c["b"]:.2f}\n{law}'
        slopes = []
        for what in ('slips', 'sound'):
            if (slope := c[f'{what}_slope']) is not None:
                slopes.append(f'{slope:.1f}' + '!' * bool(c[f'{what}_one_over_f']))
        if slopes:
            words += f'\n{", ".join(slopes)}'
        bold = 'bold' if c['in_range'] else 'normal'
        dark = 'b' in c and abs(c['b'] - 1) > 0.75
        axis.text(
            *at, words, ha='center', va='center', fontsize=6, fontweight=bold,
            color='white' if dark else 'black',
        )  # fmt: skip
        of_paper = all(c[name] == value for name, value in PAPER.items())
        if of_paper and c['model'] == 'table' and c['rows'] == 5:
            box = (at[0] - 0.48, at[1] - 0.48), 0.96, 0.96
            axis.add_patch(_rectangle(*box))
    axis.imshow(grid, origin='lower', cmap='PiYG', vmin=0, vmax=2, aspect='auto')
    axis.set_xticks(range(len(drops)), labels=[f'{d:g}' for d in drops], fontsize=7)
    axis.set_yticks(range(len(ratios)), labels=[f'{r:g}' for r in ratios], fontsize=7)


def _rectangle(corner: tuple[float, float], width: float, height: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle(corner, width, height, fill=False, linewidth=1.6, edgecolor='black')


def draw_parts(tables: list[Row], folder: Path) -> None:
    """Write parts.png: N(>= A) of the tables to build, with bands."""
    drives = list(dict.fromkeys((t['drive'], t['speed_mps']) for t in tables))
    ratios = sorted({t['stiffness_ratio'] for t in tables})
    figure, axes = picture.axes(1, len(drives), (3.7 * len(drives), 3.8), sharey=True)
    for axis, drive in zip(axes[0], drives, strict=True):
        for t in tables:
            if (t['drive'], t['speed_mps']) != drive:
                continue
            sizes = np.arange(1, len(t['share']) + 1)
            colour = f'C{ratios.index(t["stiffness_ratio"])}'
            words = f'ratio {t["stiffness_ratio"]:g}, {t["runs"]} runs'
            if t['b'] is not None:
                words += f': b {t["b_low"]:.2f} to {t["b_high"]:.2f}'
            some = np.array(t['share']) > 0
            axis.loglog(sizes[some], np.array(t['share'])[some], color=colour, label=words)
            low = np.maximum(t['low'], 1e-5)
            axis.fill_between(sizes, low, np.maximum(t['high'], 1e-5), color=colour, alpha=0.25)
        axis.loglog(sizes, 1.0 / sizes, ':', color='#777777', label='b = 1')
        axis.set(
            xlabel='area A (blocks)', title=f'{drive[0]}, {1e3 * drive[1]:g} mm/s', ylim=(1e-4, 1.3)
        )
        picture.areas(axis, int(sizes[-1]))
        axis.legend(fontsize=7, loc='lower left')
    axes[0, 0].set_ylabel('share of cascades of at least A')
    said = (
        'eol bench critical: median and 95 % of runs (starts 1 to 8, hands 1 to 4, and frictions)'
    )
    picture.save(figure, folder, 'parts', said, timed=False)
