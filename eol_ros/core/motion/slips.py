# SPDX-License-Identifier: Apache-2.0
"""Slips of the blocks: START against an anchor, STOP by speed, all thresholds from measured noise.

Vectorised over the 25 blocks; a pure function of the sequence of samples. Windows are times and
thresholds are m, m/s or m/s^2, so that 60 and 120 images/s agree.

A STOP waits until the block has been at rest for `stop_s`. A block that moves again before that has
rested all the same: each moving block keeps the run of its newest samples that agree with one
place. When it leaves that place, by the same test as any START, and the run was a rest, then the
STOP of the old slip and the START of the new one are decided in that image. A block may also pass
slowly through a place, its speed falling and rising without reaching zero. The two differ in
acceleration: static friction lets go with (mu_s - mu_k) g at once, the force on a block that slides
grows from nothing. So a run shorter than SURE_S counts as rest when the two images after it show
that acceleration; a longer one needs no more evidence, for no block stays that slow for that long.
What the acceleration is on this table is learnt from slips that begin after a long rest: on worn
grit it is small.
"""

import math
from dataclasses import dataclass

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.geometry import N_BLOCKS
from eol_ros.core.motion.onset import ACCELERATION_MPS2, onsets
from eol_ros.core.motion.threshold import exceedance, threshold_sigmas
from eol_ros.core.stamp_watch import BACK_S
from eol_ros.settings import MotionSettings

START = 1
STOP = 2
RING = 64  # samples kept: 0.27 s at 240 images/s, 1.07 s at 60
LEARN_S = 20.0  # memory of the noise
BELIEVED = 10.0  # samples that the tracker's sigma is worth
ROUND = 300.0  # samples that it is worth that noise is alike both ways, as far as anyone knows
FLOOR_M = 1e-6  # no camera measures better than a micrometre
HIDDEN_S = 0.25  # a moving block out of sight for longer has stopped, as far as anyone knows
BEFORE_IMAGES = 4  # that the onset of a START rests on, the crossing one included
LATER_IMAGES = 2  # more, that the onset of its STOP rests on
GAP_S = 0.5  # a break in the images longer than this starts everything again
# Times noisier than usual, from which on what makes a sample so leads all of them alike.
LOOSE = 2.0
AGREE_SIGMAS = 3.5  # a sample nearer to the mean of a run belongs to it: 998 of 1000 at rest are
AWAY_SIGMAS = 5.0  # a sample that is further off is not where the block rests
UNSURE_IMAGES = 2  # that may lie between agreeing and having left before a run is given up
# A run this long is a rest at this noise. A block that passes slowly, its acceleration growing in
# proportion to time, stays within a distance d for a time that grows as the cube root of d.
SURE_S, SURE_M = 0.04, 1e-5
# Of what is usual: the least pull on a block that static friction lets go, and after a run of two
# images, which a block that passes leaves with a greater one than after a longer run.
PULL, SHORT_PULL = 0.8, 0.9
PULL_STEP = 0.01  # the median pull is followed by this share for each slip
LEAST_PULL_MPS2, MOST_PULL_MPS2 = 0.2, 10.0  # else it was hands, not friction
GROWN = 1.15  # pull over acceleration: springs pull harder as the block's fellows go on


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
        self.pull_mps2 = ACCELERATION_MPS2  # median of those with which slips begin here
        self.reset()

    def reset(self) -> None:
        """Forget positions, noise and running slips; keep the count of slips and their pull."""
        self.times = np.full(RING, -np.inf)
        self.place = np.zeros((2, N_BLOCKS, RING))
        self.good = np.zeros((N_BLOCKS, RING), bool)  # seen in that image
        self.still = np.zeros((N_BLOCKS, RING), bool)  # and at rest
        self.loose = np.ones((N_BLOCKS, RING))  # how much noisier than usual: see _looseness
        self.head = 0
        self.last_s = -np.inf
        self.period_s = 0.0
        self.moving = np.zeros(N_BLOCKS, bool)
        self.variance = np.zeros(N_BLOCKS)  # m^2 an axis, of a block at rest: mean of both
        self.uneven = np.zeros((2, N_BLOCKS))  # and (xx - yy) / 2 and xy of its covariance
        self.reported = np.zeros(N_BLOCKS)  # mean sigma that the tracker gave with it
        self.samples = np.zeros(N_BLOCKS)  # that the variance rests on
        self.seen_s = np.full(N_BLOCKS, -np.inf)
        self.slip = np.zeros(N_BLOCKS, np.int64)
        self.fresh = np.zeros(N_BLOCKS, np.int64)  # images until the onset is looked at again
        self.rest_sigma = np.zeros(N_BLOCKS)
        self.rested_s = np.zeros(N_BLOCKS)  # how long it had been seen at rest before its slip
        self.started_s = np.zeros(N_BLOCKS)  # stamp of its START
        self.onset_s = np.zeros(N_BLOCKS)
        self.onset_sigma_s = np.zeros(N_BLOCKS)
        self.start = np.zeros((2, N_BLOCKS))
        self.top_mps = np.zeros(N_BLOCKS)
        self.not_before_s = np.full(N_BLOCKS, -np.inf)  # the end of the slip before
        self.run = np.zeros(N_BLOCKS, np.int64)  # newest samples of a moving block in one place
        self.run_sum = np.zeros((2, N_BLOCKS))
        self.run_from_s = np.zeros(N_BLOCKS)
        self.run_to_s = np.zeros(N_BLOCKS)
        self.left = np.zeros(N_BLOCKS, np.int64)  # samples after the run that do not agree
        self.clear = np.zeros(N_BLOCKS, bool)  # the last of them had left beyond doubt
        self.owed: list[SlipEvent] = []  # stops that the next call of `stops` returns
        self.begun = np.zeros(N_BLOCKS, bool)  # in the newest image
        self.deviation: np.ndarray | None = None  # of the newest image; None: it was passed over

    def break_off(self) -> list[SlipEvent]:
        """Return the stops of all running slips, at the last image, and forget as `reset`."""
        stops = self._stop(self.moving.copy(), self.last_s, self.seen_s)
        self.reset()
        return stops

    def update(
        self,
        stamp_s: float,
        x: np.ndarray,
        y: np.ndarray,
        seen: np.ndarray,
        sigma: np.ndarray | None = None,
    ) -> list[SlipEvent]:
        """Take one image's blocks and return what it decides: starts, then stops, earliest first.

        x, y: (25,) m. seen: (25,) bool. sigma: (25,) m, the tracker's own opinion of each sample;
        only its ratio to the usual one counts. An image that is not newer than the last one is
        passed over; one that is older by more than BACK_S begins another time, and everything
        again.
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
        """Take one image as `update`, but decide only what begins, which is urgent; then `stops`
        must be called. The STOP of a slip whose block begins another comes with it, before it."""
        self.owed = []
        self.begun[:] = False
        self.deviation = None
        if stamp_s < self.last_s - BACK_S:
            self.owed = self.break_off()
        if not stamp_s > self.last_s:
            return []
        gap = stamp_s - self.last_s
        if gap > GAP_S:
            if np.isfinite(self.last_s):
                self.owed += self._stop(self.moving, self.last_s, self.seen_s)
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
        resting = self.still & (age <= self.settings.baseline_s)
        n = resting.sum(1)
        anchor, doubt = self._anchor(resting)
        offset = now - anchor
        x_m, y_m = offset
        square = x_m * x_m + y_m * y_m
        ways = np.stack([x_m * x_m - y_m * y_m, 2.0 * x_m * y_m])
        tests = N_BLOCKS / max(self.period_s, 1e-4)
        chance = exceedance(self.settings.false_alarms_per_hour, tests)
        limit = threshold_sigmas(chance, 2.0 * self.samples) * deviation
        again = self._leave(stamp_s, now, seen & self.moving, deviation, limit)
        # the anchor has an error of its own
        both = 1.0 + doubt / np.where(loose > LOOSE, loose**2, 1.0)
        limit *= np.sqrt(both)
        ready = seen & ~self.moving & (n >= 3) & (self.samples >= 3)
        starting = ready & (self._rounded(square, ways) > limit**2)
        quiet = seen & ~self.moving & ~starting
        self._learn(quiet & (n >= 3), square, ways, both, loose, sigma)
        self._keep(stamp_s, now, seen, quiet, loose)
        events = []
        if again.any():
            anchor, n = np.where(again, self._run_place(), anchor), np.where(again, self.run, n)
            events = self._stop_before(again, stamp_s, deviation)
            starting = starting | again
        self.deviation, self.begun = deviation, starting
        if starting.any():
            events += self._start(starting, anchor, n, deviation)
        return events

    def stops(self) -> list[SlipEvent]:
        """Return what the image given to `starts` ends, earliest onset first."""
        events = self.owed
        if self.deviation is not None:
            if self.moving.any():
                events = events + self._watch(self.last_s, self.deviation, self.begun)
            self.seen_s[self.good[:, self.head - 1]] = self.last_s
        return sorted(events, key=lambda event: event.onset_s)

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
        return np.maximum(np.where(seen, sigma, 0.0) / usual, 1.0)

    def _anchor(self, resting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean place (2, 25) of the `resting` samples (25, RING), and its variance (25,)
        in units of the usual one.

        Samples that are sure count for more. What makes others unsure, an arm that hides a part,
        leads a block off in all images alike, so the mean of such is no better than one of them.
        """
        excess = np.where(self.loose > LOOSE, self.loose**2, 1.0)
        weight = resting / excess
        total = np.maximum(weight.sum(1), 1e-12)
        alike = (weight * np.sqrt(excess - 1.0)).sum(1) / total
        return (self.place * weight).sum(2) / total, 1.0 / total + alike * alike

    def _rounded(self, square: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Return squared distances (25,), each way in units of its noise, times the mean variance.

        Noise that is alike both ways leaves `square` (25,) as it is; else it is Mahalanobis's
        distance (Proc. Natl. Inst. Sci. India 2, 1936). ways (2, 25): x^2 - y^2 and 2 x y.
        """
        known = self.samples / (self.samples + ROUND)  # few samples never seem round
        a, b = self.uneven * (known / np.maximum(self.variance, FLOOR_M**2))
        return (square - a * ways[0] - b * ways[1]) / (1.0 - a * a - b * b)

    def _learn(
        self,
        quiet: np.ndarray,
        square: np.ndarray,
        ways: np.ndarray,
        both: np.ndarray,
        loose: np.ndarray,
        sigma: np.ndarray | None,
    ) -> None:
        """Learn the noise of blocks (25,) that are `quiet` from how far they are off their anchors.

        both (25,): variance of sample and anchor together, over that of the sample.
        """
        memory = LEARN_S / max(self.period_s, 1e-4)
        self.samples[quiet] = np.minimum(self.samples[quiet] + 1, memory)
        gain = np.where(quiet, 1.0 / np.maximum(self.samples, 1.0), 0.0)
        scale = 1.0 / (2.0 * both * loose**2)  # two axes
        self.variance += gain * (scale * square - self.variance)
        self.uneven += gain * (scale * ways - self.uneven)
        if sigma is not None:
            # what an arm makes unsure for a moment is not usual
            usual_sigma = np.minimum(sigma, LOOSE * self.reported)
            self.reported += gain * (usual_sigma - self.reported)

    def _keep(
        self,
        stamp_s: float,
        now: np.ndarray,
        seen: np.ndarray,
        quiet: np.ndarray,
        loose: np.ndarray,
    ) -> None:
        head = self.head
        self.loose[:, head] = loose
        self.times[head] = stamp_s
        self.place[:, :, head] = now
        self.good[:, head] = seen
        self.still[:, head] = quiet
        self.head = (head + 1) % RING

    def _leave(
        self,
        stamp_s: float,
        now: np.ndarray,
        seen: np.ndarray,
        deviation: np.ndarray,
        limit: np.ndarray,
    ) -> np.ndarray:
        """Follow the runs of the moving blocks that are `seen`; return (25,) who rested and left.

        limit: (25,) m, for the distance from a place that is known exactly.
        """
        count = np.maximum(self.run, 1)
        away = elementary.hypot(*(now - self._run_place()))
        error = np.sqrt(1.0 + 1.0 / count)
        agrees = seen & (self.run > 0) & (away < AGREE_SIGMAS * deviation * error)
        far = seen & (self.run > 1) & (away > limit * error)
        unsure = seen & (self.run > 1) & ~agrees & ~far & (self.left < UNSURE_IMAGES)
        again = np.zeros(N_BLOCKS, bool)
        for block in np.flatnonzero(far).tolist():
            sigma = float(deviation[block])
            sure_s = SURE_S * elementary.power(sigma / SURE_M, 1 / 3)
            short = self.run_to_s[block] - self.run_from_s[block] < sure_s
            early = short and not self.clear[block]
            if early or self._drifts(block, stamp_s, now[:, block], sigma):
                unsure[block] = self.left[block] < UNSURE_IMAGES  # another image may tell
            else:
                rest = self._run_place()[:, block]
                pull = self._pull(block, stamp_s, now[:, block], rest) if short else np.inf
                share = PULL if self.run[block] > 2 else SHORT_PULL
                again[block] = pull > share * self.pull_mps2
        self.clear[seen] = (far & unsure)[seen]
        self.left[unsure] += 1
        self.left[agrees] = 0
        self.run[agrees] += 1
        self.run_sum[:, agrees] += now[:, agrees]
        fresh = seen & ~agrees & ~unsure & ~again
        self.run[fresh], self.left[fresh] = 1, 0
        self.run_sum[:, fresh], self.run_from_s[fresh] = now[:, fresh], stamp_s
        self.run_to_s[agrees | fresh] = stamp_s
        return again

    def _run_place(self) -> np.ndarray:
        """Mean place (2, 25) of the runs, in m."""
        return self.run_sum / np.maximum(self.run, 1)

    def _drifts(self, block: int, stamp_s: float, now: np.ndarray, sigma_m: float) -> bool:
        """Whether `now` (2,) m lies where the run of `block`, taken for a slow slide, leads."""
        at = np.array(self._samples(block, RING, self.run_from_s[block] - 0.5 * self.period_s))
        at = at[self.times[at] <= self.run_to_s[block]]
        if len(at) < 2:
            return False
        middle = self.times[at].mean()
        lever = self.times[at] - middle
        spread = (lever**2).sum()
        ahead = (stamp_s - middle) / spread
        place = self.place[:, block, at]
        led = place.mean(1) + (place * lever).sum(1) * ahead
        error = math.sqrt(1.0 + 1.0 / len(at) + ahead * ahead * spread)
        return elementary.hypot(*(now - led).tolist()) < AGREE_SIGMAS * sigma_m * error

    def _pull(self, block: int, stamp_s: float, now: np.ndarray, rest: np.ndarray) -> float:
        """Acceleration (m/s^2) of `block` from `rest`, by the sample before `now`, all (2,) m."""
        at = next(i for i in self._samples(block, 2, -np.inf) if self.times[i] < stamp_s)
        ahead = now - rest
        far = elementary.hypot(*ahead.tolist())
        near = max(float((ahead * (self.place[:, block, at] - rest)).sum()) / far, 0.0)
        # s = a/2 (t - t0)^2 twice, t0 eliminated
        rate = (math.sqrt(far) - math.sqrt(near)) / (stamp_s - float(self.times[at]))
        return 2.0 * rate * rate

    def _learn_pull(self, block: int, stamp_s: float) -> None:
        """Learn from the first two images of a slip what pull is usual: on worn grit blocks let go
        less."""
        now = self.place[:, block, self.head - 1]
        more = self._pull(block, stamp_s, now, self.start[:, block]) > self.pull_mps2
        pull = self.pull_mps2 * elementary.exp(PULL_STEP if more else -PULL_STEP)
        self.pull_mps2 = min(max(pull, LEAST_PULL_MPS2), MOST_PULL_MPS2)

    def _stop_before(
        self, again: np.ndarray, stamp_s: float, deviation: np.ndarray
    ) -> list[SlipEvent]:
        """Return the stops of slips whose blocks rested, and move `again`."""
        blocks = np.flatnonzero(again)
        place = self._run_place()
        ended = np.full(N_BLOCKS, stamp_s)
        ended[blocks] = self._find_ends(
            blocks, place[:, blocks], deviation[blocks], self.run_to_s[blocks]
        )
        self.not_before_s[blocks] = ended[blocks]
        return self._stop(again, stamp_s, ended, place)

    def _start(
        self, starting: np.ndarray, anchor: np.ndarray, n: np.ndarray, deviation: np.ndarray
    ) -> list[SlipEvent]:
        blocks = np.flatnonzero(starting)
        self.slip[blocks] = self.count + 1 + np.arange(blocks.size)
        self.count += blocks.size
        self.start[:, blocks] = anchor[:, blocks]
        self.rested_s[blocks] = n[blocks] * self.period_s
        self.rest_sigma[blocks] = (deviation * np.sqrt(1.0 + 1.0 / np.maximum(n, 1)))[blocks]
        self.fresh[blocks] = LATER_IMAGES
        self.started_s[blocks] = self.last_s
        self._find_onsets(blocks, BEFORE_IMAGES)
        self.moving |= starting
        self.still[starting] = False  # the place it left is no anchor for where it comes to rest
        events = []
        for block in blocks.tolist():
            self.top_mps[block] = speed = self._step_speed(block)
            events.append(self._event(START, block, self.last_s, speed))
        return sorted(events, key=lambda event: event.onset_s)

    def _step_speed(self, block: int) -> float:
        """Return the speed of `block` in m/s since the image before, 0 when it was not seen in
        it."""
        at = self._samples(block, 2, self.last_s - 1.5 * self.period_s)
        if len(at) < 2:
            return 0.0
        dx, dy = (self.place[:, block, at[0]] - self.place[:, block, at[1]]).tolist()
        return elementary.hypot(dx, dy) / float(self.times[at[0]] - self.times[at[1]])

    def _samples(self, block: int, most: int, since_s: float) -> list[int]:
        """Return the places in the ring of up to `most` good samples after `since_s`, newest
        first."""
        good, times = self.good[block], self.times
        found: list[int] = []
        for back in range(1, RING + 1):
            at = (self.head - back) % RING
            if times[at] <= since_s or len(found) == most:
                break
            if good[at]:
                found.append(at)
        return found

    def _find_onsets(self, blocks: np.ndarray, samples: int) -> None:
        """Set the onset of each of `blocks` (k,) from its last `samples` good samples."""
        times = np.zeros((len(blocks), samples))
        path = np.full((len(blocks), samples), np.nan)
        for k, block in enumerate(blocks.tolist()):
            at = self._samples(block, samples, self.last_s - 0.2)[::-1]
            offset = self.place[:, block, at] - self.start[:, block, None]
            ahead = offset[:, -1]
            along = ahead[0] * offset[0] + ahead[1] * offset[1]
            times[k, -len(at) :] = self.times[at] - self.last_s
            path[k, -len(at) :] = along / max(elementary.hypot(*ahead.tolist()), 1e-12)
        latest = self.started_s[blocks] - self.last_s
        found, spread = onsets(
            times, path, self.rest_sigma[blocks], self.period_s, latest, self.pull_mps2 / GROWN
        )
        found = np.maximum(found, self._earliest(times, path, self.rest_sigma[blocks]))
        found = np.maximum(self.last_s + found, self.not_before_s[blocks])
        self.onset_s[blocks] = np.minimum(found, self.started_s[blocks])
        self.onset_sigma_s[blocks] = spread

    def _earliest(self, times: np.ndarray, path: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
        """Return (b,) s before which no block can have gone that is at rest in a later image.

        times, path (b, n): as in `onsets`. A quarter of the usual pull would have moved it out of
        the noise by then. What a hand pushes off at speed fits no pull, and its onset anything.
        """
        rows = np.arange(len(path))
        rest = (path > AWAY_SIGMAS * sigma_m[:, None]).argmax(1) - 1
        known = (rest >= 0) & np.isfinite(path[rows, rest])
        hidden_s = np.sqrt(8.0 * AWAY_SIGMAS * sigma_m / self.pull_mps2)
        return np.where(known, times[rows, rest] - hidden_s, -np.inf)

    def _find_ends(
        self, blocks: np.ndarray, rest: np.ndarray, sigma_m: np.ndarray, until_s: np.ndarray
    ) -> np.ndarray:
        """When `blocks` (k,) came to their places of rest (2, k), left by `until_s` (k,): onsets,
        looked at backwards."""
        ends = self.onset_s[blocks]
        times = np.zeros((len(blocks), BEFORE_IMAGES))
        path = np.full((len(blocks), BEFORE_IMAGES), np.nan)
        for k, block in enumerate(blocks.tolist()):
            at = np.array(self._samples(block, RING, self.onset_s[block]), int)
            at = at[self.times[at] <= until_s[k]]
            offset = self.place[:, block, at] - rest[:, k, None]
            far = elementary.hypot(offset[0], offset[1])
            away = far > AWAY_SIGMAS * sigma_m[k]
            # The newest may be away because it has begun to leave: it rested where it is not.
            out = np.flatnonzero(away & ~np.logical_and.accumulate(away))
            if out.size:
                part = slice(max(out[0] - BEFORE_IMAGES + 1, 0), out[0] + 1)
                size = part.stop - part.start
                direction = offset[:, out[0]] / far[out[0]]
                times[k, -size:] = -self.times[at[part]]
                path[k, -size:] = direction[0] * offset[0, part] + direction[1] * offset[1, part]
        found = np.flatnonzero(np.isfinite(path[:, -1]))
        if found.size:
            back, _ = onsets(
                times[found], path[found], sigma_m[found], self.period_s,
                acceleration_mps2=self.pull_mps2 / GROWN,
            )  # fmt: skip
            ends[found] = -back
        return ends

    def _recent(self, window_s: float) -> np.ndarray:
        """Places in the ring of the images of the last `window_s`, (k,), newest first."""
        order = (self.head - 1 - np.arange(RING)) % RING
        return order[: np.count_nonzero(self.last_s - self.times <= window_s)]

    def _speed(self, blocks: np.ndarray, window_s: float) -> tuple[np.ndarray, ...]:
        """Least-squares motion of `blocks` (k,) over their good samples of the last `window_s`.

        Returns speed (k,) in m/s, its sigma per metre of noise, the mean place (2, k), the greatest
        distance from it, and the number of samples.
        """
        at = self._recent(window_s)
        rows = blocks[:, None]
        mask, place = self.good[rows, at], self.place[:, rows, at]
        n = np.maximum(mask.sum(1), 1)
        time = np.where(mask, self.times[at] - self.last_s, 0.0)
        lever = np.where(mask, time - (time.sum(1) / n)[:, None], 0.0)
        spread = (lever**2).sum(1)
        spread[spread <= 0.0] = np.inf
        slope = (place * lever).sum(2) / spread
        middle = (place * mask).sum(2) / n
        away = np.where(mask, place - middle[:, :, None], 0.0)
        return (
            elementary.hypot(slope[0], slope[1]), 1.0 / np.sqrt(spread), middle,
            elementary.hypot(away[0], away[1]).max(1, initial=0.0), n,
        )  # fmt: skip

    def _watch(
        self, stamp_s: float, deviation: np.ndarray, starting: np.ndarray
    ) -> list[SlipEvent]:
        """Follow the moving blocks: greatest speed, and which of them have come to rest."""
        due = self.moving & ~starting & (self.fresh > 0) & self.good[:, self.head - 1]
        self.fresh[due] -= 1
        for block in np.flatnonzero(due & (self.fresh == LATER_IMAGES - 1)).tolist():
            if self.rested_s[block] >= self.settings.stop_s:  # else it may have passed slowly
                self._learn_pull(block, stamp_s)
        settled = np.flatnonzero(due & (self.fresh == 0))
        if settled.size:
            self._find_onsets(settled, BEFORE_IMAGES + LATER_IMAGES)
        on = np.flatnonzero(self.moving)
        top = self._speed(on, self.period_s * 2.5)[0]
        self.top_mps[on] = np.maximum(self.top_mps[on], top)
        stop_s, slowest = self.settings.stop_s, self.settings.stop_mps
        speed, lever, middle, away, n = self._speed(on, stop_s)
        noise = deviation[on]
        slow = speed < np.maximum(slowest, 3.5 * noise * lever)
        slow &= away < np.maximum(0.5 * slowest * stop_s, 4.5 * noise)
        full = n * self.period_s >= 0.75 * stop_s
        begun = stamp_s - self.onset_s[on] >= stop_s
        fresh = starting[on]
        rest = slow & full & begun & (n >= 3) & ~fresh
        gone = self.moving & (stamp_s - self.seen_s > HIDDEN_S) & ~starting
        events = []
        if rest.any():
            blocks = on[rest]
            ended = np.full(N_BLOCKS, stamp_s)
            ended[blocks] = self._find_ends(
                blocks, middle[:, rest], noise[rest], np.full(blocks.size, stamp_s)
            )
            self.not_before_s[blocks] = ended[blocks]
            which = np.zeros(N_BLOCKS, bool)
            which[blocks] = True
            events = self._stop(which, stamp_s, ended)
            at = self._recent(stop_s)
            self.still[blocks[:, None], at] |= self.good[blocks[:, None], at]
        if gone.any():
            events += self._stop(gone & self.moving, stamp_s, self.seen_s)
        return events

    def _stop(
        self,
        which: np.ndarray,
        stamp_s: float,
        ended_s: np.ndarray,
        place: np.ndarray | None = None,
    ) -> list[SlipEvent]:
        """Return the stops of `which`, at `place` (2, 25), or else where they were seen last."""
        events = []
        for block in np.flatnonzero(which).tolist():
            at = None if place is None else place[:, block]
            events.append(
                self._event(STOP, block, stamp_s, self.top_mps[block], ended_s[block], at)
            )
        self.moving &= ~which
        self.run[which] = self.left[which] = 0
        return events

    def _event(
        self,
        kind: int,
        block: int,
        stamp_s: float,
        speed: float,
        ended_s: float | None = None,
        here: np.ndarray | None = None,
    ) -> SlipEvent:
        if here is None:
            newest = self._samples(block, 1, -np.inf)
            here = self.place[:, block, newest[0]] if newest else self.start[:, block]
        moved = elementary.hypot(*(here - self.start[:, block]).tolist()) if kind == STOP else 0.0
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
