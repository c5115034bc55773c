# SPDX-License-Identifier: Apache-2.0
"""`eol bench exponents`: which law do sizes follow, on the real table and on the automaton?

The blocks are chaotic: after some hundred cascades a last bit, of another processor's or BLAS's
sums, has changed their order. So a table is simulated from several starts, and its figures are
means with the standard deviation over these: what another machine finds lies within that. The
automaton and the rice pile count in integers; their events are the same on every machine.
"""

import argparse

from eol_ros.errors import UsageError

HELP = 'Fit the law of cascade sizes: the 5x5 table, the Brown plate, the automaton, the rice pile.'
EXAMPLES = ['eol bench exponents', 'eol bench exponents --seconds 2000 --events 100000 --json']
SPEED_MPS = 0.001  # of the rim: slow enough that cascades seldom run into each other
OFFSET_M = 0.001
BLOCKS = 25
SHOWN = (1, 2, 3, 5, 8, 12, 18, 25)
AUTOMATA = (  # size, alpha, events of warm-up for each recorded one, fit
    (5, 0.20, 1.0, (1, 12)),
    (5, 0.25, 1.0, (1, 12)),
    (35, 0.15, 2.0, (2, 200)),
    (35, 0.20, 2.0, (2, 200)),
    (64, 0.20, 5.0, (2, 200)),
    (128, 0.20, 8.0, (2, 200)),
    (35, 0.25, 0.02, (2, 200)),
    (64, 0.25, 0.02, (2, 200)),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=20_000.0, help='of the table, simulated')
    parser.add_argument(
        '--seeds',
        type=int,
        default=10,
        metavar='N',
        help='simulate each table from N starts (default 10)',
    )
    parser.add_argument(
        '--speed', type=float, default=SPEED_MPS, metavar='M/S', help='of the rim (default 0.001)'
    )
    parser.add_argument('--events', type=int, default=1_000_000, help='of each automaton')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, fit, print."""
    from benchmarks.machine import tell
    from eol_ros.verbs.progress import track

    if args.seeds < 1:
        raise UsageError(f'--seeds {args.seeds}: at least 1 start')
    if not args.speed > 0:
        raise UsageError(f'--speed {args.speed}: give one above zero')
    starts = range(11, 11 + args.seeds)
    names = [name for name, _ in _tables(starts[0], args.speed)]
    work = [(_blocks, row, args.seconds) for seed in starts for row in _tables(seed, args.speed)]
    work += [(_automaton, row, args.events) for row in AUTOMATA]
    work += [(_pile, 64, args.events)]
    made = [make(row, much) for make, row, much in track(work, 'models')]
    tables = len(names) * args.seeds
    rows = [_over_seeds(name, [r for r in made[:tables] if r['model'] == name]) for name in names]
    rows += made[tables:]
    tell({'rows': rows}, args.json, lambda result: _table(result['rows']))
    return 0


def _tables(seed: int, speed_mps: float) -> list[tuple[str, dict]]:
    from eol_ros.core.physics import builders

    drive = {'kind': 'constant_velocity', 'par': [speed_mps, 0.0]}
    more = {'u0': builders.offsets(BLOCKS, OFFSET_M, seed, along_x=True), 'dim1': True}
    return [
        ('table of the paper', builders.table(drive, 1.0, **more)),
        ('plate, K_L 20, K_C 40', builders.plate(drive, 1.0, **more)),
        ('plate, K_L 5, K_C 40', builders.plate(drive, 1.0, k_plate=5.0, **more)),
    ]


def _blocks(row: tuple[str, dict], seconds: float) -> dict:
    """Cascades between rest and rest, of a simulation along x."""
    from eol_ros.core.physics import choose
    from eol_ros.core.physics.result import Limits
    from eol_ros.core.physics.scene import from_mapping
    from eol_ros.core.science.quiescent import cascades

    name, mapping = row
    scene = from_mapping(mapping | {'T': seconds})
    found = choose.simulate(scene, sample_s=seconds, ledger=False, limits=Limits())
    sizes, areas = cascades(found.event_block, found.event_start)
    return {
        'model': name,
        'status': found.status,
        **_law(sizes, (1, 12)),
        'area': _law(areas, (1, 12)) | {'full_range': _law(areas, (1, BLOCKS))},
    }


def _over_seeds(model: str, runs: list[dict]) -> dict:
    """Return the figures of one model as means over its starts, each with its deviation.

    `tau_error` is the standard deviation over the starts, of one run and not of their mean; with a
    single start it is the block bootstrap's.
    """
    found = {'model': model, 'seeds': len(runs), 'status': sorted({r['status'] for r in runs})}
    return (
        found
        | _mean_law(runs)
        | {
            'area': _mean_law([r['area'] for r in runs])
            | {'full_range': _mean_law([r['area']['full_range'] for r in runs])}
        }
    )


def _mean_law(laws: list[dict]) -> dict:
    import numpy as np

    from eol_ros.core.science.alternatives import ALTERNATIVES

    def mean(name: str) -> float:
        return float(np.mean([law[name] for law in laws]))

    def deviation(name: str) -> float:
        return float(np.std([law[name] for law in laws], ddof=1)) if len(laws) > 1 else 0.0

    shown = [s for s in laws[0]['at_least'] if all(s in law['at_least'] for law in laws)]
    found = {
        'events': round(mean('events')), 'events_deviation': deviation('events'),
        'mean_size': mean('mean_size'), 'fit': laws[0]['fit'],
        'at_least': {s: round(float(np.mean([law['at_least'][s] for law in laws]))) for s in shown},
    }  # fmt: skip
    without = next((law['no_fit'] for law in laws if 'no_fit' in law), None)
    if without is not None:
        return found | {'no_fit': without}
    error = deviation('tau') if len(laws) > 1 else laws[0]['tau_error']
    return found | {
        'tau': mean('tau'),
        'tau_error': error,
        'tau_error_bootstrap': mean('tau_error'),
        'b_value': mean('b_value'),
        'ks': mean('ks'),
        'taus': [law['tau'] for law in laws],
        'rejected': float(np.mean([law['rejected'] for law in laws])),
        'better': {n: float(np.mean([law['better'][n] for law in laws])) for n in ALTERNATIVES},
    }


def _automaton(row: tuple, events: int) -> dict:
    from eol_ros.core.physics.automaton.ofc import Automaton

    side, alpha, warmup, fit_range = row
    lattice = Automaton.random(side, alpha, 1)
    count = events if alpha < 0.25 else max(events // 20, 1000)
    lattice.run(max(int(warmup * events), 1000))
    law = _law(lattice.run(count).size, fit_range)
    return {'model': f'automaton {side}x{side}, alpha {alpha:.2f}', **law}


def _pile(side: int, events: int) -> dict:
    from eol_ros.core.physics.automaton.oslo import OsloPile

    pile = OsloPile(side, 1)
    pile.run(5 * side * side)
    sizes = pile.run(max(events // 5, 1000)).size
    return {'model': f'rice pile of {side}', **_law(sizes[sizes > 0], (2, 200))}


def _law(sizes, fit_range: tuple[int, int]) -> dict:
    import numpy as np

    from eol_ros.core.science import alternatives, powerlaw

    counts = powerlaw.histogram(sizes)
    exceedance = powerlaw.exceedance(counts)
    row = {
        'events': len(sizes),
        'mean_size': float(sizes.mean()),
        'at_least': {
            str(s): round(float(exceedance[s]) * len(sizes)) for s in SHOWN if s < len(counts)
        },
        'fit': list(fit_range),
    }
    try:
        found = powerlaw.fit(counts, *fit_range)
    except powerlaw.FitError as reason:
        return row | {'no_fit': str(reason)}
    tested = powerlaw.goodness(sizes, [found], np.random.default_rng(0))
    others = alternatives.compare(sizes, found, tested.error)
    return row | {
        'tau': found.tau, 'tau_error': tested.error, 'b_value': found.b_value, 'ks': found.ks,
        'p_value': tested.p_value, 'rejected': float(tested.p_value < powerlaw.REJECTED),
        'better': {a.name: float(a.verdict == 'better') for a in others},
    }  # fmt: skip


def _table(rows: list[dict]) -> str:
    lines = [
        'model                          events   mean size   fitted     tau            b      KS'
        '   rejected   better'
    ]
    for r in rows:
        for name, law in ((r['model'], r), ('  its area', r.get('area'))):
            if law is None:
                continue
            fitted = f'{law["fit"][0]}..{law["fit"][1]}'
            said = law.get('no_fit') or (
                f'{law["tau"]:.3f} +- {law["tau_error"]:.3f}  '
                f'{law["b_value"]:6.3f}  {law["ks"]:.3f}  {law["rejected"]:8.0%}   '
                + ', '.join(f'{n} {share:.0%}' for n, share in law['better'].items() if share)
            )
            lines.append(
                f'{name:30} {law["events"]:8d}  {law["mean_size"]:8.2f}   {fitted:8}  {said}'
            )
        if 'area' in r:
            counts = ', '.join(f'{s}: {n}' for s, n in r['area']['at_least'].items())
            lines.append(f'  cascades of at least that area: {counts}')
            lines.append(
                f'  means of {r["seeds"]} starts; of one start: '
                f'{r["events"]} +- {r["events_deviation"]:.0f} cascades, tau +- as above '
                f'(by bootstrap {r.get("tau_error_bootstrap", float("nan")):.3f})'
            )
    return '\n'.join(lines)
