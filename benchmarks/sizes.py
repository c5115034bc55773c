# SPDX-License-Identifier: Apache-2.0
"""`eol bench sizes`: what becomes of the laws as table, plate and automaton grow.

The paper's rim and the plate of Brown, Scholz and Rundle (1991) on the same blocks, side by side:
how far their cascades differ, from 3x3 to 32x32. Finite-size scaling by moments (De Menech, Stella
and Tebaldi, Phys. Rev. E 58 (1998) R2677): where P(A) = A^-tau g(A / L^D), <A^q> ~ L^sigma(q) with
sigma(q) = D (q + 1 - tau) for q > tau - 1, a straight line in q; what is bent does not scale.
`--plot` draws N(>= A) as it is, and collapsed: N(>= A) A^(tau - 1) over A / L^D.
"""

import argparse
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import picture
from eol_ros.errors import UsageError

HELP = (
    'Compare rim and plate, and the automaton, from small to large: scaling of cascades with size.'
)
EXAMPLES = [
    'eol bench sizes --seeds 2 --travel 0.02 --plot docs/img',
    'eol bench sizes --speed 5e-4 --seeds 2 --json',
]
SIDES = (3, 5, 8, 12, 16, 24, 32)
LATTICES = (8, 16, 32, 64, 128, 256, 512)
ALPHA = 0.2
MOMENTS = (1.0, 1.5, 2.0, 2.5, 3.0)
SPEED_MPS = 2e-5  # of the rim; at 0.5 mm/s cascades of a large table run into each other
# A rim reaches the middle of n blocks a side when the springs on the way are stretched one after
# the other: at most n^2 / 8 times the 55 mm that move one block. Half of the run is dropped.
TRAVEL_M = 0.04  # of the rim, times the square of the side
LEAST_M = 8.0
MOST_EVENTS = 40_000_000
# Events until an automaton has forgotten its start go as L^2 for each rise of the drive, of which
# it needs as many as L^1.3 (Lise 2002).
FORGETS = 2_000_000 / 128**3.3
LEAST_EVENTS = 4_000_000  # that are left out, and that each half of what is recorded has
AT_ONCE = 1 << 16  # events of an automaton in memory
TAIL = 30  # cascades that a point of N(>= A) stands on, at least


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--travel', type=float, default=TRAVEL_M, metavar='M',
        help='of the rim, times the square of the side (default 0.04; at least 8 m in all)',
    )  # fmt: skip
    parser.add_argument(
        '--seeds', type=int, default=3, metavar='N', help='starts of each table (default 3)'
    )
    parser.add_argument(
        '--starts', type=int, default=8, metavar='N', help='of each automaton (default 8)'
    )
    parser.add_argument('--workers', type=int, default=2, metavar='N', help='processes (2)')
    parser.add_argument(
        '--speed', type=float, default=SPEED_MPS, metavar='M/S', help='of the rim (default 2e-5)'
    )
    parser.add_argument(
        '--side', type=int, default=SIDES[-1], metavar='N', help='the greatest table (default 32)'
    )
    parser.add_argument(
        '--lattice', type=int, default=LATTICES[-1], metavar='L', help='automaton (default 512)'
    )
    parser.add_argument('--plot', metavar='DIR', help='draw sizes.png and collapse.png there')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, compare, print."""
    from benchmarks.machine import tell

    if min(args.seeds, args.starts) < 2 or not args.speed > 0 or not args.travel > 0:
        raise UsageError('two seeds and starts at least, and speed and travel above zero')
    if args.workers < 1:
        raise UsageError(f'--workers {args.workers}: 1 or more')
    sides = tuple(n for n in SIDES if n <= args.side)
    lattice_sides = tuple(n for n in LATTICES if n <= args.lattice)
    if min(len(sides), len(lattice_sides)) < 3:
        raise UsageError('--side 8 and --lattice 32 at least: three sizes of each')
    seeds, starts = range(11, 11 + args.seeds), range(11, 11 + args.starts)
    tables = [
        (kind, side, seed, args.travel, args.speed)
        for side in sides for kind in ('table', 'plate') for seed in seeds
    ]  # fmt: skip
    found = _each(_areas, tables, args.workers, 'tables')
    counts = {job[:3]: one for job, one in found.items()}
    toppled = _each(
        _toppled, [(n, s) for n in lattice_sides for s in starts], args.workers, 'automata'
    )
    result = {
        'speed_mps': args.speed, 'travel_m': args.travel, 'seeds': args.seeds,
        'starts': args.starts,
        'sides': [_side(side, seeds, counts) for side in sides],
        'automata': [_forgotten(n, [toppled[n, s] for s in starts]) for n in lattice_sides],
        'scaling': [
            _scaling('table', sides, seeds, lambda n, s: counts['table', n, s]),
            _scaling('plate', sides, seeds, lambda n, s: counts['plate', n, s]),
            _scaling(
                f'automaton, alpha {ALPHA}', lattice_sides, starts, lambda n, s: sum(toppled[n, s])
            ),
        ],
    }  # fmt: skip
    if args.plot:
        draw(result, Path(args.plot))
    tell(result, args.json, _table)
    return 0


def _each(compute: Callable, jobs: list[tuple], workers: int, words: str) -> dict[tuple, Any]:
    """Return what `compute` makes of each job, in processes; the last and largest begin first."""
    from eol_ros.analysis.sweeps.crews import end_pool, new_pool
    from eol_ros.verbs.progress import track

    jobs = jobs[::-1]
    pool = new_pool(workers)
    try:
        made = pool.map(compute, *zip(*jobs, strict=True))
        return dict(zip(jobs, track(made, words, total=len(jobs)), strict=True))
    finally:
        end_pool(pool)


def _areas(kind: str, side: int, seed: int, travel_m: float, speed_mps: float):
    """How many cascades of each area a table or plate has, side x side blocks, pulled along x."""
    import numpy as np

    from eol_ros.core.physics import builders, choose
    from eol_ros.core.physics.result import Limits
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.core.science.quiescent import cascades

    seconds = max(travel_m * side**2, LEAST_M) / speed_mps
    drive = {'kind': 'constant_velocity', 'par': [speed_mps, 0.0]}
    start = builders.offsets(side * side, 0.001, seed, along_x=True)
    scene = getattr(builders, kind)(drive, seconds, side, side, u0=start, dim1=True)
    made = choose.simulate(
        from_mapping(scene),
        sample_s=seconds,
        ledger=False,
        limits=Limits(MOST_EVENTS, 10 * MOST_EVENTS),
    )
    if made.status != 'ok':
        raise UsageError(f'{kind} {side}x{side}: {made.status}; less --travel may do')
    found = cascades(made.event_block, made.event_start)[1]
    return np.bincount(found[len(found) // 2 :], minlength=side * side + 1)


def _toppled(side: int, seed: int) -> list:
    """How many events of each area an automaton has: two halves, after its start is forgotten."""
    import numpy as np

    from eol_ros.core.physics.automaton.ofc import Automaton

    lattice, half = Automaton.random(side, ALPHA, seed), _half(side)
    for begun in range(0, 2 * half, AT_ONCE):
        lattice.run(min(AT_ONCE, 2 * half - begun))
    counts = [np.zeros(side * side + 1, np.int64) for _ in range(2)]
    for one in counts:
        for begun in range(0, half, AT_ONCE):
            areas = lattice.run(min(AT_ONCE, half - begun), full=True).area
            one += np.bincount(areas, minlength=len(one))
    return counts


def _half(side: int) -> int:
    """Return the events in a half of what is recorded; twice as many before are left out."""
    return max(int(FORGETS * side**3.3 / 4), LEAST_EVENTS)


def _forgotten(side: int, each: list) -> dict:
    """Whether the start is forgotten: mean areas of both halves, and how they differ."""
    import numpy as np

    means = np.array([[_moment(counts, 1.0) for counts in two] for two in each])
    first, second = means.mean(axis=0)
    whole, rise = means.mean(axis=1), means[:, 1] - means[:, 0]
    return {
        'side': side, 'left_out': 2 * _half(side), 'recorded': 2 * _half(side),
        'mean_area': float(whole.mean()), 'mean_area_deviation': float(whole.std(ddof=1)),
        'mean_area_first': float(first), 'mean_area_second': float(second),
        'rise_error': float(rise.std(ddof=1) / np.sqrt(len(rise))),
    }  # fmt: skip


def _moment(counts, q: float) -> float:
    """<A^q> of how many there are of each area 0, 1, 2 ..."""
    import numpy as np

    return float(counts @ np.arange(len(counts), dtype=float) ** q / counts.sum())


def _side(side: int, seeds: range, counts: dict) -> dict:
    """Rim against plate on one size: KS distance of their areas, beside that of two starts."""
    import numpy as np

    from eol_ros.core.science import powerlaw

    def far(one, other) -> float:
        shares = [c.cumsum() / c.sum() for c in (one, other)]
        return float(np.abs(shares[0] - shares[1]).max())

    row: dict = {'side': side}
    for kind in ('table', 'plate'):
        own = [counts[kind, side, s] for s in seeds]
        tops = [c[-(-side * side // 2) :].sum() / c.sum() for c in own]
        means = [_moment(c, 1.0) for c in own]
        taus = []
        for c in own:
            try:
                taus.append(powerlaw.fit(c, 1, side * side // 2).tau)
            except powerlaw.FitError:
                taus.append(np.nan)
        row[kind] = {
            'cascades': float(np.mean([c.sum() for c in own])),
            'mean_area': float(np.mean(means)),
            'mean_area_deviation': float(np.std(means, ddof=1)),
            'half_of_all': float(np.mean(tops)),
            'tau': float(np.mean(taus)), 'tau_deviation': float(np.std(taus, ddof=1)),
        }  # fmt: skip
    between = [far(counts['table', side, s], counts['plate', side, s]) for s in seeds]
    within = [
        far(counts[kind, side, s], counts[kind, side, t])
        for kind in ('table', 'plate')
        for s in seeds
        for t in seeds
        if s < t
    ]
    row['ks'] = float(np.mean(between))
    row['ks_deviation'] = float(np.std(between, ddof=1))
    row['ks_of_two_starts'] = float(np.mean(within))
    return row


def _scaling(model: str, sides: tuple, seeds: range, counts: Callable) -> dict:
    """sigma(q) by least squares over the sizes, D and tau from its line, and how straight it is.

    `counts(side, seed)`: how many there are of each area 0, 1, 2 ...
    """
    import numpy as np

    logs = np.log(sides)
    moments = np.array([
        [[np.log(_moment(counts(n, s), q)) for n in sides] for q in MOMENTS] for s in seeds
    ])  # fmt: skip  # (seeds, moments, sizes)
    centred = logs - logs.mean()
    sigma = moments @ centred / (centred @ centred)
    local = np.diff(moments, axis=2) / np.diff(logs)  # between neighbouring sizes
    dimension, at_zero = np.polyfit(MOMENTS, sigma.T, 1)
    off = sigma.mean(axis=0) - np.polyval(np.polyfit(MOMENTS, sigma.mean(axis=0), 1), MOMENTS)
    taus = 1 - at_zero / dimension
    found = {
        'model': model, 'sides': list(sides), 'q': list(MOMENTS),
        'sigma': sigma.mean(axis=0).tolist(),
        'sigma_local': local.mean(axis=0).tolist(),
        'D': float(dimension.mean()), 'D_deviation': float(dimension.std(ddof=1)),
        'tau': float(taus.mean()), 'tau_deviation': float(taus.std(ddof=1)),
        'sigma_deviation': sigma.std(axis=0, ddof=1).tolist(),
        'sigma_local_deviation': local.std(axis=0, ddof=1).tolist(),
        'bend': float(np.abs(off).max()),
    }  # fmt: skip
    curves = [at_least(sum(counts(n, s) for s in seeds)) for n in sides]
    found['curves'] = [[a.tolist(), share.tolist()] for a, share in curves]
    return found | {'apart': apart(sides, curves, found['D'], found['tau'])}


def at_least(counts):
    """Return areas, some to a decade, and the share of cascades that have them at least."""
    import numpy as np

    there = counts[::-1].cumsum()[::-1]
    some = np.unique(np.geomspace(1, np.flatnonzero(counts)[-1], 60).round().astype(int))
    some = some[there[some] >= TAIL]
    return some, there[some] / counts.sum()


def collapsed(side, curve, dimension: float, tau: float):
    """Return log A / L^D and log N(>= A) A^(tau - 1) of the tail, beyond its first blocks."""
    import numpy as np

    a, share = (np.asarray(part, float) for part in curve)
    tail = a >= min(3, a[-1])
    a, share = a[tail], share[tail]
    return np.log(a) - dimension * np.log(side), np.log(share) + (tau - 1) * np.log(a)


def apart(sides: tuple, curves: list, dimension: float, tau: float) -> float:
    """Return how far collapsed curves of neighbouring sizes lie apart, RMS of the log, where both
    are.
    """
    import numpy as np

    off = []
    each = [collapsed(n, c, dimension, tau) for n, c in zip(sides, curves, strict=True)]
    for (x, y), (other_x, other_y) in itertools.pairwise(each):
        both = (x >= other_x[0]) & (x <= other_x[-1])
        off.append(y[both] - np.interp(x[both], other_x, other_y))
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def draw(result: dict, folder: Path) -> None:
    """Write sizes.png, rim against plate, and collapse.png, N(>= A) as it is and collapsed."""
    import numpy as np

    said = (
        f'eol bench sizes --seeds {result["seeds"]} (11 and on) --travel {result["travel_m"]:g} '
        f'--side {result["sides"][-1]["side"]} --lattice {result["scaling"][-1]["sides"][-1]}: '
        f'{1e3 * result["speed_mps"]:g} mm/s; {result["starts"]} starts of the automaton'
    )
    figure, axes = picture.axes(2, len(result['scaling']), (10.5, 6.4))
    for line, found in zip(axes.T, result['scaling'], strict=True):
        for k, (side, curve) in enumerate(zip(found['sides'], found['curves'], strict=True)):
            colour = f'C{k}'
            line[0].loglog(*curve, color=colour, label=str(side))
            x, y = collapsed(side, curve, found['D'], found['tau'])
            line[1].loglog(np.exp(x), np.exp(y), color=colour)
        line[0].set(title=found['model'], xlabel='area A')
        line[1].set(
            xlabel=f'A / L^{found["D"]:.2f}',
            title=f'tau {found["tau"]:.2f}; curves apart by {found["apart"]:.2f} (log)',
        )
        for axis in line:
            axis.xaxis.set_minor_formatter('')
            axis.yaxis.set_minor_formatter('')
        line[0].legend(title='L', fontsize=7, title_fontsize=7)
    axes[0, 0].set_ylabel('share of cascades of at least A')
    axes[1, 0].set_ylabel('the same times A^(tau - 1)')
    picture.save(figure, folder, 'collapse', f'{said}; starts together')
    figure, axes = picture.axes(1, 2, (8.5, 3.6))
    sides = [r['side'] for r in result['sides']]
    for kind, words in (('table', 'rim'), ('plate', 'plate')):
        means = [r[kind]['mean_area'] for r in result['sides']]
        spread = [r[kind]['mean_area_deviation'] for r in result['sides']]
        axes[0, 0].errorbar(sides, means, spread, marker='o', capsize=2, label=words)
    axes[0, 1].errorbar(
        sides, [r['ks'] for r in result['sides']], [r['ks_deviation'] for r in result['sides']],
        marker='o', capsize=2, label='rim and plate',
    )  # fmt: skip
    axes[0, 1].plot(
        sides, [r['ks_of_two_starts'] for r in result['sides']], ':', color='#777777',
        label='two starts of one',
    )  # fmt: skip
    for axis, words in zip(axes[0], ('mean area', 'KS distance of areas'), strict=True):
        axis.set(xscale='log', xlabel='blocks a side', ylabel=words, ylim=0)
        axis.set_xticks(sides, labels=[str(n) for n in sides])
        axis.minorticks_off()
        axis.legend()
    picture.save(figure, folder, 'sizes', f'{said}; bars: deviation of a start')


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
    lines.append(
        f'automata, {result["starts"]} starts: mean area, deviation of a start; of the first and '
        'the second half of the events, error of their difference'
    )
    for r in result['automata']:
        lines.append(
            f'{r["side"]:4d}  {r["recorded"]:10d} events after {r["left_out"]}: '
            f'{r["mean_area"]:6.3f} +- {r["mean_area_deviation"]:5.3f}  '
            f'{r["mean_area_first"]:6.3f} {r["mean_area_second"]:6.3f} +- {r["rise_error"]:5.3f}'
        )
    lines.append('scaling: <A^q> ~ L^sigma(q), D and tau from its line, bend: how far off the line')
    for r in result['scaling']:
        sigma = ', '.join(f'{q:g}: {s:.2f}' for q, s in zip(r['q'], r['sigma'], strict=True))
        last = ', '.join(
            f'{steps[-1]:.2f} +- {off[-1]:.2f}'
            for steps, off in zip(r['sigma_local'], r['sigma_local_deviation'], strict=True)
        )
        lines.append(
            f'{r["model"]:22} L {r["sides"][0]}..{r["sides"][-1]}: D {r["D"]:.2f} +- '
            f'{r["D_deviation"]:.2f}, tau {r["tau"]:.2f} +- {r["tau_deviation"]:.2f}, bend '
            f'{r["bend"]:.2f}, collapsed curves apart by {r["apart"]:.2f}; sigma {sigma}; '
            f'between the two largest {last}'
        )
    return '\n'.join(lines)
