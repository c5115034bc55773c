# SPDX-License-Identifier: Apache-2.0
"""What seismologists ask of a catalogue: completeness, b-value, waiting times, Omori's law.

A magnitude here is log10 of a cascade's potency, the sum of the distances its blocks slipped; so b
is the exponent of the cumulative law of the potency itself, N(>= M) ~ 10^(-b M), without the factor
2/3 of the moment magnitude.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from eol_ros.core.science.powerlaw import (
    FEWEST_CASCADES,
    REJECTED,
    FitError,
    TooFew,
    inefficiency,
    too_few,
)

BIN = 0.1  # of magnitude, in which completeness is looked for
CORRECTION = 0.2  # added to the greatest bin (Woessner and Wiemer, BSSA 95 (2005) 684)
FEWEST = 50
FEWEST_MAINS = 10
STEEPEST = 4.0  # p of Omori's law
BETTER = 6.0  # of AIC, by which Omori's law must be better than a constant rate


@dataclass(frozen=True)
class MagnitudeLaw:
    """The law of magnitudes above completeness.

    b_value: of greatest likelihood (Aki 1965). b_positive: from positive differences of successive
    magnitudes, which cascades that go unseen after great ones do not bias (van der Elst, J.
    Geophys. Res. 126 (2021) e2020JB021027). p_value: how often an exponential law lies as far off.
    """

    completeness: float
    count: int
    b_value: float
    b_error: float
    b_positive: float
    b_positive_error: float
    positive: int
    ks: float
    p_value: float

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        test = f'KS {self.ks:.2f}, n {self.count}, p {self.p_value:.2g}'
        both = (
            f'b = {self.b_value:.2f} +- {self.b_error:.2f} of greatest likelihood, '
            f'{self.b_positive:.2f} +- {self.b_positive_error:.2f} b-positive'
        )
        above = f'above completeness (M {self.completeness:.2f})'
        if self.p_value < REJECTED:
            return f'potency: no Gutenberg-Richter law {above}: {test} ({both})'
        return f'potency: a Gutenberg-Richter law {above} is not ruled out: {both} ({test})'


def completeness(magnitudes: np.ndarray) -> float:
    """Return the magnitude from which on all of `magnitudes` (n,), n > 0, are there.

    That is the fullest bin of 0.1, and 0.2 above it.
    """
    lowest = math.floor(magnitudes.min() / BIN)
    counts = np.bincount((np.floor(magnitudes / BIN) - lowest).astype(int))
    return float((lowest + np.argmax(counts) + 0.5) * BIN + CORRECTION)


def b_value(magnitudes: np.ndarray, least: float) -> float:
    """Return b of greatest likelihood of `magnitudes` (n,) from `least` on (Aki 1965), unbinned.

    NaN where none is above `least`.
    """
    above = magnitudes[magnitudes >= least] - least
    return float(math.log10(math.e) / above.mean()) if len(above) and above.mean() > 0 else math.nan


def b_positive(magnitudes: np.ndarray, least: float = BIN) -> float:
    """Return b of the differences of successive `magnitudes` (n,), of those from `least` > 0 on."""
    return b_value(np.diff(magnitudes), least)


def magnitude_law(
    magnitudes: np.ndarray, rng: np.random.Generator, repeats: int = 400
) -> MagnitudeLaw:
    """Fit the law of Gutenberg and Richter above completeness.

    A magnitude is log10 of the potency of a cascade, the sum of the distances of its slips.
    Completeness is the middle of the fullest bin of 0.1, plus 0.2. b_value is Aki's estimate,
    log10(e) / (mean magnitude - completeness). It is not the b = tau - 1 of areas. Errors and
    p-value are those of the equivalent number of independent magnitudes (`inefficiency`).

    Parameters
    ----------
    magnitudes : ndarray
        (n,) in order of time.
    rng : Generator
        Draws the samples.
    repeats : int
        How many samples are drawn.

    Returns
    -------
    MagnitudeLaw
        Completeness, b_value and b-positive, with their errors.

    Raises
    ------
    FitError
        Fewer than 200 magnitudes, or 50 above completeness.

    References
    ----------
    K. Aki, Bull. Earthq. Res. Inst. 43 (1965) 237. J. Woessner, S. Wiemer, Bull. Seism. Soc. Am. 95
    (2005) 684. N. J. van der Elst, J. Geophys. Res. 126 (2021) e2020JB021027.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> law = magnitude_law(rng.exponential(1 / math.log(10), 2000), rng, repeats=40)
    >>> abs(law.b_value - 1) < 3 * law.b_error
    True
    """
    magnitudes = np.asarray(magnitudes, float)
    magnitudes = magnitudes[np.isfinite(magnitudes)]
    if len(magnitudes) < FEWEST_CASCADES:
        raise TooFew(len(magnitudes), 'magnitude', 'a Gutenberg-Richter law', FEWEST_CASCADES)
    least = completeness(magnitudes)
    above = magnitudes[magnitudes >= least] - least
    effective = len(above) / inefficiency(above) if len(above) else 0.0
    if effective < FEWEST:
        raise FitError(
            f'{len(above)} magnitudes above completeness (M {least:.2f}) count as '
            f'{effective:.0f} independent ones: {FEWEST} needed'
        )
    found, positive = b_value(magnitudes, least), b_positive(magnitudes)
    steps = np.diff(magnitudes)
    steps = steps[steps >= BIN]
    ks = _exponential_distance(above)
    drawn = rng.exponential(size=(repeats, round(effective)))
    worse = sum(_exponential_distance(row) >= ks for row in drawn)
    return MagnitudeLaw(
        least, len(above), found, found / math.sqrt(effective), positive,
        positive * math.sqrt(inefficiency(steps) / max(len(steps), 1)), len(steps),
        ks, (worse + 1) / (repeats + 1),
    )  # fmt: skip


def _exponential_distance(values: np.ndarray) -> float:
    """KS distance of `values` (n,) from the exponential law of their mean (test of Lilliefors)."""
    chance = 1 - np.exp(-np.sort(values) / values.mean())
    steps = np.arange(len(values) + 1) / len(values)
    return float(max((steps[1:] - chance).max(), (chance - steps[:-1]).max()))


@dataclass(frozen=True)
class Waiting:
    """Times between onsets. variation: standard deviation over mean, 1 for events by chance."""

    mean_s: float
    variation: float
    gamma_shape: float
    p_value: float
    count: int

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        if self.p_value >= REJECTED:
            words = 'as by chance (Poisson not rejected'
        elif self.gamma_shape < 1:
            words = 'in clusters (Poisson rejected'
        else:
            words = 'more evenly than by chance (Poisson rejected'
        return (
            f'waiting times: mean {self.mean_s:.3g} s, {words}, p {self.p_value:.2g}): variation '
            f'{self.variation:.2f}, shape {self.gamma_shape:.2f} of a gamma law, n {self.count}'
        )


def waiting(onsets_s: np.ndarray, rng: np.random.Generator, repeats: int = 200) -> Waiting:
    """Return the law of the times between `onsets_s` (n,); the test is that of Lilliefors.

    Raises FitError with fewer than 50.
    """
    gaps = np.diff(np.sort(onsets_s))
    gaps = gaps[gaps > 0]
    if len(gaps) < FEWEST:
        raise TooFew(len(gaps), 'waiting time', 'a law of them', FEWEST)

    found = _exponential_distance(gaps)
    drawn = rng.exponential(size=(repeats, len(gaps)))
    worse = sum(_exponential_distance(row) >= found for row in drawn)
    mean = float(gaps.mean())
    spread = math.log(mean) - float(np.log(gaps).mean())
    shape = (
        float(optimize.brentq(lambda k: math.log(k) - special.digamma(k) - spread, 1e-3, 1e6))
        if spread > 1e-6
        else math.inf
    )
    return Waiting(mean, float(gaps.std() / mean), shape, (worse + 1) / (repeats + 1), len(gaps))


@dataclass(frozen=True)
class Omori:
    """Rate after great cascades, background + K / (t + c)^p, against a constant one.

    better: AIC of the constant rate less that of Omori's. per_main: aftershocks above the
    background for each great cascade.
    """

    p: float
    p_error: float
    c_s: float
    background_hz: float
    per_main: float
    mains: int
    events: int
    least: float
    better: float

    @property
    def sentence(self) -> str:
        """The verdict for people."""
        of = f'n {self.events} after {self.mains} cascades of area {self.least:g} and more'
        if self.better < BETTER:
            return (
                f'aftershocks: no decay of the rate ({of}); a constant rate does as well '
                f'(Omori better by {self.better:.1f} of AIC, {BETTER:g} needed)'
            )
        if self.p > 0.99 * STEEPEST:
            return (
                f'aftershocks: the rate decays, and faster than by Omori ({of}): p is at its bound '
                f'of {STEEPEST:g}'
            )
        return (
            f'aftershocks: the rate decays with p = {self.p:.2f} +- {self.p_error:.2f} '
            f'(Omori, c {self.c_s:.2g} s; {of}), {self.per_main:.1f} each above the background; '
            f'better than a constant rate by {self.better:.0f} of AIC'
        )


def _stacked(
    onsets_s: np.ndarray, sizes: np.ndarray, end_s: float, mains: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return for how long each mainshock is followed (s), the times (s) of what comes after them,
    and the least size of a mainshock.
    """
    order = np.argsort(onsets_s, kind='stable')
    onsets_s, sizes = np.asarray(onsets_s, float)[order], np.asarray(sizes)[order]
    if len(sizes) < FEWEST_CASCADES:
        raise TooFew(len(sizes), 'cascade', 'a law of aftershocks', FEWEST_CASCADES)
    values, counts = np.unique(sizes, return_counts=True)
    few = values[counts[::-1].cumsum()[::-1] <= max(mains, len(sizes) // 10)]
    if not len(few):
        raise FitError('most cascades are of the greatest size: none is a mainshock')
    least = float(few[0])
    great = np.flatnonzero(sizes >= least)
    until = np.r_[onsets_s[great[1:]], end_s]
    length = until - onsets_s[great]
    ends = np.r_[great[1:], len(sizes)]
    times = np.concatenate([
        onsets_s[a + 1 : b] - onsets_s[a] for a, b in zip(great, ends, strict=True)
    ])  # fmt: skip
    length, times = length[length > 0], times[times > 0]
    if len(length) < FEWEST_MAINS:
        raise FitError(too_few(len(length), 'mainshock', 'a law of aftershocks', FEWEST_MAINS))
    if len(times) < FEWEST:
        raise FitError(too_few(len(times), 'aftershock', 'a law of them', FEWEST))
    return length, times, least


def omori(onsets_s: np.ndarray, sizes: np.ndarray, end_s: float, mains: int = 10) -> Omori:
    """Fit Omori's law after the greatest cascades, stacked.

    Each is followed up to the next great one (or `end_s`); a Poisson process of the common rate is
    fitted by its likelihood.

    Parameters
    ----------
    onsets_s : ndarray
        (n,) rising, in s.
    sizes : ndarray
        (n,) of the same cascades.
    end_s : float
        End of the catalogue, in s.
    mains : int
        A tenth of all cascades are mainshocks, or so many at most.

    Returns
    -------
    Omori
        Rate, c in s and p, and whether it is better than a constant rate.

    Raises
    ------
    FitError
        Too few cascades.

    References
    ----------
    Y. Ogata, J. Phys. Earth 31 (1983) 115.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> onsets_s = np.sort(rng.uniform(0, 1000, 400))
    >>> found = omori(onsets_s, rng.pareto(1.5, 400) + 1, 1000.0)
    >>> found.better < BETTER  # of AIC: a constant rate does as well
    True
    """
    length, times, least = _stacked(onsets_s, sizes, end_s, mains)
    total = float(length.sum())
    constant = len(times) * math.log(len(times) / total) - len(times)
    middle = float(np.median(times))

    def loss(values: np.ndarray) -> float:
        background, height, c, p = np.exp(values[0]), values[1], np.exp(values[2]), values[3]
        # `height` is the log of the rate at t = 0, which is known better than K
        fall = np.exp(height - p * np.log1p(times / c))
        expected = background * total + float(_integral(length, np.exp(height), c, p).sum())
        return expected - float(np.log(background + fall).sum())

    rate = math.log(len(times) / total)
    shortest = max(float(times.min()), 1e-6)
    best = min(
        (
            optimize.minimize(
                loss, [rate - 1, rate + up, math.log(c), p], method='L-BFGS-B',
                bounds=[(rate - 12, rate + 2), (rate - 12, rate + 12),
                        (math.log(shortest / 10), math.log(10 * middle)), (0.1, STEEPEST)],
            )
            for up in (0.0, 2.0)
            for c in (middle / 10, middle)
            for p in (0.8, 1.5)
        ),
        key=lambda found: found.fun,
    )  # fmt: skip
    background, height, c, p = best.x
    more = float(_integral(length, math.exp(height), math.exp(c), p).sum())
    return Omori(
        float(p), _curvature_error(loss, best.x, 3), math.exp(c), math.exp(background),
        more / len(length), len(length), len(times), least,
        float(2 * (-constant - best.fun)) - 6.0,
    )  # fmt: skip


def _integral(length: np.ndarray, height: float, c: float, p: float) -> np.ndarray:
    """Integral of height (1 + t / c)^-p from 0 to each length."""
    return height * c * special.boxcox1p(length / c, 1 - p)


def _curvature_error(loss: Callable[[np.ndarray], float], at: np.ndarray, which: int) -> float:
    """Standard error of one value from the curvature of the whole; nan at the edge of a bound."""
    n = len(at)
    step = 1e-3
    hessian = np.zeros((n, n))
    unit = np.eye(n) * step
    for i in range(n):
        for j in range(n):
            hessian[i, j] = (
                loss(at + unit[i] + unit[j]) - loss(at + unit[i] - unit[j])
                - loss(at - unit[i] + unit[j]) + loss(at - unit[i] - unit[j])
            ) / (4 * step**2)  # fmt: skip
    try:
        variance = np.linalg.inv(hessian)[which, which]
    except np.linalg.LinAlgError:
        return math.nan
    return float(math.sqrt(variance)) if variance > 0 else math.nan
