# SPDX-License-Identifier: Apache-2.0
"""Videos of the twin with known truth, and what each method makes of them."""

from dataclasses import dataclass, field

import numpy as np
from support.clutter import Cluttered, clutter_calibration
from support.paper import rest_lattice

from benchmarks import vision_peers
from benchmarks.vision_peers import errors, match, timed, tuned
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.render.renderer import Renderer, RenderOptions
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings

RATE_HZ = 60.0
OURS = 'eol_ros'
_TUNING = 4  # images that the peers are tuned on


@dataclass
class Tally:
    """What one method did over a video; errors in px of blocks by how much of them was visible."""

    ms: list = field(default_factory=list)
    whole: list = field(default_factory=list)
    partly: list = field(default_factory=list)
    whole_seen: int = 0
    whole_all: int = 0
    partly_seen: int = 0
    partly_all: int = 0
    hidden_reported: int = 0
    hidden_all: int = 0
    false: int = 0
    images: int = 0

    def add(self, ms, left, visible, false):
        """Count one image: left (25, 2) px or NaN, visible (25,) true shares."""
        seen = np.isfinite(left[:, 0])
        whole, partly = visible > 0.98, (visible > 0.5) & (visible <= 0.98)
        hidden = visible < 0.02
        self.ms.append(ms)
        self.whole.append(left[whole & seen])
        self.partly.append(left[partly & seen])
        self.whole_seen += int((whole & seen).sum())
        self.whole_all += int(whole.sum())
        self.partly_seen += int((partly & seen).sum())
        self.partly_all += int(partly.sum())
        self.hidden_reported += int((hidden & seen).sum())
        self.hidden_all += int(hidden.sum())
        self.false += false
        self.images += 1

    def figures(self) -> dict:
        """Return the figures of the video; None where nothing was to be measured."""

        def rms(parts):
            flat = np.concatenate(parts) if parts else np.zeros((0, 2))
            return float(np.sqrt((flat**2).mean())) if len(flat) else None

        def share(a, b):
            return a / b if b else None

        return {
            'ms_median': float(np.median(self.ms)),
            'ms_p99': float(np.quantile(self.ms, 0.99)),
            'rms_px': rms(self.whole),
            'rms_partly_px': rms(self.partly),
            'coverage': share(self.whole_seen, self.whole_all),
            'coverage_partly': share(self.partly_seen, self.partly_all),
            'hidden_reported': self.hidden_reported,
            'hidden': self.hidden_all,
            'partly': self.partly_all,
            'false_per_image': self.false / max(self.images, 1),
            'images': self.images,
        }


class Film:
    """Images of a rim that is pushed and turned, blocks lagging behind it, with their truth."""

    def __init__(self, clutter: str, noise: str, seed: int):
        self.calibration = clutter_calibration(clutter)
        self.renderer = Cluttered(clutter, self.calibration, seed, noise=noise, rate_hz=RATE_HZ)
        rng = np.random.default_rng([seed, 9])
        self.rest = rest_lattice() + rng.normal(0, 0.004, (25, 2))
        self.lag = rng.uniform(0, 0.25, 25)
        self.yaw = rng.normal(0, 0.08, 25)
        self.pace = rng.uniform(0.5, 1.1, 3)

    def pose(self, time_s: float) -> np.ndarray:
        """Return x, y, yaw of all blocks, (25, 3)."""
        t = time_s - self.lag
        sway = [np.maximum(np.sin(2 * np.pi * p * t / 4), 0) ** 2 for p in self.pace]  # with rests
        turn = 0.35 * sway[2]
        c, s = np.cos(turn), np.sin(turn)
        x = c * self.rest[:, 0] - s * self.rest[:, 1] + 0.09 * sway[0]
        y = s * self.rest[:, 0] + c * self.rest[:, 1] + 0.09 * sway[1]
        return np.column_stack([x, y, self.yaw + turn])

    def image(self, index: int):
        """Return (image, poses (25, 3), visible share (25,))."""
        t, dt = index / RATE_HZ, 1e-4
        pose = self.pose(t)
        velocity = (self.pose(t + dt) - self.pose(t - dt)) / (2 * dt)
        image = self.renderer.render(*pose.T, index, velocity=velocity)
        return image, pose, self.renderer.visible_share(*pose.T, index)


def number(value: float | None, digits: int) -> str:
    """Return a figure for a table; a dash where nothing was to be measured."""
    return '-' if value is None else f'{value:.{digits}f}'


def track_image(
    tracker: Tracker, camera: Calibration, stamp_s: float, image: np.ndarray, pose: np.ndarray
) -> tuple[float, np.ndarray, int]:
    """Return ms, errors (25, 2) px with NaN where nothing was seen, and false blocks of an image.

    camera: by which it was taken. pose: (25, 3), the truth.
    """
    tracked, ms = timed(tracker.update, stamp_s, image)
    left = (tracked.world - pose[:, :2]) * camera.px_per_m()
    left[~tracked.seen] = np.nan
    return ms, left, match(tracked.px[tracked.seen], camera.to_pixels(pose[:, :2]))[1]


def run_film(
    clutter: str, noise: str, seed: int, images: int, peers: bool = True, every: int = 1
) -> dict:
    """Return the figures of each method on one video; peers look at every `every`-th image."""
    film = Film(clutter, noise, seed)
    calibration = film.calibration
    tracker = Tracker(TrackerSettings(), calibration)
    tracker.warm_up()
    first = [film.image(k * 7) for k in range(_TUNING)]
    truths = [calibration.to_pixels(pose[:, :2]) for _, pose, _ in first]
    others = [
        tuned(peer, [i for i, _, _ in first], truths)
        for peer in (vision_peers.peers() if peers else ())
    ]
    tallies = {OURS: Tally()} | {peer.name: Tally() for peer in others}
    for index in range(images):
        image, pose, visible = film.image(index)
        ms, left, false = track_image(tracker, calibration, index / RATE_HZ, image, pose)
        truth = calibration.to_pixels(pose[:, :2])
        if index >= 10:  # the first images find the lattice
            tallies[OURS].add(ms, left, visible, false)
            if index % every == 0:
                for peer in others:
                    found, ms = timed(peer.find, image)
                    tallies[peer.name].add(
                        ms, errors(found, truth), visible, match(found, truth)[1]
                    )
    return {name: tally.figures() for name, tally in tallies.items()}


def run_clean(noise: str, images: int, bound_px: float, seed: int = 1) -> dict:
    """Return the figures of each method on still blocks at random poses, one image each.

    Of ours the second image of each pose is measured, as for a block at rest.
    """
    renderer = Renderer(RenderOptions(noise=noise), None, seed)
    calibration = renderer.calibration
    rng = np.random.default_rng([seed, 8])
    scenes = []
    for k in range(images + _TUNING):
        rim = rng.uniform(-np.pi / 4, np.pi / 4)
        c, s = np.cos(rim), np.sin(rim)
        xy = rest_lattice() @ np.array([[c, s], [-s, c]]) + rng.normal(0, 0.004, (25, 2))
        yaw = rim + rng.normal(0, 0.08, 25)
        first, image = (renderer.render(*xy.T, yaw, 2 * k + n).copy() for n in range(2))
        scenes.append((xy, first, image))
    tuning, scenes = scenes[:_TUNING], scenes[_TUNING:]
    others = [
        tuned(peer, [s[2] for s in tuning], [calibration.to_pixels(s[0]) for s in tuning])
        for peer in vision_peers.peers()
    ]
    tallies = {OURS: Tally()} | {peer.name: Tally() for peer in others}
    ones = np.ones(25)
    for xy, first, image in scenes:
        truth = calibration.to_pixels(xy)
        tracker = Tracker(TrackerSettings(), calibration)
        tracker.update(0.0, first)
        tracked, ms = timed(tracker.update, 1 / RATE_HZ, image)
        found = tracked.px[tracked.seen]
        tallies[OURS].add(ms, errors(found, truth), ones, match(found, truth)[1])
        for peer in others:
            found, ms = timed(peer.find, image)
            tallies[peer.name].add(ms, errors(found, truth), ones, match(found, truth)[1])
    figures = {name: tally.figures() for name, tally in tallies.items()}
    for one in figures.values():
        one['times_bound'] = one['rms_px'] / bound_px if one['rms_px'] else None
    return figures
