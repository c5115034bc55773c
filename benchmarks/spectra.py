# SPDX-License-Identifier: Apache-2.0
"""`eol bench spectra`: how often is the verdict on 1/f right, against the length of the series?"""

import argparse
import time

HELP = 'Ask series of known spectrum whether they are 1/f: right, wrong and undecided, by length.'
EXAMPLES = ['eol bench spectra', 'eol bench spectra --seeds 200 --json']
LENGTHS_S = (160, 600, 3600)
SPEEDS_MPS = (0.001, 0.005, 0.02)  # of the rim of the simulated table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--seeds', type=int, default=100, metavar='N', help='realisations of each (default 100)'
    )
    parser.add_argument(
        '--table-seconds', type=float, default=3600.0, help='of the simulated table (default 3600)'
    )
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Ask, count, print."""
    from support.known_series import SERIES

    from benchmarks.machine import tell
    from eol_ros.verbs.progress import track

    work = [(name, seconds) for name in SERIES for seconds in LENGTHS_S]
    rows = [_row(name, seconds, args.seeds) for name, seconds in track(work, 'series')]
    tables = [_pulled(v, args.table_seconds) for v in track(SPEEDS_MPS, 'tables')]
    tell({'seeds': args.seeds, 'rows': rows, 'tables': tables}, args.json, _table)
    return 0


def _pulled(speed_mps: float, seconds: float) -> dict:
    """Ask the slips of the paper's table, pulled at a constant speed by the exact solver."""
    import numpy as np
    from support.known_series import HIGH_HZ, RATE_HZ

    from eol_ros.core.physics import builders, choose
    from eol_ros.core.physics.result import Limits
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.core.science import one_over_f, surrogates

    drive = {'kind': 'constant_velocity', 'par': [speed_mps, 0.0]}
    start = builders.offsets(25, 0.001, 11, along_x=True)
    scene = builders.table(drive, 1.0, u0=start, dim1=True) | {'T': seconds}
    made = choose.simulate(from_mapping(scene), sample_s=seconds, ledger=False, limits=Limits())
    times = np.sort(made.event_t[np.asarray(made.event_start, bool)])
    counts = surrogates.event_counts(times, seconds, RATE_HZ)
    name = f'slips at {1e3 * speed_mps:g} mm/s'
    found = one_over_f.ask(name, counts, RATE_HZ, HIGH_HZ, np.random.default_rng(1), times_s=times)
    return {
        'speed_mps': speed_mps, 'status': made.status, 'slips': len(times),
        'answer': found.answer, 'sentence': found.sentence,
    }  # fmt: skip


def _row(name: str, seconds: int, seeds: int) -> dict:
    import numpy as np
    from support.known_series import SERIES, ask

    begin = time.process_time()
    found = [ask(name, seconds, seed) for seed in range(seeds)]
    took = time.process_time() - begin
    slopes = [f.slope for f in found if f.slope is not None]
    betas = np.array([s.beta for s in slopes])
    row = {
        'series': name, 'right': SERIES[name][0], 'seconds': seconds,
        **{answer: sum(f.answer == answer for f in found) / seeds
           for answer in ('yes', 'no', 'undecided')},
        'beta': float(betas.mean()), 'beta_deviation': float(betas.std()),
        'half_width': float(np.mean([(s.high - s.low) / 2 for s in slopes])),
        'ms': 1e3 * took / seeds,
    }  # fmt: skip
    known = {'1/f': 1.0, 'f^-0.8': 0.8, 'f^-1.2': 1.2, 'white': 0.0, 'Brownian': 2.0}.get(name)
    if known is not None:
        row['covered'] = float(np.mean([s.low <= known <= s.high for s in slopes]))
    return row


def _table(result: dict) -> str:
    lines = [
        f'{result["seeds"]} realisations of each; slope +- standard deviation of one\n'
        f'{"series":29} {"s":>5}   {"yes":>5} {"no":>5} {"undecided":>9}   '
        f'{"slope":>13} {"interval":>9} {"covers":>7} {"ms":>6}'
    ]
    for r in result['rows']:
        covers = f'{r["covered"]:7.2f}' if 'covered' in r else ' ' * 7
        lines.append(
            f'{r["series"]:29} {r["seconds"]:5d}   {r["yes"]:5.2f} {r["no"]:5.2f} '
            f'{r["undecided"]:9.2f}   {r["beta"]:5.2f} +- {r["beta_deviation"]:4.2f} '
            f'+- {r["half_width"]:5.2f}  {covers} {r["ms"]:6.0f}'
        )
    lines += [f'{t["sentence"]} ({t["slips"]} slips)' for t in result['tables']]
    return '\n'.join(lines)
