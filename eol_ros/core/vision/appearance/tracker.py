# SPDX-License-Identifier: Apache-2.0
"""The appearance tracker with the interface of the tracker by edges."""

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.appearance import model
from eol_ros.core.vision.appearance.follow import Follower
from eol_ros.core.vision.calibration import mapping
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect.scan import read_only
from eol_ros.core.vision.identity.turn_by_taps import TurnByTaps
from eol_ros.core.vision.image_health import Watch
from eol_ros.core.vision.states import FAULT, LOST, SEARCHING, TRACKING
from eol_ros.core.vision.tracker import M_STEP, PX_STEP, RAD_STEP, SIGMA_STEPS, Tracked
from eol_ros.errors import ConfigError
from eol_ros.said import said
from eol_ros.settings import TrackerSettings


class AppearanceTracker:
    """Keeps the 25 blocks of one camera by the faces of their covers.

    Takes `settings.trust_start`; the other settings are those of the tracker by edges.

    Parameters
    ----------
    settings : TrackerSettings
        As a scene has them.
    calibration : Calibration
        Of this camera and its covers.

    Raises
    ------
    ConfigError
        Without a calibration.

    Examples
    --------
    >>> from eol_ros.core.geometry import rest_lattice
    >>> from eol_ros.core.vision.render.renderer import Renderer
    >>> camera, at = Calibration.ideal(), rest_lattice()
    >>> renderer = Renderer(calibration=camera)
    >>> tracker = AppearanceTracker(TrackerSettings(), camera)
    >>> found = tracker.update(0.0, renderer.render(at[:, 0], at[:, 1], np.zeros(25), 0))
    >>> bool(found.state == TRACKING), int(found.seen.sum())
    (True, 25)
    >>> bool(np.abs(found.world - at).max() < 1e-4)  # m
    True
    """

    def __init__(self, settings: TrackerSettings, calibration: Calibration | None):
        if calibration is None:
            raise ConfigError('the appearance tracker needs a calibration: give --calibration')
        self.settings, self.calibration = settings, calibration
        self.follower = Follower(calibration, settings.trust_start)
        self.watch, self.turn = Watch(calibration), TurnByTaps()

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a tap that the accelerometer of `block` felt."""
        self.turn.tap(stamp_s, block, sigma_s)

    def warm_up(self) -> None:
        """Compile or load all compiled code, on throw-away state, before the first image comes."""
        spare = AppearanceTracker(self.settings, self.calibration)
        rest, camera = spare.follower.rest, self.calibration
        image = np.full((camera.image_height, camera.image_width), 12, np.uint8)
        half = 0.42 * spare.follower.px_per_m * 0.084
        for u, v in camera.to_pixels(rest):
            rows = slice(max(round(v - half), 0), max(round(v + half), 0))
            image[rows, max(round(u - half), 0) : max(round(u + half), 0)] = 180
        for k in range(16):
            spare.update(k / 60, image if k != 14 else image // 8)

    def image_angles(self, tracked: Tracked) -> np.ndarray:
        """Return the angle (25,) of each block in the image, u right and v up, for overlays."""
        return self.calibration.yaw_to_image(tracked.px, tracked.yaw)

    def sides_px(self) -> np.ndarray:
        """Return the side (25,) of each block in the last image, 0 where it was not seen."""
        return np.where(self.follower.blocks['seen'], self.follower.found['side_px'], 0.0)

    def side_px(self) -> float:
        """Return the side of a block in the middle of the last image, 0 when none was found."""
        sides = self.sides_px()
        return float(np.median(sides[sides > 0])) if sides.any() else 0.0

    def cover_height_m(self) -> float:
        """Return the height of what is measured above the platform."""
        return self.calibration.cover_height_m

    def update(self, stamp_s: float, image: np.ndarray) -> Tracked:
        """Take the next image, as Tracker.update does; never raises for a bad one."""
        image = read_only(image)
        fault = self.watch.fault(stamp_s, image)
        if fault:
            self.follower.lose()
            return self._answer(stamp_s, FAULT, fault)
        blocks = self.follower.update(stamp_s, image)
        follower = self.follower
        if not follower.lattice or blocks['seen'].sum() < model.LEAST:
            self.turn.lost(stamp_s)
            if not follower.lattice:
                return self._answer(stamp_s, SEARCHING, 'no lattice of squares in sight')
            return self._answer(stamp_s, LOST, said('out_of_sight'))
        xy, known = np.column_stack([blocks['x'], blocks['y']]), not follower.ambiguous
        sigma = follower.found['sigma_m']
        quarters = self.turn.update(stamp_s, xy, blocks['seen'], sigma, known)
        if quarters is not None:
            follower.turn(quarters)
            self.turn.settled(final=known)
        return self._answer(stamp_s, TRACKING, '')

    def _answer(self, stamp_s: float, state: int, why: str) -> Tracked:
        blocks, found = self.follower.blocks, self.follower.found
        world = np.column_stack([blocks['x'], blocks['y']])
        yaw, sigma = np.empty((2, N_BLOCKS))
        mapping.rounded(blocks['yaw'], found['sigma_m'], RAD_STEP, SIGMA_STEPS, yaw, sigma)
        seen = blocks['seen'] & (state not in (SEARCHING, FAULT))
        if state in (SEARCHING, FAULT):
            px = world = np.full((N_BLOCKS, 2), np.nan)
        else:
            px = np.rint(self.calibration.to_pixels(world) / PX_STEP) * PX_STEP
            world = np.rint(world / M_STEP) * M_STEP
        visible = np.where(seen, found['visible'], 0.0).astype(np.float32)
        unsure = self.follower.ambiguous
        return Tracked(stamp_s, px, yaw, world, seen, sigma, visible, state, unsure, why)
