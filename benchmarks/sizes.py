# SPDX-License-Identifier: Apache-2.0
"""`eol bench sizes`: what becomes of the laws as table, plate and automaton grow.

The paper's rim and the plate of Brown, Scholz and Rundle (1991) on the same blocks, side by side:
how far their cascades differ, from 3x3 to 24x24. Finite-size scaling by moments (De Menech, Stella
and Tebaldi, Phys. Rev. E 58 (1998) R2677): where P(A) = A^-tau g(A / L^D), <A^q> ~ L^sigma(q) with
sigma(q) = D (q + 1 - tau) for q > tau - 1, a straight line in q; what is bent does not scale.
"""

import argparse

from eol_ros.errors import UsageError

HELP = (
    'Compare rim and plate, and the automaton, from small to large: scaling of cascades with size.'
)
EXAMPLES = ['eol bench sizes', 'eol bench sizes --speed 5e-4 --seeds 2 --json']
SIDES = (3, 5, 8, 12, 16, 24)
LATTICES = (8, 16, 32, 64, 128)
ALPHA = 0.2
MOMENTS = (1.0, 1.5, 2.0, 2.5, 3.0)
SPEED_MPS = 2e-5  # of the rim; at 0.5 mm/s cascades of a large table run into each other
# A rim reaches the middle of n blocks a side when the springs on the way are stretched one after
# the other: at most n^2 / 8 times the 55 mm that move one block. Half of the run is dropped.
TRAVEL_M = 0.04  # of the rim, times the square of the side
LEAST_M = 8.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--travel', type=float, default=TRAVEL_M, metavar='M',
        help='of the rim, times the square of the side (default 0.04; at least 8 m in all)',
    )  # fmt: skip
    parser.add_argument(
        '--seeds', type=int, default=3, metavar='N', help='starts of each (default 3)'
    )
    parser.add_argument('--events', type=int, default=400_000, help='of each automaton')
    parser.add_argument(
        '--speed', type=float, default=SPEED_MPS, metavar='M/S', help='of the rim (default 2e-5)'
    )
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, compare, print."""
    from benchmarks.machine import tell
    from eol_ros.verbs.progress import track

    if args.seeds < 2 or not args.speed > 0 or not args.travel > 0:
        raise UsageError('two seeds at least, and speed and travel above zero')
    seeds = range(11, 11 + args.seeds)
    work = [(kind, side, seed) for side in SIDES for kind in ('table', 'plate') for seed in seeds]
    areas = {w: _areas(*w, args.travel, args.speed) for w in track(work, 'tables')}
    lattices = {
        (side, seed): _toppled(side, seed, args.events)
        for side, seed in track([(n, s) for n in LATTICES for s in seeds], 'automata')
    }
    result = {
        'speed_mps': args.speed, 'travel_m': args.travel, 'seeds': args.seeds,
        'sides': [_side(side, seeds, areas) for side in SIDES],
        'scaling': [
            _scaling('table', SIDES, seeds, lambda n, s: areas['table', n, s]),
            _scaling('plate', SIDES, seeds, lambda n, s: areas['plate', n, s]),
            _scaling(f'automaton, alpha {ALPHA}', LATTICES, seeds, lambda n, s: lattices[n, s]),
        ],
    }  # fmt: skip
    tell(result, args.json, _table)
    return 0


def _areas(kind: str, side: int, seed: int, travel_m: float, speed_mps: float):
    """Areas of the cascades of a table or plate of side x side blocks, pulled along x."""
    from eol_ros.core.physics import builders, choose
    from eol_ros.core.physics.result import Limits
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.core.science.quiescent import cascades

    seconds = max(travel_m * side**2, LEAST_M) / speed_mps
    drive = {'kind': 'constant_velocity', 'par': [speed_mps, 0.0]}
    start = builders.offsets(side * side, 0.001, seed, along_x=True)
    scene = getattr(builders, kind)(drive, seconds, side, side, u0=start, dim1=True)
    made = choose.simulate(from_mapping(scene), sample_s=seconds, ledger=False, limits=Limits())
    if made.status != 'ok':
        raise UsageError(f'{kind} {side}x{side}: {made.status}; less --travel may do')
    found = cascades(made.event_block, made.event_start)[1]
    return found[len(found) // 2 :]


def _toppled(side: int, seed: int, events: int):
    """Areas of the automaton's events, once its start is forgotten."""
    from eol_ros.core.physics.automaton.ofc import Automaton

    lattice = Automaton.random(side, ALPHA, seed)
    lattice.run(max(10 * events * side // 128, 20_000))
    return lattice.run(events, full=True).area


def _side(side: int, seeds: range, areas: dict) -> dict:
    """Rim against plate on one size: KS distance of their areas, beside that of two starts."""
    import numpy as np

    from eol_ros.core.science import powerlaw

    def far(one, other) -> float:
        shares = [np.bincount(a, minlength=side * side + 1).cumsum() / len(a) for a in (one, other)]
        return float(np.abs(shares[0] - shares[1]).max())

    row: dict = {'side': side}
    for kind in ('table', 'plate'):
        own = [areas[kind, side, s] for s in seeds]
        tops = [np.mean(a >= side * side / 2) for a in own]
        taus = []
        for a in own:
            try:
                taus.append(powerlaw.fit(powerlaw.histogram(a), 1, side * side // 2).tau)
            except powerlaw.FitError:
                taus.append(np.nan)
        row[kind] = {
            'cascades': float(np.mean([len(a) for a in own])),
            'mean_area': float(np.mean([a.mean() for a in own])),
            'half_of_all': float(np.mean(tops)),
            'tau': float(np.mean(taus)), 'tau_deviation': float(np.std(taus, ddof=1)),
        }  # fmt: skip
    between = [far(areas['table', side, s], areas['plate', side, s]) for s in seeds]
    within = [
        far(areas[kind, side, s], areas[kind, side, t])
        for kind in ('table', 'plate')
        for s in seeds
        for t in seeds
        if s < t
    ]
    row['ks'] = float(np.mean(between))
    row['ks_deviation'] = float(np.std(between, ddof=1))
    row['ks_of_two_starts'] = float(np.mean(within))
    return row


def _scaling(model: str, sides: tuple, seeds: range, areas) -> dict:
    """sigma(q) by least squares over the sizes, D and tau from its line, and how straight it is."""
    import numpy as np

    logs = np.log(sides)
    moments = np.array([
        [[np.log(np.mean(areas(n, s).astype(float) ** q)) for n in sides] for q in MOMENTS]
        for s in seeds
    ])  # fmt: skip  # (seeds, moments, sizes)
    centred = logs - logs.mean()
    sigma = moments @ centred / (centred @ centred)
    local = np.diff(moments, axis=2) / np.diff(logs)  # between neighbouring sizes
    dimension, at_zero = np.polyfit(MOMENTS, sigma.T, 1)
    off = sigma.mean(axis=0) - np.polyval(np.polyfit(MOMENTS, sigma.mean(axis=0), 1), MOMENTS)
    taus = 1 - at_zero / dimension
    return {
        'model': model, 'sides': list(sides), 'q': list(MOMENTS),
        'sigma': sigma.mean(axis=0).tolist(),
        'sigma_local': local.mean(axis=0).tolist(),
        'D': float(dimension.mean()), 'D_deviation': float(dimension.std(ddof=1)),
        'tau': float(taus.mean()), 'tau_deviation': float(taus.std(ddof=1)),
        'bend': float(np.abs(off).max()),
    }  # fmt: skip


def _table(result: dict) -> str:
    lines = [
        f'{result["speed_mps"] * 1e3:g} mm/s, {result["seeds"]} starts; '
        'areas; tau on 1 to half of all',
        f'{"side":>4}  {"rim: n":>8} {"mean":>6} {">= half":>7} {"tau":>13}   '
        f'{"plate: n":>8} {"mean":>6} {">= half":>7} {"tau":>13}   {"KS of both":>13} '
        f'{"of two starts":>13}',
    ]
    for r in result['sides']:
        cells = [f'{r["side"]:4d} ']
        for kind in ('table', 'plate'):
            k = r[kind]
            cells.append(
                f'{k["cascades"]:8.0f} {k["mean_area"]:6.2f} {k["half_of_all"]:7.3f} '
                f'{k["tau"]:5.2f} +- {k["tau_deviation"]:4.2f}  '
            )
        cells.append(f'{r["ks"]:5.3f} +- {r["ks_deviation"]:5.3f} {r["ks_of_two_starts"]:13.3f}')
        lines.append(' '.join(cells))
    lines.append('scaling: <A^q> ~ L^sigma(q), D and tau from its line, bend: how far off the line')
    for r in result['scaling']:
        sigma = ', '.join(f'{q:g}: {s:.2f}' for q, s in zip(r['q'], r['sigma'], strict=True))
        last = ', '.join(f'{steps[-1]:.2f}' for steps in r['sigma_local'])
        lines.append(
            f'{r["model"]:22} L {r["sides"][0]}..{r["sides"][-1]}: D {r["D"]:.2f} +- '
            f'{r["D_deviation"]:.2f}, tau {r["tau"]:.2f} +- {r["tau_deviation"]:.2f}, bend '
            f'{r["bend"]:.2f}; sigma {sigma}; between the two largest {last}'
        )
    return '\n'.join(lines)
