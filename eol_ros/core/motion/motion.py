# SPDX-License-Identifier: Apache-2.0
"""Blocks in; slips with their cascade and their tap, and cascades, out.

Starts are decided by the camera alone, at once. A tap of a block's own accelerometer takes effect a
fixed time after its stamp, however late or early it arrived, so that a replay decides the same; it
gives the stop of a slip, and its cascade, a better onset: the camera says where, the tap says when.
Provisional slips (`felt.py`) come sooner than the camera's, which confirm or retract them.
"""

from dataclasses import dataclass, replace

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.motion.cascades import CascadeEvent, Cascades
from eol_ros.core.motion.felt import VERDICT_S, Felt, FeltSlip, Knock
from eol_ros.core.motion.slips import START, SlipDetector, SlipEvent
from eol_ros.core.stamp_watch import BACK_S
from eol_ros.core.table import Table
from eol_ros.settings import MotionSettings

TAP_LAG_S = VERDICT_S  # a tap counts from the first image this much later than it
# A tap belongs to an onset this near, or within 4 of their joint sigmas. Of a slip that follows
# another at once the images see the onset up to 45 ms late, for they tell of the first one's rest.
TAP_WINDOW_S = 0.05
FUSE_SIGMA_S = 1e-4  # no onset is known better
BEGUN_S = 0.5  # how long the onset of a slip is remembered, for its tap


@dataclass(frozen=True)
class NumberedSlip:
    """A slip event with the number of its cascade, and whether a tap confirmed it."""

    event: SlipEvent
    cascade: int
    tapped: bool


@dataclass
class _Begun:
    """A slip that began lately; `felt`: whether a tap belongs to it."""

    slip: int
    block: int
    onset_s: float
    onset_sigma_s: float
    felt: bool = False


class Motion:
    """Block positions to slips and cascades: what the motion node and `eol track` run.

    Parameters
    ----------
    settings : MotionSettings
        As a scene has them; `set` changes them.
    table : Table, optional
        Whose blocks move.

    Examples
    --------
    Block 12 slips 2 cm to the right, beginning at 1 s, as springs let it.

    >>> motion, slips = Motion(MotionSettings()), []
    >>> x, y = Table().rest.T.copy()
    >>> for k in range(120):
    ...     x[12] = 0.01 - 0.01 * np.cos(np.pi * np.clip((k / 60 - 1.0) / 0.2, 0.0, 1.0))
    ...     found, _ = motion.update(k / 60, x, y, np.ones(25, bool), np.full(25, 2e-5))
    ...     slips += [one.event for one in found]
    >>> [(slip.block, round(slip.onset_s, 2)) for slip in slips][-1]
    (12, 1.0)
    >>> round(slips[-1].distance_m, 3)
    0.02
    """

    def __init__(self, settings: MotionSettings, table: Table = Table()):
        self.table = table
        self.detector = SlipDetector(settings, self.table)
        self.cascades = Cascades(settings, self.table)
        self.felt = Felt(settings.tap_probability)
        self.taps: list[Knock] = []  # not yet in effect
        self._begun: list[_Begun] = []
        self._told: list[FeltSlip] = []  # in the newest image
        self.fused: dict[int, tuple[float, float]] = {}  # slip: onset and sigma with its tap
        self._went_back = False  # in the newest image

    def set(self, settings: MotionSettings) -> None:
        """Take new settings while running."""
        self.detector.settings = settings
        self.cascades.settings = settings

    def tap(self, knock: Knock) -> list[FeltSlip]:
        """Take a report of a block's accelerometer; return its provisional slip, if any.

        Arrival order does not matter: a slip that waits for late images comes with `felt_slips`.
        """
        if knock.block not in self.table.ids:
            return []
        knock = knock._replace(sigma_s=max(knock.sigma_s, FUSE_SIGMA_S))
        self.taps.append(knock)
        return self.felt.tap(knock)

    def felt_slips(self) -> list[FeltSlip]:
        """Return provisional slips and verdicts that follow from the image given to `starts`."""
        told, self._told = self._told, []
        return told

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
            (cells,) metres.
        seen : ndarray
            (cells,) bool.
        sigma : ndarray, optional
            (cells,) standard deviation of x and y, in m.

        Returns
        -------
        slips : list of NumberedSlip
            Starts and stops found in this image.
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

        The arguments are those of `update`. A block that slips again soon after a rest brings its
        STOP along, before its START.
        """
        self._went_back = stamp_s < self.detector.history.last_s - BACK_S
        if self._went_back:  # taps from before the jump would take effect at some later time
            self.taps = [t for t in self.taps if t.stamp_s <= stamp_s + TAP_LAG_S]
            self._begun.clear()
            self.felt.reset()
        self._begun = [one for one in self._begun if one.onset_s > stamp_s - BEGUN_S]
        self._told = self.felt.look(stamp_s, x, y, seen)
        due = sorted(t for t in self.taps if t.stamp_s + TAP_LAG_S <= stamp_s)
        if due:
            self.taps = [t for t in self.taps if t.stamp_s + TAP_LAG_S > stamp_s]
        for knock in due:
            self._told += self.felt.judge(stamp_s, knock, self._fuse(knock))
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
        self._begun += [
            _Begun(e.slip, e.block, e.onset_s, e.onset_sigma_s) for e in events if e.kind == START
        ]
        for event in events:
            self.fused.pop(event.slip, None)
        return slips

    def _fuse(self, knock: Knock) -> int:
        """Return the slip that began with `knock`, 0 for none; a running one gets its onset."""
        block, near = knock.block, []
        newest = self.detector.slips[block]
        running = int(newest['slip']) if newest['moving'] else 0
        for begun in self._begun:
            if begun.block != block or begun.felt:
                continue
            if begun.slip == running:  # known better by now
                begun.onset_s = newest['onset_s']
                begun.onset_sigma_s = newest['onset_sigma_s']
            joint = elementary.hypot(begun.onset_sigma_s, knock.sigma_s)
            if abs(knock.stamp_s - begun.onset_s) <= max(TAP_WINDOW_S, 4.0 * joint):
                near.append(begun)
        if not near:
            return 0
        begun = min(near, key=lambda one: abs(knock.stamp_s - one.onset_s))
        begun.felt = True
        if begun.slip == running:
            onset_s, onset_sigma_s = begun.onset_s, begun.onset_sigma_s
            joint = elementary.hypot(onset_sigma_s, knock.sigma_s)
            # Two independent measurements of one moment: weighted by their variances.
            share = onset_sigma_s / joint
            weight = share * share
            fused = (
                onset_s + weight * (knock.stamp_s - onset_s),
                onset_sigma_s * knock.sigma_s / joint,
            )
            self.fused[running] = (float(fused[0]), float(fused[1]))
        return begun.slip

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
