# SPDX-License-Identifier: Apache-2.0
"""Slips of the blocks: START against an anchor, STOP by speed, all thresholds from measured noise.

Vectorised over the 25 blocks; a pure function of the sequence of samples. Nothing here is counted
in images: windows are times and thresholds are m or m/s, so that 60 and 120 images/s agree.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.motion.onset import onset
from eol_ros.core.motion.threshold import exceedance, threshold_sigmas
from eol_ros.settings import MotionSettings

START = 1
STOP = 2
RING = 64  # samples kept: 0.27 s at 240 images/s, 1.07 s at 60
LEARN_S = 20.0  # memory of the noise
BELIEVED = 10.0  # samples that the tracker's sigma is worth
FLOOR_M = 1e-6  # no camera measures better than a micrometre
HIDDEN_S = 0.25  # a moving block out of sight for longer has stopped, as far as anyone knows
BEFORE_IMAGES = 4  # that the onset of a START rests on, the crossing one included
LATER_IMAGES = 2  # more, that the onset of its STOP rests on
GAP_S = 0.5  # a break in the images longer than this starts everything anew


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
    """Turns positions of the 25 blocks into starts and stops."""

    def __init__(self, settings: MotionSettings):
        self.settings = settings
        self.count = 0  # slips so far
        self.reset()

    def reset(self) -> None:
        """Forget positions, noise and running slips, but not the count of slips."""
        self.times = np.full(RING, -np.inf)
        self.place = np.zeros((2, N_BLOCKS, RING))
        self.good = np.zeros((N_BLOCKS, RING), bool)  # seen in that image
        self.still = np.zeros((N_BLOCKS, RING), bool)  # and at rest
        self.head = 0
        self.last_s = -np.inf
        self.period_s = 0.0
        self.moving = np.zeros(N_BLOCKS, bool)
        self.variance = np.zeros(N_BLOCKS)  # m^2 an axis, of a block at rest
        self.reported = np.zeros(N_BLOCKS)  # mean sigma that the tracker gave with it
        self.samples = np.zeros(N_BLOCKS)  # that the variance rests on
        self.seen_s = np.full(N_BLOCKS, -np.inf)
        self.slip = np.zeros(N_BLOCKS, np.int64)
        self.fresh = np.zeros(N_BLOCKS, np.int64)  # images until the onset is looked at again
        self.rest_sigma = np.zeros(N_BLOCKS)
        self.rested_s = np.zeros(N_BLOCKS)  # how long it had been seen at rest before its slip
        self.onset_s = np.zeros(N_BLOCKS)
        self.onset_sigma_s = np.zeros(N_BLOCKS)
        self.start = np.zeros((2, N_BLOCKS))
        self.top_mps = np.zeros(N_BLOCKS)

    def update(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> list[SlipEvent]:
        """Take one image's blocks and return what it decides, earliest onset first.

        x, y: (25,) m. seen: (25,) bool. sigma: (25,) m, the tracker's own opinion of each sample;
        only its ratio to the usual one counts. An image that is not newer than the last one is
        passed over.
        """
        if not stamp_s > self.last_s:
            return []
        events: list[SlipEvent] = []
        gap = stamp_s - self.last_s
        if gap > GAP_S:
            if np.isfinite(self.last_s):
                events = self._stop(self.moving, self.last_s, self.seen_s)
            self.good[:] = self.still[:] = False
        else:
            self.period_s = gap if self.period_s == 0.0 else 0.9 * self.period_s + 0.1 * gap
        self.last_s = stamp_s
        seen = np.asarray(seen, bool) & np.isfinite(x) & np.isfinite(y)
        now = np.where(seen, np.stack([x, y]), 0.0)
        if sigma is not None:
            self._believe(sigma, seen & (self.samples == 0))
        loose = self._looseness(sigma, seen)
        deviation = np.sqrt(np.maximum(self.variance, FLOOR_M**2)) * loose

        age = stamp_s - self.times
        resting = self.still & (age <= self.settings.anchor_s)
        n = resting.sum(1)
        anchor = (self.place * resting).sum(2) / np.maximum(n, 1)
        offset = now - anchor
        square = (offset**2).sum(0)
        tests = N_BLOCKS / max(self.period_s, 1e-4)
        chance = exceedance(self.settings.false_alarms_per_hour, tests)
        limit = threshold_sigmas(chance, 2.0 * self.samples) * deviation
        limit *= np.sqrt(1.0 + 1.0 / np.maximum(n, 1))
        ready = seen & ~self.moving & (n >= 3) & (self.samples >= 3)
        starting = ready & (square > limit**2)
        quiet = seen & ~self.moving & ~starting
        self._learn(quiet & (n >= 3), square, n, loose, sigma)
        self._keep(stamp_s, now, seen, quiet)
        if starting.any():
            events += self._start(starting, anchor, n, deviation)
        if self.moving.any():
            events += self._watch(stamp_s, deviation, starting)
        self.seen_s[seen] = stamp_s
        return sorted(events, key=lambda event: (event.kind, event.onset_s))

    def _believe(self, sigma: np.ndarray, new: np.ndarray) -> None:
        """Begin with the tracker's own sigma: a block that is met moving must not pass for
        noise."""
        if new.any():
            self.variance[new] = np.maximum(sigma[new], FLOOR_M) ** 2
            self.reported[new] = np.maximum(sigma[new], FLOOR_M)
            self.samples[new] = BELIEVED

    def _looseness(self, sigma: np.ndarray | None, seen: np.ndarray) -> np.ndarray:
        """How much noisier each sample is than usual, >= 1: a block half under an arm is."""
        if sigma is None:
            return np.ones(N_BLOCKS)
        usual = np.where(self.reported > 0, self.reported, np.inf)
        return np.where(seen, np.maximum(sigma / usual, 1.0), 1.0)

    def _learn(
        self,
        quiet: np.ndarray,
        square: np.ndarray,
        n: np.ndarray,
        loose: np.ndarray,
        sigma: np.ndarray | None,
    ) -> None:
        memory = LEARN_S / max(self.period_s, 1e-4)
        self.samples[quiet] = np.minimum(self.samples[quiet] + 1, memory)
        gain = np.where(quiet, 1.0 / np.maximum(self.samples, 1.0), 0.0)
        # Two axes, and the anchor has an error of its own.
        sample = square / (2.0 * (1.0 + 1.0 / np.maximum(n, 1))) / loose**2
        self.variance += gain * (sample - self.variance)
        if sigma is not None:
            self.reported += gain * (np.minimum(sigma, 3 * self.reported + 1e-3) - self.reported)

    def _keep(self, stamp_s: float, now: np.ndarray, seen: np.ndarray, quiet: np.ndarray) -> None:
        head = self.head
        self.times[head] = stamp_s
        self.place[:, :, head] = now
        self.good[:, head] = seen
        self.still[:, head] = quiet
        self.head = (head + 1) % RING

    def _start(
        self, starting: np.ndarray, anchor: np.ndarray, n: np.ndarray, deviation: np.ndarray
    ) -> list[SlipEvent]:
        events = []
        for block in np.flatnonzero(starting).tolist():
            self.count += 1
            self.slip[block] = self.count
            self.start[:, block] = anchor[:, block]
            self.rested_s[block] = n[block] * self.period_s
            self.rest_sigma[block] = deviation[block] * np.sqrt(1.0 + 1.0 / n[block])
            self.fresh[block] = LATER_IMAGES
            self._find_onset(block, BEFORE_IMAGES)
            self.top_mps[block] = 0.0
            speed = self._speed(self._recent(self.period_s * 1.5))[0][block]
            self.top_mps[block] = speed
            events.append(self._event(START, block, self.last_s, speed))
        self.moving |= starting
        self.still[starting] = False  # the place it left is no anchor for where it comes to rest
        return events

    def _find_onset(self, block: int, samples: int) -> None:
        """Set onset of `block` from its last `samples` good samples."""
        order = (self.head - 1 - np.arange(RING)) % RING
        order = order[self.good[block, order] & (self.last_s - self.times[order] < 0.2)][:samples]
        order = order[::-1]
        offset = self.place[:, block, order] - self.start[:, block, None]
        direction = offset[:, -1] / max(float(np.hypot(*offset[:, -1])), 1e-12)
        times = self.times[order] - self.last_s
        t0, spread = onset(times, direction @ offset, self.rest_sigma[block], self.period_s)
        self.onset_s[block] = self.last_s + t0
        self.onset_sigma_s[block] = spread

    def _find_end(self, block: int, rest: np.ndarray, sigma_m: float) -> float:
        """When `block` came to its place of rest: its onset, looked at backwards."""
        order = (self.head - 1 - np.arange(RING)) % RING
        order = order[self.good[block, order] & (self.times[order] > self.onset_s[block])]
        offset = self.place[:, block, order] - rest[:, None]
        far = np.hypot(*offset)
        out = np.flatnonzero(far > 5.0 * sigma_m)
        if not out.size:
            return float(self.onset_s[block])
        first = max(out[0] - 3, 0)
        part = slice(first, out[0] + 1)
        direction = offset[:, out[0]] / far[out[0]]
        back, _ = onset(
            -self.times[order[part]], direction @ offset[:, part], sigma_m, self.period_s
        )
        return -back

    def _recent(self, window_s: float) -> np.ndarray:
        """Good samples of the last `window_s`, mask (25, RING)."""
        return self.good & (self.last_s - self.times <= window_s)

    def _speed(self, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least-squares speed over the samples in `mask`, m/s, and its sigma per metre of noise."""
        n = np.maximum(mask.sum(1), 1)
        time = np.where(mask, np.maximum(self.times - self.last_s, -1e3), 0.0)
        lever = np.where(mask, time - (time.sum(1) / n)[:, None], 0.0)
        spread = (lever**2).sum(1)
        slope = (self.place * lever).sum(2) / np.where(spread > 0, spread, np.inf)
        return np.hypot(slope[0], slope[1]), 1.0 / np.sqrt(np.where(spread > 0, spread, np.inf))

    def _watch(
        self, stamp_s: float, deviation: np.ndarray, starting: np.ndarray
    ) -> list[SlipEvent]:
        """Follow the moving blocks: greatest speed, and which of them have come to rest."""
        due = self.moving & ~starting & (self.fresh > 0) & self.good[:, self.head - 1]
        self.fresh[due] -= 1
        for block in np.flatnonzero(due & (self.fresh == 0)).tolist():
            self._find_onset(block, BEFORE_IMAGES + LATER_IMAGES)
        now, _ = self._speed(self._recent(self.period_s * 2.5))
        self.top_mps = np.where(self.moving, np.maximum(self.top_mps, now), self.top_mps)
        window = self._recent(self.settings.stop_s)
        n = np.maximum(window.sum(1), 1)
        speed, lever = self._speed(window)
        middle = (self.place * window).sum(2) / n
        away = np.hypot(*np.where(window, self.place - middle[:, :, None], 0.0)).max(1)
        slowest = self.settings.stop_mps
        slow = speed < np.maximum(slowest, 3.5 * deviation * lever)
        slow &= away < np.maximum(0.5 * slowest * self.settings.stop_s, 4.5 * deviation)
        full = n * self.period_s >= 0.75 * self.settings.stop_s
        begun = stamp_s - self.onset_s >= self.settings.stop_s
        rest = self.moving & slow & full & begun & (n >= 3) & ~starting
        gone = self.moving & (stamp_s - self.seen_s > HIDDEN_S) & ~starting
        events = []
        if rest.any():
            ended = np.full(N_BLOCKS, stamp_s)
            for block in np.flatnonzero(rest).tolist():
                ended[block] = self._find_end(block, middle[:, block], deviation[block])
            events = self._stop(rest, stamp_s, ended)
            self.still |= rest[:, None] & window
        if gone.any():
            events += self._stop(gone, stamp_s, self.seen_s)
        return events

    def _stop(self, which: np.ndarray, stamp_s: float, ended_s: np.ndarray) -> list[SlipEvent]:
        events = []
        for block in np.flatnonzero(which).tolist():
            events.append(self._event(STOP, block, stamp_s, self.top_mps[block], ended_s[block]))
        self.moving &= ~which
        return events

    def _event(
        self, kind: int, block: int, stamp_s: float, speed: float, ended_s: float | None = None
    ) -> SlipEvent:
        newest = (self.head - 1 - np.arange(RING)) % RING
        newest = newest[self.good[block, newest]]
        here = self.place[:, block, newest[0]] if newest.size else self.start[:, block]
        moved = float(np.hypot(*(here - self.start[:, block]))) if kind == STOP else 0.0
        lasted = max(float(ended_s - self.onset_s[block]), 0.0) if ended_s is not None else 0.0
        return SlipEvent(
            kind,
            int(self.slip[block]),
            int(block),
            float(stamp_s),
            float(self.onset_s[block]),
            float(self.onset_sigma_s[block]),
            float(here[0]),
            float(here[1]),
            float(speed),
            moved,
            lasted,
        )
