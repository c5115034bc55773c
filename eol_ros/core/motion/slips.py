# SPDX-License-Identifier: Apache-2.0
"""Slips of the blocks: START against a rest position, STOP by speed.

A pure function of the sequence of samples, vectorised over the blocks. All thresholds follow
from measured noise; windows are times and thresholds are m, m/s or m/s^2, so that 60 and 120
images/s agree.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.motion.history import History, Image
from eol_ros.core.motion.noise import (
    OCCLUDED,
    NoiseModel,
    exceedance,
    second_moments,
    threshold_sigmas,
)
from eol_ros.core.motion.onset import (
    ACCELERATION_MPS2,
    BEFORE_IMAGES,
    LATER_IMAGES,
    OnsetEstimator,
)
from eol_ros.core.motion.stops import StopDetector
from eol_ros.core.stamp_watch import BACK_S
from eol_ros.core.table import Table
from eol_ros.settings import MotionSettings

START = 1
STOP = 2
GAP_S = 0.5  # a pause of the images, s, after which all slips have stopped (chosen)


@dataclass(frozen=True)
class SlipEvent:
    """One START or STOP; times in s, lengths in m, speeds in m/s, as in eol_msgs/Slip."""

    kind: int
    slip: int
    block: int
    stamp_s: float
    onset_s: float
    onset_sigma_s: float
    x: float
    y: float
    speed_mps: float
    distance_m: float = 0.0
    duration_s: float = 0.0


class SlipDetector:
    """Turns positions of the blocks into starts and stops.

    `slips` (n,) SLIP: the newest slip of each block.
    """

    def __init__(self, settings: MotionSettings, table: Table = Table()):
        self.settings, self.table = settings, table
        self.count = 0  # slips so far
        self._reset(ACCELERATION_MPS2)

    def _reset(self, acceleration_mps2: float) -> None:
        self.history = History(self.table.cells)
        self.noise = NoiseModel(self.table.cells)
        self.onsets = OnsetEstimator(self.history, acceleration_mps2)
        self.slips = self.onsets.slips
        self.stop_detector = StopDetector(self.onsets)
        self._earlier_stops: list[SlipEvent] = []  # that the next call of `stops` returns
        self._image: Image | None = None  # the newest; None: it was passed over

    @property
    def moving(self) -> np.ndarray:
        """Which blocks (n,) move."""
        return self.slips['moving']

    def update(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> list[SlipEvent]:
        """Take one image's blocks and return what it decides: starts, then stops, earliest first.

        x, y: (n,) m. seen: (n,) bool. sigma: (n,) m, the tracker's standard deviation of each
        sample; only its ratio to the mean counts. An image that is not newer than the last one is
        passed over. One that is older by more than BACK_S stops all slips and forgets everything
        but their count and acceleration.
        """
        return self.starts(stamp_s, x, y, seen, sigma) + self.stops()

    def starts(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> list[SlipEvent]:
        """Take one image as `update`, but decide only starts, which are urgent; then `stops` must
        be called. The STOP of a slip whose block begins another comes with it, before it."""
        self._earlier_stops, self._image = [], None
        if stamp_s < self.history.last_s - BACK_S:
            stops = self._stop_all()
            self._reset(self.onsets.acceleration_mps2)
            self._earlier_stops = stops
        history, noise, moving = self.history, self.noise, self.slips['moving']
        gap = stamp_s - history.last_s
        if not gap > 0.0:
            return []
        if gap > GAP_S:
            self._earlier_stops += self._stop_all()
            history.seen[:] = history.resting[:] = False
        elif history.period_s == 0.0:
            history.period_s = gap
        else:
            history.period_s = 0.9 * history.period_s + 0.1 * gap
        history.last_s = stamp_s
        seen = np.asarray(seen, bool) & np.isfinite(x) & np.isfinite(y)
        place = np.where(seen[:, None], np.stack([x, y], 1), 0.0)
        inflation = noise.inflation(sigma, seen)
        deviation = np.sqrt(noise.variance) * inflation
        self._image = image = Image(stamp_s, place, seen, deviation)

        anchor, variance, n = history.rest_place(stamp_s, self.settings.baseline_s)
        moments = second_moments(place - anchor)
        samples, period_s = noise.rows['samples'], max(history.period_s, 1e-4)
        chance = exceedance(self.settings.false_alarms_per_hour, self.table.count / period_s)
        limit = threshold_sigmas(chance, 2.0 * samples) * deviation
        again = self.stop_detector.follow_runs(image, limit)
        # the anchor has an error of its own
        inflation2 = inflation**2
        excess = np.where(inflation > OCCLUDED, inflation2, 1.0)
        variance = 1.0 + variance / excess
        limit *= np.sqrt(variance)
        rested = self.stop_detector.rested(n, self.settings)
        ready = rested & (samples >= 3)
        away = seen & ~moving & (noise.distance2(moments) > limit**2)
        starting = away & ready
        history.resting[away & ~ready] = False  # it came into sight while it moved
        quiet = seen & ~moving & ~starting
        noise.learn(quiet & rested, moments, variance * inflation2, sigma, history.period_s)
        history.push(image, quiet, excess)
        events = []
        if again.any():
            blocks, runs = np.flatnonzero(again), self.stop_detector.runs
            anchor[blocks] = rest = self.stop_detector.run_place()[blocks]
            n[blocks], until_s = runs['images'][blocks], runs['to_s'][blocks]
            ended = self.stop_detector.end(blocks, rest, deviation[blocks], until_s)
            events = self._stop(blocks, ended, rest)
            starting |= again
        if starting.any():
            events += self._start(np.flatnonzero(starting), anchor, n)
        return events

    def stops(self) -> list[SlipEvent]:
        """Return what the image given to `starts` ends, earliest onset first."""
        events, image, slips = self._earlier_stops, self._image, self.slips
        if image is not None:
            if slips['moving'].any():
                self.onsets.refine(self.settings.stop_s)
                on = np.flatnonzero(slips['moving'])
                top = self.history.fit(on, self.history.period_s * 2.5).speed_mps
                slips['top_mps'][on] = np.maximum(slips['top_mps'][on], top)
                events = events + self._stop(*self.stop_detector.due(image, self.settings))
            slips['seen_s'][image.seen] = image.stamp_s
        return sorted(events, key=lambda event: event.onset_s)

    def _start(self, blocks: np.ndarray, anchor: np.ndarray, n: np.ndarray) -> list[SlipEvent]:
        """Begin slips of `blocks` (k,) from their rest positions (cells, 2), means of n."""
        assert self._image is not None
        slips, stamp_s, n = self.slips, self._image.stamp_s, n[blocks]
        slips['slip'][blocks] = self.count + 1 + np.arange(blocks.size)
        self.count += blocks.size
        slips['start'][blocks] = anchor[blocks]
        slips['rested_s'][blocks] = n * self.history.period_s
        error = np.sqrt(1.0 + 1.0 / np.maximum(n, 1))
        slips['rest_sigma_m'][blocks] = self._image.deviation[blocks] * error
        slips['refine_in'][blocks] = LATER_IMAGES
        slips['started_s'][blocks] = stamp_s
        self.onsets.estimate(blocks, BEFORE_IMAGES)
        slips['moving'][blocks] = True
        self.history.resting[blocks] = False  # the next rest position is another
        events = []
        for block in blocks.tolist():
            slips['top_mps'][block] = self.history.step_speed(block)
            events.append(self._event(START, block, stamp_s))
        return sorted(events, key=lambda event: event.onset_s)

    def _stop(
        self, blocks: np.ndarray, ended_s: np.ndarray, place: np.ndarray | None = None
    ) -> list[SlipEvent]:
        """Stop the slips of `blocks` (k,), at `place` (k, 2), else where they were seen last."""
        self.slips['moving'][blocks] = False
        places = [None] * blocks.size if place is None else place
        return [
            self._event(STOP, block, self.history.last_s, end, here)
            for block, end, here in zip(blocks.tolist(), ended_s.tolist(), places, strict=True)
        ]

    def _stop_all(self) -> list[SlipEvent]:
        """Stop all slips when the blocks were last seen."""
        blocks = np.flatnonzero(self.slips['moving'])
        return self._stop(blocks, self.slips['seen_s'][blocks])

    def _event(
        self,
        kind: int,
        block: int,
        stamp_s: float,
        ended_s: float = -np.inf,
        place: np.ndarray | None = None,
    ) -> SlipEvent:
        slip = self.slips[block]
        if place is None:
            newest = self.history.samples(block, most=1)
            place = self.history.place[:, block, newest[0]] if newest.size else slip['start']
        moved = elementary.hypot(*(place - slip['start']).tolist()) if kind == STOP else 0.0
        return SlipEvent(
            kind, int(slip['slip']), block, float(stamp_s), float(slip['onset_s']),
            float(slip['onset_sigma_s']), float(place[0]), float(place[1]),
            float(slip['top_mps']), moved, max(ended_s - float(slip['onset_s']), 0.0),
        )  # fmt: skip
