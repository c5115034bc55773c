# SPDX-License-Identifier: Apache-2.0
"""From one image to named poses in metres: a pure function of the sequence of images.

Live node, `eol track` and the tests run this same class, so that what is measured offline is what
hangs in the museum, to the bit.
"""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eol_ros.core.compiled import read_only
from eol_ros.core.table import Table
from eol_ros.core.vision.appearance import learnt, model
from eol_ros.core.vision.appearance.follow import Follower, to_pixels
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.blink import Blink
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.image_health import Watch
from eol_ros.core.vision.requests import BACKGROUND, CALIBRATE, COVERS, DARKNESS, Outcome, Requests
from eol_ros.core.vision.states import CALIBRATING, FAULT, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.turn_by_taps import TurnByTaps
from eol_ros.errors import ConfigError
from eol_ros.said import clauses, said
from eol_ros.settings import TrackerSettings

if TYPE_CHECKING:
    from eol_ros.core.vision.calibration import self_calibration

SEEK_S = 0.5  # between two searches for squares whose size is not known
WHOLE = 0.8  # visible of each block when the camera is calibrated by the blocks
REST_S = 20.0  # for so long a calibration that was asked for waits for the blocks to rest
SETTLE_S = 0.3  # after a new calibration; longer than any rest that motion compares with
LAMP_LEVEL = 5  # grey levels
# Answers lie on grids far finer than any noise (1 um, 0.001 px, 15 urad; a sigma to 2 %), so that a
# bag packs them well: what is rounded off adds less than 0.1 % to the variance of a still block.
M_STEP, PX_STEP, RAD_STEP = 2.0**-20, 2.0**-10, 2.0**-16
SIGMA_STEPS = 64


def on_grid(yaw: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return yaw and sigma (n,) on the grids of answers."""
    turned, coarse = np.empty((2, len(yaw)))
    mapping.rounded(yaw, sigma_m, RAD_STEP, SIGMA_STEPS, turned, coarse)
    return turned, coarse


class Tracked(NamedTuple):
    """All blocks in one image, as in eol_msgs/Blocks; arrays by block id.

    px (cells, 2) and world (cells, 2) in m hold for hidden blocks too (`seen` false), carried by
    their neighbours; both are NaN while the state is searching or fault and where no block is,
    world also while calibrating. yaw (cells,) rad, unwrapped. sigma_m, visibility (cells,). why:
    one line when the state is not tracking.
    changed: blocks whose covers were lately found to be others than before.
    """

    stamp_s: float
    px: np.ndarray
    yaw: np.ndarray
    world: np.ndarray
    seen: np.ndarray
    sigma_m: np.ndarray
    visibility: np.ndarray
    state: int
    symmetry_ambiguous: bool
    why: str = ''
    changed: tuple[int, ...] = ()


class Tracker:
    """Keeps the blocks of one camera by the faces of their covers.

    Parameters
    ----------
    settings : TrackerSettings
        As a scene has them.
    calibration : Calibration or None
        Calibration of camera and table. With None the tracker starts in pixels and nominal
        metres, by the size of the squares, and takes the mirror from the settings.
    table : Table, optional
        The table, where `calibration` is None; default: that of the paper.

    Examples
    --------
    >>> from eol_ros.core.vision.render.renderer import Renderer
    >>> camera, at = Calibration.ideal(), Table().rest
    >>> renderer = Renderer(calibration=camera)
    >>> tracker = Tracker(TrackerSettings(), camera)
    >>> found = tracker.update(0.0, renderer.render(at[:, 0], at[:, 1], np.zeros(25), 0))
    >>> bool(found.state == TRACKING), int(found.seen.sum())
    (True, 25)
    >>> bool(np.abs(found.world - at).max() < 1e-4)  # m
    True
    """

    def __init__(
        self,
        settings: TrackerSettings,
        calibration: Calibration | None,
        table: Table | None = None,
    ):
        self.settings, self.calibration = settings, calibration
        self.table = calibration.table if calibration is not None else table or Table()
        self.watch, self.requests = Watch(calibration), Requests(self.table)
        self.outcome: Outcome | None = None  # of the last request
        self.learning: self_calibration.SelfCalibration | None = None
        self.asked_s = math.inf  # when a new calibration was asked for
        self.settled_s = -math.inf  # until then metres are new, and nobody should compare
        self.background: BackgroundModel | None = None  # the light that is taken off each image
        self.turn = TurnByTaps(self.table)
        self.follower: Follower | None = None
        if calibration is not None:
            self.follower = Follower(calibration, settings.trust_start)
        self.blink: Blink | None = None
        if settings.blink_block >= 0:
            self.blink = Blink(
                settings.blink_block, settings.blink_period_s, settings.blink_off_s, self.table
            )
        self._image = np.zeros((0, 0), np.uint8)  # the last one
        self._sought_s = -math.inf
        self._covers: np.ndarray | None = None  # learned before, until there is a follower

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a tap that the accelerometer of `block` felt: it counts a fixed time later."""
        self.turn.tap(stamp_s, block, sigma_s)

    def learned(self) -> bytes:
        """Return what was learned of the covers, for the request `covers`; b'' for nothing yet."""
        follower = self.follower
        if follower is None or follower.ambiguous or not follower.blocks['known'].any():
            return b''
        return learnt.pack(follower.faces, follower.blocks, follower.found)

    def sides_px(self) -> np.ndarray:
        """Measure how wide each block (cells,) is in the last image; NaN where not all shows."""
        from eol_ros.core.vision.appearance.squares import squares_of
        from eol_ros.core.vision.calibration import corners

        follower, calibration = self.follower, self.calibration
        if follower is None or calibration is None or not len(self._image):
            return np.full(self.table.cells, np.nan)
        return corners.sides_px(self._image, squares_of(calibration, follower.blocks), calibration)

    def cover_height_m(self) -> float:
        """Return the height of what is measured above the platform."""
        return self.calibration.cover_height_m if self.calibration is not None else 0.0

    def warm_up(self) -> None:
        """Compile or load all code that images need, on throw-away state, in advance."""
        if self.calibration is None:
            import eol_ros.core.vision.calibration.self_calibration  # noqa: F401 with scipy
        camera = self.calibration or Calibration.ideal(table=self.table)
        spare = Tracker(self.settings, camera)
        assert spare.follower is not None
        image = np.full((camera.image_height, camera.image_width), 12, np.uint8)
        half = 0.42 * spare.follower.px_per_m * self.table.block_side_m
        for u, v in camera.to_pixels(self.table.rest[self.table.ids]):
            rows = slice(max(round(v - half), 0), max(round(v + half), 0))
            image[rows, max(round(u - half), 0) : max(round(u + half), 0)] = 180
        for k in range(16):
            spare.update(k / 60, image if k != 14 else image // 8)
        spare.sides_px()

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
            By id: pixels (cells, 2), metres (cells, 2), yaw (cells,) rad; and the state.

        Examples
        --------
        >>> tracker = Tracker(TrackerSettings(), Calibration.ideal())
        >>> int(tracker.update(0.0, np.zeros((800, 1280), np.uint8)).seen.sum())
        0
        """
        image = read_only(image)
        for kind, value in self.requests.due(stamp_s):
            self._fulfil(stamp_s, kind, value)
        if self.requests.dark(stamp_s, image):
            return self._lose(stamp_s, LOST, said('lamps_learnt'))
        self._enlighten()
        fault = self.watch.fault(stamp_s, image)
        if not fault and self.background is not None:
            try:
                image = read_only(self.background.remove(image))
            except ConfigError as error:
                fault = str(error)
        if fault:
            return self._lose(stamp_s, FAULT, fault)
        if self.follower is None and (why := self._begin(stamp_s, image)):
            return self._answer(stamp_s, SEARCHING, why)
        follower = self.follower
        assert follower is not None
        self._image, blocks = image, follower.update(stamp_s, image)
        for _ in range(2):  # along both axes
            if (other := follower.elsewhere(stamp_s, image)) is None:
                break
            self.follower = follower = other
            blocks = other.blocks
            self.turn.lost(stamp_s)
            if self.blink is not None:
                self.blink.forget()
        if not follower.lattice or blocks['seen'].sum() < follower.least:
            self.turn.lost(stamp_s)
            if self.blink is not None:
                self.blink.forget()
            self.watch.rests(False)
            if not follower.lattice:
                return self._answer(stamp_s, SEARCHING, said('no_squares'))
            return self._answer(stamp_s, LOST, said('out_of_sight'))
        self._orient(stamp_s)
        self.watch.rests(follower.rests())
        return self._answer(stamp_s, *self._state(stamp_s, image))

    def _lose(self, stamp_s: float, state: int, why: str) -> Tracked:
        if self.follower is not None:
            self.follower.lose()
        return self._answer(stamp_s, state, why)

    def _begin(self, stamp_s: float, image: np.ndarray) -> str:
        """Begin without a calibration, where a lattice of squares is in sight; else say why not."""
        if 0.0 <= stamp_s - self._sought_s < SEEK_S:
            return said('no_squares')
        from eol_ros.core.vision.appearance import squares
        from eol_ros.core.vision.calibration import self_calibration  # and scipy: only here

        self._sought_s = stamp_s
        height, width = image.shape
        start = Calibration.ideal(width, height, table=self.table)
        found = squares.find_squares(image, start, self.settings.mirror)
        if found.calibration is None:
            return found.why
        self.calibration = self.watch.calibration = found.calibration
        self.follower = Follower(found.calibration, self.settings.trust_start)
        self.learning = self_calibration.SelfCalibration(found.calibration)
        if self._covers is not None:
            self._recall(self._covers)
        return ''

    def _recall(self, covers: np.ndarray) -> None:
        """Take what was learned of the covers (cells,) before."""
        follower, self._covers = self.follower, covers
        if follower is not None:
            learnt.unpack(covers, follower.faces, follower.blocks, follower.found)

    def _orient(self, stamp_s: float) -> None:
        """Turn the ids, where the blink of a block or taps tell how."""
        follower, turn = self.follower, self.turn
        assert follower is not None
        blocks, quarters, known = follower.blocks, None, True
        xy, seen = np.column_stack([blocks['x'], blocks['y']]), blocks['seen']
        if self.blink is not None and not turn.confirmed:
            quarters = self.blink.update(stamp_s, xy, seen)
        if quarters is None:
            known = not follower.ambiguous
            quarters = turn.update(stamp_s, xy, seen, follower.found['sigma_m'], known)
        if quarters is None:
            return
        follower.turn(quarters)
        turn.settled(final=known)
        if self.blink is not None:
            self.blink.forget()

    def _fulfil(self, stamp_s: float, kind: str, value: Any) -> None:
        """Do what was asked for, from this image on."""
        if kind == BACKGROUND:
            self.background = value
        elif kind == COVERS:
            self._recall(value)
        elif kind == CALIBRATE:
            self._ask(stamp_s)

    def _tell(self, kind: str, text: str, refused: bool) -> None:
        self.outcome = Outcome(kind, refused, text)

    def _enlighten(self) -> None:
        """Use what was learnt in a darkness that is over."""
        try:
            background = self.requests.learnt()
        except ConfigError as error:
            self._tell(DARKNESS, str(error), True)
        else:
            if background is not None:
                self.background = background
                share = 100 * float((background.light > LAMP_LEVEL).mean())
                self._tell(DARKNESS, said('background_learnt', percent=f'{share:.1f}'), False)

    def _ask(self, stamp_s: float) -> None:
        """Begin with the calibration that was asked for, or say why not."""
        if self.calibration is None:
            self._tell(CALIBRATE, said('not_calibrated', why=said('no_squares')), True)
        elif self.learning is None:
            from eol_ros.core.vision.calibration import self_calibration

            self.learning = self_calibration.SelfCalibration(self.calibration)
            self.asked_s = stamp_s
        elif math.isinf(self.asked_s):
            self._tell(CALIBRATE, said('not_calibrated', why=said('learns_scale')), True)

    def _state(self, stamp_s: float, image: np.ndarray) -> tuple[int, str]:
        """Return the state of a tracker that sees its blocks, and why it is not TRACKING."""
        if self.learning is not None:
            learning = self.learning
            self._learn(stamp_s, image, learning)
            if self.learning is not None and math.isinf(self.asked_s):
                return CALIBRATING, learning.why
        return (CALIBRATING, 'metres are new') if stamp_s < self.settled_s else (TRACKING, '')

    def _learn(
        self, stamp_s: float, image: np.ndarray, learning: 'self_calibration.SelfCalibration'
    ) -> None:
        """Calibrate by the blocks themselves, as soon as all of them rest in full view."""
        found = learning.add(image, self._squares())
        if found is not None:
            self._recalibrate(found)
            left = {'px': f'{found.residual_px:.3f}', 'mm': f'{found.residual_mm:.2f}'}
            self._tell(CALIBRATE, clauses([said('calibrated', **left), learning.note]), False)
            self.learning = None
            if math.isfinite(self.asked_s):
                self.settled_s = stamp_s + SETTLE_S
        elif math.isfinite(self.asked_s) and (learning.refused or stamp_s - self.asked_s > REST_S):
            self._tell(CALIBRATE, said('not_calibrated', why=learning.why), True)
            self.learning = None
        if self.learning is None:
            self.asked_s = math.inf

    def _squares(self) -> np.ndarray | None:
        """Return the squares (count,) SQUARE of the last image; None if not all rest in view."""
        from eol_ros.core.vision.appearance.squares import squares_of

        follower, calibration = self.follower, self.calibration
        assert follower is not None and calibration is not None
        ids = self.table.ids
        blocks, visible = follower.blocks[ids], follower.found['visible'][ids]
        if not (blocks['seen'].all() and visible.min() > WHOLE and follower.rests()):
            return None
        return squares_of(calibration, blocks)

    def _recalibrate(self, found: Calibration) -> None:
        """Use another calibration of the same camera from the next image on."""
        assert self.follower is not None
        self.follower.recalibrate(found)
        self.calibration = self.watch.calibration = found

    def _answer(self, stamp_s: float, state: int, why: str) -> Tracked:
        cells = self.table.cells
        yaw, sigma = np.zeros((2, cells))
        px = world = np.full((cells, 2), np.nan)
        seen, visible = np.zeros(cells, bool), np.zeros(cells)
        follower, calibration, changed = self.follower, self.calibration, list[int]()
        if follower is not None and calibration is not None:
            blocks, found = follower.blocks, follower.found
            yaw, sigma = on_grid(blocks['yaw'], found['sigma_m'])
            changed = np.flatnonzero(follower.changed_s >= stamp_s - model.CHANGED_S).tolist()
            if state not in (SEARCHING, FAULT):
                seen, visible = blocks['seen'].copy(), found['visible']
                at = np.column_stack([blocks['x'], blocks['y']])
                at[~self.table.present] = np.nan
                px = np.empty((cells, 2))
                to_pixels(follower.packed, at, PX_STEP, px)
                if state != CALIBRATING and self.learning is None:
                    world = np.rint(at / M_STEP) * M_STEP
        return Tracked(
            stamp_s,
            px,
            yaw,
            world,
            seen,
            sigma,
            np.where(seen, visible, 0.0).astype(np.float32),
            state,
            follower is not None and bool(follower.ambiguous),
            why,
            tuple(changed),
        )
