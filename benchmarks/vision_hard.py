# SPDX-License-Identifier: Apache-2.0
"""Videos that are hard to see: clutter, arms that hide blocks, and cameras that misbehave.

Flat covers are drawn and move with their rim. Covers with relief are path-traced images: their
blocks rest, while clutter, arms and the camera are those of the flat ones. A cover's true share in
sight is then counted over its pixels. Their light inside stays as it was traced: level and flash of
each cover change, its texture does not.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from support.clutter import LEVELS, Clutter, draw_arms
from support.paper import N_BLOCKS
from support.relief import films
from support.relief.films import PSF_PX

from benchmarks import vision_peers
from benchmarks.vision_peers import match, timed, tuned
from benchmarks.vision_scenes import OURS, RATE_HZ, Film, Tally, number, track_image
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Sensor
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings
from eol_ros.verbs.progress import track

SURFACES = ('flat', 'relief')
CAMERAS = ('dropped', 'doubled', 'exposure', 'focus')  # in hard clutter
SLEEVED = 'sleeves'  # hard clutter, and sleeves so wide that blocks vanish
KINDS = (*LEVELS, *CAMERAS, SLEEVED)
SLEEVES, SLEEVE_S = 3, 4.0
FLASH = 0.35  # of a cover's light: what white light adds to it
_PEER_EVERY = 4


def sleeves(time_s: float, seed: int) -> np.ndarray:
    """Return capsules (3, 5) m that come in over the table and go again."""
    found = []
    for k in range(SLEEVES):
        slot, phase = divmod(time_s / SLEEVE_S + k / SLEEVES, 1.0)
        rng = np.random.default_rng([seed, 7, k, int(slot)])
        side, goal = rng.uniform(0, 2 * np.pi), rng.uniform(-0.35, 0.35, 2)
        shoulder = 1.3 * np.array([np.cos(side), np.sin(side)])
        hand = shoulder + math.sin(np.pi * phase) ** 2 * (goal - shoulder)
        found.append([*shoulder, *hand, rng.uniform(0.09, 0.14)])
    return np.array(found)


class FlatLight:
    """Drawn covers that move with their rim."""

    def __init__(self, level: str, seed: int):
        self.film = Film(level, 'none', seed)
        self.camera: Calibration = self.film.calibration

    def at(self, index: int, more: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return light (h, w), poses (25, 3), and shares in sight (25,)."""
        film, dt = self.film, 1e-4
        time_s = index / RATE_HZ
        pose = film.pose(time_s)
        velocity = (film.pose(time_s + dt) - film.pose(time_s - dt)) / (2 * dt)
        film.renderer.render(*pose.T, index, velocity=velocity, arms=more)
        shares = film.renderer.visible_share(*pose.T, index, arms=more)
        return film.renderer.light, pose, shares


class ReliefLight:
    """Path-traced covers at rest under drawn clutter."""

    def __init__(self, level: str, seed: int):
        shown = [f for f in films.load() if not f.name.endswith('-lit')]
        film = shown[seed % len(shown)]
        self.pose = film.shot.poses
        self.camera = films.calibration(film, True)
        self.clutter = clutter = Clutter(level, self.camera, 12.0, seed, N_BLOCKS, RATE_HZ)
        centres = self.camera.to_pixels(self.pose[:, :2])
        v, u = np.mgrid[0 : film.light.shape[0], 0 : film.light.shape[1]]
        near = np.full(film.light.shape, N_BLOCKS, np.uint8)  # whose ground a pixel is
        lit, owner = [], []
        for b, (cu, cv) in enumerate(centres):
            ground = (u - cu) ** 2 + (v - cv) ** 2 < (0.07 * self.camera.px_per_m()) ** 2
            near[ground] = b
            level_there = np.median(film.light[ground & (film.light > 40)])
            cover = np.flatnonzero(ground & (film.light > 0.4 * level_there))
            lit.append(cover)
            owner.append(np.full(len(cover), b))
        self.near = near
        self.lit, self.owner = np.concatenate(lit), np.concatenate(owner)
        self.light = film.light * clutter.vignette
        self.more = clutter.static - 12.0 * clutter.vignette
        if len(clutter.glints):  # covers hide what the sandpaper mirrors
            self.more.ravel()[self.lit] -= clutter.glints.ravel()[self.lit]
        self.windows = np.zeros((64, 4), np.int64)

    def at(self, index: int, more: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return light (h, w), poses (25, 3), and shares in sight (25,)."""
        clutter = self.clutter
        scale = np.append(clutter.battery * (1 + FLASH * clutter.flashes(index)), 1.0)
        light = self.light * scale.astype(np.float32)[self.near] + self.more
        capsules, grey = clutter.arms_and(more, index)
        if not len(capsules):
            return light, self.pose, np.ones(N_BLOCKS)
        ends = self.camera.to_pixels(capsules[:, :4].reshape(-1, 2)).reshape(-1, 4)
        arms = np.hstack([ends, capsules[:, 4:] * self.camera.px_per_m()])
        draw_arms(light, clutter.vignette, arms, grey, PSF_PX, self.windows, 0)
        free = np.ones(light.shape, np.float32)
        draw_arms(free, clutter.vignette, arms, 0.0 * grey, PSF_PX, self.windows, 0)
        count = np.bincount(self.owner, minlength=N_BLOCKS)
        shares = np.bincount(self.owner, free.ravel()[self.lit], N_BLOCKS) / count
        return light, self.pose, shares


@dataclass
class HardTally(Tally):
    """And how far the worst lie."""

    far: dict[str, list[float]] = field(default_factory=lambda: {'whole': [], 'partly': []})

    def add(self, ms, left, visible, false):
        """Count one image."""
        super().add(ms, left, visible, false)
        for name, parts in (('whole', self.whole), ('partly', self.partly)):
            self.far[name] += np.hypot(*parts[-1].T).tolist()

    def figures(self) -> dict:
        """Return the figures of the video."""
        more = {}
        for name, far in self.far.items():
            more[f'{name}_beyond_2px'] = int(np.sum(np.array(far) > 2.0))
            more[f'{name}_worst_px'] = max(far, default=None)
        return super().figures() | more | {'whole': self.whole_all}


def _schedule(kind: str, seed: int) -> Iterator[int]:
    """Yield the index of what each image shows; one that comes again was doubled."""
    rng = np.random.default_rng([seed, 8])
    index = 0
    while True:
        yield index
        if kind == 'doubled' and rng.random() < 0.1:
            yield index
        index += int(rng.integers(2, 6)) if kind == 'dropped' and rng.random() < 0.1 else 1


def _camera(kind: str, light: np.ndarray, index: int) -> np.ndarray:
    """Return `light` as a camera shows it whose exposure hunts, or whose focus drifts."""
    time_s = index / RATE_HZ
    if kind == 'exposure':  # 0.66 to 1.57 times, slowly and in jumps
        hunting = 0.4 * math.sin(2 * np.pi * time_s / 3) + (0.25 if int(time_s / 0.7) % 2 else -0.2)
        return light * np.float32(2.0**hunting)
    if kind == 'focus' and time_s > 0:  # to 1.5 px of blur beside the lens's
        return cv2.GaussianBlur(light, (0, 0), 0.05 + 1.45 * math.sin(np.pi * time_s / 5) ** 2)
    return light


def run(
    tallies: dict[str, HardTally],
    surface: str,
    kind: str,
    images: int,
    seed: int,
) -> None:
    """Add to `tallies` what the tracker makes of one video, and SimpleBlobDetector of `hard`."""
    level = kind if kind in LEVELS else 'hard'
    source = (FlatLight if surface == 'flat' else ReliefLight)(level, seed)
    sensor = Sensor(*films.NOISE, (seed, 0))
    tracker = Tracker(TrackerSettings(), source.camera)
    tracker.warm_up()
    ours = tallies.setdefault(OURS, HardTally())
    image = np.empty((source.camera.image_height, source.camera.image_width), np.uint8)
    other, first, truths, shown = None, [], [], -1
    for count, index in enumerate(_schedule(kind, seed)):
        if count == images:
            break
        if index != shown:
            more = sleeves(index / RATE_HZ, seed) if kind == SLEEVED else np.zeros((0, 5))
            light, pose, visible = source.at(index, more)
            light = _camera(kind, light, index)
            sensor.sense(light, index, image)
        shown = index
        stamp_s = (count if kind == 'doubled' else index) / RATE_HZ
        ms, left, false = track_image(tracker, source.camera, stamp_s, image, pose)
        if count < 10:  # the first images find the lattice
            continue
        truth = source.camera.to_pixels(pose[:, :2])
        ours.add(ms, left, visible, false)
        if kind == 'hard' and len(first) < 4:
            first.append(image.copy())
            truths.append(truth)
            if len(first) == 4:
                other = tuned(vision_peers.SimpleBlobDetector, first, truths)
        elif other is not None and count % _PEER_EVERY == 0:
            found, ms = timed(other.find, image)
            left = vision_peers.errors(found, truth)
            mine = tallies.setdefault(other.name, HardTally())
            mine.add(ms, left, visible, match(found, truth)[1])


def measure(
    kinds: list[str], surfaces: list[str], seconds: float, seeds: int, first_seed: int
) -> dict:
    """Return figures of each surface and kind, all videos of it together."""
    jobs = [(s, k, seed) for s in surfaces for k in kinds for seed in range(seeds)]
    joint: dict[str, dict[str, dict[str, HardTally]]] = {}
    for surface, kind, seed in track(jobs, 'videos'):
        tallies = joint.setdefault(surface, {}).setdefault(kind, {})
        run(tallies, surface, kind, round(seconds * RATE_HZ), first_seed + seed)
    return {
        'hard': {
            surface: {kind: {n: t.figures() for n, t in two.items()} for kind, two in of.items()}
            for surface, of in joint.items()
        }
    }


def table(result: dict) -> str:
    """Return the figures as lines of text."""
    lines = []
    for surface, kinds in result['hard'].items():
        for kind, methods in kinds.items():
            for name, f in methods.items():
                lines.append(
                    f'{surface:6s} {kind:10s} {name:18s} whole {number(f["rms_px"], 3)} px'
                    f' {number(f["coverage"], 5)} of {f["whole"]} ({f["whole_beyond_2px"]} beyond'
                    f' 2 px)  partly {number(f["rms_partly_px"], 3)} px'
                    f' {number(f["coverage_partly"], 3)}'
                    f' of {f["partly"]} ({f["partly_beyond_2px"]} beyond 2 px, worst'
                    f' {number(f["partly_worst_px"], 3)})'
                    f'  hidden {f["hidden_reported"]}/{f["hidden"]}'
                    f'  false {f["false_per_image"]:.4f}  {f["ms_median"]:.2f} ms p99'
                    f' {f["ms_p99"]:.2f}'
                )
    return '\n'.join(lines)
