# SPDX-License-Identifier: Apache-2.0
"""eol track: the tracker and the motion node over recorded images, to the bit as they run live."""

import json
import re
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros import scene as scenes
from eol_ros.cli import within
from eol_ros.errors import ConfigError

HELP = 'Track the blocks in a .npy stack, a video, a folder of images or a bag.'
EXAMPLES = [
    'eol track images.npy --fps 60 --output answer.npz --json',
    'eol track film.mp4 --calibration table.yaml --output answer.npz',
    'eol track film.mkv --stamps film.txt --output answer.npz',
    'eol track bags/2026-11-21 --output answer.npz',
]
SLIP = [
    ('slip', 'u4'), ('block', 'u1'), ('onset_s', 'f8'), ('onset_sigma_s', 'f8'),
    ('start_stamp_s', 'f8'), ('stop_stamp_s', 'f8'), ('duration_s', 'f8'), ('distance_m', 'f8'),
    ('speed_mps', 'f8'), ('x', 'f8'), ('y', 'f8'), ('cascade', 'u4'), ('tapped', '?'),
]  # fmt: skip
CASCADE = [
    ('cascade', 'u4'),
    ('onset_s', 'f8'),
    ('duration_s', 'f8'),
    ('nucleus', 'u1'),
    ('area', 'u1'),
    ('size', 'u2'),
    ('distance_m', 'f8'),
]  # and `blocks`: for each place, whether its block slipped


def add_arguments(parser):
    """Declare the command line."""
    parser.add_argument('frames', metavar='FRAMES', help='.npy stack, video, folder or bag')
    parser.add_argument(
        '--fps', type=within(1e-3, 10000), help='images a second (default: of the video, or 60)'
    )
    parser.add_argument(
        '--stamps', metavar='FILE',
        help='time of each image instead of --fps, for videos with dropped images: mid-exposure, '
             'one a line, in seconds with a decimal point or in whole nanoseconds',
    )  # fmt: skip
    parser.add_argument(
        '--calibration', metavar='C.yaml',
        help='calibration of this camera (default: estimated from the blocks at rest)',
    )  # fmt: skip
    parser.add_argument(
        '--mirror', action='store_true',
        help='the camera sees the table in a mirror; not needed with --calibration',
    )  # fmt: skip
    parser.add_argument(
        '--scene',
        metavar='SCENE',
        help='scene with the table (default: that of the bag or calibration)',
    )
    parser.add_argument('-o', '--output', metavar='ANS.npz', help='file for the result')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args) -> int:
    """Track, write, tell."""
    from eol_ros.core.motion.felt import Knock
    from eol_ros.core.motion.motion import Motion
    from eol_ros.core.table import Table, check_same
    from eol_ros.core.vision.states import TRACKING
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.devices.bag.reader import table_in
    from eol_ros.devices.camera.image_sequence import open_source
    from eol_ros.settings import MotionSettings, TrackerSettings
    from eol_ros.verbs.progress import track

    source = open_source(args.frames, args.fps, args.stamps)
    if args.output and not Path(args.output).absolute().parent.is_dir():
        raise ConfigError(f'{args.output}: there is no such folder')
    recorded = table_in(source.about.get('settings', ''))
    wanted = scenes.load(args.scene).table if args.scene else recorded
    if recorded and wanted:
        check_same(recorded, wanted, args.frames, args.scene, 'leave out --scene')
    table = Table.of(wanted) if wanted else None
    calibration = _calibration(args.calibration, args.mirror, table)
    tracker = Tracker(TrackerSettings(mirror=args.mirror), calibration, table)
    table = tracker.table
    tracker.warm_up()
    motion = Motion(MotionSettings(), table)
    for tap in source.taps:
        tracker.tap(*tap)
        motion.tap(Knock(round(tap[0] * 1e9), *tap[1:]))
    oddities, events = _Oddities(tracker), _Events()
    spent: list[float] = []
    rows: list[Any] = []
    for stamp_s, image in track(source.read(), 'tracking', total=source.count):
        if not rows:
            _check_size(tracker, image, args.frames)
            oddities.first(stamp_s, image)
        begun = time.perf_counter()
        tracked = tracker.update(stamp_s, image)
        spent.append(time.perf_counter() - begun)
        rows.append(tracked)
        oddities.look(tracked)
        x, y = tracked.world.T
        seen = tracked.seen & (tracked.state == TRACKING)
        events.add(*motion.update(stamp_s, x, y, seen, tracked.sigma_m))
    for note in source.notes:
        print(note, file=sys.stderr)
    if not rows:
        raise ConfigError(f'{args.frames}: no image in it')
    events.finish(motion.cascades.finish(rows[-1].stamp_s))
    answer = _answer(rows, events.slips, events.cascades, tracker.cover_height_m())
    if args.output:
        np.savez_compressed(args.output, **answer)
    summary = _summary(rows, spent, answer)
    if args.json:
        print(json.dumps(summary))
    else:
        print('\n'.join(f'{k:10} {v}' for k, v in summary.items()))
    return 0


def _check_size(tracker, image, path) -> None:
    if tracker.calibration is None:
        return
    try:
        tracker.calibration.check_image(image)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None


def _summary(rows: list, spent: list, answer: dict) -> dict:
    """Return the figures of a run; `spent`: seconds in the tracker, of each image."""
    from eol_ros.core.vision.states import STATES

    ms = np.array(spent) * 1e3
    return {
        'frames': len(rows),
        'ms_median': round(float(np.median(ms)), 4),
        'ms_p99': round(float(np.percentile(ms, 99)), 4),
        'coverage': round(float(answer['visible'].mean()), 6),
        'slips': len(answer['slips']),
        'cascades': len(answer['cascades']),
        'states': {STATES[s]: n for s, n in sorted(Counter(r.state for r in rows).items())},
        'ambiguous': int(sum(r.symmetry_ambiguous for r in rows)),
    }


class _Oddities:
    """What people should know of the images while they are tracked: a line on stderr, once each."""

    def __init__(self, tracker):
        from eol_ros.core.vision.image_health import Sizes

        self._tracker = tracker
        self._sizes = Sizes(tracker.calibration) if tracker.calibration is not None else None
        self._reasons: set[str] = set()  # why nothing was tracked
        self._changed: set[int] = set()  # blocks with another cover

    def first(self, stamp_s: float, image: np.ndarray) -> None:
        """Look at the exposure of the first image."""
        from eol_ros.core.vision.lens import FULL_SHARE, light

        seen = light(image)
        if seen.saturated > FULL_SHARE and seen.level > seen.dark:
            _say(
                stamp_s,
                f'{seen.saturated:.0%} of what is bright is saturated: blocks look larger, and '
                'flashes are lost; expose less',
            )

    def look(self, tracked) -> None:
        """Look at what the tracker says of an image."""
        from eol_ros.core.vision.states import STATES, TRACKING

        reason = re.sub(r'\d+', '', tracked.why)  # how many lights it sees is no news
        if tracked.state != TRACKING and reason not in self._reasons:
            self._reasons.add(reason)
            _say(tracked.stamp_s, f'{STATES[tracked.state]}: {tracked.why}')
        if tracked.state == TRACKING and not tracked.symmetry_ambiguous:
            self._look_at_sizes(tracked)
        if new := set(tracked.changed) - self._changed:
            self._changed |= new
            _say(
                tracked.stamp_s,
                f'other covers than before on blocks {", ".join(map(str, sorted(new)))}: '
                'their names stay, and these covers are learnt from now on',
            )

    def _look_at_sizes(self, tracked) -> None:
        sizes = self._sizes
        if sizes and sizes.add(tracked.world, self._tracker.sides_px, tracked.visibility):
            self._sizes = None
            if fault := sizes.fault():
                _say(tracked.stamp_s, fault)


def _say(stamp_s: float, text: str) -> None:
    print(f'{stamp_s:.3f} s: {text}', file=sys.stderr)


def _calibration(path, mirror, table):
    if not path:
        return None
    from eol_ros.devices.files import calibration_file

    return calibration_file.load(path, mirror, table)


class _Events:
    """Rows of slips, of START and STOP joined, and cascades, as they come."""

    def __init__(self):
        self.slips: list[tuple] = []
        self.cascades: list[Any] = []
        self._starts: dict[int, Any] = {}  # by slip: those that still move

    def add(self, slips: list, cascades: list) -> None:
        """Take in what one image has brought."""
        from eol_ros.core.motion.slips import START

        for slip in slips:
            if slip.event.kind == START:
                self._starts[slip.event.slip] = slip
            else:
                self.slips.append(_row(self._starts.pop(slip.event.slip), slip))
        self.cascades += cascades

    def finish(self, cascades: list) -> None:
        """End with `cascades`, and with what still moved when the images ended."""
        self.slips += [_row(start, None) for start in self._starts.values()]
        self.cascades += cascades


def _row(start, stop) -> tuple:
    event = (stop or start).event
    return (
        event.slip, event.block, event.onset_s, event.onset_sigma_s, start.event.stamp_s,
        event.stamp_s if stop else np.nan, event.duration_s if stop else np.nan,
        event.distance_m, event.speed_mps, event.x, event.y, (stop or start).cascade,
        bool(stop and stop.tapped),
    )  # fmt: skip


def _answer(rows: list, slips: list, cascades: list, height_m: float) -> dict:
    """Return the arrays of the answer file; see docs."""
    seen = np.array([r.seen for r in rows])
    px = np.array([r.px for r in rows])
    world = np.array([r.world for r in rows])
    table = np.array(sorted(slips, key=lambda row: (row[2], row[1])), SLIP)
    cells = seen.shape[1]
    falls = np.zeros(len(cascades), [*CASCADE, ('blocks', '?', cells)])
    for k, c in enumerate(cascades):
        blocks = np.isin(np.arange(cells), c.blocks)
        falls[k] = (
            c.cascade, c.onset_s, c.duration_s, c.nucleus, c.area, c.size, c.distance_m, blocks,
        )  # fmt: skip
    return {
        'time': np.array([r.stamp_s for r in rows]),
        'px': np.where(seen[..., None], px, np.nan),
        'yaw': np.array([np.where(np.isfinite(r.px[:, 0]), r.yaw, np.nan) for r in rows]),
        'world': np.concatenate([world, np.full((*world.shape[:2], 1), height_m)], axis=2),
        'visible': seen,
        'visibility': np.array([r.visibility for r in rows]),
        'sigma': np.array([r.sigma_m for r in rows]),
        'state': np.array([r.state for r in rows], np.uint8),
        'ambiguous': np.array([r.symmetry_ambiguous for r in rows]),
        'onset': np.column_stack([table['onset_s'], table['block']]).reshape(-1, 2),
        'slips': table,
        'cascades': falls,
    }
