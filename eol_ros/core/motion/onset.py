# SPDX-License-Identifier: Apache-2.0
"""When a block began to move: back-extrapolation through the images around the threshold crossing.

A block that static friction lets go accelerates by (mu_s - mu_k) g, so its path begins as
a/2 (t - t0)^2. The onset t0 is the posterior mean on a grid; the acceleration a is integrated out
under a Gaussian prior. The image that crosses a threshold alone leaves the onset open within one
period, a standard deviation of period / sqrt(12) or more. This estimate is two to five times
closer. Some 30 array operations estimate all blocks of one image.
"""

import math

import numpy as np

from eol_ros.core import elementary
from eol_ros.core.motion.history import History

ACCELERATION_MPS2 = 2.5  # Coulomb friction: (mu_s - mu_k) g, m/s^2
ACCELERATION_SPREAD = 0.24  # standard deviation of the prior, as a share of its mean (chosen)
# Springs relax as the block moves, or pull harder as the rim and its neighbours move on: the path
# departs from a parabola by a share of itself that grows with time (fitted to the twin).
GROWTH_PER_S = 3.0
GROWTH_SIGMA_PER_S = 5.0
_GRID = np.linspace(0.0, 1.0, 48)
BEFORE_IMAGES = 4  # that the onset of a START rests on, the crossing one included (chosen)
LATER_IMAGES = 2  # more, that the onset of its STOP rests on (chosen)
AWAY_SIGMAS = 5.0  # a sample that is further off is not where the block rests (chosen)
ACCELERATION_STEP = 0.01  # the median follows each slip by this share (chosen)
FRICTION_MPS2 = 0.2, 10.0  # range of acceleration that friction explains; beyond it, hands
GROWN = 1.15  # mean acceleration of the first images over that at the onset: springs pull harder

SLIP = np.dtype([
    ('moving', '?'),
    ('slip', 'i8'),  # number of the newest slip
    ('refine_in', 'i8'),  # images until its onset is estimated again
    ('rest_sigma_m', 'f8'),  # standard deviation of the path from `start`
    ('rested_s', 'f8'),  # how long the block was seen at rest before
    ('started_s', 'f8'),  # stamp of its START
    ('onset_s', 'f8'),
    ('onset_sigma_s', 'f8'),
    ('start', 'f8', 2),  # rest position before, m
    ('top_mps', 'f8'),  # greatest speed
    ('not_before_s', 'f8'),  # end of the slip before
    ('seen_s', 'f8'),  # stamp of the newest image that shows the block
])  # fmt: skip


def onsets(
    times_s: np.ndarray,
    path_m: np.ndarray,
    sigma_m: np.ndarray,
    period_s: float,
    latest_s: np.ndarray | None = None,
    acceleration_mps2: float = ACCELERATION_MPS2,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate when blocks began to slip, between images.

    Parameters
    ----------
    times_s : ndarray
        (b, n) rising, in s.
    path_m : ndarray
        (b, n) displacement along the slip in m, the first still at rest; NaN where there is none.
    sigma_m : ndarray
        (b,) noise of `path_m`, the error of the rest position included.
    period_s : float
        Time between images, s.
    latest_s : ndarray, optional
        (b,) latest possible onsets: stamps of images that surely show motion (default: the newest).
    acceleration_mps2 : float
        Mean acceleration of the prior.

    Returns
    -------
    onset_s, sigma_s : ndarray
        (b,) mean and standard deviation of the posterior, on the clock of `times_s`.

    Examples
    --------
    >>> t = np.arange(20)[None] / 60
    >>> path = 0.8 * np.maximum(t - 0.15, 0) ** 2
    >>> found, sigma = onsets(t, path, np.array([2e-5]), 1 / 60)
    >>> found.round(3).tolist(), bool(sigma[0] < 2e-3)
    ([0.15], True)
    """
    absent = np.isnan(path_m)
    path = np.where(absent, 0.0, path_m).T[:, :, None]
    noise2 = np.where(absent, 1e12, (sigma_m * sigma_m)[:, None]).T[:, :, None]
    times, newest = times_s.T[:, :, None], times_s[:, -1:]
    if latest_s is not None:
        newest = np.minimum(newest, latest_s[:, None])
    low, high = np.where(absent, np.inf, times_s).min(1, keepdims=True) - period_s, newest
    for _ in range(2):  # a coarse grid finds the place, a fine one the moment
        width = high - low
        weight = _posterior(low + width * _GRID, times, path, noise2, acceleration_mps2)
        total = np.add.reduce(weight, 1, keepdims=True)
        centre = np.add.reduce(weight * _GRID, 1, keepdims=True) / total
        square = np.add.reduce(weight * (_GRID * _GRID), 1, keepdims=True) / total
        spread = width * np.sqrt(np.maximum(square - centre * centre, 0.0))
        centre = low + width * centre
        step = width / (_GRID.size - 1)
        reach = 4.0 * spread + 2.0 * step
        low, high = centre - reach, np.minimum(centre + reach, newest)
    return centre[:, 0], np.maximum(spread, step / math.sqrt(12.0))[:, 0]


def _posterior(
    t0: np.ndarray, times: np.ndarray, path: np.ndarray, noise2: np.ndarray, acceleration: float
) -> np.ndarray:
    """Return the posterior (b, g) of the onset on the grid `t0` (b, g), not normalised.

    The acceleration is integrated out. Samples (n, b, 1) come first, so that sums over them are
    sums of rows. With sums over the samples S.., the misfit at the best acceleration (Sps +
    prior A) / (Sss + prior) is Spp - (Sps + prior A)^2 / (Sss + prior), up to a constant. The
    function divides by the product of all variances and the information, without a logarithm.
    """
    prior = 1.0 / (ACCELERATION_SPREAD * acceleration) ** 2
    since = np.maximum(times - t0, 0.0)
    shape = since * since * (0.5 + 0.5 * GROWTH_PER_S * since)
    model_error = GROWTH_SIGMA_PER_S * since * path
    error = noise2 + model_error * model_error
    seen, form = path / error, shape / error
    information = np.add.reduce(shape * form) + prior
    pull = np.add.reduce(path * form) + prior * acceleration
    misfit = np.add.reduce(path * seen) - pull * pull / information
    misfit += 50.0 * (pull <= 0.0)
    misfit -= np.minimum.reduce(misfit, 1, keepdims=True)
    misfit *= -0.5
    return elementary.exp(misfit) / np.sqrt(np.multiply.reduce(error) * information)


class OnsetEstimator:
    """Onsets and ends of the slips of all blocks, and the acceleration with which they begin.

    `slips` (n,) SLIP is shared with the detector. acceleration_mps2: median so far.
    """

    def __init__(self, history: History, acceleration_mps2: float = ACCELERATION_MPS2):
        self.history = history
        self.acceleration_mps2 = acceleration_mps2
        self.slips = np.zeros(len(history.seen), SLIP)
        self.slips['not_before_s'] = self.slips['seen_s'] = -np.inf

    def acceleration(
        self, block: int, stamp_s: float, place: np.ndarray, rest: np.ndarray
    ) -> float:
        """Return the acceleration (m/s^2) with which `block` came from `rest` to `place`, (2,) m
        each, by the sample before."""
        history = self.history
        at = history.samples(block, most=2)
        at = at[history.times_s[at] < stamp_s][0]
        ahead = place - rest
        far = elementary.hypot(*ahead.tolist())
        near = max(float((ahead * (history.place[:, block, at] - rest)).sum()) / far, 0.0)
        # s = a/2 (t - t0)^2 twice, t0 eliminated
        rate = (math.sqrt(far) - math.sqrt(near)) / (stamp_s - float(history.times_s[at]))
        return 2.0 * rate * rate

    def refine(self, least_rest_s: float) -> None:
        """Learn from the second image of each slip, and estimate its onset again after the third.

        Slips after less than `least_rest_s` of rest teach nothing: the block may not have rested.
        """
        slips, history = self.slips, self.history
        due = slips['moving'] & (slips['started_s'] < history.last_s) & (slips['refine_in'] > 0)
        due &= history.seen[:, history.newest]
        if not due.any():
            return
        slips['refine_in'][due] -= 1
        second = due & (slips['refine_in'] == LATER_IMAGES - 1)
        for block in np.flatnonzero(second & (slips['rested_s'] >= least_rest_s)).tolist():
            place = history.place[:, block, history.newest]
            found = self.acceleration(block, history.last_s, place, slips['start'][block])
            median = self.acceleration_mps2
            step = ACCELERATION_STEP if found > median else -ACCELERATION_STEP
            least, most = FRICTION_MPS2
            self.acceleration_mps2 = min(max(median * elementary.exp(step), least), most)
        settled = np.flatnonzero(due & (slips['refine_in'] == 0))
        if settled.size:
            self.estimate(settled, BEFORE_IMAGES + LATER_IMAGES)

    def estimate(self, blocks: np.ndarray, samples: int) -> None:
        """Set the onset of each of `blocks` (k,) from its last `samples` samples."""
        history, rows = self.history, self.slips[blocks]
        last_s = history.last_s
        times = np.zeros((len(blocks), samples))
        path = np.full((len(blocks), samples), np.nan)
        for k, block in enumerate(blocks.tolist()):
            at = history.samples(block, last_s - 0.2, samples)[::-1]
            offset = history.place[:, block, at] - rows['start'][k][:, None]
            ahead = offset[:, -1]
            along = ahead[0] * offset[0] + ahead[1] * offset[1]
            times[k, -len(at) :] = history.times_s[at] - last_s
            path[k, -len(at) :] = along / max(elementary.hypot(*ahead.tolist()), 1e-12)
        sigma_m = rows['rest_sigma_m']
        found, spread = self._onsets(times, path, sigma_m, rows['started_s'] - last_s)
        found = np.maximum(found, self._earliest(times, path, sigma_m))
        found = np.maximum(last_s + found, rows['not_before_s'])
        self.slips['onset_s'][blocks] = np.minimum(found, rows['started_s'])
        self.slips['onset_sigma_s'][blocks] = spread

    def _onsets(
        self,
        times: np.ndarray,
        path: np.ndarray,
        sigma_m: np.ndarray,
        latest: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        acceleration = self.acceleration_mps2 / GROWN
        return onsets(times, path, sigma_m, self.history.period_s, latest, acceleration)

    def _earliest(self, times: np.ndarray, path: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
        """Return lower limits (b,) s of the onsets of blocks that a later image shows at rest.

        times, path (b, n): as in `onsets`. A quarter of the median acceleration would have moved
        the block out of the noise by then. A block that a hand pushes off at speed fits no
        acceleration, so that the posterior says little.
        """
        rows = np.arange(len(path))
        rest = (path > AWAY_SIGMAS * sigma_m[:, None]).argmax(1) - 1
        known = (rest >= 0) & np.isfinite(path[rows, rest])
        hidden_s = np.sqrt(8.0 * AWAY_SIGMAS * sigma_m / self.acceleration_mps2)
        return np.where(known, times[rows, rest] - hidden_s, -np.inf)

    def ends(
        self, blocks: np.ndarray, rest: np.ndarray, sigma_m: np.ndarray, until_s: np.ndarray
    ) -> np.ndarray:
        """Return when `blocks` (k,) came to their rest positions (k, 2), which they left after
        `until_s` (k,): onsets backwards in time."""
        history = self.history
        ends = self.slips['onset_s'][blocks]
        times = np.zeros((len(blocks), BEFORE_IMAGES))
        path = np.full((len(blocks), BEFORE_IMAGES), np.nan)
        for k, block in enumerate(blocks.tolist()):
            at = history.samples(block, ends[k])
            at = at[history.times_s[at] <= until_s[k]]
            offset = history.place[:, block, at] - rest[k][:, None]
            far = elementary.hypot(offset[0], offset[1])
            away = far > AWAY_SIGMAS * sigma_m[k]
            # The newest may be away because the block begins to leave: that is not before its rest.
            out = np.flatnonzero(away & ~np.logical_and.accumulate(away))
            if out.size:
                part = slice(max(out[0] - BEFORE_IMAGES + 1, 0), out[0] + 1)
                size = part.stop - part.start
                direction = offset[:, out[0]] / far[out[0]]
                times[k, -size:] = -history.times_s[at[part]]
                path[k, -size:] = direction[0] * offset[0, part] + direction[1] * offset[1, part]
        found = np.flatnonzero(np.isfinite(path[:, -1]))
        if found.size:
            ends[found] = -self._onsets(times[found], path[found], sigma_m[found])[0]
        return ends
