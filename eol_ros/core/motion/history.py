# SPDX-License-Identifier: Apache-2.0
"""The newest images: where each block was, and how good each sample is."""

from typing import NamedTuple

import numpy as np

from eol_ros.core import elementary

RING = 64  # images kept: 0.27 s at 240 images/s, 1.07 s at 60
_BACK = np.arange(RING)


class Image(NamedTuple):
    """One image: stamp, positions (n, 2) m, seen (n,), standard deviation (n,) m an axis."""

    stamp_s: float
    place: np.ndarray
    seen: np.ndarray
    deviation: np.ndarray


class Fit(NamedTuple):
    """Least-squares motion of k blocks.

    Speed (k,) m/s and its standard deviation (k,) per metre of noise, mean place (k, 2) m,
    greatest distance from it (k,) m, number of samples (k,).
    """

    speed_mps: np.ndarray
    sigma_per_m: np.ndarray
    place: np.ndarray
    away_m: np.ndarray
    images: np.ndarray


class History:
    """Ring buffer of RING images; `order` lists its indices, newest first."""

    def __init__(self, cells: int) -> None:
        self.times_s = np.full(RING, -np.inf)
        self.place = np.zeros((2, cells, RING))  # m
        self.seen = np.zeros((cells, RING), bool)
        self.resting = np.zeros((cells, RING), bool)
        self.weight = np.ones((cells, RING))  # inverse variance, in units of the noise
        self.common = np.zeros((cells, RING))  # sigma of the error that repeats, in the same
        self.newest = -1
        self.order = _BACK
        self.last_s = -np.inf
        self.period_s = 0.0  # between images, smoothed

    def push(self, image: Image, resting: np.ndarray, excess: np.ndarray) -> None:
        """Store an image; resting: (n,). excess: (n,) variance in units of the noise, >= 1."""
        self.newest = at = (self.newest + 1) % RING
        self.order = (at - _BACK) % RING
        self.times_s[at] = image.stamp_s
        self.place[:, :, at] = image.place.T
        self.seen[:, at] = image.seen
        self.resting[:, at] = resting
        self.weight[:, at] = 1.0 / excess
        self.common[:, at] = np.sqrt(excess - 1.0)

    def recent(self, window_s: float) -> np.ndarray:
        """Return the indices (k,) of the images of the last `window_s`, newest first."""
        return self.order[: np.count_nonzero(self.last_s - self.times_s <= window_s)]

    def samples(self, block: int, since_s: float = -np.inf, most: int = RING) -> np.ndarray:
        """Return the indices of up to `most` images after `since_s` that show `block`, newest
        first."""
        at = self.order[: np.count_nonzero(self.times_s > since_s)]
        return at[self.seen[block, at]][:most]

    def rest_place(
        self, stamp_s: float, window_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the mean resting place (n, 2) m over `window_s` before `stamp_s`.

        With it its variance (n,), in units of that of a sample, and the number of samples.
        Weights are inverse variances. An occlusion shifts a block alike in all images, so the mean
        of occluded samples is no better than one of them.
        """
        resting = self.resting & (stamp_s - self.times_s <= window_s)
        weight = resting * self.weight
        total = np.maximum(weight.sum(1), 1e-12)
        common = (weight * self.common).sum(1) / total
        place = (self.place * weight).sum(2) / total
        return place.T, 1.0 / total + common * common, resting.sum(1)

    def step_speed(self, block: int) -> float:
        """Return the speed of `block` in m/s since the image before, 0 if that did not show it."""
        at = self.samples(block, self.last_s - 1.5 * self.period_s, 2)
        if len(at) < 2:
            return 0.0
        dx, dy = (self.place[:, block, at[0]] - self.place[:, block, at[1]]).tolist()
        return elementary.hypot(dx, dy) / float(self.times_s[at[0]] - self.times_s[at[1]])

    def fit(self, blocks: np.ndarray, window_s: float) -> Fit:
        """Return the motion of `blocks` (k,) over their samples of the last `window_s`."""
        at = self.recent(window_s)
        rows = blocks[:, None]
        mask, place = self.seen[rows, at], self.place[:, rows, at]
        n = np.maximum(mask.sum(1), 1)
        time = np.where(mask, self.times_s[at] - self.last_s, 0.0)
        lever = np.where(mask, time - (time.sum(1) / n)[:, None], 0.0)
        spread = (lever**2).sum(1)
        spread[spread <= 0.0] = np.inf
        slope = (place * lever).sum(2) / spread
        middle = (place * mask).sum(2) / n
        away = np.where(mask, place - middle[:, :, None], 0.0)
        far = elementary.hypot(away[0], away[1]).max(1, initial=0.0)
        return Fit(elementary.hypot(slope[0], slope[1]), 1.0 / np.sqrt(spread), middle.T, far, n)
