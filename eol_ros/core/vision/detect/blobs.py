# SPDX-License-Identifier: Apache-2.0
"""Find the lit squares of one image and measure them to a few thousandths of a pixel.

Each image is scanned as a whole, so there is no window out of which a block could fall. Squares are
fitted where they are predicted and where light is left unexplained (see edges, scan).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from eol_ros.core import algebra
from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS
from eol_ros.core.vision.calibration import covers, mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import edges, outline, profiles, scan, search, usual_outline
from eol_ros.errors import ConfigError

if TYPE_CHECKING:
    from eol_ros.core.vision.background.model import BackgroundModel

BLOB = np.dtype(
    [
        ('u', 'f8'),
        ('v', 'f8'),
        ('theta', 'f8'),
        ('side_px', 'f8'),
        ('visibility', 'f4'),
        ('sigma_px', 'f4'),
        ('quality', 'f4'),
        ('contrast', 'f4'),
        ('misfit', 'f4'),
    ]
)

SIDES_PX = (16.0, 160.0)  # squares that can be blocks while their size is not yet known
_BLUR_PX = 1.25  # edges of a lens in focus, pixel included
_MOST_REGIONS = 96
_LABELS = 20000  # int16
# images between looks for more squares while all 25 are in sight, and while some are not: those are
# sought about their places in every image
_GLANCE, _GLANCE_MISSED = 8, 4
_MOST_FOUND = 12  # blocks
# columns of what is expected of a block
_UNKNOWN = np.array([0.0, 0.0, 0.0, 0.0, -1.0, np.inf, np.nan, np.nan])


class BlobFinder:
    """Finds and measures squares, image after image.

    What it learns on the way (size of the squares over the image, brightness, background) is a
    function of the images seen and of nothing else, so that a replay gives the same numbers.

    `background` may be set to a BackgroundModel at any time; its light is then subtracted from
    every image. So may `threshold`, grey levels that the light of a cover must have at least.

    Args:
        calibration: gives the expected size of a block anywhere in the image, and the outlines of
            its cover; None learns the size.
        threshold: grey levels.
    """

    def __init__(self, calibration: Calibration | None = None, threshold: float = 0.0):
        self._known = np.zeros(search.KNOWN)
        self._known[search.BLUR] = _BLUR_PX
        self._shape = (0, 0)
        self.calibration = calibration
        self.background: BackgroundModel | None = None
        self.threshold = threshold
        self._scratch = profiles.workspace()
        self._fits = np.zeros((_MOST_REGIONS, edges.FIELDS))
        self._kept = np.zeros((_MOST_REGIONS, edges.FIELDS))
        self._found = np.zeros((_MOST_REGIONS, 6))
        self._found_more = False  # in the last image, than where blocks were expected
        self._refused = np.zeros((_MOST_REGIONS, 3))

    def renamed(self, others: np.ndarray) -> None:
        """Learn the outlines of blocks `others` (25,) again: their ids mean other blocks now."""
        self._usual[:-1][others] = usual_outline.rows(0)

    @property
    def threshold(self) -> float:
        """Grey levels that the light of a cover must have at least."""
        return float(self._known[search.THRESHOLD])

    @threshold.setter
    def threshold(self, threshold: float) -> None:
        self._known[search.THRESHOLD] = threshold

    def find(self, image: np.ndarray, predicted: ArrayLike | None = None) -> np.ndarray:
        """Return the squares in `image` (h, w) uint8 as a BLOB array, predicted ones first.

        Args:
            predicted: (k, 3) u, v, theta where blocks are expected, good to a few px; a fourth
                column says their contrast in grey levels, 0 where that is not known; a fifth that
                row i is block i, and how many right angles lie from theta to its x axis, or -1; a
                sixth how many seconds ago it was seen; two more where it rested, NaN for not known.

        Raises:
            ConfigError: not an 8-bit grey image.
        """
        if image.ndim != 2 or image.dtype != np.uint8:
            raise ConfigError(
                f'image has shape {image.shape} and type {image.dtype}; blocks are '
                'found in 8-bit grey images: set the camera to grey (mono8)'
            )
        if image.shape != self._shape:
            self._begin(image.shape)
        if self.background is not None:
            image = self.background.remove(image)
        image = scan.read_only(image)
        known, kept, turn = self._known, self._kept, int(self._known[search.TURN])
        scan.sample(image, self._grid)
        scan.backgrounds(self._grid, self._tiles, turn % 8, 8 if turn else 1)
        turn += 1
        known[search.TURN] = turn
        n = 0
        expected = np.zeros((0, 3)) if predicted is None else np.asarray(predicted, float)
        if len(expected) and known[search.FIELD]:
            near = np.empty((len(expected), len(_UNKNOWN)))
            near[:, : expected.shape[1]] = expected
            near[:, expected.shape[1] :] = _UNKNOWN[expected.shape[1] :]
            n = search.at_predictions(
                image,
                known,
                self._grid,
                self._tiles,
                near,
                *self._relief,
                self._usual,
                *self._scratch,
                self._fits,
                kept,
            )
        # most blocks found where they were expected: little is left to look for
        busy = n < _MOST_FOUND or self._found_more or known[search.LEFT]
        each = 1 if busy else _GLANCE_MISSED
        expected_n = n
        few = search.SOFT_MOST_TRIED if len(self._relief[1]) else search.MOST_TRIED
        for _ in range(0 if turn % (_GLANCE if n >= N_BLOCKS else each) else 2):
            before = n
            if predicted is None:  # nothing is known of where blocks are: try every light
                known[search.REFUSED] = 0
            scan.erase(self._grid, self._tiles, kept, 0, n, scan.STEP)
            starts = self._unexplained()
            known[search.LEFT] = 0
            if not len(starts):
                break
            self._table[0] = 0.0
            n = search.at_lights(
                image,
                known,
                starts,
                self._refused,
                few if before >= _MOST_FOUND else _MOST_REGIONS,
                *self._relief,
                self._usual,
                *self._scratch,
                self._fits,
                kept,
                n,
            )
            if before or n == before:
                break
            self._learn(n, 1.0)  # a first look: now look again with the right size
        self._found_more = n > expected_n
        search.learn_usual(known, kept, n)
        if self._calibration is None and (turn % 8 == 0 or not known[search.FIELD]):
            self._learn(n, 0.3)
        blobs = np.zeros(n, BLOB)
        search.report(kept, blobs)
        return blobs

    def bare(self, image: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return at which `places` (k, 3) u, v, theta of the last image is nothing but platform."""
        if self.background is not None:
            image = scan.read_only(self.background.remove(image))
        scan.sample(image, self._grid)  # squares that were found are erased in it
        found = np.empty(len(places), bool)
        search.bare(self._known, image.shape, self._grid, self._tiles, places, found)
        return found

    def _begin(self, shape: tuple[int, int]) -> None:
        """Prepare for images of another size."""
        if min(shape) < 64:
            raise ConfigError(f'image of {shape[1]}x{shape[0]} px is too small to show the table')
        self._shape = shape
        rows, cols = (shape[0] - 2) // scan.STEP, (shape[1] - 2) // scan.STEP
        self._grid = np.zeros((rows, cols), np.uint8)
        self._tiles = np.zeros((-(-rows // scan.TILE), -(-cols // scan.TILE)), np.uint8)
        self._label = np.zeros((rows, cols), np.int16)
        self._parent = np.zeros(_LABELS, np.int32)
        self._stats = np.zeros((_LABELS, 7))
        self._found_more = False
        for what in (search.CONTRASTS, search.TURN, search.REFUSED, search.LEFT):
            self._known[what] = 0.0
        self._known[search.AGREEING] = 1.0
        self._known[search.FIELD :] = 0.0
        self.calibration = self._calibration

    @property
    def calibration(self) -> Calibration | None:
        """What the expected sizes come from; may be set at any time."""
        return self._calibration

    @calibration.setter
    def calibration(self, calibration: Calibration | None) -> None:
        self._calibration = calibration
        self._usual = usual_outline.rows(N_BLOCKS)
        self._known[search.CALIBRATED] = calibration is not None
        self._table = np.zeros(outline.SIZE, np.float32)
        outlines, camera = covers.FLAT, np.zeros(mapping.NUMBERS)
        if calibration is not None and calibration.covers is not None:
            outlines = calibration.covers.over(calibration.cover_height_m)
            camera = calibration.packed()
        self._relief = camera, outlines, self._table
        if calibration is None or self._shape == (0, 0):
            return
        u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(-0.45, 0.45, 7)] * 2))
        px = np.column_stack([u + 0.5, v + 0.5]) * self._shape[::-1]
        half = calibration.side_px(px, BLOCK_SIDE_M) / 2
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
        shear = calibration.shear(px)
        self._known[search.FIELD :] = algebra.least_squares(
            terms, np.column_stack([half, shear])
        ).T.ravel()

    def _unexplained(self) -> np.ndarray:
        """Return starts of squares, (n, 4): u, v, theta, half side or 0 where it is known."""
        known = self._known
        contrast = known[search.CONTRASTS]
        if not contrast:
            contrast = scan.bright_level(self._grid, 0.02) - float(np.median(self._tiles))
        over = max(0.3 * contrast, profiles.MIN_CONTRAST)
        if known[search.FIELD]:
            area = (2 * known[search.FIELD] / scan.STEP) ** 2
            least, most = 0.35 * area, 2.2 * area
        else:
            least, most = ((side / scan.STEP) ** 2 for side in SIDES_PX)
        n = scan.regions(
            self._grid,
            self._tiles,
            over,
            least,
            most,
            self._label,
            self._parent,
            self._stats,
            self._found,
        )
        found = self._found[:n]
        if known[search.FIELD]:
            starts = found[:, :4].copy()
            starts[:, 3] = 0.0
            return starts
        # a square fills between half (at 45 degrees) and all of the box around it
        box = found[:, 4] * found[:, 5]
        area = found[:, 3] * scan.STEP**2
        ratio = found[:, 4] / found[:, 5]
        square = (area > 0.42 * box) & (ratio > 0.7) & (ratio < 1.43)
        found, area = found[square], area[square]
        if not len(found):
            return np.zeros((0, 4))
        usual = np.median(area)
        alike = (area > 0.6 * usual) & (area < 1.6 * usual)
        half = np.sqrt(area[alike]) / 2
        return np.column_stack([found[alike, :3], half])

    def _learn(self, n: int, share: float) -> None:
        """Renew a share of what is known of the size from the first `n` squares, seen whole."""
        kept, known = self._kept[:n], self._known
        search.learn_usual(known, self._kept, n)
        whole = kept[(kept[:, edges.VISIBLE] > 0.9) & (kept[:, edges.QUALITY] > 0.7)]
        if len(whole) < 4 or self._calibration is not None:
            return
        half = whole[:, edges.HALF]
        usual = np.median(half)
        alike = np.abs(half / usual - 1) < 0.06
        if alike.sum() < 4:
            return
        u, v = (whole[alike, :2] / self._shape[::-1] - 0.5).T
        columns = np.column_stack([np.ones(len(u)), u, v])
        # a plane, held flat by a prior so that few blocks in one place cannot tip it
        normal = algebra.matmul(columns.T, columns)
        normal[1, 1] += 0.005 * len(u)
        normal[2, 2] += 0.005 * len(u)
        plane = algebra.solve(normal, algebra.matmul(columns.T, half[alike] - usual))
        plane[0] += usual
        size = known[search.FIELD : search.FIELD + 3]
        size += (share if size[0] else 1.0) * (plane - size)
