# SPDX-License-Identifier: Apache-2.0
"""The appearance tracker with the interface of the tracker by edges."""

import math
from typing import Any

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.vision.appearance import learnt, model
from eol_ros.core.vision.appearance.follow import Follower
from eol_ros.core.vision.background.model import BackgroundModel
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.core.vision.detect.scan import read_only
from eol_ros.core.vision.identity.blink import Blink
from eol_ros.core.vision.identity.turn_by_taps import TurnByTaps
from eol_ros.core.vision.requests import BACKGROUND, CALIBRATE, COVERS
from eol_ros.core.vision.states import CALIBRATING, FAULT, LOST, SEARCHING
from eol_ros.core.vision.tracker_base import M_STEP, PX_STEP, BaseTracker, Tracked, on_grid
from eol_ros.errors import ConfigError
from eol_ros.said import said
from eol_ros.settings import TrackerSettings

SEEK_S = 0.5  # between two searches for squares whose size is not known
WHOLE = 0.8  # visible of each block when the camera is calibrated by the blocks


class AppearanceTracker(BaseTracker):
    """Keeps the 25 blocks of one camera by the faces of their covers.

    Of the settings `threshold` and `know_covers` are those of the tracker by edges.

    Parameters
    ----------
    settings : TrackerSettings
        As a scene has them.
    calibration : Calibration or None
        Of this camera. None starts with pixels and nominal metres of the size of the squares, and
        asks the settings for a mirror.

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
        super().__init__(settings, calibration)
        self.turn = TurnByTaps()
        self.follower: Follower | None = None
        if calibration is not None:
            self.follower = Follower(calibration, settings.trust_start)
        self.blink: Blink | None = None
        if settings.blink_block >= 0:
            self.blink = Blink(settings.blink_block, settings.blink_period_s, settings.blink_off_s)
        self.background: BackgroundModel | None = None
        self._sought_s = -math.inf
        self._covers: np.ndarray | None = None  # learned before, until there is a follower

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Take a tap that the accelerometer of `block` felt: it counts a fixed time later."""
        self.turn.tap(stamp_s, block, sigma_s)

    def learned(self) -> dict[str, bytes]:
        """Return what was learned of the blocks, by the request that brings it back."""
        follower = self.follower
        if follower is None or follower.ambiguous or not follower.blocks['known'].any():
            return {}
        return {COVERS: learnt.pack(follower.faces, follower.blocks, follower.found)}

    def sides_px(self) -> np.ndarray:
        """Return the side (25,) of each block in the last image, 0 where it was not seen."""
        if self.follower is None:
            return np.zeros(N_BLOCKS)
        return np.where(self.follower.blocks['seen'], self.follower.found['side_px'], 0.0)

    def side_px(self) -> float:
        """Return the side of a block in the middle of the last image, 0 when none was found."""
        sides = self.sides_px()
        return float(np.median(sides[sides > 0])) if sides.any() else 0.0

    def warm_up(self) -> None:
        """Compile or load all compiled code, on throw-away state, before the first image comes."""
        camera = self.calibration or Calibration.ideal()
        spare = AppearanceTracker(self.settings, camera)
        assert spare.follower is not None
        image = np.full((camera.image_height, camera.image_width), 12, np.uint8)
        half = 0.42 * spare.follower.px_per_m * 0.084
        for u, v in camera.to_pixels(spare.follower.rest):
            rows = slice(max(round(v - half), 0), max(round(v + half), 0))
            image[rows, max(round(u - half), 0) : max(round(u + half), 0)] = 180
        for k in range(16):
            spare.update(k / 60, image if k != 14 else image // 8)

    def update(self, stamp_s: float, image: np.ndarray) -> Tracked:
        """Take the next image, as Tracker.update does; never raises for a bad one."""
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
        blocks = follower.update(stamp_s, image)
        if not follower.lattice or blocks['seen'].sum() < model.LEAST:
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
        start = Calibration.ideal(width, height)
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
        """Take what was learned of the covers (25,) before."""
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

    def _squares(self, stamp_s: float) -> np.ndarray | None:
        from eol_ros.core.vision.appearance.squares import squares_of

        follower, calibration = self.follower, self.calibration
        assert follower is not None and calibration is not None
        blocks, visible = follower.blocks, follower.found['visible']
        if not (blocks['seen'].all() and visible.min() > WHOLE and follower.rests()):
            return None
        return squares_of(calibration, blocks)

    def _recalibrate(self, found: Calibration) -> None:
        assert self.follower is not None
        self.follower.recalibrate(found)
        self.calibration = self.watch.calibration = found

    def _answer(self, stamp_s: float, state: int, why: str) -> Tracked:
        yaw, sigma = np.zeros((2, N_BLOCKS))
        px = world = np.full((N_BLOCKS, 2), np.nan)
        seen, visible = np.zeros(N_BLOCKS, bool), np.zeros(N_BLOCKS)
        follower, calibration, changed = self.follower, self.calibration, list[int]()
        if follower is not None and calibration is not None:
            blocks, found = follower.blocks, follower.found
            yaw, sigma = on_grid(blocks['yaw'], found['sigma_m'])
            changed = np.flatnonzero(follower.changed_s >= stamp_s - model.CHANGED_S).tolist()
            if state not in (SEARCHING, FAULT):
                seen, visible = blocks['seen'].copy(), found['visible']
                at = np.column_stack([blocks['x'], blocks['y']])
                px = np.rint(calibration.to_pixels(at) / PX_STEP) * PX_STEP
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
