# SPDX-License-Identifier: Apache-2.0
"""Metres from nothing but the blocks: 84 mm squares, at rest on the lattice of 174 mm.

Until 25 blocks have rested for a moment, lengths come from the size of the squares alone; that is
good enough to tell neighbours, not to publish. Then a homography is fitted to the mean pixels of
the lattice (Hartley and Zisserman, Multiple View Geometry, 4.1), and refused where the blocks do
not lie in it.
"""

import cv2
import numpy as np

from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS, rest_lattice
from eol_ros.core.vision.calibration import Calibration

IMAGES = 20  # still ones, all 25 blocks seen
MOST_MM = 6.0  # RMS departure of resting blocks from the lattice that is still believed


def nominal(shape: tuple[int, ...], side_px: float) -> Calibration:
    """Return a straight camera that sees blocks `side_px` wide in images of `shape`."""
    return Calibration.ideal(shape[1], shape[0], px_per_m=side_px / BLOCK_SIDE_M)


class SelfCalibration:
    """Collects still images until a calibration can be made; `why` says what it waits for."""

    def __init__(self, shape: tuple[int, ...]):
        self.shape = shape
        self.total = np.zeros((N_BLOCKS, 2))
        self.images = 0
        self.why = 'metres follow when 25 blocks have rested'

    def add(self, px: np.ndarray, good: bool) -> Calibration | None:
        """Take px (25, 2) of one image; `good`: all seen whole and at rest. Return the result."""
        if not good:
            self.total[:] = 0.0
            self.images = 0
            return None
        self.total += px
        self.images += 1
        if self.images < IMAGES:
            return None
        mean = self.total / self.images
        self.total[:] = 0.0
        self.images = 0
        return self._fit(mean)

    def _fit(self, px: np.ndarray) -> Calibration | None:
        rest = rest_lattice()
        homography, _ = cv2.findHomography(rest, px)
        if homography is None:
            return None
        height, width = self.shape[:2]
        focal = float(max(width, height))
        camera = np.array(
            [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]]
        )
        found = Calibration(width, height, camera, np.zeros(5), homography)
        off_mm = float(np.sqrt(((found.to_table(px) - rest) ** 2).mean()) * 1e3)
        off_px = float(np.sqrt(((found.to_pixels(rest) - px) ** 2).mean()))
        if off_mm > MOST_MM:
            self.why = f'blocks rest {off_mm:.1f} mm off their lattice: straighten them'
            return None
        return Calibration(
            width, height, camera, np.zeros(5), homography, residual_px=off_px, residual_mm=off_mm
        )
