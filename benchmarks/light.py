# SPDX-License-Identifier: Apache-2.0
"""eol bench light: does a flash stay a flash? The light of a recording under each limit of flashes.

The taps and slips of a bag light their blocks again, as `leds` does, under the limit of the whole
field, under that of each 10 degree field with each look, and under none; `recorded` is light of
`led_commands`. Columns:

    flash     time of a block above 10 % of full light, median and 90th percentile
    20 lit    share of the time with light in which at least 20 of 25 blocks are above 10 %
    raised    share of the slips over 1 mm whose tap or image raises their block by 20 % or more
    flashes   most flashes of any 10 degree field in any second (WCAG 2.2: at most 3), at rest
              positions, for eyes at 0.4 to 2.5 m. A change counts when it reaches 10 %, even if
              it began before that second: stricter than the standard
    space     contrast between blocks: standard deviation over mean, median of the time with light
    time      share of the change of light that is faster than 1 Hz
    tau       order of lighting against order of onsets (Kendall), median of cascades of 5 blocks
    at limit  share of the time with light in which a block or a square of four has as many falls in
              a second as the limit by field of view allows
    frames    lit blocks in three frames of the greatest cascade, 0.5 s apart
    cost      run time for each slip and each frame

With `--seeds N` the lightings are those of N rehearsals of the twin, each with another seed: a
block is lit KNOCK_S after each true onset, and `20 lit` is a share of the time in which the rim
moves. `--look` chooses the look.
"""

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from support.fields_of_view import distinct, fields, most_in_a_second
from support.paper import COLS, N_BLOCKS, ROWS, rest_lattice

from benchmarks import held_out
from benchmarks.machine import tell
from benchmarks.twin_slips import Rehearsal
from eol_ros.analysis import light, open_bag
from eol_ros.analysis.bag import Bag
from eol_ros.analysis.recorded_settings import recorded_settings
from eol_ros.core.light.flash import FlashField
from eol_ros.core.light.frames import FELT_NS
from eol_ros.core.light.local import BLOCK_FALLS, SQUARE_FALLS, LocalField, squares
from eol_ros.core.light.looks import LOOKS, REST_S, Look, spread
from eol_ros.core.motion.slips import START, STOP
from eol_ros.core.table import Table
from eol_ros.errors import EolError
from eol_ros.verbs.progress import track

HELP = 'Measure the light of a bag under each flash limit: duration, lit share, WCAG 2.2.'
EXAMPLES = [
    'eol bench light',
    'eol bench light bags/run --json',
    'eol bench light --sheet light.svg',
    'eol bench light --seeds 8 --seeds-from-time',
]
SAMPLE = Path(__file__).parents[1] / 'bags' / 'sample'
WITHIN_S = 0.005  # from a tap to its light
KNOCK_S = 0.002  # from an onset to the light of its block: the median of `eol bench taps`
EYES = [
    (0.0, 0.0, 0.4), (0.0, 0.0, 0.8), (0.0, -0.9, 0.6), (0.0, -1.0, 1.1), (1.0, -1.0, 0.9),
    (0.0, 0.0, 2.2), (0.0, -2.0, 1.5),  # the farthest: from 3 m no field holds 0.006 sr
]  # fmt: skip
FRAMES, FRAME_S = 12, 0.1  # of the sheet
RAISED, LONG_M = 0.2, 1e-3
RATE_HZ = light.RATE_HZ
SOMETIMES = {  # figures that are None without light, slips or cascades, or in short recordings
    'many_lit': '.1%', 'raised': '.1%', 'at_limit': '.1%', 'contrast_space': '.2f',
    'contrast_time': '.0%', 'order_tau': '.2f',
}  # fmt: skip
PAPER = Look(0.1, 0, 0.0)
LIMITS = {  # name: field, look, limited
    'whole field': (FlashField, PAPER._replace(decay_s=0.35), True),
    'whole field, short': (FlashField, PAPER._replace(decay_s=0.182), True),
    'none': (LocalField, PAPER, False),
    'field of view, paper': (LocalField, PAPER, True),
    **{f'field of view, {name}': (LocalField, look, True) for name, look in LOOKS.items()},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'bag', nargs='?', default=str(SAMPLE), help='bag to light (default: bags/sample)'
    )
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')
    parser.add_argument(
        '--sheet',
        metavar='FILE.svg',
        help='draw an SVG with twelve frames of the greatest cascade under each limit',
    )
    parser.add_argument(
        '--seeds', type=int, default=0, metavar='N', help='measure N rehearsals of the twin instead'
    )
    parser.add_argument(
        '--seconds', type=float, default=60.0, metavar='S', help='length of each rehearsal (60 s)'
    )
    parser.add_argument('--first-seed', type=int, default=1, metavar='S', help='first of --seeds')
    held_out.add_argument(parser)
    parser.add_argument(
        '--look',
        choices=('paper', *LOOKS),
        default='paper',
        help='look of the light in the rehearsals (paper)',
    )


def lightings(bag: Bag) -> list[tuple[float, int, bool]]:
    """Return time in s from the start, block, and whether its slip was over LONG_M, by time.

    A slip whose block felt a tap from 0.1 s before its onset to its image is lit by that tap.
    """
    if not (bag.count('slips') and bag.count('block_taps')):
        raise EolError('this bag has no slips or no taps; `eol bench light` lights blocks by both')
    slips, taps = bag.table('slips'), bag.table('block_taps')
    stops = slips[slips['kind'] == STOP]
    far = dict(zip(stops['slip'].tolist(), stops['distance'].tolist(), strict=True))
    felt_ns = taps['stamp'].astype('i8')
    found = {(int(t), int(b)): False for t, b in zip(felt_ns, taps['block'], strict=True)}
    for one in slips[slips['kind'] == START]:
        stamp_ns, onset_ns = int(one['stamp'].astype('i8')), int(one['onset'].astype('i8'))
        block, long = int(one['block']), far.get(int(one['slip']), 0.0) > LONG_M
        own = (taps['block'] == block) & (felt_ns > onset_ns - FELT_NS) & (felt_ns <= stamp_ns)
        nearest = felt_ns[own][np.argsort(np.abs(felt_ns[own] - onset_ns))[:1]]
        key = (int(nearest[0]) if len(nearest) else stamp_ns, block)
        found[key] = found.get(key, False) or long
    return sorted(((t - bag.start_ns) * 1e-9, block, long) for (t, block), long in found.items())


def rehearsed(seed: int, seconds: float) -> tuple[list[tuple[float, int, bool]], float]:
    """Return `lightings` of the twin under visitors that follow from `seed`, and for how many
    seconds its rim moved.
    """
    fps = 60.0
    twin, placed, pushed = Rehearsal(seed, fps), [], 0
    for _ in twin.images(round(seconds * fps)):
        placed.append(np.stack([twin.play.table.x, twin.play.table.y], axis=1))
        pushed += bool(twin.play.rim.velocity.any())
    places = np.stack(placed)

    def place(at_s: float) -> np.ndarray:  # the image at the end of that time
        return places[min(max(math.ceil(at_s * fps) - 1, 0), len(places) - 1)]

    lit = []
    for slip in twin.slips():
        after, before = (
            place(slip.end_s if math.isfinite(slip.end_s) else seconds),
            place(slip.onset_s - 1 / fps),
        )
        far_m = float(np.hypot(*(after - before)[slip.block]))
        lit.append((slip.onset_s + KNOCK_S, slip.block, far_m > LONG_M))
    return lit, pushed / fps


class Play:
    """Lightings under one limit, as time goes on: levels, and by how much each raised its block.

    `rises`: time in s, block, by how much, whether its slip was long. Light that runs on lights no
    block that has been lit within REST_S or shines brighter.
    """

    def __init__(self, limit: str, lit: list[tuple[float, int, bool]]):
        make, self.look, limited = LIMITS[limit]
        self.field, self.rises = make(self.look.decay_s, limited=limited), []
        runs = [(t + late_s, *to) for t, one, _ in lit for late_s, *to in spread(one, self.look)]
        own = [(t, b, 1.0, long, True) for t, b, long in lit]
        self._waiting = sorted(own + [(*run, False, False) for run in runs], reverse=True)
        self._lit_s = np.full(N_BLOCKS, -math.inf)

    def levels(self, now_s: float) -> np.ndarray:
        """Return the levels at `now_s`."""
        while self._waiting and self._waiting[-1][0] <= now_s:
            at_s, block, share, long, own = self._waiting.pop()
            before = self.field.levels(at_s)[block]
            if not own and (at_s - self._lit_s[block] < REST_S or before >= share):
                continue
            self._lit_s[block] = at_s
            self.field.slip(at_s, block, share)
            self.rises.append((at_s, block, self.field.levels(at_s)[block] - before, long))
        return self.field.levels(now_s)


def sheet(bag: Bag, lit: list[tuple[float, int, bool]]) -> str:
    """Return an SVG: FRAMES of the greatest cascade, FRAME_S apart, a row for each limit.

    The block that slipped first has an orange outline.
    """
    if not bag.count('cascades'):
        raise EolError('this bag has no cascades to draw')
    begin_s, number = light.greatest(bag, bag.table('cascades'))
    slips = bag.table('slips')
    slips = slips[(slips['cascade'] == number) & (slips['kind'] == START)]
    first = int(slips['block'][np.argmin(slips['onset'].astype('i8'))])
    width, height = 60 * FRAMES + 10, 80 * len(LIMITS) + 10
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="#111"/>',
        '<g fill="#bbb" font-family="sans-serif" font-size="9">',
    ]
    for row, limit in enumerate(LIMITS):
        play, top = Play(limit, lit), 80 * row + 20
        drawn.append(f'<text x="10" y="{top - 6}">{limit}, decay {play.look.decay_s} s</text>')
        for k in range(FRAMES):
            for block, level in enumerate(play.levels(begin_s + k * FRAME_S)):
                x, y = 10 + 60 * k + 10 * (block % COLS), top + 10 * (ROWS - 1 - block // COLS)
                grey = round(40 + 215 * level)
                drawn.append(f'<path d="M{x} {y}h8v8h-8z" fill="#{grey:02x}{grey:02x}{grey:02x}"/>')
            x, y = 10 + 60 * k + 10 * (first % COLS), top + 10 * (ROWS - 1 - first // COLS)
            drawn.append(f'<rect x="{x}" y="{y}" width="8" height="8" fill="none" stroke="#f80"/>')
    return '\n'.join([*drawn, '</g></svg>', ''])


def measure(
    lit: list[tuple[float, int, bool]], seconds: float, limit: str, bag: Bag | None = None
) -> dict[str, Any]:
    """Return the columns of one limit; with `bag` those of its cascades, too."""
    play, levels = Play(limit, lit), np.zeros((int(seconds * RATE_HZ), N_BLOCKS))
    began = time.perf_counter()
    for k in range(len(levels)):
        levels[k] = play.levels(k / RATE_HZ)
    cost_us = 1e6 * (time.perf_counter() - began) / (len(levels) + 3 * len(lit))
    at_s, block, rise, long = np.array(play.rises).T
    own = rise[long > 0]

    def rises(begin_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
        one = (at_s >= begin_s) & (at_s <= end_s) & (rise >= light.FLASH / 255)
        return at_s[one], block[one]

    many = (levels > light.LIT).sum(axis=1) >= light.MANY * N_BLOCKS
    found = figures(levels) | {
        'many_s': float(many.sum() / RATE_HZ),
        'limit': limit, 'decay_s': play.look.decay_s,
        'raised': float(np.mean(own >= RAISED)) if len(own) else None,
        'long_slips': len(own), 'held': int(play.field.lengthened), 'cost_us': cost_us,
    }  # fmt: skip
    if bag and (slipped := light.onsets(bag)):
        tau, share = light.order(slipped, rises)
        found |= {'order_tau': tau, 'cascade_lit': share}
        begin_s, _ = light.greatest(bag, bag.table('cascades'))
        frame = np.rint((begin_s + light.FRAMES_S) * RATE_HZ).astype(int)
        found |= light.of_frames(levels[np.minimum(frame, len(levels) - 1)])
    return found


def figures(levels: np.ndarray) -> dict[str, Any]:
    """Return what holds of any light, recorded or recomputed."""
    shape = light.Measure(Table())
    shape.add(levels)
    areas_sr = distinct(np.concatenate([fields(rest_lattice(), eye) for eye in EYES]))
    most = most_in_a_second(levels, areas_sr)
    return shape.figures() | {'most_flashes_per_s': most, 'spectrum': shape.spectrum()}


def recorded(bag: Bag, lit: list[tuple[float, int, bool]]) -> dict[str, Any] | None:
    """Return the columns of the light that `leds` recorded."""
    if not bag.count('led_commands'):
        return None
    at_s, white = light.shown(bag, bag.table('led_commands'))
    rises = []
    for slip_s, block, long in lit:
        first, last = np.searchsorted(at_s, [slip_s - 1e-6, slip_s + WITHIN_S])
        if long and first > 0:
            rises.append(white[first : last + 1, block].max(initial=0) - white[first - 1, block])
    levels = np.concatenate([part for _, part in light.levels(bag)])
    leds = recorded_settings(bag, 'leds')
    tau, share = light.recorded_order(bag)
    frames = light.frames(bag, bag.table('cascades') if bag.count('cascades') else None)
    if frames:
        found_frames = light.of_frames(frames['level'].reshape(light.FRAMES, -1))
    return figures(levels) | (found_frames if frames else {}) | {
        'limit': f'recorded: {getattr(leds, "flash_limit", "not known")}',
        'decay_s': getattr(leds, 'decay_s', float('nan')),
        'raised': float(np.mean(np.array(rises) >= RAISED * 255)) if rises else None,
        'long_slips': len(rises), 'held': None, 'cost_us': None,
        'order_tau': tau, 'cascade_lit': share,
    }  # fmt: skip


class Logged(LocalField):
    """A LocalField that keeps its falls: block, when asked for, when it began, when it ended."""

    def __init__(self, decay_s: float):
        super().__init__(decay_s)
        self.log: list[list[float]] = []
        self._last: dict[int, list[float]] = {}

    def slip(self, now_s: float, block: int) -> None:
        """Light `block`."""
        before_s = self._fall_s[block]
        super().slip(now_s, block)
        if self._fall_s[block] != before_s:
            self._last[block] = [block, now_s, self._fall_s[block], math.inf]
            self.log.append(self._last[block])

    def _ended(self, block: int, at_s: float) -> None:
        super()._ended(block, at_s)
        self._last[block][3] = at_s


def optimum(lit: list[tuple[float, int, bool]]) -> dict[str, Any]:
    """Return how long falls wait, by the limiter and at least, and what either takes.

    At least: a linear programme with the same falls, as long and in the same order, under the same
    rules, which knows all slips beforehand. The limiter takes each fall that lasts as one without
    end, for it knows none that is to come.
    """
    from scipy.optimize import linprog
    from scipy.sparse import coo_matrix

    field, began = Logged(PAPER.decay_s), time.perf_counter()
    for at_s, block, _ in lit:
        field.slip(at_s, block)
    limiter_s = time.perf_counter() - began
    field.levels(lit[-1][0] + 100.0)
    falls = np.array(sorted(field.log, key=lambda fall: fall[2]))
    block, asked_s, begin_s, end_s = falls.T
    lasts_s = end_s - begin_s
    before, after = [], []  # the second of a pair begins `window_s` after the end of the first
    for members, most in [
        *(([b], BLOCK_FALLS) for b in range(N_BLOCKS)),
        *((s, SQUARE_FALLS) for s in squares(Table())),
    ]:
        own = np.flatnonzero(np.isin(block, members))
        for k in range(most, len(own)):
            last = own[:k][np.argsort(end_s[own[:k]], kind='stable')]
            before.append(last[-most])
            after.append(own[k])
    row = np.arange(len(before))
    rules = coo_matrix(
        (np.repeat([1.0, -1.0], len(row)), (np.tile(row, 2), before + after)),
        (len(row), len(falls)),
    )
    began = time.perf_counter()
    bounds = [(at_s, None) for at_s in asked_s]
    least = linprog(np.ones(len(falls)), rules, -lasts_s[before] - field.window_s, bounds=bounds)
    return {
        'falls': len(falls), 'delayed': int((begin_s > asked_s).sum()),
        'limiter_wait_s': float((begin_s - asked_s).sum()),
        'least_wait_s': float(least.fun - asked_s.sum()),
        'limiter_us_a_slip': 1e6 * limiter_s / len(lit),
        'programme_us_a_slip': 1e6 * (time.perf_counter() - began) / len(lit),
    }  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    if args.seeds:

        def rehearsals(first: int) -> dict[str, Any]:
            rows = []
            for seed in track(range(first, first + args.seeds), 'rehearsals', args.seeds):
                lit, pushed_s = rehearsed(seed, args.seconds)
                row = measure(lit, args.seconds, f'field of view, {args.look}')
                row |= {'limit': f'twin, seed {seed}', 'optimum': optimum(lit)}
                rows.append(row | {'many_lit': row.pop('many_s') / pushed_s if pushed_s else None})
            return {'seconds': args.seconds, 'limits': rows}

        held_out.measure(args.seeds_from_time, args.first_seed, rehearsals, args.json, table)
        return 0
    bag = open_bag(args.bag)
    lit = lightings(bag)
    if args.sheet:
        Path(args.sheet).write_text(sheet(bag, lit))
    rows = [measure(lit, bag.duration_s, limit, bag) for limit in LIMITS]
    rows += [row for row in [recorded(bag, lit)] if row]
    found = {
        'lightings': len(lit), 'seconds': bag.duration_s, 'limits': rows, 'optimum': optimum(lit),
    }  # fmt: skip
    tell(found, args.json, table)
    return 0


def table(result: dict[str, Any]) -> str:
    """Return the figures as lines of text."""
    lines = [
        f'{"limit":25}{"decay":>7}{"flash":>14}{"20 lit":>8}{"raised":>9}{"flashes":>9}'
        f'{"space":>7}{"time":>6}{"at limit":>10}{"tau":>7}{"frames":>10}{"cost":>8}'
    ]
    for r in result['limits']:
        many, raised, limited, space, fast, tau = (
            '-' if r.get(name) is None else format(r[name], form)
            for name, form in SOMETIMES.items()
        )
        median_s, p90_s = (r[k] or 0.0 for k in ('flash_median_s', 'flash_p90_s'))  # none: 0
        frames = ' '.join(map(str, r.get('frames_lit', '-')))
        lines.append(
            f'{r["limit"]:25}{r["decay_s"]:5.2f} s{median_s:7.2f}'
            f'{p90_s:5.2f} s{many:>8}{raised:>9}{r["most_flashes_per_s"]:9d}'
            f'{space:>7}{fast:>6}{limited:>10}{tau:>7}'
            f'{frames:>10}' + (f'{r["cost_us"]:5.0f} us' if r['cost_us'] else '')
        )
    if 'lightings' in result:
        lines.insert(0, f'{result["lightings"]} lightings in {result["seconds"]:.0f} s')
    lines += [
        f'{one.get("limit", "field of view, paper")}: {o["delayed"]} of {o["falls"]} falls wait, '
        f'{o["limiter_wait_s"]:.2f} s in all, {o["limiter_us_a_slip"]:.0f} us a slip; with all '
        f'slips known beforehand (linear programme) {o["least_wait_s"]:.2f} s, '
        f'{o["programme_us_a_slip"]:.0f} us'
        for one in (result, *result['limits'])
        if (o := one.get('optimum'))
    ]
    return '\n'.join(lines)
