# SPDX-License-Identifier: Apache-2.0
"""Find the lit squares of one image and measure them to a few thousandths of a pixel.

Each image is scanned as a whole, so there is no window out of which a block could fall. Squares are
fitted where they are predicted and where light is left unexplained (see edges, scan).
"""

import numpy as np

from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS
from eol_ros.core.vision import edges, profiles, scan
from eol_ros.core.vision.calibration import Calibration
from eol_ros.errors import ConfigError

BLOB = np.dtype([('u', 'f8'), ('v', 'f8'), ('theta', 'f8'), ('side_px', 'f8'),
                 ('visibility', 'f4'), ('sigma_px', 'f4'), ('quality', 'f4'), ('contrast', 'f4')])

SIDES_PX = (16.0, 160.0)  # squares that can be blocks while their size is not yet known
_BLUR_PX = 1.25  # edges of a lens in focus, pixel included
_MOST_REGIONS = 96
_LABELS = 20000
_GLANCE = 8  # images between looks for more squares while all 25 are in sight
_HALF_SIGMA_PX = 0.25  # how well the size of a block is known beforehand
_TIGHT_PX = 0.05  # and with a calibration
_MOST_SIGMA_PX = 0.3  # a square less sure than this is not reported
# least share of edges that agree, of the worst side, and least quality
_PREDICTED = (0.30, 0.0, 0.10)
_NEW = (0.60, 0.30, 0.40)
_REGAINED = (0.35, 0.0, 0.25)
_DIM, _GLARING = 0.65, 1.9  # of the contrast that a block had when it was last seen whole
_FULLER = 0.2  # by this share a square must be fuller of light than its surroundings
_AGAIN = 5  # images until a light that was no square is asked again
_SAME_PX = 10.0


class BlobFinder:
    """Finds and measures squares, image after image.

    What it learns on the way (size of the squares over the image, brightness, background) is a
    function of the images seen and of nothing else, so that a replay gives the same numbers.

    `clutter` may be set to a ClutterMap at any time; its light is then taken off every image. So
    may `threshold`, grey levels that the light of a cover must have at least.

    Args:
        settings: unused by the finder itself except `blur_px`, the edge blur, when it has one.
        calibration: gives the expected size of a block anywhere in the image; None learns it.
    """

    def __init__(self, settings=None, calibration=None):
        self.blur_px = float(getattr(settings, 'blur_px', _BLUR_PX))
        self._shape = (0, 0)
        self.calibration = calibration
        self.clutter = None
        self.threshold = float(getattr(settings, 'threshold', 0.0))
        self._size: np.ndarray | None = None  # of a side, px: at the middle, per width, per height
        self._scratch = profiles.workspace()
        self._fitted = np.zeros((_MOST_REGIONS, edges.FIELDS))
        self._kept = np.zeros((_MOST_REGIONS, edges.FIELDS))
        self._found = np.zeros((_MOST_REGIONS, 6))
        self._contrast = 0.0
        self._turn = 0

    def find(self, image: np.ndarray, predicted=None) -> np.ndarray:
        """Return the squares in `image` (h, w) uint8 as a BLOB array, predicted ones first.

        Args:
            predicted: (k, 3) u, v, theta where blocks are expected, good to a few px; a fourth
                column says their contrast in grey levels, 0 where that is not known.

        Raises:
            ConfigError: not an 8-bit grey image.
        """
        if image.ndim != 2 or image.dtype != np.uint8:
            raise ConfigError(f'image has shape {image.shape} and type {image.dtype}; blocks are '
                              'found in 8-bit grey images: set the camera to grey (mono8)')
        if image.shape != self._shape:
            self._begin(image.shape)
        if self.clutter is not None:
            image = self.clutter.remove(image)
        image = scan.read_only(image)
        scan.sample(image, self._grid)
        scan.backgrounds(self._grid, self._tiles, self._turn % 8 if self._turn else 0,
                         8 if self._turn else 1)
        self._turn += 1
        n = 0
        if predicted is not None and len(predicted) and self._known():
            predicted = np.asarray(predicted, float)
            predicted = predicted[np.isfinite(predicted[:, :3]).all(axis=1)]
            near, own = predicted[:, :3], predicted[:, 3] if predicted.shape[1] > 3 else None
            n = self._keep(self._fit(image, near, 0, own), n, *_PREDICTED)
            n = self._look_about(image, near, own, n)
        # all blocks of the table found where they were expected: nothing is left to look for
        looks = 0 if n >= N_BLOCKS and self._turn % _GLANCE else 2
        for _ in range(looks):
            before = n
            scan.erase(self._grid, self._tiles, self._kept[:n], scan.STEP)
            starts = self._unexplained()
            if predicted is not None:
                starts = self._not_refused(starts)
            if not len(starts):
                break
            n = self._keep(self._fit(image, starts, search=2), n, *_NEW)
            self._refuse(starts, n)
            if before or n == before:
                break
            self._learn(self._kept[:n], 1.0)  # a first look: now look again with the right size
        kept = self._kept[:n]
        if self._turn % 8 == 0 or self._size is None:
            self._learn(kept, 0.3)
        blobs = np.zeros(len(kept), BLOB)
        blobs['u'], blobs['v'] = kept[:, edges.U], kept[:, edges.V]
        blobs['theta'] = kept[:, edges.THETA]
        blobs['side_px'] = 2 * kept[:, edges.HALF]
        blobs['visibility'] = np.minimum(kept[:, edges.VISIBLE], 1.0)
        blobs['sigma_px'] = kept[:, edges.SIGMA]
        blobs['quality'] = kept[:, edges.QUALITY]
        blobs['contrast'] = kept[:, edges.CONTRAST]
        return blobs

    def _begin(self, shape) -> None:
        """Prepare for images of another size."""
        if min(shape) < 64:
            raise ConfigError(f'image of {shape[1]}x{shape[0]} px is too small to show the table')
        self._shape = shape
        rows, cols = (shape[0] - 2) // scan.STEP, (shape[1] - 2) // scan.STEP
        self._grid = np.zeros((rows, cols), np.uint8)
        self._tiles = np.zeros((-(-rows // scan.TILE), -(-cols // scan.TILE)), np.uint8)
        self._label = np.zeros((rows, cols), np.int32)
        self._parent = np.zeros(_LABELS, np.int32)
        self._stats = np.zeros((_LABELS, 9))
        self._size, self._contrast, self._turn = None, 0.0, 0
        self._refused = np.zeros((0, 3))  # u, v, and in which image
        self.calibration = self._calibration

    @property
    def calibration(self) -> Calibration | None:
        """What the expected sizes come from; may be set at any time."""
        return self._calibration

    @calibration.setter
    def calibration(self, calibration: Calibration | None) -> None:
        self._calibration = calibration
        if calibration is None or self._shape == (0, 0):
            return
        u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(-0.45, 0.45, 7)] * 2))
        px = np.column_stack([u + 0.5, v + 0.5]) * self._shape[::-1]
        half = calibration.side_px(px, BLOCK_SIDE_M) / 2
        self._field = np.linalg.lstsq(
            _terms(u, v), np.column_stack([half, calibration.shear(px)]), rcond=None)[0]

    def _look_about(self, image, near, own, n) -> int:
        """Try again around predictions (k, 3) that failed and have light left beside them."""
        if n == len(near):
            return n
        away = np.hypot(near[:, None, 0] - self._kept[None, :n, 0],
                        near[:, None, 1] - self._kept[None, :n, 1])
        gone = away.min(axis=1, initial=np.inf) > 20
        lost = near[gone]
        if not len(lost):
            return n
        scan.erase(self._grid, self._tiles, self._kept[:n], scan.STEP)
        over = np.full(len(lost), max(0.4 * self._contrast, 20.0))
        if own is not None:
            own = own[gone]
            over = np.where(own > 0, 0.55 * own, over)
        place = np.zeros((len(lost), 3))
        scan.seek(self._grid, self._tiles, lost, self._expected(lost[:, :2]), over, place)
        near = place[:, 2] > _FULLER
        starts = lost[near] + np.column_stack([place[near, :2], np.zeros(near.sum())])
        return self._keep(self._fit(image, starts, 2, None if own is None else own[near]), n,
                          *_REGAINED)

    def _not_refused(self, starts: np.ndarray) -> np.ndarray:
        """Leave out `starts` (k, >= 2) of lights that were tried a moment ago: arms stay arms."""
        self._refused = self._refused[self._turn - self._refused[:, 2] < _AGAIN]
        apart = starts[:, None, :2] - self._refused[None, :, :2]
        return starts[(np.abs(apart).max(axis=2, initial=0.0) > _SAME_PX).all(axis=1)] \
            if len(self._refused) else starts

    def _refuse(self, starts: np.ndarray, n: int) -> None:
        """Remember those of `starts` (k, >= 2) that gave no square."""
        apart = starts[:, None, :2] - self._kept[None, :n, :2]
        no = (np.abs(apart).max(axis=2, initial=0.0) > _SAME_PX).all(axis=1)
        new = np.column_stack([starts[no, :2], np.full(no.sum(), self._turn)])
        self._refused = np.concatenate([self._refused, new])

    def _known(self) -> bool:
        return self._size is not None or self.calibration is not None

    def _expected(self, uv: np.ndarray) -> np.ndarray:
        """Return the half side in px (n,) of a block at `uv` (n, 2), once it is known."""
        u, v = (uv / self._shape[::-1] - 0.5).T
        if self.calibration is not None:
            return _terms(u, v) @ self._field[:, 0]
        assert self._size is not None
        return (self._size[0] + self._size[1] * u + self._size[2] * v) / 2

    def _shears(self, starts: np.ndarray) -> np.ndarray:
        """Return how lens and tilt shear a square (n, 2) at `starts` (n, >= 2)."""
        if self.calibration is None:
            return np.zeros((len(starts), 2))
        u, v = (starts[:, :2] / self._shape[::-1] - 0.5).T
        return _terms(u, v) @ self._field[:, 1:]

    def _fit(self, image, starts, search, own=None) -> np.ndarray:
        """Return fitted squares (n, FIELDS) from `starts` (n, 3) or (n, 4) with their half side.

        own (n,): contrast that each is known to have, 0 where it is not.
        """
        starts = starts[:_MOST_REGIONS]
        if not len(starts):
            return np.zeros((0, edges.FIELDS))
        half_sigma = _HALF_SIGMA_PX
        if starts.shape[1] == 3:
            half = self._expected(starts[:, :2])
        else:
            half, half_sigma = starts[:, 3], 0.05 * float(np.median(starts[:, 3]))
        tight = _TIGHT_PX if self.calibration is not None else 0.0
        out = self._fitted[:len(starts)]
        edges.fit_squares(image, np.column_stack([starts[:, :3], half]), self._shears(starts),
                          self.blur_px, half_sigma, tight, search, *self._scratch, out)
        off = np.abs(out[:, edges.HALF] / half - 1)
        moved = np.hypot(*(out[:, :2] - starts[:, :2]).T)
        # a hand may stand where a block should; it is dimmer, or its edges are not all there
        contrast = out[:, edges.CONTRAST]
        dim = contrast < 0.5 * self._contrast
        if own is None:
            out[:, edges.QUALITY] *= out[:, edges.ALONE]
        else:  # a block known by its brightness may have an arm beside it that is as bright
            out[:, edges.QUALITY] *= np.where(own > 0, 1.0, out[:, edges.ALONE])
            dim = np.where(own > 0, (contrast < _DIM * own) | (contrast > _GLARING * own), dim)
        good = ((out[:, edges.SIGMA] < _MOST_SIGMA_PX) & (moved < half)
                & (out[:, edges.LEVEL] >= self.threshold)
                & (off < (0.06 if half_sigma == _HALF_SIGMA_PX else 0.25))
                & (contrast > 0.2 * self._contrast)
                & ~(dim & (out[:, edges.VISIBLE] < 0.8)))
        out[~good, edges.VISIBLE] = 0.0
        return out

    def _keep(self, fits, n, least_visible, least_worst, least_quality) -> int:
        """Append to the squares kept in this image; return their new number."""
        order = np.argsort(-fits[:, edges.QUALITY], kind='stable')
        return edges.keep_apart(fits, order, self._kept, n, least_visible, least_worst,
                                least_quality)

    def _unexplained(self) -> np.ndarray:
        """Return starts of squares, (n, 3) or, while their size is unknown, (n, 4)."""
        contrast = self._contrast
        if not contrast:
            contrast = scan.bright_level(self._grid, 0.02) - float(np.median(self._tiles))
        over = max(0.3 * contrast, profiles.MIN_CONTRAST)
        if self._known():
            middle = np.array([self._shape[::-1]]) / 2
            area = (2 * self._expected(middle)[0] / scan.STEP) ** 2
            least, most = 0.35 * area, 2.2 * area
        else:
            least, most = ((side / scan.STEP) ** 2 for side in SIDES_PX)
        n = scan.regions(self._grid, self._tiles, over, least, most, self._label, self._parent,
                         self._stats, self._found)
        found = self._found[:n]
        if self._known():
            return found[:, :3].copy()
        # a square fills between half (at 45 degrees) and all of the box around it
        box = found[:, 4] * found[:, 5]
        area = found[:, 3] * scan.STEP ** 2
        ratio = found[:, 4] / found[:, 5]
        square = (area > 0.42 * box) & (ratio > 0.7) & (ratio < 1.43)
        found, area = found[square], area[square]
        if not len(found):
            return np.zeros((0, 4))
        usual = np.median(area)
        alike = (area > 0.6 * usual) & (area < 1.6 * usual)
        half = np.sqrt(area[alike]) / 2
        return np.column_stack([found[alike, :3], half])

    def _learn(self, kept, share: float) -> None:
        """Renew a share of what is known of size and brightness from squares seen whole."""
        whole = kept[(kept[:, edges.VISIBLE] > 0.9) & (kept[:, edges.QUALITY] > 0.7)]
        if len(whole) < 4:
            return
        self._contrast = float(np.median(whole[:, edges.CONTRAST]))
        if self.calibration is not None:
            return
        side = 2 * whole[:, edges.HALF]
        usual = np.median(side)
        alike = np.abs(side / usual - 1) < 0.06
        if alike.sum() < 4:
            return
        u, v = (whole[alike, :2] / self._shape[::-1] - 0.5).T
        columns = np.column_stack([np.ones(len(u)), u, v])
        # a plane, held flat by a prior so that few blocks in one place cannot tip it
        normal = columns.T @ columns
        normal[1, 1] += 0.005 * len(u)
        normal[2, 2] += 0.005 * len(u)
        plane = np.linalg.solve(normal, columns.T @ (side[alike] - usual))
        plane[0] += usual
        if self._size is None:
            self._size = plane
        else:
            self._size += share * (plane - self._size)


def _terms(u, v) -> np.ndarray:
    """Return the terms (n, 6) of a quadratic over the image."""
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
