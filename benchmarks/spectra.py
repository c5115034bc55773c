# SPDX-License-Identifier: Apache-2.0
"""`eol bench spectra`: how often is the verdict on 1/f right, against the length of the series?"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import held_out
from eol_ros.errors import UsageError

if TYPE_CHECKING:
    from eol_ros.lab.science.one_over_f import Answer

HELP = 'Count right, wrong and undecided 1/f verdicts on series of known spectrum, by length.'
EXAMPLES = [
    'eol bench spectra --plots docs/img',
    'eol bench spectra --seeds 20 --seeds-from-time',
    'eol bench spectra --seeds 200 --series "sum of three relaxations" --json',
]
LENGTHS_S = (160, 600, 3600, 14400)
LONGEST_S = {  # of series whose next length takes half a minute for each seed, or more
    'events of 1/f rate': 160,
    'triggers of the twin': 600,
    'sound of the twin': 600,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--seeds',
        type=int,
        default=100,
        metavar='N',
        help='realisations of each series (default 100)',
    )
    parser.add_argument('--first-seed', type=int, default=0, metavar='S', help='first of --seeds')
    held_out.add_argument(parser)
    parser.add_argument(
        '--series',
        metavar='NAME',
        action='append',
        help='only this series; may be repeated',
    )
    parser.add_argument('--plots', metavar='FOLDER', help='draw spectra.png there')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Ask, count, print."""
    from support.known_series import SERIES, ask

    from eol_ros.verbs.progress import track

    names = args.series or list(SERIES)
    for name in names:
        if name not in SERIES:
            raise UsageError(f'--series {name}: unknown; choose from {", ".join(SERIES)}')
    work = [
        (name, seconds)
        for name in names
        for seconds in LENGTHS_S
        if seconds <= LONGEST_S.get(name, seconds)
    ]
    measured: list[dict] = []

    def one(first: int) -> dict:
        asked = [(*row, first + k) for k in range(args.seeds) for row in work]
        found: dict[tuple[str, int], list[tuple[Any, float]]] = {row: [] for row in work}
        for name, seconds, seed in track(asked, 'realisations'):
            begin_s = time.process_time()
            answer = ask(name, seconds, seed)
            found[name, seconds].append((answer, time.process_time() - begin_s))
        rows = [_row(*row, *zip(*found[row], strict=True)) for row in work]
        measured.extend(rows)
        return {'realisations': args.seeds, 'rows': rows}

    held_out.measure(args.seeds_from_time, args.first_seed, one, args.json, _table)
    if args.plots:
        _draw(measured, args.seeds, Path(args.plots))
    return 0


def _row(name: str, seconds: int, found: Sequence['Answer'], took_s: Sequence[float]) -> dict:
    """Return the row of the verdicts on the realisations of one series of one length."""
    import numpy as np
    from support.known_series import SERIES

    slopes = [f.slope for f in found if f.slope is not None]
    betas = np.array([s.beta for s in slopes])
    row = {
        'series': name, 'right': SERIES[name][0], 'seconds': seconds,
        **{answer: sum(f.answer == answer for f in found) / len(found)
           for answer in ('yes', 'no', 'undecided')},
        'ms': 1e3 * float(np.mean(took_s)),
    }  # fmt: skip
    if slopes:  # none of a record that is too short for any verdict
        row |= {
            'beta': float(betas.mean()), 'beta_deviation': float(betas.std()),
            'half_width': float(np.mean([(s.high - s.low) / 2 for s in slopes])),
        }  # fmt: skip
    known = {'1/f': 1.0, 'f^-0.8': 0.8, 'f^-1.2': 1.2, 'white': 0.0, 'Brownian': 2.0}.get(name)
    if known is not None:
        row['covered'] = float(np.mean([s.low <= known <= s.high for s in slopes]))
    return row


def _draw(rows: list[dict], seeds: int, folder: Path) -> None:
    """Draw the share called 1/f of all seeds; bars: its deviation, given any share beforehand."""
    from benchmarks.plots import Curves, draw

    shares: dict[tuple[str, str, int], list[float]] = {}
    for r in rows:
        name = r['series'].replace(',', '')
        shares.setdefault((f'right: {r["right"]}', name, r['seconds']), []).append(r['yes'])
    panels: dict[str, Curves] = {}
    for (panel, name, seconds), each in shares.items():
        share, n = sum(each) / len(each), seeds * len(each)
        likely = (share * n + 1) / (n + 2)
        deviation = (likely * (1 - likely) / (n + 3)) ** 0.5
        point = seconds, share, deviation, ''
        panels.setdefault(panel, {}).setdefault(name, []).append(point)
    draw(folder / 'spectra.png', panels, 'length, s', 'share called 1/f', ('log', 'linear'))


def _table(result: dict) -> str:
    lines = [
        f'{result["realisations"]} realisations of each; slope +- standard deviation of one\n'
        f'{"series":29} {"s":>5}   {"yes":>5} {"no":>5} {"undecided":>9}   '
        f'{"slope":>13} {"interval":>9} {"covers":>7} {"ms":>6}'
    ]
    for r in result['rows']:
        covers = f'{r["covered"]:7.2f}' if 'covered' in r else ' ' * 7
        slope = ' ' * 23
        if 'beta' in r:
            slope = f'{r["beta"]:5.2f} +- {r["beta_deviation"]:4.2f} +- {r["half_width"]:5.2f}'
        lines.append(
            f'{r["series"]:29} {r["seconds"]:5d}   {r["yes"]:5.2f} {r["no"]:5.2f} '
            f'{r["undecided"]:9.2f}   {slope}  {covers} {r["ms"]:6.0f}'
        )
    return '\n'.join(lines)
