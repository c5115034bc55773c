# SPDX-License-Identifier: Apache-2.0
"""eol bench table: where in the table slips happen, over the stiffness of springs and the friction.

The twin's table under its own visitors, image by image as it runs live; slips are those of the
event solver, cascades are joined as the motion node joins them (core.motion.cascades). For each
table: what share of the slips the inner nine blocks have, and the block that has fewest; cascades
of each area, and how long it took until every area from 1 to 25 had occurred; length of a slip.

Two pulls from rest say what hands need: along x until the middle block slips (the rim has 22 cm,
and 9 cm of gap), and, of the last table, towards a corner, with the time from the first slip to
each block's own.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import picture
from benchmarks.machine import tell
from eol_ros.core.geometry import (
    BLOCK_SIDE_M,
    COLS,
    N_BLOCKS,
    RIM_REACH_M,
    RIM_SIDE_M,
    ROWS,
    neighbours,
)
from eol_ros.core.motion.cascades import Cascades
from eol_ros.core.motion.slips import START, STOP, SlipEvent
from eol_ros.core.physics.twin.live import SOFT, Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.settings import MotionSettings

HELP = 'Where slips happen, and cascades of which area, by stiffness and friction of the table.'
EXAMPLES = ['eol bench table --minutes 10 --seeds 3', 'eol bench table --map --plot docs/img']
FPS = 60.0
INNER = [block for block in range(N_BLOCKS) if len(neighbours(block, diagonal=True)) == 8]
MIDDLE = N_BLOCKS // 2
BESIDE = np.array([(i, j) for i in range(N_BLOCKS) for j in neighbours(i, True) if i < j]).T
TOUCH_M = 0.0025  # the rim stops 2 mm from a block
PULL_MPS, HANDS = 0.05, ('anna', 'ben', 'carla', 'dora')
LEAST_INNER, LEAST_BLOCK = 0.20, 0.01  # what the paper's words ask of a table
STIFFNESSES = (20.0, 40.0, 70.0, 100.0, 150.0, 200.0)
STATICS = (0.6, 0.75, 0.9)
RATIOS = (0.5, 0.6, 0.72)  # mu_k / mu_s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--stiffness', type=float, help="N/m (default: the twin's)")
    parser.add_argument('--mu-static', type=float, help="default: the twin's")
    parser.add_argument('--mu-kinetic', type=float, help="default: the twin's")
    parser.add_argument('--rotate', action=argparse.BooleanOptionalAction, help='of the blocks')
    parser.add_argument('--spring-natural-m', type=float, help="m (default: the twin's)")
    parser.add_argument('--block-kg', type=float, help="default: the twin's")
    parser.add_argument('--map', action='store_true', help='all tables of the map, and its best')
    parser.add_argument('--minutes', type=float, default=10.0, help='of each start (default 10)')
    parser.add_argument('--seeds', type=int, default=1, metavar='N', help='starts (default 1)')
    parser.add_argument('--plot', type=Path, metavar='FOLDER', help='write table_map.png there')
    parser.add_argument('--json', action='store_true')


def run(args: argparse.Namespace) -> int:
    """Simulate, count, print."""
    given = {
        name: value
        for name in Coupling._fields
        if (value := getattr(args, name)) is not None
    }  # fmt: skip
    tables = [Coupling()._replace(**given)]
    if args.map:
        tables = [
            Coupling(k, mu, round(mu * ratio, 3))
            for k in STIFFNESSES for mu in STATICS for ratio in RATIOS
        ]  # fmt: skip
        tables += [SOFT, Coupling()]
    rows = []
    for number, coupling in enumerate(tables, 1):
        words = ', '.join(f'{v:g}' for v in coupling[:3])
        print(f'{number} of {len(tables)}: {words}', file=sys.stderr, flush=True)
        rows.append(measure(coupling, args.minutes, range(1, 1 + args.seeds)))
    last = tables[-1]
    result = {
        'minutes': args.minutes, 'seeds': args.seeds, 'tables': rows,
        'last': {'rough': rough(last), 'corner_s': from_a_corner(last)},
    }  # fmt: skip
    if args.plot:
        what = f'--map --minutes {args.minutes:g}' if args.map else f'--minutes {args.minutes:g}'
        draw(rows, args.plot, f'eol bench table {what} --seeds {args.seeds} (1 and on): together')
    tell(result, args.json, _table)
    return 0


def measure(coupling: Coupling, minutes: float, seeds: Any) -> dict[str, Any]:
    """Return the row of one table: `minutes` from each start, and the pull along x."""
    slips, lengths, areas = np.zeros(N_BLOCKS, int), [], np.zeros(N_BLOCKS + 1, int)
    until, spent, faults, farthest, gap, rim_gap = [], 0.0, 0, 0.0, np.inf, np.inf
    for seed in seeds:
        play = Counted(coupling, seed)
        first = np.full(N_BLOCKS + 1, np.inf)
        for _ in range(round(60 * minutes * FPS)):
            for cascade in play.image():
                areas[cascade.area] += 1
                first[cascade.area] = min(first[cascade.area], play.time_s)
            farthest = max(farthest, float(np.abs(play.rim.pose[:2]).max()))
            gap, rim_gap = min(gap, play.gap_m()), min(rim_gap, play.rim_gap_m())
        slips += play.slips
        lengths += play.lengths
        until.append(float(first[1:].max()))
        spent, faults = spent + play.spent_s, faults + play.table.faults
    hours = minutes * len(seeds) / 60
    share = slips / slips.sum()
    inner = float(share[INNER].sum())
    return coupling._asdict() | {
        'inner_share': inner, 'least_share': float(share.min()), 'least_block': int(share.argmin()),
        'slips_per_min': float(slips.sum() / (60 * hours)),
        'slip_mm_p10': 1e3 * float(np.percentile(lengths, 10)),
        'slip_mm_p50': 1e3 * float(np.median(lengths)),
        'cascades_per_min': float(areas.sum() / (60 * hours)),
        'areas': areas[1:].tolist(), 'areas_missing': int((areas[1:] == 0).sum()),
        'all_areas_s': until, 'reach_m': farthest,
        'pull_to_middle_m': pull_to_middle(coupling),
        'gap_mm': 1e3 * gap, 'rim_gap_mm': 1e3 * rim_gap,
        'ms_per_s': 1e3 * spent / (3600 * hours), 'faults': faults,
        'good': bool(inner >= LEAST_INNER and share.min() >= LEAST_BLOCK and areas[1:].all()),
    }  # fmt: skip


class Counted(Play):
    """A table under hands, and what happens on it: slips and their lengths by block, cascades."""

    def __init__(self, coupling: Coupling, seed: int):
        super().__init__(seed, coupling=coupling)
        self.slips, self.lengths = np.zeros(N_BLOCKS, int), []
        self.onset_s = np.full(N_BLOCKS, np.inf)  # of the first slip of each
        self.spent_s, self._count = 0.0, 0
        self._cascades = Cascades(MotionSettings())
        self._begun: dict[int, tuple[int, float, np.ndarray]] = {}

    def image(self, visitors: bool = True) -> list[Any]:
        """Go on by one image; return the cascades that are over."""
        table = self.table
        before, log = np.stack([table.x, table.y], 1), table._log
        log.start[:] = -1
        spent = time.process_time()
        begin_s = self.advance(1 / FPS, visitors)
        self.spent_s += time.process_time() - spent
        after, events = np.stack([table.x, table.y], 1), []
        which = np.flatnonzero(log.start >= 0)
        for i in which[np.argsort(log.t[which], kind='stable')]:
            block, at_s = int(log.block[i]), begin_s + float(log.t[i])
            if log.start[i]:
                self._count += 1
                self.slips[block] += 1
                self.onset_s[block] = min(self.onset_s[block], at_s)
                self._begun[block] = self._count, at_s, before[block]
                events.append(_event(START, self._count, block, at_s, 0.0, 0.0))
            elif block in self._begun:
                slip, onset_s, place = self._begun.pop(block)
                length_m = float(np.hypot(*(after[block] - place)))
                self.lengths.append(length_m)
                events.append(_event(STOP, slip, block, onset_s, at_s - onset_s, length_m))
        return self._cascades.update(self.time_s, events)[1]

    def gap_m(self) -> float:
        """Return the least distance between two blocks, m; less than none where they overlap."""
        table, (i, j), half = self.table, BESIDE, 0.5 * BLOCK_SIDE_M
        dx, dy, yaw = table.x[i] - table.x[j], table.y[i] - table.y[j], table.yaw
        reach = half * (1 + abs(np.cos(yaw[i] - yaw[j])) + abs(np.sin(yaw[i] - yaw[j])))
        apart = [  # squares that overlap do so along the sides of both
            np.maximum(abs(dx * np.cos(t) + dy * np.sin(t)), abs(dy * np.cos(t) - dx * np.sin(t)))
            for t in (yaw[i], yaw[j])
        ]
        return float((np.maximum(*apart) - reach).min())

    def rim_gap_m(self) -> float:
        """Return the least distance from the rim to a block, m."""
        return self.table.clearance_m(self.table.rim_pose)


def rough(coupling: Coupling, minutes: float = 12.0, starts: int = 12) -> dict[str, float]:
    """Return the same distances, mm, under three who jerk the rim at random as fast as may be.

    `minutes` are shared by the `starts`; `gaps_mm` are the least of each, `overlap` is the share of
    images in which two blocks are in the same place.
    """
    gaps = np.zeros((starts, round(60 * minutes / starts * FPS), 2))
    for start in range(starts):
        play, random = Counted(coupling, start), np.random.default_rng(start)
        velocity, until_s = np.zeros(3), 0.0
        for image in range(gaps.shape[1]):
            if play.time_s >= until_s:
                until_s = play.time_s + random.uniform(0.3, 2.0)
                way = random.uniform(0, 2 * np.pi)
                x, y, yaw_rate = 0.35 * np.cos(way), 0.35 * np.sin(way), random.uniform(-0.9, 0.9)
                velocity = np.array([x, y, yaw_rate])
            for hand in HANDS[:3]:
                play.commands.take(play.time_s, hand, velocity, 1.0)
            play.image(visitors=False)
            gaps[start, image] = play.gap_m(), play.rim_gap_m()
    blocks, rim = gaps[:, :, 0], gaps[:, :, 1]
    return {
        'gap_mm': 1e3 * float(blocks.min()), 'overlap': float(np.mean(blocks < 0)),
        'gaps_mm': sorted((1e3 * blocks.min(axis=1)).round(1).tolist()),
        'rim_gap_mm': 1e3 * float(rim.min()), 'rim_touches': float(np.mean(rim < TOUCH_M)),
    }  # fmt: skip


def _event(kind: int, slip: int, block: int, onset_s: float, lasted_s: float, length_m: float):
    stamp_s = onset_s + lasted_s
    return SlipEvent(kind, slip, block, stamp_s, onset_s, 0.0, 0.0, 0.0, 0.0, length_m, lasted_s)


def _led(coupling: Coupling, velocity: tuple[float, float, float]) -> Iterator[Counted]:
    """Lead the rim from rest at `velocity` (3,) as far as the platform lets it."""
    play = Counted(coupling, 1)
    for _ in range(round(2 * RIM_REACH_M / PULL_MPS * FPS)):
        for hand in HANDS:  # one alone is not strong enough everywhere
            play.commands.take(play.time_s, hand, velocity, 1.0)
        play.image(visitors=False)
        yield play


def pull_to_middle(coupling: Coupling) -> float:
    """Return how far the rim goes along x until the middle block slips, m; nan if it never does."""
    for play in _led(coupling, (PULL_MPS, 0.0, 0.0)):
        if np.isfinite(play.onset_s[MIDDLE]):
            return float(play.rim.pose[0])
    return float('nan')


def from_a_corner(coupling: Coupling) -> list[float]:
    """Return the first slip, s after the very first, by steps from the pushed corner (0 to 8).

    The corner at +x, +y goes sideways and the rim turns about the opposite one; medians over blocks
    as far away.
    """
    way, onset_s = 0.5 * PULL_MPS / np.sqrt(2), np.zeros(N_BLOCKS)
    for play in _led(coupling, (-way, way, 0.5 * PULL_MPS / (RIM_SIDE_M / np.sqrt(2)))):
        onset_s = play.onset_s
    row, column = np.divmod(np.arange(N_BLOCKS), COLS)
    steps = (ROWS - 1 - row) + (COLS - 1 - column)
    after = onset_s - onset_s.min()
    return [float(np.median(after[steps == n])) for n in range(ROWS + COLS - 1)]


def draw(rows: list[dict[str, Any]], folder: Path, said: str) -> None:
    """Write table_map.png: inner share over stiffness by friction, and spectra of area."""
    figure, grid = picture.axes(1, 3, (11, 3.4))
    axes = grid[0]
    shipped = Coupling()._asdict()
    chosen = next((r for r in rows if all(r[k] == v for k, v in shipped.items())), rows[-1])
    soft = next((r for r in rows if all(r[k] == v for k, v in SOFT._asdict().items())), None)
    for mu, colour in zip(STATICS, ('C0', 'C1', 'C2'), strict=True):
        for ratio, style in zip(RATIOS, ('-', '--', ':'), strict=True):
            line = [
                r for r in rows
                if r['mu_static'] == mu and r['mu_kinetic'] == round(mu * ratio, 3)
                and r['stiffness'] in STIFFNESSES
            ]  # fmt: skip
            label = f'{mu:g}, {mu * ratio:.2g}'
            k = [r['stiffness'] for r in line]
            axes[0].plot(k, [100 * r['inner_share'] for r in line], style, color=colour)
            axes[1].plot(
                k, [100 * r['least_share'] for r in line], style, color=colour, label=label
            )
    for axis, key, least, words in (
        (axes[0], 'inner_share', LEAST_INNER, 'slips of the inner nine blocks, %'),
        (axes[1], 'least_share', LEAST_BLOCK, 'slips of the block that has fewest, %'),
    ):
        axis.axhline(100 * least, color='0.6', linewidth=0.8)
        axis.plot(chosen['stiffness'], 100 * chosen[key], 'k*', markersize=12)
        axis.set(xlabel='stiffness of a spring, N/m', ylabel=words, ylim=0)
    axes[1].legend(title='mu_s, mu_k', fontsize=7, title_fontsize=7)
    for row, mark, words in ((chosen, 'k-', 'shipped'), (soft, 'C3--', 'soft')):
        if row:
            at_least = np.cumsum(row['areas'][::-1])[::-1]
            axes[2].loglog(range(1, N_BLOCKS + 1), at_least, mark, label=words)
    axes[2].set(xlabel='area A, blocks', ylabel='cascades of at least A')
    axes[2].legend(fontsize=7)
    picture.save(figure, folder, 'table_map', said)


def _table(result: dict[str, Any]) -> str:
    lines = [
        f'{result["minutes"]:g} min of visitors from each of {result["seeds"]} starts;'
        ' slip: median and first decile; all: until every area had occurred; pull: of the rim'
        ' along x until the middle slips',
        '    k  mu_s   mu_k  inner  least (of)  slips/min  slip mm     casc/min  1 / 2-4 / 5-12'
        ' / 13-24 / 25    all s       pull m  ms/s',
    ]
    for r in result['tables']:
        a = np.array(r['areas'])
        parts = [a[0], a[1:4].sum(), a[4:12].sum(), a[12:24].sum(), a[24]]
        until = '/'.join(f'{s:.0f}' for s in r['all_areas_s'])
        lines.append(
            f'{r["stiffness"]:5g} {r["mu_static"]:5g} {r["mu_kinetic"]:6g} {r["inner_share"]:6.3f}'
            f' {r["least_share"]:6.4f} ({r["least_block"]:2d}) {r["slips_per_min"]:9.0f}'
            f' {r["slip_mm_p50"]:5.2f} {r["slip_mm_p10"]:5.2f} {r["cascades_per_min"]:9.1f}  '
            + ' / '.join(str(n) for n in parts)
            + f'  {until}  {r["pull_to_middle_m"]:6.3f} {r["ms_per_s"]:5.1f}'
            + ('  good' if r['good'] else '')
            + (f'  {r["faults"]} FAULTS' if r['faults'] else '')
        )
    last, worst = result['last']['corner_s'], result['last']['rough']
    lines.append(
        f'least distance (last table) of two blocks {result["tables"][-1]["gap_mm"]:.1f} mm, to'
        f' the rim {result["tables"][-1]["rim_gap_mm"]:.1f} mm; under three rough people'
        f' {worst["gap_mm"]:.1f} and {worst["rim_gap_mm"]:.1f} mm, the rim at a block in'
        f' {100 * worst["rim_touches"]:.1f} % of the images, two blocks in one place in'
        f' {100 * worst["overlap"]:.4f} %; least of each start, mm: '
        + ', '.join(f'{gap:.1f}' for gap in worst['gaps_mm'])
    )
    lines.append(
        'pushed from one corner, s from the first slip to those n steps away (last table): '
        + ', '.join(f'{s:.2f}' for s in last)
    )
    return '\n'.join(lines)
