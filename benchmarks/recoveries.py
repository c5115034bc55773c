# SPDX-License-Identifier: Apache-2.0
"""Names after darkness by covers alone: path-traced images, the whole tracker, no taps.

The table goes dark, is turned by any quarter, pushed and stirred, and is seen again, often with an
arm over it. Blocks stand crooked in another way each time, so that yaws say nothing.
"""

import math

import cv2
import numpy as np

from benchmarks.relief import films
from benchmarks.vision_relief import RATE_HZ, calibration
from eol_ros.core.vision.states import TRACKING
from eol_ros.core.vision.tracker import Tracker
from eol_ros.settings import TrackerSettings
from eol_ros.verbs.progress import track

FIRST_S = 1.0  # of images before the first darkness
DARK_S = 3.0
PATIENCE = 30  # images until the names must be there again
BANK = 8  # fields of noise; each image begins somewhere in one of them
ARM_GREY, ARM_PX = 70, 45


def measure(count: int, seed: int, known: bool = False) -> dict[str, float]:
    """Return figures of `count` recoveries; known: the calibration has the covers' heights."""
    shown = films.load(films.TURNED)
    rng = np.random.default_rng([seed, 19])
    bank = [rng.standard_normal(shown[0].light.shape, np.float32) for _ in range(BANK)]
    cameras = {film.name: calibration(film, known) for film in shown}
    start = next(film for film in shown if film.name.endswith('-0-0'))
    tracker = Tracker(TrackerSettings(), cameras[start.name])
    now, wrong, open_still, at_once, armed = 0.0, 0, 0, 0, 0
    margins, waits = [], []
    for _ in range(round(FIRST_S * RATE_HZ)):
        tracker.update(now, _seen(start.light, bank, rng))
        now += 1 / RATE_HZ
    dark = np.full(start.light.shape, 3, np.uint8)
    for _ in track(range(count), 'recoveries'):
        for _ in range(8):
            tracker.update(now, dark + rng.integers(0, 2, dark.shape[:1], np.uint8)[:, None])
            now += DARK_S / 8
        film = shown[rng.integers(len(shown))]
        arm = rng.random() < 0.5
        armed += arm
        ends = rng.integers([300, 0], [980, 800], (2, 2))
        for image in range(1, PATIENCE + 1):  # noqa: B007 - told below
            light = film.light
            if arm:
                light = light.copy()
                cv2.line(light, *(tuple(map(int, end)) for end in ends), ARM_GREY, 2 * ARM_PX)
            found = tracker.update(now, _seen(light, bank, rng))
            now += 1 / RATE_HZ
            if found.state == TRACKING and not found.symmetry_ambiguous:
                break
        else:
            open_still += 1
            continue
        waits.append(image)
        at_once += image == 1
        off = np.hypot(*(found.world - film.shot.poses[:, :2]).T)[found.seen]
        wrong += bool((off > 0.05).any())
        margins.append(_margin(tracker))
    low, mean, sd = float(np.min(margins)), float(np.mean(margins)), float(np.std(margins))
    covers = tracker.identity.covers
    assert covers is not None
    return {
        'recoveries': count,
        'with_an_arm': armed,
        'wrong': wrong,
        'still_open': open_still,
        'known_in_the_first_image': at_once,
        'images_until_known_most': max(waits),
        'margin_nats_least': low,
        'margin_nats_mean': mean,
        'margin_nats_sd': sd,
        # extrapolated: as if margins were spread normally, a wrong turn ahead of the right one
        'log10_error_extrapolated': _log10_below(-mean / sd),
        'covers_learnt': int((covers.looks > 0).sum()),
    }


def _seen(light: np.ndarray, bank: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Return what a sensor sees of `light`, with noise out of the bank."""
    read, gain = films.NOISE
    noise = np.roll(bank[rng.integers(BANK)].ravel(), rng.integers(light.size))
    noisy = light + np.sqrt(np.float32(read**2) + np.float32(gain) * light) * noise.reshape(
        light.shape
    )
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _margin(tracker: Tracker) -> float:
    """Return by how many nats the present names explain the covers better than any turn of them."""
    covers = tracker.identity.covers
    assert covers is not None
    blocks = np.flatnonzero(tracker.lattice.seen)
    patterns, good = tracker._glance(tracker.lattice.index[blocks], tracker.lattice.yaw[blocks])
    nats, _ = covers.weigh(patterns[good], blocks[good])
    return float(nats[0] - nats[1:].max())


def _log10_below(sigmas: float) -> float:
    """Return log10 of the normal distribution function at `sigmas` < 0, asymptotic far out."""
    if sigmas > -30:
        return math.log10(0.5 * math.erfc(-sigmas / math.sqrt(2)))
    return (-0.5 * sigmas**2 - math.log(-sigmas * math.sqrt(2 * math.pi))) / math.log(10)
