# SPDX-License-Identifier: Apache-2.0
"""What all trackers share: their answer, and what people ask of them."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.image_health import Watch
from eol_ros.core.vision.requests import CALIBRATE, DARKNESS, Outcome, Requests
from eol_ros.core.vision.states import CALIBRATING, TRACKING
from eol_ros.errors import ConfigError
from eol_ros.said import clauses, said
from eol_ros.settings import TrackerSettings

if TYPE_CHECKING:
    from eol_ros.core.vision.background.model import BackgroundModel
    from eol_ros.core.vision.calibration import self_calibration

REST_S = 20.0  # for so long a calibration that was asked for waits for the blocks to rest
SETTLE_S = 0.3  # after a new calibration; longer than any rest that motion compares with
LAMP_LEVEL = 5  # grey levels
# Answers lie on grids far finer than any noise (1 um, 0.001 px, 15 urad; a sigma to 2 %), so that a
# bag packs them well: what is rounded off adds less than 0.1 % to the variance of a still block.
M_STEP, PX_STEP, RAD_STEP = 2.0**-20, 2.0**-10, 2.0**-16
SIGMA_STEPS = 64


def on_grid(yaw: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return yaw and sigma (25,) on the grids of answers."""
    turned, coarse = np.empty((2, len(yaw)))
    mapping.rounded(yaw, sigma_m, RAD_STEP, SIGMA_STEPS, turned, coarse)
    return turned, coarse


class Tracked(NamedTuple):
    """All blocks in one image, as in eol_msgs/Blocks; arrays by block id.

    px (25, 2) and world (25, 2) in m hold for hidden blocks too (`seen` false), carried by their
    neighbours; both are NaN while the state is searching or fault, world also while calibrating.
    yaw (25,) rad, unwrapped. sigma_m, visibility (25,). why: one line when the state is not
    tracking.
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


class BaseTracker:
    """Holds the calibration and answers requests; `update` of a subclass tracks the blocks."""

    background: 'BackgroundModel | None'  # the light that is taken off each image

    def __init__(self, settings: TrackerSettings, calibration: Calibration | None):
        self.settings, self.calibration = settings, calibration
        self.watch, self.requests = Watch(calibration), Requests()
        self.outcome: Outcome | None = None  # of the last request
        self.learning: self_calibration.SelfCalibration | None = None
        self.asked_s = math.inf  # when a new calibration was asked for
        self.settled_s = -math.inf  # until then metres are new, and nobody should compare

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a tap of a block's accelerometer: it counts a fixed time after its stamp."""
        raise NotImplementedError

    def warm_up(self) -> None:
        """Compile or load all compiled code, on throw-away state, before the first image comes."""
        raise NotImplementedError

    def update(self, stamp_s: float, image: np.ndarray) -> Tracked:
        """Take the next image; never raises for a bad one."""
        raise NotImplementedError

    def learned(self) -> dict[str, bytes]:
        """Return what was learned of the blocks, by the request that brings it back."""
        raise NotImplementedError

    def side_px(self) -> float:
        """Return the side of a block in the middle of the last image, 0 when none was found."""
        raise NotImplementedError

    def sides_px(self) -> np.ndarray:
        """Return the side (25,) of each block in the last image, 0 where it was not seen."""
        raise NotImplementedError

    def image_angles(self, tracked: Tracked) -> np.ndarray:
        """Return the angle (25,) of each block in the image, u right and v up, for overlays."""
        if self.calibration is None:
            return tracked.yaw
        return self.calibration.yaw_to_image(tracked.px, tracked.yaw)

    def cover_height_m(self) -> float:
        """Return the height of what is measured above the platform."""
        return self.calibration.cover_height_m if self.calibration is not None else 0.0

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

            self.learning = self_calibration.SelfCalibration(self._start())
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
        found = learning.add(image, self._squares(stamp_s))
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

    def _start(self) -> Calibration:
        """Return the camera that a calibration begins with, once there is one."""
        assert self.calibration is not None
        return self.calibration

    def _squares(self, stamp_s: float) -> np.ndarray | None:
        """Return the squares (25,) SQUARE of the last image; None if not all rest in full view."""
        raise NotImplementedError

    def _recalibrate(self, found: Calibration) -> None:
        """Use another calibration of the same camera from the next image on."""
        raise NotImplementedError
