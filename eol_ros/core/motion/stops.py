# SPDX-License-Identifier: Apache-2.0
"""When a moving block has come to rest: for `stop_s`, or for less before it moves again.

Each moving block has a run: its newest samples that agree with one position. When the block leaves
it, by the same test as for any START, and the run was a rest, one image decides the STOP of the old
slip and the START of the new one. A block may also pass a position slowly, or turn back there,
without a rest. Then one parabola in time fits the run and the images beside it. If none fits, a
rest differs from a pass in acceleration: static friction lets go with (mu_s - mu_k) g at once, the
force on a sliding block grows from zero. So a run shorter than PASS_S counts as rest if the two
images after it show that acceleration. The least acceleration follows the median of the slips that
begin after a long rest: on worn grit it is small.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.motion.history import Image
from eol_ros.core.motion.onset import OnsetEstimator
from eol_ros.settings import MotionSettings

REST_SHARE = 0.75  # least duration of a rest, as a share of stop_s (chosen)
HIDDEN_S = 0.25  # a moving block that is not seen for longer counts as stopped, s (chosen)
AGREE_SIGMAS = 3.5  # distance of a sample from the mean of its run: 998 of 1000 at rest are nearer
PASS_SIGMAS = 2.9  # greatest misfit of the parabola, normal deviations: 998 of 1000 passes fit
UNSURE_IMAGES = 2  # that may lie between agreeing and having left before a run is given up (chosen)
# A run of PASS_S is a rest at a noise of PASS_M. A block that passes slowly, its acceleration
# growing in proportion to time, stays within a distance d for a time that grows as its cube root.
PASS_S, PASS_M = 0.04, 1e-5
# Least acceleration after a rest, over the median. A block that passes leaves a run of two images
# with a greater acceleration than a longer one.
LEAST_SHARE, LEAST_SHARE_OF_TWO = 0.8, 0.9

RUN = np.dtype([
    ('images', 'i8'),
    ('sum', 'f8', 2),  # of positions, m
    ('from_s', 'f8'),  # stamps of its first and last image
    ('to_s', 'f8'),
    ('left', 'i8'),  # newer samples that do not agree with it
    ('clear', '?'),  # the last of them exceeds the threshold
])  # fmt: skip


class StopDetector:
    """Finds rests of moving blocks."""

    def __init__(self, onsets: OnsetEstimator):
        self.onsets, self.history, self.slips = onsets, onsets.history, onsets.slips
        self.runs = np.zeros(len(self.slips), RUN)

    def run_place(self) -> np.ndarray:
        """Return the mean position (n, 2) of each run, in m."""
        return self.runs['sum'] / np.maximum(self.runs['images'], 1)[:, None]

    def rested(self, images: np.ndarray, settings: MotionSettings) -> np.ndarray:
        """Return whether `images` (n,) at one place, counted within baseline_s, make a rest."""
        least_s = REST_SHARE * min(settings.stop_s, settings.baseline_s)
        return (images >= 3) & (images * self.history.period_s >= least_s)

    def follow_runs(self, image: Image, limit: np.ndarray) -> np.ndarray:
        """Extend the runs by an image that is not in the history yet; return which blocks (n,)
        rested and left.

        limit: (n,) m, for the distance from a position that is known exactly.
        """
        again, seen = np.zeros(len(self.runs), bool), image.seen & self.slips['moving']
        if not seen.any():
            return again
        runs, place, images = self.runs, self.run_place(), self.runs['images']
        away = elementary.hypot(*(image.place - place).T)
        error = np.sqrt(1.0 + 1.0 / np.maximum(images, 1))
        several = seen & (images > 1)
        agrees = seen & (images > 0) & (away < AGREE_SIGMAS * image.deviation * error)
        far = several & (away > limit * error)
        wait = runs['left'] < UNSURE_IMAGES  # another image may tell
        unsure = several & ~agrees & ~far & wait
        for block in np.flatnonzero(far).tolist():
            rested = self._rested(block, image, place[block])
            again[block] = rested is True
            unsure[block] = rested is None and wait[block]
        restart = seen & ~agrees & ~unsure & ~again
        runs[restart] = np.zeros((), RUN)
        runs['from_s'][restart] = image.stamp_s
        more = agrees | restart
        images += more
        runs['sum'][more] += image.place[more]
        runs['to_s'][more] = image.stamp_s
        runs['left'][more] = 0
        runs['left'][unsure] += 1
        runs['clear'][seen] = (far & unsure)[seen]
        return again

    def _rested(self, block: int, image: Image, rest: np.ndarray) -> bool | None:
        """Whether the run of `block`, at `rest` (2,) m, which it has left, was a rest; None if the
        next image must tell."""
        run, sigma_m = self.runs[block], float(image.deviation[block])
        enough_s = PASS_S * elementary.power(sigma_m / PASS_M, 1 / 3)
        short = run['to_s'] - run['from_s'] < enough_s
        place = image.place[block]
        if (short and not run['clear']) or self._passes(block, image.stamp_s, place, sigma_m):
            return None
        if not short:
            return True
        share = LEAST_SHARE if run['images'] > 2 else LEAST_SHARE_OF_TWO
        acceleration = self.onsets.acceleration(block, image.stamp_s, place, rest)
        return bool(acceleration > share * self.onsets.acceleration_mps2)

    def _passes(self, block: int, stamp_s: float, place: np.ndarray, sigma_m: float) -> bool:
        """Return whether one parabola in time fits the run of `block`, the image before it and the
        images since, up to `place` (2,) m: a slide under a constant force, which may turn back."""
        history = self.history
        at = history.samples(block, self.runs['from_s'][block] - 1.5 * history.period_s)
        times_s = np.append(history.times_s[at] - stamp_s, 0.0)
        freedom = 2 * (len(times_s) - 3)
        if freedom <= 0:
            return False
        places = np.append(history.place[:, block, at] - place[:, None], np.zeros((2, 1)), 1)
        left = (places * places).sum()
        basis: list[np.ndarray] = []
        for column in (np.ones_like(times_s), times_s, times_s * times_s):
            for other in basis:
                column = column - (column * other).sum() * other
            basis.append(column / math.sqrt((column * column).sum()))
            left -= ((places * basis[-1]).sum(1) ** 2).sum()
        # quantile of chi squared: Wilson and Hilferty (Proc. Natl. Acad. Sci. 17, 1931)
        width = 2.0 / (9.0 * freedom)
        root = 1.0 - width + PASS_SIGMAS * math.sqrt(width)
        return bool(left < freedom * (root * root * root) * sigma_m * sigma_m)

    def end(
        self, blocks: np.ndarray, rest: np.ndarray, sigma_m: np.ndarray, until_s: np.ndarray
    ) -> np.ndarray:
        """Forget the runs of `blocks` (k,); return when they came to rest, as `ends` does."""
        ended = self.onsets.ends(blocks, rest, sigma_m, until_s)
        self.slips['not_before_s'][blocks] = ended
        self.runs[blocks] = np.zeros((), RUN)
        return ended

    def due(self, image: Image, settings: MotionSettings) -> tuple[np.ndarray, np.ndarray]:
        """Return moving blocks (k,) whose STOP the newest image decides, and their ends (k,) s."""
        slips, history = self.slips, self.history
        stop_s, stop_mps = settings.stop_s, settings.stop_mps
        on = np.flatnonzero(slips['moving'])
        fit, noise = history.fit(on, stop_s), image.deviation[on]
        rest = fit.speed_mps < np.maximum(stop_mps, 3.5 * noise * fit.sigma_per_m)
        rest &= fit.away_m < np.maximum(0.5 * stop_mps * stop_s, 4.5 * noise)
        rest &= self.rested(fit.images, settings)
        rest &= image.stamp_s - slips['onset_s'][on] >= stop_s
        older = slips['started_s'][on] < image.stamp_s
        rest &= older
        gone = on[~rest & older & (image.stamp_s - slips['seen_s'][on] > HIDDEN_S)]
        blocks, ended = on[rest], np.empty(0)
        if not (blocks.size or gone.size):
            return blocks, ended
        self.runs[gone] = np.zeros((), RUN)
        if blocks.size:
            until_s = np.full(blocks.size, image.stamp_s)
            ended = self.end(blocks, fit.place[rest], noise[rest], until_s)
            at = history.recent(stop_s)
            rows = blocks[:, None]
            history.resting[rows, at] |= history.seen[rows, at]
        return np.append(blocks, gone), np.append(ended, slips['seen_s'][gone])
