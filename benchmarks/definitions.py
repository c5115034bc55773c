# SPDX-License-Identifier: Apache-2.0
"""eol bench definitions: how N(>= A) depends on what one calls a cascade.

The slips of one table, joined in two ways: as the motion node does (`core.motion.cascades`: the
same or touching blocks, corners included, and an onset no later than `gap` after the earlier slip's
end), and from rest to rest of the whole table (`core.science.quiescent`).
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import picture
from benchmarks.machine import tell
from eol_ros.errors import UsageError

HELP = "N(>= A) of the same slips by the graph's rule and by rest to rest, against speed and gap."
EXAMPLES = ['eol bench definitions --plot docs/img', 'eol bench definitions --seeds 5 --json']
GAPS_S = (0.0, 0.05, 0.2, 0.5)  # the second is the motion node's
DRIVES = (('pull', 0.001, 3.0), ('pull', 0.005, 6.0), ('hands', 0.0475, 30.0))  # m/s, m
SHOWN = (1, 2, 3, 5, 8, 12, 18, 25)
REST = 'rest to rest'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--seeds', type=int, default=3, metavar='N', help='starts of each (3)')
    parser.add_argument('--plot', metavar='DIR', help='draw definitions.png there')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, join, print, draw."""
    from eol_ros.verbs.progress import track

    if args.seeds < 1:
        raise UsageError(f'--seeds {args.seeds}: 1 or more')
    rows = []
    for drive, speed_mps, travel_m in track(DRIVES, 'drives'):
        runs = [slips(drive, speed_mps, travel_m, seed) for seed in range(1, args.seeds + 1)]
        joined = {REST: [by_rest(one) for one in runs]}
        for gap_s in GAPS_S:
            joined[f'gap {gap_s:g} s'] = [by_graph(one, gap_s) for one in runs]
        rows += [_row(drive, speed_mps, name, each) for name, each in joined.items()]
    result = {'seeds': args.seeds, 'gap_s': default_gap_s(), 'rows': rows}
    if args.plot:
        draw(result, Path(args.plot))
    tell(result, args.json, table)
    return 0


def default_gap_s() -> float:
    """Return the gap of the motion node."""
    from eol_ros.settings import MotionSettings

    return MotionSettings().cascade_gap_s


def slips(drive: str, speed_mps: float, travel_m: float, seed: int) -> Any:
    """Return the run of the paper's table."""
    from eol_ros.core.science import sweep

    task = sweep.Table(drive=drive, speed_mps=speed_mps, travel_m=travel_m, seed=seed)
    return sweep.run_of(task)


def by_rest(run: Any) -> np.ndarray:
    """Return the areas of cascades from rest to rest, (n,)."""
    from eol_ros.core.science.quiescent import cascades

    return cascades(run.event_block, run.event_start)[1]


def by_graph(run: Any, gap_s: float) -> np.ndarray:
    """Return the areas of cascades as the motion node joins them, (n,)."""
    from dataclasses import replace

    from eol_ros.core.motion.cascades import Cascades
    from eol_ros.core.motion.slips import START, STOP, SlipEvent
    from eol_ros.settings import MotionSettings

    rule = Cascades(replace(MotionSettings(), cascade_gap_s=gap_s))
    begun: dict[int, tuple[int, float]] = {}
    areas, number = [], 0
    for at_s, block, starts in zip(
        run.event_t.tolist(), run.event_block.tolist(), run.event_start.tolist(), strict=True
    ):
        if starts:
            number += 1
            begun[block] = number, at_s
            what, slip, onset_s = START, number, at_s
        else:
            what, (slip, onset_s) = STOP, begun.pop(block)
        event = SlipEvent(what, slip, block, at_s, onset_s, 0.0, 0.0, 0.0, 0.0, 0.0, at_s - onset_s)
        areas += [cascade.area for cascade in rule.update(at_s, [event])[1]]
    return np.array(areas + [c.area for c in rule.finish(np.inf)], np.int64)


def _row(drive: str, speed_mps: float, name: str, each: list[np.ndarray]) -> dict[str, Any]:
    """Return N(>= A) of the starts together, and the slope of the nearest law from 1 to 12."""
    from eol_ros.core.science import powerlaw

    found: dict[str, Any] = {'drive': drive, 'speed_mps': speed_mps, 'rule': name}
    taus, rejected = [], 0
    for areas in each:
        try:
            law = powerlaw.fit(powerlaw.histogram(areas), 1, 12)
            tested = powerlaw.goodness(areas, [law], np.random.default_rng(1))
        except powerlaw.FitError:
            continue
        taus.append(law.tau)
        rejected += tested.p_value < powerlaw.REJECTED
    areas = np.concatenate(each)
    found |= {'cascades': len(areas), 'fitted': len(taus), 'rejected': rejected}
    found['at_least'] = [int((areas >= a).sum()) for a in range(1, 26)]
    if len(taus) > 1:
        found |= {'b': float(np.mean(taus) - 1), 'b_deviation': float(np.std(taus, ddof=1))}
    return found


def table(result: dict[str, Any]) -> str:
    """Return the table of docs/science.md."""
    heads = ' | '.join(str(a) for a in SHOWN)
    lines = [
        f'{result["seeds"]} starts; b: slope of the nearest law of 1 to 12 blocks, not a verdict; '
        f'the motion node has a gap of {result["gap_s"]:g} s',
        f'| drive | rule | {heads} | b | rejected |', '| --- ' * (len(SHOWN) + 4) + '|',
    ]  # fmt: skip
    for r in result['rows']:
        counts = ' | '.join(str(r['at_least'][a - 1]) for a in SHOWN)
        b = f'{r["b"]:.2f} +- {r["b_deviation"]:.2f}' if 'b' in r else ''
        speed = f'{1e3 * r["speed_mps"]:g} mm/s'
        lines.append(
            f'| {r["drive"]}, {speed} | {r["rule"]} | {counts} | {b} | '
            f'{r["rejected"]} of {r["fitted"]} |'
        )
    return '\n'.join(lines)


def draw(result: dict[str, Any], folder: Path) -> None:
    """Write definitions.png."""
    drives = list(dict.fromkeys((r['drive'], r['speed_mps']) for r in result['rows']))
    figure, axes = picture.axes(1, len(drives), (3.6 * len(drives), 3.7), sharey=True)
    for axis, (drive, speed) in zip(axes[0], drives, strict=True):
        for r in result['rows']:
            if (r['drive'], r['speed_mps']) != (drive, speed):
                continue
            rest = r['rule'] == REST
            words = f'{r["rule"]}: b {r["b"]:.2f}' if 'b' in r else r['rule']
            style, width = ('k-', 2.0) if rest else ('--', 1.2)
            axis.loglog(range(1, 26), r['at_least'], style, label=words, linewidth=width)
        axis.set(xlabel='area A (blocks)', title=f'{drive}, {1e3 * speed:g} mm/s')
        picture.areas(axis, 25)
        axis.legend(fontsize=8)
    axes[0, 0].set_ylabel('cascades of at least A')
    said = f'eol bench definitions --seeds {result["seeds"]}: all starts together'
    picture.save(figure, folder, 'definitions', said)
