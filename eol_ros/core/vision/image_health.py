# SPDX-License-Identifier: Apache-2.0
"""Is what the camera sends usable at all? One line says why not."""

from collections.abc import Callable

import numpy as np

from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.errors import ConfigError
from eol_ros.said import said

STEP = 16  # every 16th pixel of every 16th row says enough, for 5 us
BLACK = 3  # grey levels: an image without spread and this dark is black
FROZEN_S = 0.5
WHOLE = 0.98  # of an outline in view
SIZED_IMAGES = 5  # of blocks in full view say how large they are
SIZED_SHARE = 0.48  # of all blocks at least
UNLIKE = 0.0047  # spread of sizes: path-traced 0.0033 at most with the right covers, else 0.0069
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
            return said('not_grey', kind=axes)
        if self.calibration is not None:
            try:
                self.calibration.check_image(image)
            except ConfigError as error:
                return str(error)
        elif self.shape is not None and image.shape != self.shape:
            (h, w), (first_h, first_w) = image.shape, self.shape
            first = {'first_width': first_w, 'first_height': first_h}
            return said('other_size', width=w, height=h, **first)
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
            return said('black')
        if low >= 250:
            return said('white')
        if self.same and self.differed >= LIVELY and stamp_s - self.since_s > FROZEN_S:
            return said('frozen', seconds=f'{FROZEN_S:g}')
        return ''

    def rests(self, resting: bool) -> None:
        """Learn whether images of a table at rest differ: only then an identical one is a fault."""
        if resting and self.differed < LIVELY:
            self.differed = 0 if self.same else self.differed + 1


class Sizes:
    """Notices covers that are not those of the calibration: their blocks differ in size.

    How large a block looks follows from the heights of its own cover, so with those of other covers
    (or of none) some look larger and some smaller than they should. A scale that is wrong for all
    is no sign of it: light that spreads at edges does that too.
    """

    def __init__(self, calibration: Calibration):
        self.calibration, table = calibration, calibration.table
        self._enough = SIZED_SHARE * table.count
        self._ratios: list[np.ndarray] = []
        self.spread = np.nan  # of the sizes of blocks over what they should be; NaN: not known yet

    def add(
        self, world: np.ndarray, sides_px: Callable[[], np.ndarray], visibility: np.ndarray
    ) -> bool:
        """Take in one image: places (n, 2) in m, shares in view (n,), what measures sides in px.

        True when enough images have come, and `spread` is known.
        """
        if len(self._ratios) == SIZED_IMAGES:
            return True
        whole = (visibility > WHOLE) & np.isfinite(world[:, 0])
        if whole.sum() < self._enough:
            return False
        ratios = np.full(len(world), np.nan)
        camera = self.calibration
        px = camera.to_pixels(world[whole])
        ratios[whole] = sides_px()[whole] / camera.side_px(px, camera.table.block_side_m)
        self._ratios.append(ratios)
        if len(self._ratios) < SIZED_IMAGES:
            return False
        often = np.isfinite(self._ratios).sum(axis=0) > SIZED_IMAGES // 2
        if often.sum() < self._enough:
            self._ratios.clear()
            return False
        sizes = np.nanmedian(np.array(self._ratios)[:, often], axis=0)
        self.spread = float(1.4826 * np.median(np.abs(sizes - np.median(sizes))))
        return True

    def fault(self) -> str:
        """Return what is wrong with the covers, in one line, or an empty string."""
        if not self.spread > UNLIKE:
            return ''
        known = 'others' if self.calibration.covers is not None else 'flat ones'
        return (
            f'blocks differ in size by {self.spread:.1%} from what their covers should look like: '
            f'the calibration is of {known}; `eol calibrate blocks --covers FOLDER` names these'
        )
