# SPDX-License-Identifier: Apache-2.0
"""Power laws of whole numbers: maximum likelihood, with an upper limit where the system has one.

P(s) ~ s^-tau on s = x_min .. x_max; the cumulative N(>= s) of an unlimited law falls as s^-b with
b = tau - 1. The two are never mixed up: `tau` is of the density, `b_value` of the cumulative.

Estimator: Clauset, Shalizi and Newman, SIAM Rev. 51 (2009) 661, with the zeta function; with x_max
the normaliser is the plain sum, because a table of 25 blocks cannot have a cascade of 26 and a
fit without that knowledge is steeper than the truth. No line is laid through a log-log plot
anywhere.
"""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.table import Table
from eol_ros.errors import EolError

FEWEST_CASCADES = 200  # fewer reject other laws too seldom (docs/explanation/science.md)
REJECTED = 0.05  # the p-value below which a law is called none
FEWEST = 30  # independent events in the range of a fit: with fewer, a slope would be invented
AUTOMATON_B = 0.77  # of the 5x5 automaton, alpha 0.20 (docs/explanation/science.md)
DECADE = 10  # from the lower end of a fit to its upper end, at least
GREATEST_END = 100  # greatest lower end that is tried
REPEATS = 400  # number of samples drawn
WINDOW = 5.0  # autocorrelation times over which autocorrelations are summed (Sokal)
STEEPEST, FLATTEST = 12.0, -4.0
TAU_TOLERANCE = 1e-12
DRAWN_TOLERANCE = 1e-6  # of tau, for drawn samples
UNLIMITED = 1 << 20  # untruncated: sums go this far, the zeta function does the rest


class FitError(EolError):
    """These numbers do not carry a fit."""


class TooFew(FitError):
    """There are fewer than `needed` cascades."""

    needed = FEWEST_CASCADES

    def __init__(self, count: int) -> None:
        there = '1 cascade is' if count == 1 else f'{count} cascades are'
        super().__init__(f'{there} too few for a power law of areas: {self.needed} are needed')


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
    """Return the fits of `counts` (m,) from every lower end that leaves a decade.

    `nearest` chooses among them. Raises FitError where there is none.
    """
    if x_max is not None and x_max < DECADE:
        raise FitError(f'sizes up to {x_max} are no decade: no power law can be seen in that')
    fits = []
    for x_min in range(1, min(GREATEST_END, len(counts) - 2) + 1):
        if x_max is not None and x_max < DECADE * x_min:
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
    """The law of cascade areas on a table, up to all of its blocks.

    `tested` heeds that cascades depend on each other. `others`: the fits with the other lower ends,
    by which one sees how much the range decides.
    """

    fit: Fit
    tested: 'Goodness'
    others: list[Fit]

    @property
    def rejected(self) -> bool:
        """Whether a power law lies too far off, wherever it begins."""
        return self.tested.p_value < REJECTED

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        f, t = self.fit, self.tested
        test = f'KS {f.ks:.2f}, n {f.count} as {t.effective:.0f} independent, p {t.p_value:.2g}'
        end = f.x_max
        assert end is not None  # `cascade_law` sets it
        drift = ''
        if t.drift_p < REJECTED:
            first, second = (tau - 1 for tau in t.halves)
            drift = (
                f'; it drifts (p {t.drift_p:.2g}): b is {first:.2f} in the first half and '
                f'{second:.2f} in the second'
            )
        if self.rejected:
            return f'not a power law: {test}, the nearest from area {f.x_min} on{drift}'
        bs = [other.b_value for other in self.others]
        return (
            f'a power law is not ruled out: b = {f.b_value:.2f} ({t.low - 1:.2f} to '
            f'{t.high - 1:.2f}) for areas {f.x_min} to {end}, {np.log10(end / f.x_min):.1f} '
            f'decades ({test}); with other lower ends b is {min(bs):.2f} to {max(bs):.2f}{drift}'
        )


def cascade_law(areas: np.ndarray, blocks: int = Table().count) -> CascadeLaw:
    """Fit cascade areas as the panel and `eol report` do.

    Parameters
    ----------
    areas : ndarray
        (n,) int, distinct blocks of each cascade, in order of time.
    blocks : int
        How many the table has: the upper end.

    Returns
    -------
    CascadeLaw
        The fit whose lower end has the least KS distance, up to all blocks, and its test.

    Raises
    ------
    FitError
        Fewer than 200 cascades, fewer than 30 independent ones, fewer than 10 blocks, or no slope;
        the text is for people.

    Examples
    --------
    >>> law = cascade_law(sample(1.8, 1, 25, 2000, np.random.default_rng(1)))
    >>> law.fit.x_max, law.rejected
    (25, False)
    """
    areas = np.asarray(areas, np.int64)  # logarithms of uint8 would be of half precision
    if len(areas) < FEWEST_CASCADES:
        raise TooFew(len(areas))
    fits = candidates(histogram(areas), blocks)
    return CascadeLaw(nearest(fits), goodness(areas, fits, np.random.default_rng(1)), fits)


def inefficiency(series: np.ndarray) -> float:
    """Return by what factor dependence widens the variance of the mean of `series` (n,); >= 1.

    So n values in order of time tell as much as n over this that are independent. It is
    1 + 2 x the sum of autocorrelations, over five autocorrelation times (A. Sokal, in Functional
    Integration, 1997, 131), corrected for the mean that was subtracted.
    """
    series = np.asarray(series, float) - np.mean(series)
    n, power = len(series), float((series**2).sum())
    if power == 0 or n < 4:
        return 1.0
    products = np.fft.irfft(np.abs(np.fft.rfft(series, 2 * n)) ** 2)[1 : n // 2]
    lags = np.arange(1, n // 2)
    sums = 1 + 2 * (products / power * n / (n - lags)).cumsum()
    beyond = lags >= WINDOW / 2 * sums
    last = int(np.argmax(beyond)) if beyond.any() else len(lags) - 1
    return float(max(1.0, sums[last]) * (1 + (2 * lags[last] + 1) / n))


@dataclass(frozen=True)
class Goodness:
    """Test of the fit of least KS distance.

    Of its tau: `error`, the standard error, and `low` to `high`, the 95 % interval; both include
    the choice of the range. `p_value`: of the law. `effective`: the number of independent events
    that tell as much. `drift_p`: of a law that stays the same; `halves`: tau of the first and of
    the second half.
    """

    error: float
    low: float
    high: float
    p_value: float
    effective: float
    drift_p: float
    halves: tuple[float, float]


def goodness(
    numbers: np.ndarray, fits: list[Fit], rng: np.random.Generator, repeats: int = REPEATS
) -> Goodness:
    """Test a power law where events depend on those before them.

    Samples of the nearest law are drawn (below its lower end of the numbers themselves), with as
    many events as there are independent ones; every range is fitted again and the nearest chosen
    again.

    Parameters
    ----------
    numbers : ndarray
        (n,) int, in order of time.
    fits : list of Fit
        Of one upper end; see `candidates`.
    rng : Generator
        Draws the samples.
    repeats : int
        How many samples are drawn.

    Returns
    -------
    Goodness
        Error and interval of tau of the nearest fit; p_value, how often a sample is as far off.

    Raises
    ------
    FitError
        The law has no upper end, or there are fewer than 30 independent events.

    References
    ----------
    A. Clauset, C. R. Shalizi, M. E. J. Newman, SIAM Review 51 (2009) 661, section 4. Drift: the
    greatest cumulative sum against Kolmogorov's law, W. Ploberger, W. Kraemer, Econometrica 60
    (1992) 271.

    Examples
    --------
    >>> areas = sample(1.8, 1, 25, 2000, np.random.default_rng(1))
    >>> fits = [fit(histogram(areas), 1, 25)]
    >>> goodness(areas, fits, np.random.default_rng(2), repeats=40).p_value > 0.1
    True
    """
    top = fits[0].x_max
    if top is None:
        raise FitError('a law without an upper end has no test')
    first, best = min(f.x_min for f in fits), nearest(fits)
    numbers = np.asarray(numbers)
    numbers = numbers[(numbers >= first) & (numbers <= top)]
    effective = _independent(numbers)
    share = np.bincount(numbers - first, minlength=top - first + 1) / len(numbers)
    begin = best.x_min - first
    law = _Law(best.x_min, top).cumulative(best.tau, top)
    share[begin:] = share[begin:].sum() * np.diff(law, prepend=0.0)
    drawn = rng.multinomial(round(effective), share / share.sum(), repeats)
    least, taus = np.full(repeats, np.inf), np.full(repeats, best.tau)
    for f in fits:
        law_of = _Law(f.x_min, top)
        inside = drawn[:, f.x_min - first :]
        total = inside.sum(axis=1)
        some = np.flatnonzero(total)
        found = law_of.solve_all(inside[some] @ law_of.logs / total[some])
        off = inside[some].cumsum(axis=1) / total[some, None] - law_of.cumulatives(found)
        off = np.abs(off).max(axis=1)
        nearer = off < least[some]
        least[some[nearer]], taus[some[nearer]] = off[nearer], found[nearer]
    low, high = np.percentile(taus, [2.5, 97.5])
    tail = numbers[numbers >= best.x_min]
    return Goodness(
        float(np.std(taus, ddof=1)), float(2 * best.tau - high), float(2 * best.tau - low),
        (int((least >= best.ks).sum()) + 1) / (repeats + 1), effective,
        *_drift(tail, _Law(best.x_min, top)),
    )  # fmt: skip


def _independent(numbers: np.ndarray) -> float:
    """How many independent events tell as much as `numbers` (n,), in order of time."""
    effective = len(numbers) / inefficiency(np.log(numbers)) if len(numbers) else 0.0
    if effective < FEWEST:
        raise FitError(
            f'{len(numbers)} events depend on each other and count as {effective:.0f} independent '
            f'ones: {FEWEST} are needed'
        )
    return effective


def _drift(numbers: np.ndarray, law: '_Law') -> tuple[float, tuple[float, float]]:
    """p-value of a law that stays the same through `numbers` (n,), and tau of each half of them."""
    logs = np.log(numbers)
    way = np.abs((logs - logs.mean()).cumsum()).max()
    reach = way / (logs.std() * np.sqrt(len(logs) * inefficiency(logs)))
    k = np.arange(1, 101)
    p = float(np.clip(-2 * ((-1.0) ** k * np.exp(-2 * (k * reach) ** 2)).sum(), 0, 1))
    middle = len(logs) // 2
    first, second = law.solve_all(np.array([logs[:middle].mean(), logs[middle:].mean()]))
    return p, (float(first), float(second))


def band(areas: np.ndarray, rng: np.random.Generator, blocks: int = Table().count) -> np.ndarray:
    """Return where N(>= A) of as long a catalogue would lie in 95 of 100 cases, for each A.

    areas: (n,) int, distinct blocks of each cascade, in order of time; they are drawn again, as
    many as there are independent ones. Returns (2, blocks), lower and upper end for A = 1 to
    `blocks`. Raises FitError with fewer than 30 independent cascades.
    """
    share = np.bincount(np.asarray(areas) - 1, minlength=blocks) / max(len(areas), 1)
    drawn = rng.multinomial(round(_independent(areas)), share, REPEATS)
    at_least = drawn[:, ::-1].cumsum(axis=1)[:, ::-1] * len(areas) / drawn[0].sum()
    found: np.ndarray = np.percentile(at_least, [2.5, 97.5], axis=0)
    return found


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
        """The tau of each mean log s, (n,), of a law with an end."""
        low, high = np.full(len(mean_logs), FLATTEST), np.full(len(mean_logs), STEEPEST)
        while np.max(high - low, initial=0.0) > DRAWN_TOLERANCE:
            middle = (low + high) / 2
            weights = -middle[:, None] * self.logs
            weights = np.exp(weights - weights.max(axis=1, keepdims=True))
            steeper = weights @ self.logs / weights.sum(axis=1) > mean_logs
            low, high = np.where(steeper, middle, low), np.where(steeper, high, middle)
        return (low + high) / 2

    def cumulatives(self, taus: np.ndarray) -> np.ndarray:
        """P(x_min <= s <= k) for each tau, (n, x_max - x_min + 1)."""
        weights = -taus[:, None] * self.logs
        weights = np.exp(weights - weights.max(axis=1, keepdims=True)).cumsum(axis=1)
        return weights / weights[:, -1:]

    def cumulative(self, tau: float, top: int) -> np.ndarray:
        """P(x_min <= s <= k) for k = x_min .. top."""
        logs = np.log(np.arange(self.x_min, top + 1))
        return np.minimum(np.exp(-tau * logs - self.log_norm(tau)).cumsum(), 1.0)
