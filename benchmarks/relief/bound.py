# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound of a cover's place by its outline: no unbiased method can do better."""

import math

import numpy as np
from scipy.special import erf

from benchmarks.relief.films import NOISE, Film
from benchmarks.relief.path_tracer import PSF_PX
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import outline, profiles, search
from eol_ros.core.vision.detect.blobs import BlobFinder


def outline_bounds_m(film: Film, camera: Calibration) -> np.ndarray:
    """Return the bounds (2, 25) on one coordinate of each block, m, RMS over both axes.

    Numerical Fisher information of independent Gaussian pixels whose variance is known (Kay 1993,
    eq. 3.31, first term), summed over the profiles that cross the outline. A pixel at `d` from an
    edge sees the light A there as A Phi(-d / blur), so the edge moves it by A phi(d / blur) / blur.
    A comes from the light without noise: the least squares of a ramp that ends at the true edge.
    Unknown are place, angle, background, and the light of each side, or (second row) only one scale
    for the light of all.
    """
    assert camera.covers is not None
    packed, heights = camera.packed(), camera.covers.over(camera.cover_height_m)
    image = np.ascontiguousarray(np.minimum(film.light, 255), np.float32)
    finder, truth = BlobFinder(calibration=camera), film.shot.poses
    finder.find(np.zeros(image.shape, np.uint8))  # learns the sizes for this image
    known = finder._known
    expected, still = np.zeros((N_BLOCKS, 5)), np.zeros((N_BLOCKS, 2))
    mapping.expected(
        packed, truth[:, :2].copy(), still, truth[:, 2].copy(), np.zeros(N_BLOCKS), 0.0, expected
    )
    work, ends = profiles.workspace()
    blur = math.hypot(PSF_PX, 12**-0.5)
    bounds = np.zeros((2, N_BLOCKS))
    for i, (u, v, theta, _, quarter) in enumerate(expected):
        half, *shear = search.expected(known, image.shape, u, v)
        table = np.zeros(outline.SIZE, np.float32)
        outline.tabulate(packed, heights[i], u, v, theta, half, int(quarter), table)
        profiles.gather(image, u, v, theta, half, blur, tuple(shear), table, work, ends)
        fisher = _fisher(work, ends, abs(math.cos(theta)), half, blur)
        beside = camera.to_table(np.array([[u + 0.5, v], [u - 0.5, v], [u, v + 0.5], [u, v - 0.5]]))
        metres = np.column_stack([beside[0] - beside[1], beside[2] - beside[3]])  # a px of u, of v
        one = np.zeros((8, 5))
        one[[0, 1, 2, 7], [0, 1, 2, 4]] = one[3:7, 3] = 1.0
        for k, turn in enumerate((np.eye(8), one)):
            spread = np.linalg.inv(turn.T @ fisher @ turn)[:2, :2]
            bounds[k, i] = math.sqrt(np.trace(metres @ spread @ metres.T) / 2)
    return bounds


def _fisher(
    work: np.ndarray, ends: np.ndarray, slope: float, half: float, blur: float
) -> np.ndarray:
    """Return the information (8, 8) on u, v, angle, light of four sides and background."""
    taps = int(ends[profiles.TAPS_USED])
    total = np.zeros((8, 8))
    for side in range(4):
        lines = ends[profiles.BEGIN + side] + np.arange(ends[profiles.COUNT + side])
        lines = lines[work[profiles.VALID + lines] > 0]
        # those that cross a side stand for its ends too, and for what is too steep to be read
        share = 2 * half * slope / max(len(lines), 1)
        for line in lines:
            d = work[profiles.FIRST + line] + slope * np.arange(taps)
            light = work[profiles.TAP + line + profiles.LINES * np.arange(taps)].astype(float)
            bell = np.exp(-0.5 * (d / blur) ** 2) / math.sqrt(2 * math.pi)
            cover = 0.5 - 0.5 * erf(d / blur / math.sqrt(2))
            ramp = np.column_stack([np.ones(taps), cover, d * cover - blur * bell])
            edge = max(np.linalg.lstsq(ramp, light, rcond=None)[0][1], 0.0) * bell / blur
            slopes = np.zeros((taps, 8))
            slopes[:, 0] = edge * work[profiles.NU + line]
            slopes[:, 1] = edge * work[profiles.NV + line]
            slopes[:, 2] = -edge * work[profiles.T + line]
            slopes[:, 3 + side], slopes[:, 7] = cover, 1.0
            variance = NOISE[0] ** 2 + NOISE[1] * light + 1 / 12
            total += share * (slopes / variance[:, None]).T @ slopes
    return total
