# SPDX-License-Identifier: Apache-2.0
"""From one image to 25 named poses in metres: a pure function of the sequence of images.

Live node, `eol track` and the tests run this same class, so that what is measured offline is what
hangs in the museum, to the bit.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.geometry import BLOCK_SIDE_M, N_BLOCKS, rest_lattice
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect import cover_light, scan, search
from eol_ros.core.vision.detect.blobs import BLOB, BlobFinder
from eol_ros.core.vision.detect.brightness import Brightness
from eol_ros.core.vision.detect.homes import Homes
from eol_ros.core.vision.detect.lasting_misfit import LastingMisfit
from eol_ros.core.vision.identity.blink import Blink
from eol_ros.core.vision.identity.identity import Identity
from eol_ros.core.vision.requests import (
    BACKGROUND,
    CALIBRATE,
    COVER_PATTERNS,
    THRESHOLD,
    YAW_OFFSETS,
)
from eol_ros.core.vision.states import CALIBRATING, FAULT, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.tracker_base import M_STEP, PX_STEP, BaseTracker, Tracked, on_grid
from eol_ros.said import said
from eol_ros.settings import TrackerSettings

if TYPE_CHECKING:
    from eol_ros.core.vision.background.model import BackgroundModel

# By more no block goes or turns from image to image: it is another one that has its id now.
GOES_M, TURNS = 0.02, math.radians(45)
STEPS = np.array([M_STEP, PX_STEP])
NOWHERE = np.full((2, N_BLOCKS, 2), np.nan)


class Tracker(BaseTracker):
    """Keeps the 25 blocks of one camera.

    Parameters
    ----------
    settings : TrackerSettings
        As a scene has them.
    calibration : Calibration or None
        Of this camera. None starts with pixels and nominal metres of the size of the squares, and
        asks the settings for a mirror.
    finder : object, optional
        What finds squares in an image; anything with `find(image, predicted)`.

    Examples
    --------
    >>> from eol_ros.core.geometry import rest_lattice
    >>> from eol_ros.core.vision.render.renderer import Renderer
    >>> camera, at = Calibration.ideal(), rest_lattice()
    >>> tracker, renderer = Tracker(TrackerSettings(), camera), Renderer(calibration=camera)
    >>> for k in range(30):
    ...     image = renderer.render(at[:, 0], at[:, 1], np.zeros(25), k)
    ...     found = tracker.update(k / 60, image)
    >>> bool(found.state == TRACKING), int(found.seen.sum())
    (True, 25)
    >>> bool(np.abs(found.world - at).max() < 1e-4)  # m
    True
    """

    def __init__(
        self,
        settings: TrackerSettings,
        calibration: Calibration | None,
        finder: BlobFinder | None = None,
    ):
        super().__init__(settings, calibration)
        self._take(calibration)
        self.predicted = np.zeros((N_BLOCKS, 8))
        self.finder = finder or BlobFinder(calibration, settings.threshold)
        blink = None
        if settings.blink_block >= 0:
            blink = Blink(settings.blink_block, settings.blink_period_s, settings.blink_off_s)
        self.identity = Identity(settings.trust_start, blink, settings.know_covers)
        self.lattice = self.identity.lattice
        self.visibility: np.ndarray = np.zeros(N_BLOCKS, np.float32)
        self.brightness, self.misfit, self.homes = Brightness(), LastingMisfit(), Homes()
        self._renamings = 0
        self._stood, self._stood_yaw = self.lattice.xy, self.lattice.yaw  # in the last image
        self.last_s = -np.inf
        self._image, self._xy = np.zeros((0, 0), np.uint8), np.zeros((0, 2))  # of the last one
        self.blobs = np.zeros(0, BLOB)  # of the last image, for overlays

    def _take(self, calibration: Calibration | None) -> None:
        self.calibration = calibration
        if calibration is not None:
            self.watch.calibration = calibration
        self.packed = calibration.packed() if calibration is not None else np.zeros(mapping.NUMBERS)

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a knock of a block's accelerometer: it counts a fixed time after its stamp."""
        self.identity.tap(stamp_s, block, sigma_s)

    def learned(self) -> dict[str, bytes]:
        """Return what was learned of the blocks, by the request that brings it back."""
        found = {YAW_OFFSETS: self.lattice.yaws, COVER_PATTERNS: self.identity.covers}
        return {k: v.packed() for k, v in found.items() if v is not None and v.looks.any()}

    @property
    def background(self) -> 'BackgroundModel | None':
        """The light that is taken off each image."""
        return self.finder.background

    @background.setter
    def background(self, light: 'BackgroundModel | None') -> None:
        self.finder.background = light

    def side_px(self) -> float:
        """Return the side of a block in the middle of the last image, 0 when none was found."""
        return float(np.median(self.blobs['side_px'])) if len(self.blobs) else 0.0

    def sides_px(self) -> np.ndarray:
        """Return the side (25,) of each block in the last image, 0 where it was not seen."""
        seen, sides = self.lattice.seen, np.zeros(N_BLOCKS)
        sides[seen] = self.blobs['side_px'][self.lattice.index[seen]]
        return sides

    def warm_up(self) -> None:
        """Compile or load all compiled code, on throw-away state, before the first image comes.

        A video of the lattice without a column, then at rest, then moving; a side goes and comes
        back; all goes and comes.
        """
        import cv2

        calibration = self.calibration or Calibration.ideal()
        spare = Tracker(self.settings, calibration)
        shape = calibration.image_height, calibration.image_width
        half = BLOCK_SIDE_M / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        for k in range(90):
            image: np.ndarray = np.full(shape, 12, np.uint8)
            moved = rest_lattice() + max(k - 15, 0) * 4e-4
            if k < 2:
                moved = moved[moved[:, 0] > moved[:, 0].min()]
            for corners in moved[:, None] + half if not 60 <= k < 70 else []:
                outline = np.rint(calibration.to_pixels(corners) * 16).astype(np.int32)
                cv2.fillConvexPoly(image, outline, 200, cv2.LINE_AA, 4)
            if 30 <= k < 45:
                image[:, : shape[1] // 2] = 12
            image = cv2.GaussianBlur(image, (0, 0), 1.2)
            image.flags.writeable = False  # as it comes over the wire: a type of its own
            spare.update(k / 60, image)

    def update(self, stamp_s: float, image: np.ndarray) -> Tracked:
        """Take the next image; never raises for a bad one.

        Parameters
        ----------
        stamp_s : float
            Mid-exposure, in s.
        image : ndarray
            (h, w) uint8, grey.

        Returns
        -------
        Tracked
            All blocks, by id: pixels (25, 2), metres (25, 2), yaw (25,) rad, and the state.

        Examples
        --------
        >>> tracker = Tracker(TrackerSettings(), Calibration.ideal())
        >>> int(tracker.update(0.0, np.zeros((800, 1280), np.uint8)).seen.sum())
        0
        """
        image = scan.read_only(image)
        for kind, value in self.requests.due(stamp_s):
            self._fulfil(stamp_s, kind, value)
        if self.requests.dark(stamp_s, image):
            self.lattice.break_off(stamp_s)
            self.blobs = self.blobs[:0]
            return self._answer(stamp_s, LOST, said('lamps_learnt'))
        self._enlighten()
        fault = self.watch.fault(stamp_s, image)
        if fault:
            self.lattice.break_off(stamp_s)
            self.blobs = self.blobs[:0]
            return self._answer(stamp_s, FAULT, fault)
        lattice = self.lattice
        tracking = lattice.state == TRACKING
        blobs = self.finder.find(image, self._predicted(stamp_s))
        all_good, good, faint, sound = search.judged(blobs, tracking)
        if not all_good:
            blobs, faint, sound = blobs[good], faint[good], sound[good]
        self.blobs = blobs
        if self.calibration is None:
            if len(blobs) < 9:
                return self._answer(stamp_s, SEARCHING, f'{len(blobs)} squares: no scale yet')
            from eol_ros.core.vision.calibration import (
                self_calibration,  # and scipy with it: only here
            )

            self._take(self_calibration.nominal(image.shape, self.side_px(), self.settings.mirror))
            assert self.calibration is not None
            self.learning = self_calibration.SelfCalibration(self.calibration)
        xy, yaw, sigma = mapping.poses(self.packed, blobs, BLOCK_SIDE_M)
        self._image, self._xy = image, xy
        self.identity.update(stamp_s, xy, yaw, sigma, faint, self._glance, sound, self._bare)
        self.watch.rests(lattice.state == TRACKING and lattice.rests())
        seen = lattice.seen
        self.visibility, contrast = np.empty(N_BLOCKS, np.float32), np.empty(N_BLOCKS)
        search.by_block(blobs, seen, lattice.index, self.visibility, contrast)
        if self._renamings != lattice.renamings:
            self._renamings = lattice.renamings
            others = elementary.hypot(*(lattice.xy - self._stood).T) > GOES_M
            others |= np.abs(lattice.yaw - self._stood_yaw) > TURNS
            others |= not tracking  # nobody knows what became of them in the dark
            self.brightness.renamed(others)
            self.misfit.renamed(others)
            self.homes.renamed(others)
            self.finder.renamed(others)
        self._stood, self._stood_yaw = lattice.xy.copy(), lattice.yaw.copy()
        self.brightness.learn(stamp_s - self.last_s, seen, self.visibility, contrast)
        self.misfit.learn(stamp_s - self.last_s, lattice.index, blobs)
        self.homes.learn(stamp_s - self.last_s, lattice.xy, seen, self.visibility)
        self.last_s = stamp_s
        if lattice.state == TRACKING:
            return self._answer(stamp_s, *self._state(stamp_s, image))
        why = {SEARCHING: said('no_lattice', count=len(blobs)), LOST: said('out_of_sight')}
        return self._answer(stamp_s, lattice.state, why.get(lattice.state, ''))

    def _glance(self, detections: np.ndarray, yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how light is spread over the covers of detections (k,), as Identity asks."""
        patterns, good = (
            np.empty((len(detections), cover_light.SIZE)),
            np.empty(len(detections), bool),
        )
        cover_light.glance(
            self.packed, self._image, self._xy, self.blobs, detections, yaw, patterns, good
        )
        return patterns, good

    def _bare(self, xy: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """Return at which places (k, 2) m of blocks turned by yaw (k,) is nothing but platform."""
        return self.finder.bare(self._image, self._near(xy, yaw))

    def _fulfil(self, stamp_s: float, kind: str, value: Any) -> None:
        """Do what was asked for, from this image on."""
        if kind == THRESHOLD:
            self.finder.threshold = value
        elif kind == BACKGROUND:
            self.background = value
        elif kind == YAW_OFFSETS:
            self.lattice.yaws = value
        elif kind == COVER_PATTERNS:
            if self.identity.covers is not None:
                self.identity.covers = value
        elif kind == CALIBRATE:
            self._ask(stamp_s)

    def _start(self) -> Calibration:
        """Return a straight camera with the scale, covers and lens of the calibration."""
        from eol_ros.core.vision.calibration import self_calibration

        known = super()._start()
        shape = known.image_height, known.image_width
        start = self_calibration.nominal(shape, known.px_per_m() * BLOCK_SIDE_M, known.mirrored)
        return replace(
            start,
            cover_height_m=known.cover_height_m,
            covers=known.covers,
            distortion_coefficients=known.distortion_coefficients,
        )

    def _squares(self, stamp_s: float) -> np.ndarray | None:
        from eol_ros.core.vision.appearance.squares import SQUARE

        lattice = self.lattice
        if not (lattice.seen.all() and self.visibility.min() > 0.8 and lattice.rests()):
            return None
        blobs, squares = self.blobs[lattice.index], np.zeros(N_BLOCKS, SQUARE)
        for name in SQUARE.names or ():
            squares[name] = blobs[name]
        if self.calibration is not None and self.calibration.covers is not None:
            self._predicted(stamp_s)
            squares['theta'] += self.predicted[:, 4] * (np.pi / 2)
        return squares

    def _recalibrate(self, found: Calibration) -> None:
        assert self.calibration is not None
        self.lattice.move(found.to_table(self.calibration.to_pixels(self.lattice.xy)))
        self._take(found)
        self.finder.calibration = found

    def _predicted(self, stamp_s: float) -> np.ndarray | None:
        """Where squares are expected, (n, 6), for the finder; see BlobFinder.find."""
        lattice = self.lattice
        if self.calibration is None:
            return None
        if lattice.state != TRACKING:
            near = self._near(lattice.around_xy, lattice.around_yaw)
            return near if len(near) else None
        ahead = stamp_s - self.last_s
        mapping.expected(
            self.packed,
            lattice.xy,
            lattice.velocity,
            lattice.yaw,
            self.brightness.contrast * self.brightness.exposure,
            ahead if 0 < ahead < 0.1 else 0.0,
            self.predicted,
            self._bend(),
        )
        self.predicted[:, 5] = stamp_s - lattice.seen_s
        self.homes.expected(self.packed, self.predicted[:, 6:])
        if lattice.ambiguous:  # then it is not known which cover is which
            self.predicted[:, 4] = -1.0
        return self.predicted

    def _near(self, xy: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """Return places (k, 2) m of blocks nobody knows as the finder takes them, (k, 6)."""
        still, near = np.zeros_like(xy), np.empty((len(xy), 6))
        light = still[:, 0].copy()
        mapping.expected(self.packed, xy, still, yaw, light, 0.0, near, self._bend())
        near[:, 4:] = -1.0, np.inf
        return near

    def _bend(self) -> float:
        return mapping.BEND if self.calibration and self.calibration.covers is not None else 0.0

    def _answer(self, stamp_s: float, state: int, why: str) -> Tracked:
        lattice = self.lattice
        px, world = NOWHERE.copy()
        yaw, sigma = on_grid(lattice.yaw, lattice.sigma / self.misfit.lasting)
        if state in (SEARCHING, FAULT) or self.calibration is None:
            seen, visibility = np.zeros(N_BLOCKS, bool), np.zeros(N_BLOCKS, np.float32)
        else:
            seen = lattice.seen.copy()
            visibility = self.visibility * seen
            mapping.answer(
                self.packed, lattice.xy, seen, lattice.index, self.blobs, STEPS, px, world
            )
            if state == CALIBRATING or self.learning is not None:
                world[:] = np.nan
        return Tracked(
            stamp_s,
            px,
            yaw,
            world,
            seen,
            sigma,
            visibility,
            state,
            bool(lattice.ambiguous),
            why,
            self.identity.names.changed(stamp_s),
        )
