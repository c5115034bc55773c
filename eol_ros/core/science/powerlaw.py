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

FEWEST_CASCADES = 200  # 20 blocks of 10, from which error and goodness of fit are drawn
BLOCKS = 20  # long enough to hold what hangs together; with 50 more true laws are rejected
REJECTED = 0.05  # the p-value below which a law is called none
FEWEST = 30  # events in the range of a fit: with fewer, a slope would be invented
AUTOMATON_B = 0.77  # of the 5x5 automaton, alpha 0.20 (docs/science.md)
GREATEST_END = 100  # greatest lower end that is tried
REPEATS = 400  # number of samples drawn
STEEPEST, FLATTEST = 12.0, -4.0
TAU_TOLERANCE = 1e-12
UNLIMITED = 1 << 20  # untruncated: sums go this far, the zeta function does the rest


class FitError(EolError):
    """These numbers do not carry a fit."""


class TooFew(FitError):
    """There are fewer than `needed`."""

    def __init__(self, count: int, name: str, law: str, needed: int) -> None:
        super().__init__(too_few(count, name, law, needed))
        self.needed = needed


def too_few(count: int, name: str, law: str, needed: int) -> str:
    """Return, for people, that `law` takes `needed` and there are `count`; `name` is of one."""
    there = f'{count} {name} is' if count == 1 else f'{count} {name}s are'
    return f'{there} too few for {law}: {needed} are needed'


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
    """Return how often each whole number 0, 1 ... m stands in `numbers`, (m + 1,); m: the greatest.

    Raises FitError for anything but whole numbers of 0 or more.
    """
    numbers = np.asarray(numbers)
    if numbers.size and (numbers.dtype.kind not in 'iub' or numbers.min() < 0):
        raise FitError('a size is a whole number of 0 or more')
    return np.bincount(numbers.astype(np.int64).ravel())


def exceedance(counts: np.ndarray) -> np.ndarray:
    """Return P(s >= k) for k = 0 .. m - 1, (m,), of a histogram (m,); FitError if it is empty."""
    total = counts.sum()
    if total == 0:
        raise FitError('no events: nothing to count')
    return counts[::-1].cumsum()[::-1] / total


def fit(counts: np.ndarray, x_min: int = 1, x_max: int | None = None) -> Fit:
    """Fit the discrete power law of greatest likelihood.

    Parameters
    ----------
    counts : ndarray
        (m,) how often each whole number 0, 1, 2 ... was found; see `histogram`.
    x_min, x_max : int
        The range; x_max None means without end.

    Returns
    -------
    Fit
        `tau` of the density and its standard error for independent events; `b_value` is tau - 1.

    Raises
    ------
    FitError
        Fewer than 30 events in the range, or all of them on one number.

    References
    ----------
    A. Clauset, C. R. Shalizi, M. E. J. Newman, SIAM Review 51 (2009) 661.

    Examples
    --------
    >>> areas = sample(1.8, 1, 25, 5000, np.random.default_rng(1))
    >>> found = fit(histogram(areas), 1, 25)
    >>> abs(found.tau - 1.8) < 3 * found.error, found.count
    (True, 5000)
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


def candidates(counts: np.ndarray, x_max: int | None = None) -> list[Fit]:
    """Return the fits of `counts` (m,) from every lower end that leaves a factor of four.

    `nearest` chooses among them. Raises FitError where there is none.
    """
    fits = []
    for x_min in range(1, min(GREATEST_END, len(counts) - 2) + 1):
        if x_max is not None and x_max < 4 * x_min:
            break  # less than that says nothing about a slope
        try:
            fits.append(fit(counts, x_min, x_max))
        except FitError:
            break
    if not fits:
        raise FitError(f'too few events ({int(np.sum(counts))}) for a fit')
    return fits


def nearest(fits: list[Fit]) -> Fit:
    """Return the fit whose lower end makes the KS distance least (Clauset et al. 2009, 3.3)."""
    return min(fits, key=lambda f: f.ks)


@dataclass(frozen=True)
class CascadeLaw:
    """The law of cascade areas on a table of 25 blocks.

    `b_error` and `p_value` heed that cascades depend on each other. `others`: the fits with the
    other lower ends, by which one sees how much the range decides.
    """

    fit: Fit
    b_error: float
    p_value: float
    others: list[Fit]

    @property
    def rejected(self) -> bool:
        """Whether a power law lies too far off, wherever it begins."""
        return self.p_value < REJECTED

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        f = self.fit
        test = f'KS {f.ks:.2f}, n {f.count}, p {self.p_value:.2g}'
        end = N_BLOCKS if f.x_max is None else f.x_max
        if self.rejected:
            return f'not a power law: {test} (the nearest, from area {f.x_min} on)'
        bs = [other.b_value for other in self.others]
        return (
            f'a power law is not ruled out: b = {f.b_value:.2f} +- {self.b_error:.2f} for areas '
            f'{f.x_min} to {end}, {np.log10(end / f.x_min):.1f} decades ({test}); '
            f'with other lower ends b is {min(bs):.2f} to {max(bs):.2f}'
        )


def cascade_law(areas: np.ndarray) -> CascadeLaw:
    """Fit cascade areas as the panel and `eol report` do.

    Parameters
    ----------
    areas : ndarray
        (n,) int, distinct blocks of each cascade, in order of time.

    Returns
    -------
    CascadeLaw
        The fit whose lower end has the least KS distance, up to all blocks; its error and p-value.

    Raises
    ------
    FitError
        Fewer than 200 cascades, or no slope; the text is for people.

    Examples
    --------
    >>> law = cascade_law(sample(1.8, 1, 25, 2000, np.random.default_rng(1)))
    >>> law.fit.x_max, law.rejected
    (25, False)
    """
    areas = np.asarray(areas)
    if len(areas) < FEWEST_CASCADES:
        raise TooFew(len(areas), 'cascade', 'a power law of areas', FEWEST_CASCADES)
    fits = candidates(histogram(areas), N_BLOCKS)
    found = nearest(fits)
    tested = goodness(areas, fits, np.random.default_rng(1))
    return CascadeLaw(found, max(tested.error, found.error), tested.p_value, fits)


@dataclass(frozen=True)
class Goodness:
    """Of the fit of least KS distance: the standard error of tau, and the p-value of the law."""

    error: float
    p_value: float


def goodness(
    numbers: np.ndarray,
    fits: list[Fit],
    rng: np.random.Generator,
    blocks: int = BLOCKS,
    repeats: int = REPEATS,
) -> Goodness:
    """Test a power law where events depend on those before them.

    Blocks of `numbers`, in order of time, are drawn again, every range is fitted again and the
    nearest chosen again. The distance of a drawn sample is counted from that of the numbers
    themselves, F* - F - (law* - law): so far would the numbers lie off if the law were true and
    they hung together as they do.

    Parameters
    ----------
    numbers : ndarray
        (n,) int, in order of time.
    fits : list of Fit
        Of one upper end; see `candidates`.
    rng : Generator
        Draws the blocks.
    blocks : int
        How many a sample has.
    repeats : int
        How many samples are drawn.

    Returns
    -------
    Goodness
        Standard error of tau of the nearest fit; p_value, how often a sample is as far off.

    References
    ----------
    H. R. Kuensch, Ann. Stat. 17 (1989) 1217.

    Examples
    --------
    >>> areas = sample(1.8, 1, 25, 2000, np.random.default_rng(1))
    >>> fits = [fit(histogram(areas), 1, 25)]
    >>> goodness(areas, fits, np.random.default_rng(2), repeats=40).p_value > 0.1
    True
    """
    numbers = np.asarray(numbers)
    x_max = fits[0].x_max
    top = int(numbers.max()) if x_max is None else x_max
    first = min(f.x_min for f in fits)
    drawn = _drawn_histograms(numbers, first, top, rng, blocks, repeats)
    best = nearest(fits)
    counts = histogram(numbers[numbers <= top]).astype(float)
    counts = np.pad(counts, (0, top + 1 - len(counts)))
    least = np.full(repeats, np.inf)
    error = 0.0
    for f in fits:
        law = _Law(f.x_min, x_max)
        inside = drawn[:, f.x_min - first :]
        total = inside.sum(axis=1)
        some = total > 0
        logs = np.log(np.arange(f.x_min, top + 1))
        taus = law.solve_all(inside[some] @ logs / total[some])
        if f is best:
            error = float(np.std(taus, ddof=1))
        chance = law.cumulatives(taus, top)
        own = counts[f.x_min :].cumsum() / counts[f.x_min :].sum()
        off = inside[some].cumsum(axis=1) / total[some, None] - own
        off -= chance - law.cumulative(f.tau, top)
        least[some] = np.minimum(least[some], np.abs(off).max(axis=1))
    worse = int((least >= best.ks).sum())
    return Goodness(error, (worse + 1) / (repeats + 1))


def band(areas: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return where N(>= A) of as long a catalogue would lie in 95 of 100 cases, for A = 1 to 25.

    Blocks of the catalogue are drawn again, as in `goodness`, so cascades may depend on those
    before them.

    Parameters
    ----------
    areas : ndarray
        (n,) int, distinct blocks of each cascade, in order of time.
    rng : Generator
        Draws the blocks.

    Returns
    -------
    ndarray
        (2, 25) float, lower and upper end.

    Raises
    ------
    FitError
        Fewer than 50 cascades.

    Examples
    --------
    >>> areas = sample(1.8, 1, 25, 2000, np.random.default_rng(1))
    >>> low, high = band(areas, np.random.default_rng(2))
    >>> low[0] == high[0] == 2000.0, bool(low[4] < high[4])
    (True, True)
    """
    areas = np.asarray(areas)
    drawn = _drawn_histograms(areas, 1, N_BLOCKS, rng, BLOCKS, REPEATS)
    at_least = drawn[:, ::-1].cumsum(axis=1)[:, ::-1]
    # what is left over when blocks of one length are cut is scaled for
    at_least = at_least * (len(areas) / at_least[:, 0].mean())
    found: np.ndarray = np.percentile(at_least, [2.5, 97.5], axis=0)
    return found


def _drawn_histograms(
    numbers: np.ndarray, first: int, top: int, rng: np.random.Generator, blocks: int, repeats: int
) -> np.ndarray:
    """Histograms over first .. top of `repeats` series drawn in blocks, (repeats, top - first + 1).

    Raises FitError where there are too few for blocks.
    """
    blocks = min(blocks, len(numbers) // 10)
    if blocks < 5:
        raise FitError(f'{len(numbers)} events are too few to draw blocks of them')
    length = len(numbers) // blocks
    width = top - first + 1
    used = numbers[: length * blocks]
    inside = (used >= first) & (used <= top)
    which = np.repeat(np.arange(blocks), length)[inside] * width + (used[inside] - first)
    each = np.bincount(which, minlength=blocks * width).reshape(blocks, width)
    picked = rng.integers(0, blocks, (repeats, blocks))
    times = np.apply_along_axis(np.bincount, 1, picked, minlength=blocks)
    return times @ each


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

    def cumulatives(self, taus: np.ndarray, top: int) -> np.ndarray:
        """P(x_min <= s <= k) for each tau, (n, top - x_min + 1)."""
        if self.x_max is None:
            return np.stack([self.cumulative(tau, top) for tau in taus])
        weights = -taus[:, None] * self.logs
        weights = np.exp(weights - weights.max(axis=1, keepdims=True)).cumsum(axis=1)
        return weights / weights[:, -1:]

    def cumulative(self, tau: float, top: int) -> np.ndarray:
        """P(x_min <= s <= k) for k = x_min .. top."""
        logs = np.log(np.arange(self.x_min, top + 1))
        return np.minimum(np.exp(-tau * logs - self.log_norm(tau)).cumsum(), 1.0)
