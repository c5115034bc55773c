# SPDX-License-Identifier: Apache-2.0
"""Blocks in; slips with their cascade and their tap, and cascades, out.

Starts are decided by the camera alone, at once. A tap of a block's own accelerometer takes effect a
fixed time after its stamp, however late or early it arrived, so that a replay decides the same; it
gives the stop of a slip, and its cascade, a better onset: the camera says where, the tap says when.
"""

from dataclasses import dataclass, replace

import numpy as np

from eol_ros.core.motion.cascades import CascadeEvent, Cascades
from eol_ros.core.motion.slips import SlipDetector, SlipEvent
from eol_ros.core.stamp_watch import BACK_S
from eol_ros.settings import MotionSettings

TAP_LAG_S = 0.1  # a tap counts from the first image this much later than it
TAP_WINDOW_S = 0.03  # a tap belongs to an onset this near, or within 4 of their joint sigmas
FUSE_SIGMA_S = 1e-4  # no onset is known better


@dataclass(frozen=True)
class NumberedSlip:
    """A slip event with the number of its cascade, and whether a tap confirmed it."""

    event: SlipEvent
    cascade: int
    tapped: bool


class Motion:
    """Block positions to slips and cascades: what the motion node and `eol track` run.

    Parameters
    ----------
    settings : MotionSettings
        As a scene has them; `set` changes them.

    Examples
    --------
    Block 12 moves 2 cm to the right, beginning at 1 s.

    >>> from eol_ros.core.geometry import rest_lattice
    >>> motion, slips = Motion(MotionSettings()), []
    >>> x, y = rest_lattice().T.copy()
    >>> for k in range(120):
    ...     x[12] = 0.02 * min(max(k / 60 - 1.0, 0.0) / 0.2, 1.0)
    ...     found, _ = motion.update(k / 60, x, y, np.ones(25, bool), np.full(25, 2e-5))
    ...     slips += [one.event for one in found]
    >>> [(slip.block, round(slip.onset_s, 2)) for slip in slips][-1]
    (12, 1.0)
    >>> round(slips[-1].distance_m, 3)
    0.02
    """

    def __init__(self, settings: MotionSettings):
        self.detector = SlipDetector(settings)
        self.cascades = Cascades(settings)
        self.taps: list[tuple[float, int, float]] = []  # stamp, block, sigma
        self.fused: dict[int, tuple[float, float]] = {}  # slip: onset and sigma with its tap
        self._went_back = False  # in the newest image

    def set(self, settings: MotionSettings) -> None:
        """Take new settings while running."""
        self.detector.settings = settings
        self.cascades.settings = settings

    def tap(self, stamp_s: float, block: int, sigma_s: float) -> None:
        """Keep a report of a block's accelerometer; arrival order does not matter."""
        if 0 <= block < 25 and np.isfinite(stamp_s):
            self.taps.append((stamp_s, block, max(sigma_s, FUSE_SIGMA_S)))

    def update(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> tuple[list[NumberedSlip], list[CascadeEvent]]:
        """Take the blocks of one image.

        Parameters
        ----------
        stamp_s : float
            Mid-exposure, in s.
        x, y : ndarray
            (25,) metres.
        seen : ndarray
            (25,) bool.
        sigma : ndarray, optional
            (25,) standard deviation of x and y, in m.

        Returns
        -------
        slips : list of NumberedSlip
            Starts and stops that this image told.
        cascades : list of CascadeEvent
            Those that are over.

        Examples
        --------
        >>> motion = Motion(MotionSettings())
        >>> motion.update(0.0, np.zeros(25), np.zeros(25), np.ones(25, bool))
        ([], [])
        """
        begun = self.starts(stamp_s, x, y, seen, sigma)
        ended, closed = self.stops(stamp_s)
        return begun + ended, closed

    def starts(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> list[NumberedSlip]:
        """Take one image's blocks and return what begins; then `stops` must be called.

        A block that slips again soon after a rest brings its STOP along, before its START.
        """
        self._went_back = stamp_s < self.detector.last_s - BACK_S
        if self._went_back:  # what is left of the time before would come due some day
            self.taps = [t for t in self.taps if t[0] <= stamp_s + TAP_LAG_S]
        due = sorted(t for t in self.taps if t[0] + TAP_LAG_S <= stamp_s)
        if due:
            self.taps = [t for t in self.taps if t[0] + TAP_LAG_S > stamp_s]
        for tap in due:
            self._fuse(tap)
        events = [
            self._with_tap(event) for event in self.detector.starts(stamp_s, x, y, seen, sigma)
        ]
        return self._numbered(events, self.cascades.begun(events))

    def stops(self, stamp_s: float) -> tuple[list[NumberedSlip], list[CascadeEvent]]:
        """Return the slips and cascades that end with the image given to `starts`."""
        events = [self._with_tap(event) for event in self.detector.stops()]
        numbers, closed = self.cascades.update(stamp_s, events)
        if self._went_back:  # every slip has been stopped
            closed += self.cascades.finish(stamp_s)
        return self._numbered(events, numbers), closed

    def _numbered(self, events: list[SlipEvent], numbers: list[int]) -> list[NumberedSlip]:
        slips = [
            NumberedSlip(event, number, event.slip in self.fused)
            for event, number in zip(events, numbers, strict=True)
        ]
        for event in events:
            self.fused.pop(event.slip, None)
        return slips

    def _fuse(self, tap: tuple[float, int, float]) -> None:
        """Join a tap with the running slip of its block, if their times agree."""
        stamp_s, block, sigma_s = tap
        detector = self.detector
        slip = int(detector.slip[block])
        if not detector.moving[block] or slip in self.fused:
            return
        onset_s, onset_sigma_s = detector.onset_s[block], detector.onset_sigma_s[block]
        joint = np.hypot(onset_sigma_s, sigma_s)
        if abs(stamp_s - onset_s) > max(TAP_WINDOW_S, 4.0 * joint):
            return
        # Two independent measurements of one moment: weighted by their variances.
        weight = onset_sigma_s**2 / joint**2
        fused = onset_s + weight * (stamp_s - onset_s), onset_sigma_s * sigma_s / joint
        self.fused[slip] = (float(fused[0]), float(fused[1]))

    def _with_tap(self, event: SlipEvent) -> SlipEvent:
        if event.slip not in self.fused:
            return event
        onset_s, sigma_s = self.fused[event.slip]
        return replace(
            event,
            onset_s=onset_s,
            onset_sigma_s=sigma_s,
            duration_s=max(event.duration_s + event.onset_s - onset_s, 0.0),
        )
