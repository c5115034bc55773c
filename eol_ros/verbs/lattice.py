# SPDX-License-Identifier: Apache-2.0
"""`eol lattice`: run the earthquake automaton; which law do the sizes of its events follow?"""

import argparse
import json
import re
import sys
import time

from eol_ros import folders
from eol_ros.cli import within
from eol_ros.errors import UsageError, writing

HELP = 'Run the earthquake automaton and fit the law of its sizes.'
EXAMPLES = [
    'eol lattice --size 64 --alpha 0.2 --events 200000 --warmup 1000000 --json',
    'eol lattice --size 12 --events 500 --output events.npz',
]
LARGEST_FIT = 20_000  # hundreds of samples have a count of every size
CHUNK = 1 << 15


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--size', type=within(1, 4096, int), default=64, metavar='L', help='sites along a side (64)'
    )
    parser.add_argument(
        '--alpha', type=within(0, 0.25), default=0.2, metavar='A',
        help='share that each neighbour gets (0.2)',
    )  # fmt: skip
    parser.add_argument(
        '--events', type=within(1, 1e9, int), default=1_000_000, metavar='N',
        help='events to record (1000000)',
    )  # fmt: skip
    parser.add_argument(
        '--warmup',
        type=within(0, 1e12, int),
        default=0,
        metavar='W',
        help='events before recording (0)',
    )
    parser.add_argument(
        '--seed', type=within(0, 1e18, int), default=1, metavar='S', help='seed of the start (1)'
    )
    parser.add_argument(
        '--fit',
        default='',
        metavar='FROM:TO',
        help=f'range of sizes for the fit of tau, up to {LARGEST_FIT}',
    )
    parser.add_argument(
        '-o', '--output', metavar='FILE.npz', help='file for size, area, duration and first'
    )
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def run(args: argparse.Namespace) -> int:
    """Warm up, run, fit, print."""
    import numpy as np

    from eol_ros.lab.automaton.ofc import Automaton, Events

    full = args.output is not None
    if full:
        folders.check_writable(args.output, '--output')
    fit_range = _fit_range(args.fit, args.size)
    Automaton(np.zeros((1, 1)), 0.2).run(1, full)  # compiles now, not in the time that is told
    lattice = Automaton.random(args.size, args.alpha, args.seed)
    _advance(lattice, args.warmup, 'warming up', False)
    parts, seconds = _advance(lattice, args.events, 'running', full)
    events = Events.joined(parts)
    if full:
        _save(args.output, events)
    report = {
        'model': 'ofc',
        'size': args.size,
        'alpha': args.alpha,
        'seed': args.seed,
        'warmup': args.warmup,
        'events': args.events,
        'topplings_per_s': float(events.size.sum() / seconds),
        'events_per_s': args.events / seconds,
        **_law(events.size, fit_range),
    }
    print(json.dumps(report) if args.json else _words(report))
    return 0


def _fit_range(text: str, side: int) -> tuple[int, int]:
    """Return the sizes to fit on: small ones follow the lattice, the greatest its boundary."""
    if not text:
        return 2, min(200, max(20, side * side // 6))
    found = re.fullmatch(r'(\d{1,8}):(\d{1,8})', text)
    if not found or not 1 <= int(found[1]) < int(found[2]) <= LARGEST_FIT:
        raise UsageError(f'--fit {text}: write two rising sizes up to {LARGEST_FIT}, like 2:200')
    return int(found[1]), int(found[2])


def _advance(lattice, count: int, words: str, full: bool):
    """Run `count` events; return them in parts, and the processor seconds of the runs alone."""
    from eol_ros.verbs.progress import track

    parts, seconds = [], 0.0
    steps = [min(CHUNK, count - begun) for begun in range(0, count, CHUNK)]
    for step in track(steps, words) if count > CHUNK else steps:
        began = time.thread_time()
        part = lattice.run(step, full)
        seconds += time.thread_time() - began
        parts.append(part)
    return parts, max(seconds, 1e-9)


def _law(sizes, fit_range: tuple[int, int]) -> dict:
    import numpy as np

    from eol_ros.core.science import powerlaw

    counts = powerlaw.histogram(sizes)
    exceedance = powerlaw.exceedance(counts)
    top = len(counts) - 1
    shown = {*range(1, min(top, 100) + 1), *np.geomspace(1, max(top, 1), 80).astype(int).tolist()}
    shown |= {m * 10**k for k in range(10) for m in (1, 2, 3, 5)} | {top}
    law = {
        'mean_size': float(sizes.mean()),
        'max_size': top,
        'ccdf': {str(s): float(exceedance[s]) for s in sorted(shown) if 1 <= s <= top},
        'fit': f'{fit_range[0]}:{fit_range[1]}',
    }
    try:
        found = powerlaw.fit(counts, *fit_range)
        tested = powerlaw.goodness(sizes, [found], np.random.default_rng(0))
        rejected = tested.p_value < powerlaw.REJECTED
        law |= {
            'rejected': rejected, 'p_value': tested.p_value, 'ks': found.ks,
            'nearest_tau' if rejected else 'tau': found.tau, 'tau_error': tested.error,
            'tau_interval': [tested.low, tested.high],
        }  # fmt: skip
    except powerlaw.FitError as reason:
        law['no_fit'] = str(reason)
    return law


def _save(path: str, events) -> None:
    import numpy as np

    columns = ('size', 'area', 'duration', 'first')
    with writing(path, '--output'), open(path, 'wb') as file:
        np.savez_compressed(file, **{name: getattr(events, name) for name in columns})
    print(f'{len(events.size)} events written to {path}', file=sys.stderr)


def _words(report: dict) -> str:
    lines = [
        f'{report["events"]} events on {report["model"]} of size {report["size"]}: '
        f'{report["topplings_per_s"] / 1e6:.3g} million topplings a second, '
        f'{report["events_per_s"]:.3g} events a second',
        f'size: mean {report["mean_size"]:.4g}, greatest {report["max_size"]}',
    ]
    if 'no_fit' in report:
        lines.append(f'no law: {report["no_fit"]}')
    else:
        name = 'nearest_tau' if report['rejected'] else 'tau'
        low, high = report['tau_interval']
        verdict = 'no power law' if report['rejected'] else 'a power law is not ruled out'
        lines.append(
            f'density of sizes {report["fit"]}: {verdict} (p {report["p_value"]:.2g}); '
            f'{name} = {report[name]:.3f} ({low:.3f} to {high:.3f})'
        )
    return '\n'.join(lines)
