# SPDX-License-Identifier: Apache-2.0
"""Numbers to turn a lens and to set an exposure by, from images of the table at rest."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from eol_ros.core.verdict import Verdict, judged

TILES = 3  # rows and columns of what is in sight, each with a blur of its own
SMOOTH_PX = 1.0  # of the derivatives; taken out again
REACH_PX = 9  # from a strong gradient: the whole profile of its edge
STRONG = 0.2  # of the strongest squared gradients
LEAST_SNR = 4.0  # of an edge's energy over that of noise and of what moved
LEAST_STEP = 8.0  # grey levels: less is no edge of a block

SATURATED = 254
BRIGHT = 0.975  # quantile: blocks fill a twentieth of the image
TARGET = 180.0  # grey levels of a block: room for flashes, far from the noise
FULL_SHARE = 0.05  # of the blocks' pixels: more than the lights inside, so edges are, too
MIN_LEVEL, MAX_LEVEL = 110.0, 225.0
FLICKER = 0.02  # of the blocks' brightness
BLUR_PX = 1.55, 1.95  # good, usable: calibrations at 1.53 and 1.92 px


@dataclass(frozen=True)
class Blur:
    """Standard deviation of the blur of edges in px: of all, and of (3, 3) parts.

    NaN where there is no edge, or where what moves hides it.
    """

    px: float
    tiles: np.ndarray


def _derivatives() -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return row and column kernels of Gx, Gy, Gxx, Gyy, Gxy, and how often each counts."""
    t = np.arange(-5, 6)
    plain = np.exp(-(t**2) / (2 * SMOOTH_PX**2))
    plain /= plain.sum()
    first = t * plain / (t * t * plain).sum()
    second = (t**2 - SMOOTH_PX**2) * plain
    second -= plain * second.sum()
    second *= 2 / (t**2 * second).sum()
    return [
        (first, plain, 1.0),
        (plain, first, 1.0),
        (second, plain, 1.0),
        (plain, second, 1.0),
        (first, first, 2.0),
    ]


def _energies(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the squared first and second derivatives of a float32 image, per pixel."""
    found = [
        weight * cv2.sepFilter2D(image, cv2.CV_32F, row, column) ** 2
        for row, column, weight in _derivatives()
    ]
    return found[0] + found[1], found[2] + found[3] + found[4]


def edge_blur(first: np.ndarray, second: np.ndarray) -> Blur:
    """Return how blurred edges are in two images (h, w) uint8 of the same, one after the other.

    The profile across a step that a Gaussian of standard deviation s has blurred is a Gaussian, and
    the energy of its slope is 2 s^2 that of its curvature, whatever its contrast. Both are summed
    over the surroundings of strong edges; what noise adds is told by the images' difference. The
    parts are those of the field in which edges are; a block counts where its middle is.
    """
    a, b = first.astype(np.float32), second.astype(np.float32)
    slope, curve = _energies((a + b) / 2)
    noise_slope, noise_curve = _energies((a - b) / 2)
    level = float(np.quantile(slope[::4, ::4], 0.995))
    least = LEAST_STEP**2 / (8 * math.pi * SMOOTH_PX**2) / 4
    kernel = np.ones((2 * REACH_PX + 1,) * 2, np.uint8)
    near = cv2.dilate((slope > max(STRONG * level, least)).astype(np.uint8), kernel)
    count, labels, _, centres = cv2.connectedComponentsWithStats(near)
    sums = np.array(
        [
            np.bincount(labels.ravel(), weights=energy.ravel(), minlength=count)[1:]
            for energy in (slope, curve, noise_slope, noise_curve)
        ]
    )

    def blur(here: np.ndarray) -> float:
        slopes, curves, noise_slopes, noise_curves = sums[:, here].sum(axis=1)
        signal, bend = slopes - noise_slopes, curves - noise_curves
        if signal < LEAST_SNR * noise_slopes or bend <= 0 or not signal:
            return math.nan
        return math.sqrt(max(signal / (2 * bend) - SMOOTH_PX**2, 0.0))

    if count == 1:
        return Blur(math.nan, np.full((TILES, TILES), math.nan))
    low, high = centres[1:].min(axis=0), centres[1:].max(axis=0)
    place = (TILES * (centres[1:] - low) / np.maximum(high - low, 1.0)).astype(int)
    columns, rows = np.minimum(place, TILES - 1).T
    tiles = [[blur((rows == i) & (columns == j)) for j in range(TILES)] for i in range(TILES)]
    return Blur(blur(np.ones(count - 1, bool)), np.array(tiles))


def focus_verdict(blur: Blur) -> Verdict:
    """Return whether the lens is focused, by the part that is most blurred."""
    if math.isnan(blur.px):
        return Verdict(
            'poor', 'no edge at rest in sight', 'light the blocks, and let the table rest'
        )
    return judged(
        'blur of the worst part', float(np.nanmax([blur.px, *blur.tiles.ravel()])), 'px', BLUR_PX,
        'a calibration is 0.6 to 0.8 mm off at 1.5 px, 1.2 to 1.6 mm at 1.9 px',
        'turn the lens until the number is least; where corners differ, close the aperture',
    )  # fmt: skip


@dataclass(frozen=True)
class Light:
    """Grey levels of the blocks and of what is around them, and the blocks' saturated share."""

    level: float
    dark: float
    saturated: float


def light(image: np.ndarray) -> Light:
    """Return how bright an image (h, w) uint8 is."""
    counts = np.bincount(image.ravel(), minlength=256)
    total = np.cumsum(counts)
    level = float(np.searchsorted(total, BRIGHT * total[-1]))
    dark = float(np.searchsorted(total, 0.5 * total[-1]))
    lit = int(counts[int((level + dark) / 2) :].sum())
    return Light(level, dark, float(counts[SATURATED:].sum()) / max(lit, 1))


def exposure_verdict(seen: Light, exposure_us: float | None, flicker: float = 0.0) -> Verdict:
    """Return whether the exposure is right.

    exposure_us: as it is, None where nobody knows. flicker: standard deviation of the blocks'
    brightness from image to image, over its mean.
    """
    step = seen.level - seen.dark
    if step < LEAST_STEP:
        return Verdict(
            'poor',
            f'no block stands out: blocks at {seen.level:.0f}, ground at {seen.dark:.0f} of 255',
            'check lens cap, exposure and the infrared LEDs',
        )

    def changed(factor: float) -> str:
        if exposure_us is None:
            return f'{factor:.2g} times the exposure'
        return f'exposure_us {exposure_us * factor:.0f}'

    wanted = (TARGET - seen.dark) / step
    if seen.saturated > FULL_SHARE:  # by how much it is too bright, nobody knows
        return Verdict(
            'poor',
            f'{seen.saturated:.0%} of what is bright is saturated, good up to {FULL_SHARE:.0%}: '
            'edges of saturated blocks are not where they seem',
            f'{changed(min(0.5, wanted))}, less gain, or a smaller aperture',
        )
    if seen.level > MAX_LEVEL:
        return Verdict(
            'usable',
            f'blocks at {seen.level:.0f} of 255, good up to {MAX_LEVEL:.0f}: no room for flashes',
            changed(wanted),
        )
    if seen.level < MIN_LEVEL:
        return Verdict(
            'usable',
            f'blocks at {seen.level:.0f} of 255 are dim, good from {MIN_LEVEL:.0f}: nearer to the '
            'noise',
            f'{changed(wanted)}, or more gain; in 3000 us a block at 1 m/s moves 1.6 px',
        )
    if flicker > FLICKER:
        return Verdict(
            'usable',
            f'brightness varies by {flicker:.0%}, good up to {FLICKER:.0%}: lamps flicker',
            'expose for a multiple of 10 ms (50 Hz) or 8.33 ms (60 Hz), or filter their light',
        )
    return Verdict(
        'good', f'blocks at {seen.level:.0f} of 255; good from {MIN_LEVEL:.0f} to {MAX_LEVEL:.0f}'
    )
