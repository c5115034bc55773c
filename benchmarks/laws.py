# SPDX-License-Identifier: Apache-2.0
"""`eol bench laws`: how often is the test of a power law right, against the number of cascades?"""

import argparse
from collections.abc import Callable

HELP = 'Test catalogues of known law for a power law: rejected, bias and coverage, by their length.'
EXAMPLES = ['eol bench laws', 'eol bench laws --seeds 500 --json']
COUNTS = (200, 1000, 5000)
TAU, BLOCKS = 1.6, 25


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--seeds', type=int, default=100, metavar='N', help='catalogues of each (default 100)'
    )
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Draw, test, count, print."""
    from benchmarks.machine import tell
    from eol_ros.verbs.progress import track

    work = [(name, count) for name in _catalogues() for count in COUNTS]
    rows = [_row(name, count, args.seeds) for name, count in track(work, 'catalogues')]
    tell({'seeds': args.seeds, 'tau': TAU, 'rows': rows}, args.json, _table)
    return 0


def _catalogues() -> dict[str, Callable]:
    """Areas in order of time, of a count and a generator; the first two are true laws."""
    import numpy as np

    from eol_ros.core.science.powerlaw import sample

    def law(count, rng):
        return sample(TAU, 1, BLOCKS, count, rng)

    def whole_table(count, rng):
        areas = law(count, rng)
        areas[rng.random(count) < 0.05] = BLOCKS
        return areas

    def bent(count, rng):
        weight = np.arange(1.0, BLOCKS + 1) ** -TAU * np.exp(-0.1 * np.arange(BLOCKS))
        return rng.choice(BLOCKS, count, p=weight / weight.sum()) + 1

    return {
        'power law': law,
        'power law, in runs of four': lambda count, rng: np.repeat(
            law(count, rng), rng.geometric(0.25, count)
        )[:count],
        'cut off at 10 blocks': bent,
        'and 5 % of all 25 blocks': whole_table,
        'exponential, mean 5': lambda count, rng: np.minimum(rng.geometric(0.2, count), BLOCKS),
    }


def _row(name: str, count: int, seeds: int) -> dict:
    import numpy as np

    from eol_ros.core.science import alternatives, powerlaw

    laws, better = [], []
    for seed in range(seeds):
        areas = _catalogues()[name](count, np.random.default_rng([seed, count]))
        laws.append(powerlaw.cascade_law(areas))
        found = alternatives.compare(areas, laws[-1].fit, laws[-1].b_error)
        better.append([a.verdict == 'better' for a in found])
    taus = np.array([law.fit.tau for law in laws])
    errors = np.array([law.b_error for law in laws])
    return {
        'catalogue': name, 'cascades': count,
        'rejected': float(np.mean([law.rejected for law in laws])),
        'tau': float(taus.mean()), 'tau_deviation': float(taus.std()),
        'tau_error': float(errors.mean()),
        'covered': float(np.mean(np.abs(taus - TAU) < 1.96 * errors)),
        'better': dict(
            zip(alternatives.ALTERNATIVES, np.mean(better, axis=0).tolist(), strict=True)
        ),
    }  # fmt: skip


def _table(result: dict) -> str:
    lines = [
        f'{result["seeds"]} catalogues of each; tau of the chosen range, true {result["tau"]}\n'
        f'{"catalogue":28} {"n":>5} {"rejected":>9}   {"tau":>13} {"error":>6} {"covers":>7}   '
        'better'
    ]
    for r in result['rows']:
        better = ', '.join(f'{n} {share:.2f}' for n, share in r['better'].items() if share >= 0.005)
        lines.append(
            f'{r["catalogue"]:28} {r["cascades"]:5d} {r["rejected"]:9.2f}   '
            f'{r["tau"]:5.2f} +- {r["tau_deviation"]:4.2f} {r["tau_error"]:6.2f} '
            f'{r["covered"]:7.2f}   {better}'
        )
    return '\n'.join(lines)
