# SPDX-License-Identifier: Apache-2.0
"""eol bench identity: who stays who under arms, false lights and darkness, against two usual ways.

A stick-slip table (support.stick_slip): the tracker sees images of it, the usual ways simulated
detections. A failure lasts when a
block in full view has a wrong name, or none, for 2 s; then the tracker is told the truth and goes
on. It was declared when the tracker said that the turn is open, or the blocks are lost.
Of a block that goes out of sight under its right name it is told how far from the truth its
predicted place is.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import stats
from support.clutter import LEVELS, Cluttered
from support.paper import N_BLOCKS
from support.stick_slip import Detections, Moment, Onlooker, Table

from benchmarks import held_out
from eol_ros.core.compiled import njit
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.states import TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.errors import UsageError
from eol_ros.settings import TrackerSettings

HELP = 'Measure identity failures per simulated hour, beside nearest neighbour and Hungarian.'
EXAMPLES = [
    'eol bench identity --hours 0.5 --json',
    'eol bench identity --fps 120 --rough 1.4 --permanent 3',
    'eol bench identity --hours 10 --methods eol_ros --seed 7',
    'eol bench identity --hours 1 --seeds 100 --methods eol_ros',
    'eol bench identity --hours 1 --methods eol_ros --seeds-from-time',
    'eol bench identity --hours 1 --methods eol_ros --losses 120 --yaw-offset 0',
]
Figures = dict[str, dict[str, float | None]]  # of each method
LASTING_S = 2.0
OCCLUDED = (1, 6, 30)  # images out of sight after which a block's place is compared with the truth
METHODS = ('eol_ros', 'nearest', 'hungarian')
LAMP_PX = 42  # half width of what is drawn of a false light: three standard deviations


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--hours', type=float, default=0.25, help='simulated time of each seed')
    parser.add_argument('--fps', type=float, default=60.0, help='image rate, Hz')
    parser.add_argument('--seed', type=int, default=1, help='random seed')
    parser.add_argument('--seeds', type=int, default=1, help='number of seeds, from --seed on')
    parser.add_argument(
        '--rough',
        type=float,
        default=1.0,
        help='relative speed of the visitors; 1.4 is very rough',
    )
    parser.add_argument('--permanent', type=int, default=0, help='number of lamps that stay on')
    parser.add_argument('--losses', type=float, default=6.0, help='dark intervals an hour')
    parser.add_argument(
        '--yaw-offset',
        type=float,
        default=2.9,
        help='standard deviation of the yaw offsets of the blocks, degrees',
    )
    parser.add_argument(
        '--covers',
        default='textured',
        choices=('textured', 'alike'),
        help='covers with a texture each, or all alike, so that only places identify the blocks',
    )
    parser.add_argument('--no-taps', action='store_true', help='leave the accelerometers out')
    parser.add_argument('--methods', default=','.join(METHODS), help='methods, separated by commas')
    held_out.add_argument(parser)
    parser.add_argument('--json', action='store_true', help='print the figures as JSON')


def run(args: argparse.Namespace) -> int:
    """Measure, print."""
    if not args.hours > 0 or not args.fps > 0 or args.seeds < 1:
        raise UsageError('--hours, --fps and --seeds must be positive')

    def one(seed: int) -> dict[str, dict[str, float | None]]:
        return measure(
            args.methods.split(','), args.hours, args.fps, seed, args.rough, args.permanent,
            args.losses, not args.no_taps, np.radians(args.yaw_offset), args.covers == 'textured',
        )  # fmt: skip

    def block(first: int) -> dict[str, dict[str, float | None]]:
        if args.seeds == 1:
            return one(first)
        return measure_seeds(one, range(first, first + args.seeds), args.hours)

    held_out.measure(args.seeds_from_time, args.seed, block, args.json, _table)
    return 0


def _cell(value: float | None) -> str:
    return f'{"-":>14}' if value is None else f'{value:14.6g}'


def _table(scores: dict[str, dict]) -> str:
    lines = [f'{"":34}' + ''.join(f'{name:>14}' for name in scores)]
    for key in next(iter(scores.values())):
        lines.append(f'{key:34}' + ''.join(_cell(of[key]) for of in scores.values()))
    return '\n'.join(lines)


class Ours:
    """The tracker, with images that show what the detections do.

    textured: covers have a texture of their own; else all are alike.
    """

    NEAR_M = 0.02  # between a block as it is reported and its detection

    def __init__(self, onlooker: Onlooker, textured: bool = True) -> None:
        level = dataclasses.replace(LEVELS['clean'], texture=LEVELS['hard'].texture * textured)
        self.renderer = Cluttered(level, Calibration.ideal(), 13)
        self.onlooker, self.images = onlooker, 0
        rows, columns = np.mgrid[-LAMP_PX : LAMP_PX + 1, -LAMP_PX : LAMP_PX + 1]
        self.lamp = 150 * np.exp(-(rows**2 + columns**2) / (LAMP_PX / 3) ** 2 / 2)

    def begin(self, xy: np.ndarray) -> None:
        self.tracker = Tracker(TrackerSettings(), self.renderer.calibration)
        self.xy, self.named = xy.copy(), False

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        self.tracker.tap(stamp_s, block, sigma_s)

    def image(self, moment: Moment, seen: Detections) -> np.ndarray:
        """Return the image of a moment, with its arms and false lights; dark without detections."""
        arms = [[*shoulder, *hand, width] for _, shoulder, hand, _, width in self.onlooker.arms]
        self.images += 1
        image = self.renderer.render(
            *moment.xy.T, moment.yaw, self.images, flash=np.zeros(N_BLOCKS),
            ir=np.full(N_BLOCKS, float(len(seen.xy) > 0)), arms=np.reshape(arms, (-1, 5)),
        )  # fmt: skip
        lamps = self.renderer.calibration.to_pixels(seen.xy[seen.true < 0])
        for u, v in np.rint(lamps).astype(int):
            rows = slice(max(v - LAMP_PX, 0), max(v + LAMP_PX + 1, 0))
            columns = slice(max(u - LAMP_PX, 0), max(u + LAMP_PX + 1, 0))
            part = image[rows, columns]
            lamp = self.lamp[rows.start - v + LAMP_PX :, columns.start - u + LAMP_PX :]
            part[:] = np.minimum(part + lamp[: len(part), : part.shape[1]], 255)
        return image

    def update(self, moment: Moment, seen: Detections) -> np.ndarray:
        """Return the detection of each block (25,), -1 for none."""
        found = self.tracker.update(moment.stamp_s, self.image(moment, seen))
        self.ambiguous = found.symmetry_ambiguous or found.state != TRACKING
        if not self.named and found.state == TRACKING:  # it is told which way round the table lies
            turns = self.tracker.table.turned_ids
            apart = [np.nansum(np.abs(found.world - moment.xy[turn])) for turn in turns]
            self.tracker.follower.turn(int(np.argmin(apart)))
            self.named = True
            return np.full(N_BLOCKS, -1)
        known = np.isfinite(found.world[:, 0])
        self.xy[known] = found.world[known]
        index = np.full(N_BLOCKS, -1)
        if not len(seen.xy) or found.state != TRACKING:
            return index
        for block in np.flatnonzero(found.seen):
            far = np.hypot(*(seen.xy - found.world[block]).T)
            index[block] = far.argmin() if far.min() < self.NEAR_M else -1
        return index


class Slots:
    """The usual way: 25 slots, each follows the detection that is nearest, or cheapest in all.

    Gates and memory are tuned on this simulator; `hungarian` predicts with constant velocity.
    """

    GATE_M = 0.06  # one that grows brought more switches

    def __init__(self, hungarian: bool):
        self.hungarian = hungarian
        self.ambiguous = False

    def begin(self, xy: np.ndarray) -> None:
        self.xy, self.velocity = xy.copy(), np.zeros_like(xy)
        self.seen_s = np.zeros(N_BLOCKS)

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """A camera-only tracker hears nothing."""

    def update(self, moment: Any, seen: Any) -> np.ndarray:
        """Return the detection of each slot (25,), or -1: the followed first, then the lost."""
        expected = self.xy + self.velocity if self.hungarian else self.xy.copy()
        index = np.full(N_BLOCKS, -1)
        lost_s = moment.stamp_s - self.seen_s
        followed = lost_s < 0.03
        for slots in (np.flatnonzero(followed), np.flatnonzero(~followed)):
            free = np.setdiff1d(np.arange(len(seen.xy)), index)
            if slots.size and free.size:
                apart = expected[slots][:, None] - seen.xy[free][None]
                far = np.hypot(apart[..., 0], apart[..., 1]) / self.GATE_M
                for slot, light in self._pairs(far):
                    index[slots[slot]] = free[light]
        held = index >= 0
        self.velocity *= 0.5  # coasts a little, then waits where it is
        self.velocity[held] = seen.xy[index[held]] - self.xy[held]
        self.xy = expected
        self.xy[held] = seen.xy[index[held]]
        self.seen_s[held] = moment.stamp_s
        return index

    def _pairs(self, far: np.ndarray) -> list[tuple[int, int]]:
        """Return the pairs of rows and columns of `far`, in units of the gate, that belong."""
        from scipy.optimize import linear_sum_assignment

        if self.hungarian:
            rows, columns = linear_sum_assignment(np.minimum(far, 1.0) ** 2)
            return [(r, c) for r, c in zip(rows, columns, strict=True) if far[r, c] < 1.0]
        pairs: list[tuple[int, int]] = []
        rows, columns = np.nonzero(far < 1.0)
        for k in np.argsort(far[rows, columns], kind='stable'):
            if all(rows[k] != r and columns[k] != c for r, c in pairs):
                pairs.append((int(rows[k]), int(columns[k])))
        return pairs


def make(name: str, onlooker: Onlooker, textured: bool = True) -> Any:
    return Ours(onlooker, textured) if name == 'eol_ros' else Slots(name == 'hungarian')


class Score:
    """What one tracker did."""

    def __init__(self) -> None:
        self.shown = self.missed = self.wrong = self.switches = self.hidden = self.ghosts = 0
        self.sure_wrong = self.sure_switches = 0  # while it did not say that the turn is open
        self.lasting = self.undeclared = self.open_images = 0
        self.was_declared = False
        self.last = np.full(N_BLOCKS, -1)
        self.wrong_since = np.full(N_BLOCKS, np.inf)
        self.spent = 0.0
        self.switch_times: list[float] = []
        self.out_of_sight = np.full(N_BLOCKS, -1)  # images; -1: under a wrong name before
        self.occluded_m: dict[int, list[float]] = {images: [] for images in OCCLUDED}

    def compare_occluded(
        self, moment: Any, true: np.ndarray, index: np.ndarray, xy: np.ndarray
    ) -> None:
        """Take where blocks (25, 2) are believed to be in one image; see add."""
        held = index >= 0
        right = held.copy()
        right[held] = true[index[held]] == np.flatnonzero(held)
        known = ~held & (self.out_of_sight >= 0)
        self.out_of_sight = np.where(right, 0, np.where(known, self.out_of_sight + 1, -1))
        for images, far in self.occluded_m.items():
            now = self.out_of_sight == images
            far += np.hypot(*(xy[now] - moment.xy[now]).T).tolist()

    def add(self, now: float, true: np.ndarray, index: np.ndarray, declared: bool) -> bool:
        """Take one image: `true` names each detection. Return whether a failure has lasted."""
        shown, missed, wrong, ghosts, changed = _compare(
            now, true, index, self.last, self.wrong_since
        )
        self.shown += shown
        self.hidden += N_BLOCKS - shown
        self.missed += missed
        self.wrong += wrong
        self.ghosts += ghosts
        self.switches += changed
        self.sure_wrong += wrong * (not declared)
        # the image in which an open turn is settled renames all, as was announced
        self.sure_switches += changed * (not declared and not self.was_declared)
        self.was_declared = declared
        if changed:
            self.switch_times.append(now)
        self.open_images += declared
        if now - self.wrong_since.min() <= LASTING_S:
            return False
        self.lasting += 1
        self.undeclared += not declared
        self.wrong_since[:] = np.inf
        self.last[:] = -1
        return True

    def figures(self, hours: float, images: int) -> dict[str, float | None]:
        occluded = {
            f'occluded_{count}_images_{name}_mm': 1e3 * float(np.quantile(far, q)) if far else None
            for count, far in self.occluded_m.items()
            for name, q in (('median', 0.5), ('99_percent', 0.99))
        }
        return {
            'switches_per_hour': self.switches / hours,
            'mislabelled_percent': 100 * self.wrong / self.shown,
            'undeclared_switches_per_hour': self.sure_switches / hours,
            'undeclared_mislabelled_percent': 100 * self.sure_wrong / self.shown,
            'missed_percent': 100 * self.missed / self.shown,
            'lasting_failures_per_hour': self.lasting / hours,
            'undeclared_per_hour': self.undeclared / hours,
            'false_lights_taken_for_blocks': self.ghosts / max(self.hidden, 1),
            'hidden_percent': 100 * self.hidden / (self.hidden + self.shown),
            'turn_open_percent': 100 * self.open_images / images,
            'us_per_image': 1e6 * self.spent / images,
            **occluded,
        }


@njit(cache=True)
def _compare(now, true, index, last, wrong_since):
    """Compare names (25,) given to detections with the true ones; renew last and wrong_since (25,).

    Returns how many blocks were shown, missed, under a wrong name, how many names were given to
    false lights, and how many names changed.
    """
    got = np.full(N_BLOCKS, -1)
    shown = missed = wrong = ghosts = changed = 0
    for block in range(N_BLOCKS):
        if index[block] >= 0:
            name = true[index[block]]
            if name < 0:
                ghosts += 1
            else:
                got[name] = block
    poor = np.zeros(N_BLOCKS, np.bool_)
    for name in true:
        if name < 0:
            continue
        mine = got[name]
        shown += 1
        poor[name] = mine != name
        if mine < 0:
            missed += 1
            continue
        wrong += mine != name
        changed += last[name] >= 0 and last[name] != mine
        last[name] = mine
    for name in range(N_BLOCKS):
        wrong_since[name] = min(wrong_since[name], now) if poor[name] else np.inf
    return shown, missed, wrong, ghosts, changed


def measure(
    methods: list[str],
    hours: float,
    fps: float,
    seed: int,
    rough: float = 1.0,
    permanent: int = 0,
    losses_per_hour: float = 6.0,
    taps: bool = True,
    askew_rad: float = 0.05,
    textured: bool = True,
) -> dict[str, dict[str, float | None]]:
    """Run all `methods` over the same simulated hours and return their figures."""
    table = Table(seed, fps, rough, askew_rad=askew_rad)
    onlooker = Onlooker(seed, permanent=permanent, losses_per_hour=losses_per_hour)
    trackers = {name: make(name, onlooker, textured) for name in methods}
    scores = {name: Score() for name in methods}
    images = round(hours * 3600 * fps)
    for tracker in trackers.values():
        tracker.begin(table.xy)
    heard = 0
    for k in range(images):
        moment = table.step()
        seen = onlooker.look(moment)
        knocks = onlooker.listen(table.begun[heard:])
        heard = len(table.begun)
        for name, tracker in trackers.items():
            if taps:
                for stamp_s, block in knocks:
                    tracker.tap(stamp_s, block, 0.008)
            begun = time.perf_counter()
            index = tracker.update(moment, seen)
            score = scores[name]
            score.spent += time.perf_counter() - begun
            score.compare_occluded(moment, seen.true, index, tracker.xy)
            if score.add(moment.stamp_s, seen.true, index, tracker.ambiguous):
                tracker.begin(moment.xy)
        if images >= 10 and k % (images // 10) == 0 and k:
            print(f'{100 * k // images} %', file=sys.stderr, flush=True)
    return {name: score.figures(hours, images) for name, score in scores.items()}


def measure_seeds(one: Callable[[int], Figures], seeds: range, hours: float) -> Figures:
    """Return what `one` measures by all `seeds`, so many hours each, together."""
    found = []
    for done, seed in enumerate(seeds, 1):
        found.append(one(seed))
        lasting = sum(of['lasting_failures_per_hour'] > 0 for of in found[-1].values())
        said = 'a lasting failure' if lasting else 'no lasting failure'
        print(f'seed {seed}, {done} of {len(seeds)}: {said}', file=sys.stderr, flush=True)
    return together(found, hours)


def together(pieces: list[Figures], hours: float) -> Figures:
    """Return means of the figures of `pieces`, each of so many hours, and what failed in all."""
    total, result = hours * len(pieces), {}
    for name in pieces[0]:
        of = [piece[name] for piece in pieces]
        figures = {key: _mean([one[key] for one in of]) for key in of[0]}
        lasting = round(figures['lasting_failures_per_hour'] * total)
        result[name] = figures | {
            'hours': total,
            'switches_per_hour_most': max(one['switches_per_hour'] for one in of),
            'lasting_failures': lasting,
            # Garwood 1936, one side
            'lasting_per_hour_below_95': float(stats.chi2.ppf(0.95, 2 * lasting + 2) / 2 / total),
        }
    return result


def _mean(of: list[float | None]) -> float | None:
    """Return the mean of those that were measured."""
    known = [one for one in of if one is not None]
    return float(np.mean(known)) if known else None
