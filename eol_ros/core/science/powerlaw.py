# SPDX-License-Identifier: Apache-2.0
"""Power laws of whole numbers: maximum likelihood, with an upper limit where the system has one.

P(s) ~ s^-tau on s = x_min .. x_max; the cumulative N(>= s) of an unlimited law falls as s^-b with
b = tau - 1. The two are never mixed up: `tau` is of the density, `b_value` of the cumulative.

Estimator: Clauset, Shalizi and Newman, SIAM Rev. 51 (2009) 661, with the zeta function; with x_max
the normaliser is the plain sum, because a lattice of 25 blocks cannot have a cascade of 26 and a
fit without that knowledge is steeper than the truth. No line is laid through a log-log plot
anywhere.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.geometry import N_BLOCKS
from eol_ros.errors import EolError

FEWEST_CASCADES = 50  # as many as `block_error` needs: one without an error is no result
FEWEST = 30  # events in the range of a fit: with fewer, a slope would be invented
STEEPEST, FLATTEST = 12.0, -4.0
TAU_TOLERANCE = 1e-12
UNLIMITED = 1 << 20  # untruncated: sums go this far, the zeta function does the rest


class FitError(EolError):
    """These numbers do not carry a fit."""


@dataclass(frozen=True)
class Fit:
    """A power law on x_min .. x_max (None: without end) through `count` numbers.

    `tau` is the exponent of the density, `error` its standard error for independent events
    (Fisher), `ks` the greatest distance between the two cumulative distributions.
    """

    tau: float
    error: float
    x_min: int
    x_max: int | None
    count: int
    ks: float
    log_likelihood: float

    @property
    def b_value(self) -> float:
        """Exponent of the cumulative N(>= s) ~ s^-b."""
        return self.tau - 1


def histogram(numbers: np.ndarray) -> np.ndarray:
    """Return how often each whole number 0, 1, 2 ... stands in `numbers`."""
    numbers = np.asarray(numbers)
    if numbers.size and (numbers.dtype.kind not in 'iub' or numbers.min() < 0):
        raise FitError('a size is a whole number of 0 or more')
    return np.bincount(numbers.astype(np.int64).ravel())


def exceedance(counts: np.ndarray) -> np.ndarray:
    """Return P(s >= k) for k = 0 .. len(counts) - 1, from a histogram."""
    total = counts.sum()
    if total == 0:
        raise FitError('no events: nothing to count')
    return counts[::-1].cumsum()[::-1] / total


def fit(counts: np.ndarray, x_min: int = 1, x_max: int | None = None) -> Fit:
    """Return the power law of greatest likelihood through a histogram (see `histogram`).

    Raises FitError with fewer than 30 events in the range, or all of them on one number.
    """
    counts = np.asarray(counts)
    if x_min < 1 or (x_max is not None and x_max <= x_min):
        raise FitError(
            f'fit from {x_min} to {x_max}: a range begins at 1 or later, and has a length'
        )
    top = len(counts) - 1 if x_max is None else min(x_max, len(counts) - 1)
    inside = counts[x_min : top + 1].astype(float)
    total = inside.sum()
    if total < FEWEST:
        raise FitError(
            f'too few events ({total:.0f}) from {x_min} to {x_max or "the greatest"} '
            f'for a fit: {FEWEST} are needed'
        )
    if np.count_nonzero(inside) < 2:
        raise FitError(f'all {total:.0f} events have one size: no law can be seen in that')
    logs = np.log(np.arange(x_min, top + 1))
    mean_log = float(inside @ logs / total)
    law = _Law(x_min, x_max)
    tau = law.solve(mean_log)
    chance = law.cumulative(tau, top)
    ks = float(np.abs(inside.cumsum() / total - chance).max())
    error = 1 / np.sqrt(total * law.moments(tau)[1])
    likelihood = -total * (tau * mean_log + law.log_norm(tau))
    return Fit(tau, float(error), x_min, x_max, int(total), ks, float(likelihood))


def choose_x_min(counts: np.ndarray, x_max: int | None = None, largest: int = 100) -> Fit:
    """Return the fit whose lower end makes the KS distance least (Clauset et al. 2009, 3.3)."""
    fits = []
    for x_min in range(1, min(largest, len(counts) - 2) + 1):
        if x_max is not None and x_max < 4 * x_min:
            break  # less than that says nothing about a slope
        try:
            fits.append(fit(counts, x_min, x_max))
        except FitError:
            break
    if not fits:
        raise FitError(f'too few events ({int(np.sum(counts))}) for a fit')
    return min(fits, key=lambda f: f.ks)


def block_error(
    numbers: np.ndarray, found: Fit, rng: np.random.Generator, blocks: int = 50, repeats: int = 200
) -> float:
    """Return the standard error of `found.tau` where events depend on each other.

    `numbers` in order of time; whole blocks of them are drawn again (Kuensch, Ann. Stat. 17 (1989)
    1217), so what hangs together stays together. The mean logarithm is all that the estimator
    needs.
    """
    numbers = np.asarray(numbers)
    blocks = min(blocks, len(numbers) // 10)
    if blocks < 5:
        raise FitError(f'{len(numbers)} events are too few to draw blocks of them')
    inside = (numbers >= found.x_min) & (numbers <= (found.x_max or np.inf))
    logs = np.where(inside, np.log(np.maximum(numbers, 1)), 0.0)
    used = len(numbers) // blocks * blocks
    block_logs = logs[:used].reshape(blocks, -1).sum(axis=1)
    block_counts = inside[:used].reshape(blocks, -1).sum(axis=1)
    drawn = rng.integers(0, blocks, (repeats, blocks))
    counts = block_counts[drawn].sum(axis=1)
    mean_logs = block_logs[drawn].sum(axis=1)[counts > 0] / counts[counts > 0]
    law = _Law(found.x_min, found.x_max)
    return float(np.std(law.solve_all(mean_logs), ddof=1))


@dataclass(frozen=True)
class CascadeLaw:
    """The law of cascade areas on a table of 25 blocks; `b_error` heeds dependent cascades."""

    fit: Fit
    b_error: float


def cascade_law(areas: np.ndarray) -> CascadeLaw:
    """Return the power law of cascade areas in order of time, upper end at all blocks.

    The one rule for panel and report. Raises FitError, whose text is for people, with fewer than
    50 cascades, or where they follow no power law.
    """
    areas = np.asarray(areas)
    if len(areas) < FEWEST_CASCADES:
        raise FitError(f'{len(areas)} cascades are too few for a fit: {FEWEST_CASCADES} are needed')
    found = choose_x_min(histogram(areas), x_max=N_BLOCKS)
    error = block_error(areas, found, np.random.default_rng(1))
    return CascadeLaw(found, max(error, found.error))


def p_value(found: Fit, rng: np.random.Generator, repeats: int = 100) -> float:
    """Return how often a true power law of these parameters lies further off than `found` does.

    For independent events, so small values are to be read with care; the estimate is repeated on
    each sample, as it must be (Clauset et al. 2009, 4.1).
    """
    worse = 0
    for _ in range(repeats):
        numbers = sample(found.tau, found.x_min, found.x_max, found.count, rng)
        worse += fit(histogram(numbers), found.x_min, found.x_max).ks >= found.ks
    return worse / repeats


def sample(
    tau: float, x_min: int, x_max: int | None, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return `count` independent numbers of the law, (count,) int64."""
    if x_max is None and tau <= 1:
        raise FitError(f'tau {tau:g}: a law without end needs tau > 1')
    top = UNLIMITED if x_max is None else x_max
    law = _Law(x_min, x_max)
    cumulative = law.cumulative(tau, top)
    drawn = rng.random(count)
    numbers = x_min + np.searchsorted(cumulative, drawn, side='right')
    beyond = numbers > top
    if x_max is None:  # the tail beyond the table, by inversion of its integral
        left = (1 - drawn[beyond]) / (1 - cumulative[-1])
        numbers[beyond] = np.minimum((top + 1) * left ** (-1 / (tau - 1)), 2.0**62).astype(np.int64)
    return numbers if x_max is None else np.minimum(numbers, x_max)


class _Law:
    """Sums over x_min .. x_max, or to infinity."""

    def __init__(self, x_min: int, x_max: int | None):
        self.x_min, self.x_max = x_min, x_max
        if x_max is not None:
            self.logs = np.log(np.arange(x_min, x_max + 1))

    def log_norm(self, tau: float) -> float:
        """log of sum s^-tau."""
        if self.x_max is None:
            from scipy.special import zeta  # the panel, which fits bounded laws, does without scipy

            return float(np.log(zeta(tau, self.x_min)))
        weights = -tau * self.logs
        return float(np.max(weights) + np.log(np.exp(weights - np.max(weights)).sum()))

    def moments(self, tau: float) -> tuple[float, float]:
        """Mean and variance of log s."""
        if self.x_max is None:
            step = 1e-4 * min(1.0, tau - 1)
            low, mid, high = (self.log_norm(tau + k * step) for k in (-1, 0, 1))
            return (low - high) / (2 * step), (low - 2 * mid + high) / step**2
        weights = -tau * self.logs
        weights = np.exp(weights - np.max(weights))
        weights /= weights.sum()
        mean = float(weights @ self.logs)
        return mean, float(weights @ (self.logs - mean) ** 2)

    def solve(self, mean_log: float) -> float:
        """The tau at which the law has this mean log s; it falls as tau grows."""
        flattest = 1 + 1e-3 if self.x_max is None else FLATTEST

        low, high = flattest, STEEPEST
        if self.moments(low)[0] < mean_log or self.moments(high)[0] > mean_log:
            raise FitError(
                f'no tau between {flattest:g} and {STEEPEST:g} has these sizes: '
                'they are no power law on this range'
            )
        while high - low > TAU_TOLERANCE:
            middle = (low + high) / 2
            if self.moments(middle)[0] > mean_log:
                low = middle
            else:
                high = middle
        return (low + high) / 2

    def solve_all(self, mean_logs: np.ndarray) -> np.ndarray:
        """The tau of each mean log s, (n,); all at the same time where the law has an end."""
        if self.x_max is None:
            return np.array([self.solve(float(mean)) for mean in mean_logs])
        low, high = np.full(len(mean_logs), FLATTEST), np.full(len(mean_logs), STEEPEST)
        while np.max(high - low, initial=0.0) > TAU_TOLERANCE:
            middle = (low + high) / 2
            weights = -middle[:, None] * self.logs
            weights = np.exp(weights - weights.max(axis=1, keepdims=True))
            steeper = weights @ self.logs / weights.sum(axis=1) > mean_logs
            low, high = np.where(steeper, middle, low), np.where(steeper, high, middle)
        return (low + high) / 2

    def cumulative(self, tau: float, top: int) -> np.ndarray:
        """P(x_min <= s <= k) for k = x_min .. top."""
        logs = np.log(np.arange(self.x_min, top + 1))
        return np.minimum(np.exp(-tau * logs - self.log_norm(tau)).cumsum(), 1.0)
