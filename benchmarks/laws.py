# SPDX-License-Identifier: Apache-2.0
"""`eol bench laws`: how often is the test of a power law right, against the number of cascades?"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

HELP = 'Test catalogues of known law for a power law: rejected, coverage, drift, alternatives.'
EXAMPLES = ['eol bench laws --plots docs/img', 'eol bench laws --seeds 500 --json']
COUNTS = (200, 1000, 5000)
TAU, BLOCKS = 1.6, 25
SEARCHED = (600, 2400)  # cascades of a cell of the search for a critical table, at ratios 1 and 1/4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--seeds', type=int, default=200, metavar='N', help='catalogues of each (default 200)'
    )
    parser.add_argument('--plots', metavar='FOLDER', help='draw laws.png there')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Draw, test, count, print."""
    from benchmarks.machine import tell
    from eol_ros.verbs.progress import track

    work = [(name, count) for name in CATALOGUES for count in COUNTS]
    rows = [_row(name, count, args.seeds) for name, count in track(work, 'catalogues')]
    search = [_search(b, count, args.seeds) for count in SEARCHED for b in (0.8, 0.9, 1.0, 1.2)]
    result = {'seeds': args.seeds, 'tau': TAU, 'rows': rows, 'search': search}
    if args.plots:
        _draw(rows, args.seeds, Path(args.plots))
    tell(result, args.json, _table)
    return 0


def _draw(rows: list[dict], seeds: int, folder: Path) -> None:
    from benchmarks.plots import Curves, draw

    panels: dict[str, Curves] = {'a power law': {}, 'none': {}}
    for r in rows:
        if 'rejected' in r:
            share, name = r['rejected'], r['catalogue'].replace(',', '')
            deviation = (share * (1 - share) / (seeds * r['tested'])) ** 0.5
            law = name.startswith(('power', 'in runs'))
            panels['a power law' if law else 'none'].setdefault(name, []).append(
                (r['cascades'], share, deviation, '')
            )
    draw(folder / 'laws.png', panels, 'cascades', 'share rejected', ('log', 'linear'))


def _law(count: int, rng: np.random.Generator, tau: float = TAU) -> np.ndarray:
    from eol_ros.core.science.powerlaw import sample

    return sample(tau, 1, BLOCKS, count, rng)


def _runs(length: float, count: int, rng: np.random.Generator) -> np.ndarray:
    return np.repeat(_law(count, rng), rng.geometric(1 / length, count))[:count]


def _bent(count: int, rng: np.random.Generator) -> np.ndarray:
    weight = np.arange(1.0, BLOCKS + 1) ** -TAU * np.exp(-0.1 * np.arange(BLOCKS))
    return rng.choice(BLOCKS, count, p=weight / weight.sum()) + 1


def _whole_table(count: int, rng: np.random.Generator) -> np.ndarray:
    return np.where(rng.random(count) < 0.05, BLOCKS, _law(count, rng))


def _drifting(count: int, rng: np.random.Generator) -> np.ndarray:
    half = count // 2
    return np.concatenate([_law(half, rng, 1.4), _law(count - half, rng, 1.8)])


# Areas in order of time, of a count and a generator.
CATALOGUES: dict[str, Callable[[int, np.random.Generator], np.ndarray]] = {
    'power law': _law,
    'in runs of 4 on average': partial(_runs, 4),
    'in runs of 10': partial(_runs, 10),
    'in runs of 40': partial(_runs, 40),
    'tau 1.4, then 1.8': _drifting,
    'cut off at 10 blocks': _bent,
    'and 5 % of all 25 blocks': _whole_table,
    'exponential, mean 5': lambda n, rng: np.minimum(rng.geometric(0.2, n), BLOCKS),
}


def _row(name: str, count: int, seeds: int) -> dict:
    from eol_ros.core.science import powerlaw
    from eol_ros.lab.science import alternatives

    laws, better = [], []
    for seed in range(seeds):
        areas = CATALOGUES[name](count, np.random.default_rng([seed, count]))
        try:
            laws.append(powerlaw.cascade_law(areas))
        except powerlaw.FitError:
            continue  # too few independent ones
        found = alternatives.compare(areas, laws[-1].fit)
        better.append([a.verdict == 'better' for a in found])
    row = {'catalogue': name, 'cascades': count, 'tested': len(laws) / seeds}
    if not laws:
        return row
    taus = np.array([law.fit.tau for law in laws])
    tested = [law.tested for law in laws]
    return row | {
        'rejected': float(np.mean([law.rejected for law in laws])),
        'tau': float(taus.mean()), 'tau_deviation': float(taus.std()),
        'tau_error': float(np.mean([t.error for t in tested])),
        'covered': float(np.mean([t.low <= TAU <= t.high for t in tested])),
        'drifts': float(np.mean([t.drift_p < powerlaw.REJECTED for t in tested])),
        'better': dict(
            zip(alternatives.ALTERNATIVES, np.mean(better, axis=0).tolist(), strict=True)
        ),
    }  # fmt: skip


def _search(b: float, count: int, seeds: int) -> dict:
    """How often the search of `v0.2.0: eol bench critical` finds a cell that is critical.

    Two starts, areas 1 to 12: b of 0.8 to 1.2 and a law that is not ruled out in most of them.
    """
    from eol_ros.core.science import powerlaw

    found = 0
    for seed in range(seeds):
        bs, ps = [], []
        for start in range(2):
            rng = np.random.default_rng([seed, start, count])
            areas = powerlaw.sample(1 + b, 1, BLOCKS, count, rng)
            fit = powerlaw.fit(powerlaw.histogram(areas), 1, 12)
            bs.append(fit.b_value)
            ps.append(powerlaw.goodness(areas, [fit], rng, repeats=200).p_value)
        found += 0.8 <= np.mean(bs) <= 1.2 and np.median(ps) >= powerlaw.REJECTED
    return {'b': b, 'cascades': count, 'found': found / seeds}


def _table(result: dict) -> str:
    lines = [
        f'{result["seeds"]} catalogues of each; tau of the chosen range, true {result["tau"]}; +-: '
        'standard deviation of one',
        f'{"catalogue":25} {"n":>5} {"tested":>7} {"rejected":>9} {"tau":>13} {"error":>6} '
        f'{"covers":>7} {"drifts":>7}  better',
    ]
    for r in result['rows']:
        line = f'{r["catalogue"]:25} {r["cascades"]:5d} {r["tested"]:7.2f}'
        if 'tau' in r:
            better = ', '.join(f'{n} {share:.2f}' for n, share in r['better'].items())
            line += (
                f' {r["rejected"]:9.2f} {r["tau"]:5.2f} +- {r["tau_deviation"]:4.2f} '
                f'{r["tau_error"]:6.2f} {r["covered"]:7.2f} {r["drifts"]:7.2f}  {better}'
            )
        lines.append(line)
    lines.append('share of true laws that the search for a critical table finds:')
    lines += [f'b {r["b"]}, {r["cascades"]} cascades: {r["found"]:.2f}' for r in result['search']]
    return '\n'.join(lines)
