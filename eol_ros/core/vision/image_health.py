# SPDX-License-Identifier: Apache-2.0
"""Is what the camera sends usable at all? One line says why not."""

import numpy as np

from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError

STEP = 16  # every 16th pixel of every 16th row says enough, for 5 us
BLACK = 3  # grey levels: an image without spread and this dark is black
FROZEN_S = 0.5
LIVELY = 60  # so many still images that all differed prove that the camera has noise


class Watch:
    """Notices images of a wrong kind, black, white and frozen ones."""

    def __init__(self, calibration: Calibration | None):
        self.calibration = calibration
        self.shape: tuple[int, ...] | None = None
        self.last = np.zeros((0, 0), np.uint8)  # what was looked at in the last image
        self.since_s = np.inf
        self.same = False
        self.differed = 0  # still images in a row that were not identical

    def fault(self, stamp_s: float, image: np.ndarray) -> str:
        """Return what is wrong with `image`, or an empty string."""
        if image.ndim != 2 or image.dtype != np.uint8:
            axes = 'colour or stacked' if image.ndim != 2 else f'{image.dtype}'
            return f'image is {axes}, not 8-bit grey: set the camera to mono8'
        if self.calibration is not None:
            try:
                self.calibration.check_image(image)
            except ConfigError as error:
                return str(error)
        elif self.shape is not None and image.shape != self.shape:
            return (
                f'image is {image.shape[1]}x{image.shape[0]}, the first one was '
                f'{self.shape[1]}x{self.shape[0]}: one camera, one size'
            )
        self.shape = image.shape
        size = image.shape[0] // STEP, image.shape[1] // STEP
        new = self.last.shape != size
        if new:
            self.last = np.zeros(size, np.uint8)
        low, high, same = mapping.glance(image, STEP, self.last)
        self.same = same and not new
        if not self.same:
            self.since_s = stamp_s
        if high <= BLACK:
            return 'image is black: check lens cap, exposure and the infrared LEDs'
        if low >= 250:
            return 'image is white: check exposure and lamps'
        if self.same and self.differed >= LIVELY and stamp_s - self.since_s > FROZEN_S:
            return f'image is frozen for {stamp_s - self.since_s:.1f} s: check camera and cable'
        return ''

    def rests(self, resting: bool) -> None:
        """Learn whether images of a table at rest differ: only then an identical one is a fault."""
        if resting and self.differed < LIVELY:
            self.differed = 0 if self.same else self.differed + 1
