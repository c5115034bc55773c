# SPDX-License-Identifier: Apache-2.0
"""Hours of rest on path-traced covers: what is seen to move where nothing does.

Each place is one image of light without noise. Only the sensor's noise changes from image to image,
so an hour costs no more than its noise and the tracker.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats

from benchmarks import vision_relief
from benchmarks.relief import films
from benchmarks.vision_relief import RATE_HZ, SETTLED
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.motion.motion import Motion
from eol_ros.core.motion.slips import START, SlipDetector
from eol_ros.core.vision.render.renderer import Sensor
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import MotionSettings, TrackerSettings
from eol_ros.verbs.progress import track

OFTEN = 300.0  # false alarms an hour, stated: so many that a short run tells whether they are right
ALLOWED_SCATTERS = 6.5  # as far as a block at rest may seem to move
HONEST = 1.5  # factor by which sigma may differ from the scatter


def measure(minutes: float, shown: list[films.Film] | None = None) -> dict:
    """Return what is seen to move in so many minutes of rest, all places together.

    A deviation is that of one coordinate from its median at this place, in units of the block's own
    scatter there: 1.48 times the median of all its deviations.
    """
    if shown is None:
        shown = films.load(films.FOLDER) + films.load(films.TURNED)
    images = max(round(60 * minutes * RATE_HZ / len(shown)), 12)
    names = [film.name for film in shown]
    runs = [_Rest(film, seed, images) for seed, film in enumerate(shown)]
    steps = (step for run in runs for step in run.images())
    for _ in track(steps, 'rest', len(runs) * (images + SETTLED)):
        pass
    places = {name: run.figures() for name, run in zip(names, runs, strict=True)}
    slips = [slip for run in runs for slip in run.slips]
    often = sum(run.often for run in runs)
    hours = images * len(shown) / RATE_HZ / 3600
    low, high = poisson(len(slips))
    samples = 2 * N_BLOCKS * images * len(shown)
    return {
        'hours': hours,
        'places': places,
        'worst_scatters': max(one['worst_scatters'] for one in places.values()),
        'expected_worst': float(stats.norm.isf(0.5 / samples)),
        'beyond_5': sum(one['beyond_5'] for one in places.values()),
        'expected_beyond_5': float(2 * stats.norm.sf(5.0) * samples),
        'allowed_scatters': ALLOWED_SCATTERS,
        'coverage': float(np.mean([one['coverage'] for one in places.values()])),
        'honest_places': sum(not one['dishonest_blocks'] for one in places.values()),
        'honest_blocks': N_BLOCKS * len(places)
        - sum(len(one['dishonest_blocks']) for one in places.values()),
        'error_mm_rms': float(
            np.sqrt(np.mean([one['error_mm_rms'] ** 2 for one in places.values()]))
        ),
        'error_mm_worst': max(one['error_mm_worst'] for one in places.values()),
        'false_slips': slips,
        'false_an_hour': len(slips) / hours,
        'false_an_hour_95': [low / hours, high / hours],
        'stated_an_hour': MotionSettings().false_alarms_per_hour,
        'often_an_hour': often / hours,
        'often_an_hour_95': [count / hours for count in poisson(often)],
        'often_stated_an_hour': OFTEN,
    }


class _Rest:
    """One place, seen again and again."""

    def __init__(self, film: films.Film, seed: int, images: int):
        self.film, self.seed = film, seed
        self.places = np.full((images, N_BLOCKS, 2), np.nan, np.float32)
        self.sigma = np.full((images, N_BLOCKS), np.nan, np.float32)
        self.slips: list[dict[str, Any]] = []
        self.often = 0  # slips found where OFTEN of them are allowed

    def images(self) -> Iterator[None]:
        """Take the images one by one."""
        light, settings = self.film.light, MotionSettings()
        sensor = Sensor(*films.NOISE, (self.seed, 4))
        tracker = Tracker(TrackerSettings(), vision_relief.calibration(self.film, True))
        motion, seen = Motion(settings), np.empty(light.shape, np.uint8)
        often = SlipDetector(replace(settings, false_alarms_per_hour=OFTEN))
        for k in range(SETTLED + len(self.places)):
            sensor.sense(light, k, seen)
            if k == 2:  # a lattice alone does not tell which way round it lies
                turned = np.median(self.film.shot.poses[:, 2]) / (np.pi / 2)
                tracker.lattice.turn_ids(round(float(turned)))
            got = tracker.update(k / RATE_HZ, seen)
            if k >= SETTLED:
                self.places[k - SETTLED, got.seen] = got.world[got.seen]
                self.sigma[k - SETTLED, got.seen] = got.sigma_m[got.seen]
                shown = k / RATE_HZ, *got.world.T, got.seen, got.sigma_m
                self._look(k - SETTLED, motion.update(*shown)[0])
                self.often += sum(event.kind == START for event in often.update(*shown))
            yield

    def _look(self, k: int, found: list) -> None:
        for event in (slip.event for slip in found if slip.event.kind == START):
            at = self.places[k, event.block]
            before = np.nanmedian(self.places[max(k - 60, 0) : k, event.block], axis=0)
            self.slips.append(
                {
                    'place': self.film.name,
                    'block': event.block,
                    'after_s': k / RATE_HZ,
                    'moved_um': float(np.hypot(*(at - before))) * 1e6,
                    'sigma_um': float(self.sigma[k, event.block]) * 1e6,
                }
            )

    def figures(self) -> dict:
        """Return figures of all images."""
        usual = np.nanmedian(self.places, axis=0)
        away = np.abs(self.places - usual)
        scatter = np.nanmedian(away, axis=0) * 1.4826
        scatters = away / scatter
        worst = np.nanmax(scatters, axis=(0, 2))
        honest = np.nanmedian(self.sigma, axis=0) / scatter.mean(axis=1)
        far = np.hypot(*(usual - self.film.shot.poses[:, :2]).T) * 1e3
        # how much of a deviation the next image still has
        off = np.nan_to_num((self.places - usual) / scatter)
        kept = (off[1:] * off[:-1]).sum(axis=0) / (off**2).sum(axis=0)
        return {
            'worst_scatters': float(worst.max()),
            'worst_block': int(worst.argmax()),
            'beyond_5': int((scatters > 5.0).sum()),
            'scatter_um': float(np.median(scatter)) * 1e6,
            'coverage': float(np.isfinite(self.places[..., 0]).mean()),
            'sigma_of_scatter': [
                float(honest.min()),
                float(np.median(honest)),
                float(honest.max()),
            ],
            'dishonest_blocks': np.flatnonzero(abs(np.log(honest)) > np.log(HONEST)).tolist(),
            'error_mm_rms': float(np.sqrt(np.mean(far**2))),
            'error_mm_worst': float(far.max()),
            'kept': [float(kept.min()), float(kept.mean()), float(kept.max())],
        }


def poisson(count: int) -> tuple[float, float]:
    """Return the 95 % interval of the mean of a count (Garwood 1936)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2)


def table(f: dict) -> str:
    """Return the figures as lines of text."""
    lines = [f'at rest for {f["hours"]:.3f} h in all, at {len(f["places"])} places']
    for name, one in f['places'].items():
        low, middle, high = one['sigma_of_scatter']
        lines.append(
            f'  {name:18s} worst deviation {one["worst_scatters"]:.2f} scatters (block'
            f' {one["worst_block"]:2d}), {one["beyond_5"]} beyond 5; scatter'
            f' {one["scatter_um"]:.1f} um; sigma/scatter {low:.2f} to {high:.2f}, median'
            f' {middle:.2f}; kept from image to image {one["kept"][1]:.2f}'
            f' (at most {one["kept"][2]:.2f}); coverage {one["coverage"]:.5f};'
            f' {one["error_mm_rms"]:.2f} mm off, at most {one["error_mm_worst"]:.2f}'
        )
    low, high = f['false_an_hour_95']
    lines.append(
        f'worst deviation {f["worst_scatters"]:.2f} scatters (normal noise:'
        f' {f["expected_worst"]:.2f}; allowed: {f["allowed_scatters"]}), {f["beyond_5"]} beyond 5'
        f' (normal noise: {f["expected_beyond_5"]:.1f})'
    )
    lines.append(
        f'sigma within a factor of {HONEST} of the scatter for {f["honest_blocks"]} of'
        f' {N_BLOCKS * len(f["places"])} blocks, for all of them at {f["honest_places"]} of'
        f' {len(f["places"])} places; blocks {f["error_mm_rms"]:.2f} mm off (RMS), at most'
        f' {f["error_mm_worst"]:.2f}'
    )
    lines.append(
        f'{len(f["false_slips"])} false slips, {f["false_an_hour"]:.1f} an hour'
        f' (95 %: {low:.1f} to {high:.1f}; stated: {f["stated_an_hour"]:g})'
    )
    low, high = f['often_an_hour_95']
    lines.append(
        f'{f["often_an_hour"]:.0f} false slips an hour (95 %: {low:.0f} to {high:.0f}) where'
        f' {f["often_stated_an_hour"]:g} are stated'
    )
    lines += [
        f'  {s["place"]}, block {s["block"]}, after {s["after_s"]:.2f} s: {s["moved_um"]:.0f} um,'
        f' sigma {s["sigma_um"]:.1f}'
        for s in f['false_slips']
    ]
    return '\n'.join(lines)
