# SPDX-License-Identifier: Apache-2.0
"""`eol bench lattice`: topplings a second of one core, ours beside the plain ways.

Times are processor time of the one thread, so that other work on the machine counts less.
"""

import argparse
import time

HELP = 'Measure the automaton: speed by size and alpha, beside two other queues and plain NumPy.'
EXAMPLES = ['eol bench lattice --json', 'eol bench lattice --seconds 1']
ROWS = (  # size, alpha, events of warm-up
    (35, 0.20, 1_000_000),
    (35, 0.25, 30_000),
    (128, 0.15, 2_000_000),
    (128, 0.20, 6_000_000),
    (128, 0.25, 10_000),
    (512, 0.20, 200_000),
    (1000, 0.20, 100_000),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seconds', type=float, default=2.0, help='measured, per row')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    from benchmarks.machine import tell
    from eol_ros.core.physics.automaton.ofc import Automaton
    from eol_ros.verbs.progress import track

    for queue in ('bucket', 'sweep'):
        Automaton.random(4, 0.2, 1, queue).run(10)  # compile
    rows = [_row(*row, args.seconds) for row in track(ROWS, 'lattices')]
    report = {'rows': rows, 'exact': _departure()}
    tell(report, args.json, _table)
    return 0


def _row(side: int, alpha: float, warmup: int, seconds: float) -> dict:
    from eol_ros.core.physics.automaton.ofc import Automaton

    warm = Automaton.random(side, alpha, 1)
    warm.run(warmup)
    row = {'size': side, 'alpha': alpha, 'warmup': warmup}
    for queue, share in (('bucket', 1.0), ('sweep', 0.3)):
        lattice = Automaton(warm.stress, alpha, queue)
        row[f'{queue}_mtop_s'], row[f'{queue}_mev_s'], mean = _speed(lattice, seconds * share)
        if queue == 'bucket':
            row['mean_size'] = mean
    for queue in ('tree', 'boxes'):
        row[f'{queue}_mtop_s'] = _other_speed(queue, warm, alpha, seconds * 0.3)
    row['numpy_mtop_s'] = _numpy_speed(warm.stress, alpha, seconds * 0.3)
    row['over_numpy'] = row['bucket_mtop_s'] / row['numpy_mtop_s']
    return row


def _speed(lattice, seconds: float) -> tuple[float, float, float]:
    """Return million topplings and events a second, best of the chunks, and the mean size."""
    chunk, best, best_events, topplings, events = 200, 0.0, 0.0, 0, 0
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        began = time.thread_time()
        total = int(lattice.run(chunk).size.sum())
        spent = time.thread_time() - began
        topplings, events = topplings + total, events + chunk
        if spent < 0.05 * seconds:
            chunk *= 2
        else:
            best = max(best, total / spent / 1e6)
            best_events = max(best_events, chunk / spent / 1e6)
    return best, best_events, topplings / events


def _other_speed(queue: str, warm, alpha: float, seconds: float) -> float:
    """Return million topplings a second of another queue; its events must be the same."""
    import numpy as np

    from benchmarks import lattice_queues
    from eol_ros.core.physics.automaton.ofc import ONE, Automaton

    run, ours = getattr(lattice_queues, queue), Automaton(warm.stress, alpha)
    other = Automaton(warm.stress, alpha)
    stress, share = other._stress, other._share
    run(stress.copy(), other.side, ONE, share, np.zeros(1, np.int64))  # compiles
    best, until = 0.0, time.thread_time() + seconds
    count = 100 if alpha >= 0.25 else max(100, ours.side**2 // 4)  # setting up counts, too
    while time.thread_time() < until:
        sizes = np.zeros(count, np.int64)
        began = time.thread_time()
        done = run(stress, other.side, ONE, share, sizes)
        spent = time.thread_time() - began
        if (sizes[:done] != ours.run(done).size).any():
            raise AssertionError(f'the queue {queue} finds other events')
        best = max(best, sizes.sum() / spent / 1e6)
        if spent < 0.05 * seconds:
            count *= 2
    return float(best)


def _numpy_speed(stress, alpha: float, seconds: float) -> float:
    """The way a script does it: arrays, a maximum each event, a mask each layer."""
    import numpy as np

    f = np.zeros((len(stress) + 2, len(stress) + 2))
    f[1:-1, 1:-1] = stress
    inner, total = f[1:-1, 1:-1], 0
    began = time.thread_time()
    while time.thread_time() < began + seconds:
        inner += 1 - inner.max()
        while (high := inner >= 1).any():
            gift = np.where(high, alpha * inner, 0.0)
            total += int(high.sum())
            inner[high] = 0
            inner[1:] += gift[:-1]
            inner[:-1] += gift[1:]
            inner[:, 1:] += gift[:, :-1]
            inner[:, :-1] += gift[:, 1:]
    return total / (time.thread_time() - began) / 1e6


def _departure() -> list[dict]:
    """After how many events fixed point leaves exact arithmetic, and what that does to sizes."""
    from fractions import Fraction

    import numpy as np

    from eol_ros.core.physics.automaton.ofc import Automaton, ExactAutomaton

    rows = []
    for side, alpha in ((16, Fraction(1, 5)), (24, Fraction(3, 20))):
        start = np.random.default_rng(1).integers(0, 100_000, (side, side))
        exact = ExactAutomaton(start, 100_000, alpha).run(4000)
        fixed = Automaton(start / 100_000, float(alpha)).run(4000, full=True)
        differ = np.flatnonzero((exact.size != fixed.size) | (exact.first != fixed.first))
        rows.append(
            {
                'size': side,
                'alpha': str(alpha),
                'events': 4000,
                'same_until': int(differ[0]) if len(differ) else 4000,
                'mean_size_exact': float(exact.size.mean()),
                'mean_size_fixed': float(fixed.size.mean()),
            }
        )
    return rows


def _table(report: dict) -> str:
    lines = [
        'size  alpha  mean size   bucket          sweep    tree   boxes   NumPy   over NumPy',
        '                      Mtop/s  Mev/s    Mtop/s  Mtop/s  Mtop/s  Mtop/s',
    ]
    for r in report['rows']:
        lines.append(
            f'{r["size"]:4}  {r["alpha"]:.2f}  {r["mean_size"]:9.2f}  '
            f'{r["bucket_mtop_s"]:6.1f} {r["bucket_mev_s"]:6.2f}   '
            f'{r["sweep_mtop_s"]:7.2f} {r["tree_mtop_s"]:7.2f} {r["boxes_mtop_s"]:7.2f} '
            f'{r["numpy_mtop_s"]:7.3f}  {r["over_numpy"]:9.0f}'
        )
    for r in report['exact']:
        lines.append(
            f'size {r["size"]} alpha {r["alpha"]}: fixed point and exact arithmetic agree '
            f'for {r["same_until"]} of {r["events"]} events; mean size '
            f'{r["mean_size_fixed"]:.3f} and {r["mean_size_exact"]:.3f}'
        )
    return '\n'.join(lines)
