# SPDX-License-Identifier: Apache-2.0
"""Slips of the twin against what the motion node finds in them.

The twin's event solver says when each block broke loose and came to rest. Its places are given to
`Motion` with white noise of NOISE_M, which is what the tracker makes of the twin's images (9 um an
axis, at rest and in motion alike: `rendered` draws and tracks them instead, and prints it).

`recall` asks for a START of every slip whose rest before it held at least two images. A detection
is right when its onset lies within 0.05 s of that of a true slip which no other detection has
named. Intervals are Wilson's (95 %).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from support.paper import N_BLOCKS
from support.true_slips import wilson

from eol_ros.core.motion.noise import exceedance
from eol_ros.core.motion.slips import START, SlipDetector
from eol_ros.core.physics.twin.live import Coupling
from eol_ros.core.physics.twin.play import Play
from eol_ros.errors import UsageError
from eol_ros.settings import MotionSettings

NOISE_M = 9e-6
SLIDING_MPS = 0.3
NEAR_S = 0.05
LEARN_S, TAIL_S = 2.0, 1.0  # out of account: the noise is learnt, what begins last is cut off


@dataclass(frozen=True)
class TrueSlip:
    """One slip of the twin, s; `rest_images`: how many images the rest before it held."""

    onset_s: float
    end_s: float
    block: int
    rest_s: float
    rest_images: int


class Rehearsal:
    """The twin's table under `hands`: visitors, or sliding (a rim that is led at 0.3 m/s)."""

    def __init__(
        self, seed: int, fps: float, hands: str = 'visitors', coupling: Coupling | None = None
    ):
        self.fps, self.hands = fps, hands
        self.play = Play(seed, coupling=coupling)
        self.table = self.play.table
        self.random, self.led, self.until_s = np.random.default_rng([seed, 5]), np.zeros(3), 0.0
        self.events: list[tuple[float, int, bool]] = []  # time, block, begins

    def images(self, count: int) -> Iterator[float]:
        """Move on image by image; yield the stamp of each, in s."""
        log = self.table._ledger.log
        for k in range(count):
            end_s = (k + 1) / self.fps
            if self.hands != 'visitors':
                if end_s > self.until_s:  # somewhere else, at full speed, and turning
                    self.until_s += 0.35
                    way = self.random.uniform(0, 2 * np.pi)
                    self.led[:2] = SLIDING_MPS * np.cos(way), SLIDING_MPS * np.sin(way)
                    self.led[2] = self.random.uniform(-0.9, 0.9)
                self.play.commands.take(end_s, self.hands, self.led, 1.0)
            log.start[:] = -1
            begin_s = self.play.advance(1 / self.fps, self.hands == 'visitors')
            self.events += [
                (begin_s + float(log.t[i]), int(log.block[i]), bool(log.start[i]))
                for i in np.flatnonzero(log.start >= 0)
            ]
            yield self.play.time_s

    def slips(self) -> list[TrueSlip]:
        """Return the slips so far, in the order of their onsets."""
        found: list[TrueSlip] = []
        ended = np.full(N_BLOCKS, -np.inf)
        begun: dict[int, float] = {}

        def add(block: int, end_s: float) -> None:
            onset_s, rest_s = begun[block], begun.pop(block) - ended[block]
            images = 10**6
            if np.isfinite(rest_s):
                last, first = onset_s * self.fps + 1e-9, ended[block] * self.fps - 1e-9
                images = int(np.floor(last) - np.ceil(first)) + 1
            found.append(TrueSlip(onset_s, end_s, block, float(rest_s), images))
            ended[block] = end_s

        for time_s, block, begins in sorted(self.events, key=lambda e: e[0]):
            if begins:
                begun[block] = time_s
            elif block in begun:
                add(block, time_s)
        for block in list(begun):
            add(block, np.inf)
        return sorted(found, key=lambda slip: slip.onset_s)


class Difference:
    """The peer: a block moves while two successive images differ, at the same false alarms."""

    def __init__(self, fps: float, sigma_m: float):
        chance = exceedance(MotionSettings().false_alarms_per_hour, N_BLOCKS * fps)
        self.limit_m = np.sqrt(-4.0 * np.log(chance)) * sigma_m
        self.fps, self.moving = fps, np.zeros(N_BLOCKS, bool)
        self.before: np.ndarray | None = None

    def update(self, stamp_s: float, xy: np.ndarray) -> list[tuple[int, float, float]]:
        """Return block, onset and stamp, in s, of what begins in this image of (25, 2) m."""
        begun = []
        if self.before is not None:
            moving = np.hypot(*(xy - self.before).T) > self.limit_m
            half = 0.5 / self.fps
            begun = [
                (int(b), stamp_s - half, stamp_s) for b in np.flatnonzero(moving & ~self.moving)
            ]
            self.moving = moving
        self.before = xy
        return begun


def measure(
    fps: float,
    seconds: float,
    seed: int,
    hands: str = 'visitors',
    rendered: bool = False,
    coupling: Coupling | None = None,
) -> list[dict[str, Any]]:
    """Return one row of figures for the motion node, one for the peer; times in ms."""
    rehearsal = Rehearsal(seed, fps, hands, coupling)
    seen_by = _tracked(rehearsal, seed) if rendered else _noisy(rehearsal, seed)
    detector, peer = SlipDetector(MotionSettings()), Difference(fps, NOISE_M)
    ours: list[tuple[int, float, float]] = []
    theirs: list[tuple[int, float, float]] = []
    errors = []
    for k, stamp_s in enumerate(rehearsal.images(round(seconds * fps))):
        xy, seen, sigma = seen_by(k, stamp_s)
        x, y = xy.T
        for event in detector.update(stamp_s, x, y, seen, sigma):
            if event.kind == START:
                ours.append((event.block, event.onset_s, event.stamp_s))
        theirs += peer.update(stamp_s, xy)
        off = (xy - np.stack([rehearsal.table.x, rehearsal.table.y], 1))[seen]
        errors.append(np.sqrt(np.mean(off**2)) if len(off) else 0.0)
    what = {
        'hands': hands, 'images': 'rendered' if rendered else 'noise', 'fps': fps,
        'noise_um': 1e6 * float(np.sqrt(np.mean(np.square(errors)))),
    }  # fmt: skip
    truth, span = rehearsal.slips(), (LEARN_S, seconds - TAIL_S)
    return [
        what | {'method': name} | compare(found, truth, fps, span)
        for name, found in (('eol_ros', ours), ('difference', theirs))
    ]


def compare(
    found: list[tuple[int, float, float]],
    truth: list[TrueSlip],
    fps: float,
    span: tuple[float, float],
) -> dict[str, Any]:
    """Compare `found` (block, onset, stamp, in s) with `truth` within `span`, in s."""
    of_block: list[list[TrueSlip]] = [[] for _ in range(N_BLOCKS)]
    for slip in truth:
        of_block[slip.block].append(slip)
    named: set[TrueSlip] = set()
    errors, latency, false = [], [], 0
    for block, onset_s, stamp_s in found:
        near = [
            s for s in of_block[block]
            if abs(s.onset_s - onset_s) < NEAR_S and s not in named
        ]  # fmt: skip
        inside = span[0] < stamp_s < span[1]
        if not near:
            false += inside
            continue
        slip = min(near, key=lambda s: abs(s.onset_s - onset_s))
        named.add(slip)
        if inside:
            errors.append(1e3 * (onset_s - slip.onset_s))
            latency.append((stamp_s - slip.onset_s) * fps)
    asked = [s for s in truth if s.rest_images >= 2 and span[0] < s.onset_s < span[1]]
    hits = sum(s in named for s in asked)
    right = len(errors)
    if not hits or not right:
        raise UsageError(
            f'{len(asked)} slips from {span[0]:.0f} to {span[1]:.0f} s: measure for longer'
        )
    return {
        'slips': len(asked), 'recall': hits / len(asked),
        'recall_low': wilson(hits, len(asked))[0],
        'precision': right / max(right + false, 1),
        'precision_low': wilson(right, right + false)[0],
        'start_rms_ms': float(np.sqrt(np.mean(np.square(errors)))),
        'start_p95_ms': float(np.percentile(np.abs(errors), 95)),
        'latency_images_p50': float(np.median(latency)),
        'latency_images_p95': float(np.percentile(latency, 95)),
    }  # fmt: skip


def _noisy(rehearsal: Rehearsal, seed: int):
    random = np.random.default_rng([seed, 17])
    seen, sigma = np.ones(N_BLOCKS, bool), np.full(N_BLOCKS, NOISE_M)

    def look(_index: int, _stamp_s: float):
        xy = np.stack([rehearsal.table.x, rehearsal.table.y], 1)
        return xy + random.normal(0, NOISE_M, xy.shape), seen, sigma

    return look


def _tracked(rehearsal: Rehearsal, seed: int):
    from eol_ros.core.vision.calibration.model import Calibration
    from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
    from eol_ros.core.vision.states import TRACKING
    from eol_ros.core.vision.tracker import Tracker
    from eol_ros.settings import TrackerSettings, TwinSettings

    twin, calibration = TwinSettings(), Calibration.ideal()
    options = RenderOptions(twin.noise, exposure_s=twin.exposure_us * 1e-6)
    renderer = Renderer(options, calibration, seed)
    tracker = Tracker(TrackerSettings(), calibration)
    tracker.warm_up()

    def look(index: int, stamp_s: float):
        t = rehearsal.table
        image = renderer.render(t.x, t.y, t.yaw, index, velocity=t.velocity)
        tracked = tracker.update(stamp_s, image)
        return tracked.world, tracked.seen & (tracked.state == TRACKING), tracked.sigma_m

    return look
