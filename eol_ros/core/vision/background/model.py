# SPDX-License-Identifier: Apache-2.0
"""A map of lamps and reflections, learnt while the blocks' own infrared light is off.

A tracker that commands its LEDs can see what is left without them. The light of a lamp adds to
that of a cover on which it falls, so the map is taken off the image, but where the sensor is full.
The level of the empty platform stays, and with it the noise of a dark pixel.
"""

import cv2
import numpy as np

from eol_ros.core.table import Table
from eol_ros.errors import ConfigError
from eol_ros.said import said

_EMPTY = 0.3  # share of the image that is certainly free of lamps: its level is the ambient light
_PART = 8  # images of one average: noise below a grey level
_BLOCKS_LIT = 3  # squares on a lattice in a dark image that say it is not dark


class BackgroundModel:
    """Static light (h, w) uint8 above the ambient.

    Raises:
        ConfigError: not an 8-bit grey array.
    """

    def __init__(self, light: np.ndarray):
        light = np.ascontiguousarray(light)
        if light.ndim != 2 or light.dtype != np.uint8:
            raise ConfigError(
                f'background model has shape {light.shape} and type {light.dtype}; it is '
                'an 8-bit grey image'
            )
        self.light = light
        self._clean = np.empty_like(light)

    def remove(self, image: np.ndarray) -> np.ndarray:
        """Return `image` (h, w) uint8 without the static light; valid until the next call.

        Raises:
            ConfigError: the map is of another image size.
        """
        if image.shape != self.light.shape:
            raise ConfigError(
                f'background model is {self.light.shape[1]}x{self.light.shape[0]}, '
                f'the image {image.shape[1]}x{image.shape[0]}: learn it again '
                'with this camera'
            )
        cv2.subtract(image, self.light, dst=self._clean)
        self._clean[image == 255] = 255
        return self._clean


class BackgroundLearner:
    """Averages dark images, then tells lamps from ambient light. `images` counts what was taken.

    Every eight images have an average of their own, and the least of these counts: the light of a
    hand that goes by is nobody's lamp.
    """

    def __init__(self, table: Table) -> None:
        self._table, self.images = table, 0
        self._total: np.ndarray | None = None
        self._least: np.ndarray | None = None

    def add(self, image: np.ndarray) -> None:
        """Take one image (h, w) uint8 with all infrared LEDs off."""
        if self._total is None or self._total.shape != image.shape:
            self._total, self._least, self.images = np.zeros(image.shape, np.float32), None, 0
        cv2.accumulate(image, self._total)
        self.images += 1
        if self.images % _PART == 0:
            self._total /= _PART
            self._least = (
                self._total if self._least is None else np.minimum(self._least, self._total)
            )
            self._total = np.zeros(image.shape, np.float32)

    def result(self) -> BackgroundModel:
        """Return the map of what was seen.

        Raises:
            ConfigError: too few images were taken, or blocks were lit in them.
        """
        from eol_ros.core.vision.appearance.squares import lattice  # only after a darkness

        if self._least is None:
            raise ConfigError(said('few_dark', images=self.images, needed=_PART))
        light = self._least
        dark = np.rint(light).astype(np.uint8)
        dark.flags.writeable = False  # as live images
        lit = len(lattice(dark, self._table)[0])
        if lit >= _BLOCKS_LIT:
            raise ConfigError(said('still_lit', lit=lit))
        light = np.maximum(light - np.quantile(light[::4, ::4], _EMPTY), 0)
        return BackgroundModel(np.clip(np.rint(light), 0, 255).astype(np.uint8))
