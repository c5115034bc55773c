# SPDX-License-Identifier: Apache-2.0
"""eol bench tables: processor time of each part and errors of the tracker, by size of the table.

The tables are square, have blocks of 84 mm, and are moved by simulated visitors. An ideal camera
shows the whole platform, so blocks of a larger table are smaller in the image. Columns:

    px            side of a block in the image
    twin ... bag  processor time of each part for an image, ms, median; of the bag: of a message
    start         from the first image until all blocks are named, images
    whole         share of the blocks, over all images, that are seen
    mm            error of a place, RMS
    names         images in which a block is more than a quarter pitch from its place
    recall        share of the true slips of 1 mm and more, after a rest of 0.2 s, that have a START
                  within 0.1 s
    precision     share of the STARTs within 0.1 s of a true motion of their block
    kB/s          size of `blocks` at 60 images a second, in a bag before compression
"""

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import plots
from benchmarks.machine import tell
from eol_ros.core.light.local import LocalField
from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START
from eol_ros.core.physics.twin.play import Play
from eol_ros.core.sound.corpus import GRAIN, Corpus, Source
from eol_ros.core.sound.select import Selector
from eol_ros.core.table import Table
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.states import TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import UsageError
from eol_ros.ros.definitions import definition
from eol_ros.settings import GrainsSettings, LedsSettings, MotionSettings, TrackerSettings
from eol_ros.streams import blocks
from eol_ros.verbs.progress import track

HELP = 'Measure cost of each part, and errors of tracker and slips, for 3 x 3 to 15 x 15 blocks.'
EXAMPLES = [
    'eol bench tables --plot docs/img/tables.png',
    'eol bench tables --sides 3,5,8 --seconds 60 --json',
]
FPS = 60
REST_S, NEAR_S, LEAST_M = 0.2, 0.1, 1e-3
PARTS = ('twin', 'tracker', 'motion', 'grains', 'light', 'bag')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--sides', default='3,5,8,12,15', help='blocks along a side, with commas')
    parser.add_argument('--seconds', type=float, default=20.0, help='duration of each table')
    parser.add_argument('--seed', type=int, default=1, help='random seed')
    parser.add_argument('--plot', metavar='FILE.png', help='draw time against blocks there')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    sides = [word.strip() for word in args.sides.split(',')]
    if not all(side.isdecimal() and 2 <= int(side) <= 15 for side in sides):
        raise UsageError(f'--sides {args.sides}: numbers from 2 to 15, with commas')
    rows = [measure(int(side), args.seconds, args.seed) for side in track(sides, 'tables')]
    tell({'rows': rows}, args.json, table_of)
    if args.plot:
        curves = {n: [(row['blocks'], row[n], 0.0, '') for row in rows] for n in PARTS}
        title, axes = 'processor time of each part', ('blocks', 'ms an image')
        plots.draw(Path(args.plot), {title: curves}, *axes)
    return 0


def square(side: int) -> Table:
    """Return a table of side x side blocks on a platform with as much room around the rim."""
    usual, rim_m = Table(), Table(rows=side, columns=side, platform_m=(9.0, 9.0)).rim_m()[0]
    room_m = usual.platform_m[0] - usual.rim_m()[0]
    return Table(rows=side, columns=side, platform_m=(rim_m + room_m, rim_m + room_m))


def grains(count: int = 480) -> Corpus:
    """Return grains all over the space."""
    found = np.zeros(count, GRAIN)
    found['x'], found['y'] = np.random.default_rng(1).random((2, count))
    found['duration_s'] = 0.25
    return Corpus((Source('ice.wav', 48000, 100.0, ''),), found)


def measure(side: int, seconds: float, seed: int) -> dict[str, Any]:
    """Return the figures of one table."""
    table = square(side)
    camera = Calibration.ideal(table=table)
    play, renderer = Play(seed, 0, None, table), Renderer(RenderOptions(), camera, seed)
    tracker, motion = Tracker(TrackerSettings(), camera), Motion(MotionSettings(), table)
    selector = Selector(GrainsSettings(), grains(), table)
    light = LocalField(LedsSettings().decay_s, table=table)
    codec = blocks.Codec(definition(blocks.TYPE), cells=table.cells)
    tracker.warm_up()
    spent: dict[str, list[float]] = defaultdict(list)

    def timed(name: str, call: Any, *args: Any) -> Any:
        begin = time.thread_time_ns()
        found = call(*args)
        spent[name].append((time.thread_time_ns() - begin) * 1e-6)
        return found

    places, moving, seen, off_m, starts, named = [], [], [], [], [], None
    size = 0
    for k in range(round(seconds * FPS)):
        stamp_s = k / FPS
        timed('twin', play.advance, 1 / FPS)
        t = play.table
        image = renderer.render(t.x, t.y, t.yaw, k, velocity=t.velocity).copy()
        found = timed('tracker', tracker.update, stamp_s, image)
        known = found.seen & (found.state == TRACKING)
        slips, _ = timed('motion', motion.update, stamp_s, *found.world.T, known, found.sigma_m)
        timed('grains', selector.update, stamp_s, *found.world.T, known, found.sigma_m)
        begun = [one.event for one in slips if one.event.kind == START]
        timed('light', _lit, light, stamp_s, begun)
        rows = blocks.rows_of(found, codec.rows)
        size = len(timed('bag', codec.pack, k, found.state, False, k, rows))
        starts += [(event.onset_s, event.block) for event in begun]
        at = np.column_stack([t.x, t.y])
        places.append(at)
        moving.append(t.moving.copy())
        seen.append(known)
        off_m.append(np.hypot(*(found.world - at).T))
        if named is None and known.all():
            named = k
    off, sight = np.array(off_m), np.array(seen)
    recall, precision = _slips(np.array(places), np.array(moving), starts)
    return {
        'side': side, 'blocks': table.count, 'px': camera.px_per_m() * table.block_side_m,
        **{name: float(np.median(spent[name])) for name in PARTS}, 'start': named,
        'whole': float(sight.mean()), 'mm': 1e3 * float(np.sqrt((off[sight] ** 2).mean())),
        'names': int((np.where(sight, off, 0.0) > min(table.pitch_m) / 4).any(axis=1).sum()),
        'recall': recall, 'precision': precision, 'slips': len(starts),
        'kb_per_s': size * FPS / 1e3,
    }  # fmt: skip


def _lit(light: LocalField, stamp_s: float, begun: list[Any]) -> None:
    for event in begun:
        light.slip(stamp_s, event.block)
    light.levels(stamp_s)


def _slips(
    places: np.ndarray, moving: np.ndarray, starts: list[tuple[float, int]]
) -> tuple[float, float]:
    """Return recall and precision of STARTs against true motion (images, blocks)."""
    near, rest = round(NEAR_S * FPS), round(REST_S * FPS)
    true, met = 0, 0
    told = defaultdict(list)
    for onset_s, block in starts:
        told[block].append(onset_s)
    for block in range(moving.shape[1]):
        on = moving[:, block]
        for k in np.flatnonzero(on[1:] & ~on[:-1]) + 1:
            end = k + int(np.argmin(np.append(on[k:], False)))
            far = np.hypot(*(places[min(end, len(on) - 1), block] - places[k - 1, block]))
            if k < rest or on[k - rest : k].any() or far < LEAST_M:
                continue
            true += 1
            met += any(abs(onset_s - k / FPS) <= NEAR_S for onset_s in told[block])
    right = sum(
        moving[max(round(s * FPS) - near, 0) : round(s * FPS) + near + 1, block].any()
        for s, block in starts
    )
    return met / max(true, 1), right / max(len(starts), 1)


def table_of(result: dict[str, Any]) -> str:
    """Return the figures as Markdown."""
    names = ('blocks', 'px', *PARTS, 'start', 'whole', 'mm', 'names', 'recall', 'precision', 'kB/s')
    lines = [f'| {" | ".join(names)} |', '|' + ' --- |' * len(names)]
    for row in result['rows']:
        values = [row['blocks'], f'{row["px"]:.0f}', *(f'{row[name]:.3g}' for name in PARTS)]
        values += [row['start'], f'{row["whole"]:.4f}', f'{row["mm"]:.3f}', row['names']]
        values += [f'{row["recall"]:.3f}', f'{row["precision"]:.3f}', f'{row["kb_per_s"]:.0f}']
        lines.append(f'| {" | ".join(map(str, values))} |')
    return '\n'.join(lines)
