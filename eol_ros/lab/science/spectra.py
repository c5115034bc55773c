# SPDX-License-Identifier: Apache-2.0
"""The power spectrum of a series in logarithmic bins, its slope, and which shape it has.

S(f) ~ f^-beta; beta 0 is white, 1 is 1/f, 2 is Brownian. A straight line through a bent spectrum
has a slope too, so a slope alone says nothing: `shapes` fits what bends as well, by the likelihood
of Whittle (Ark. Mat. 2 (1953) 423), and `rhythm` looks for lines.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import signal, stats

from eol_ros.errors import EolError

Curve = Callable[[np.ndarray, np.ndarray], np.ndarray]  # values and log(f) to log(S)

BINS_PER_DECADE = 8
PERIODS = 8  # of the lowest frequency in the whole series: below, the taper's own shape is seen
# The mean of m ordinates under a Hann taper scatters as that of m / 1.944 independent ones: their
# neighbours' squared correlations are 4/9 and 1/36.
HANN_OVERLAP = 35 / 18
# No bin counts for more than 50 independent ordinates. It would let departures of a few per cent in
# the highest bins, which hold most ordinates, decide everything; so 14 % of power is tolerated.
MOST_WEIGHT = 50.0
LINE_CHANCE = 1e-4  # of noise without a line having one as high, over all frequencies
STEEPEST = 5.0
STEP = 1e-5  # of the values of a shape, for its derivatives


class SeriesError(EolError):
    """A series too short or too empty to have a spectrum."""


@dataclass(frozen=True)
class Spectrum:
    """Power in logarithmic bins, (k,); `weight` is how many independent ordinates each counts for.

    `ordinates_hz`, `ordinates` (n,): the periodogram within the band, before it was binned.
    """

    frequency_hz: np.ndarray
    power: np.ndarray
    weight: np.ndarray
    low_hz: float
    high_hz: float
    ordinates_hz: np.ndarray
    ordinates: np.ndarray

    @property
    def decades(self) -> float:
        """How wide the band is."""
        return float(np.log10(self.high_hz / self.low_hz))


@dataclass(frozen=True)
class Slope:
    """S(f) ~ f^-beta; low and high bound the 95 % interval of beta."""

    beta: float
    low: float
    high: float
    deviance: float
    bins: int

    @property
    def p_value(self) -> float:
        """How often a power law scatters as widely about its own line."""
        return float(stats.chi2.sf(self.deviance, self.bins - 2))


@dataclass(frozen=True)
class Shape:
    """One shape at its greatest likelihood: its AIC (to within a constant), and its curve (k,)."""

    name: str
    aic: float
    curve: np.ndarray


def spectrum(
    series: np.ndarray,
    rate_hz: float,
    low_hz: float,
    high_hz: float,
    window_s: float = 0.0,
) -> Spectrum:
    """Estimate a power spectrum in logarithmic bins, under one Hann taper over the whole.

    Parameters
    ----------
    series : ndarray
        (n,) of even distance.
    rate_hz : float
        Samples a second.
    low_hz, high_hz : float
        The range.
    window_s : float
        Each value is a mean over so long; its response is divided out.

    Returns
    -------
    Spectrum
        Frequencies, powers and weights of the bins.

    Raises
    ------
    SeriesError
        No such band, shorter than eight periods of `low_hz`, or without variation.

    Examples
    --------
    >>> noise = coloured_noise(1.0, 20000, np.random.default_rng(1))
    >>> round(spectrum(noise, 100.0, 0.1, 10.0).decades, 2)
    2.0
    """
    series = np.asarray(series, float)
    if high_hz > 0.45 * rate_hz or high_hz <= low_hz:
        raise SeriesError(f'{low_hz:g} to {high_hz:g} Hz is no band of a series of {rate_hz:g}/s')
    duration_s = len(series) / rate_hz
    if low_hz * duration_s < PERIODS * (1 - 1e-9):
        raise SeriesError(
            f'{duration_s:.0f} s are too short for {low_hz:g} Hz: {PERIODS / low_hz:.0f} s are the '
            'least'
        )
    if not np.isfinite(series).all() or np.ptp(series) == 0:
        raise SeriesError('the series does not vary: it has no spectrum')
    taper = signal.get_window('hann', len(series))
    power = np.abs(np.fft.rfft((series - series.mean()) * taper)) ** 2
    power *= 2 / (rate_hz * (taper**2).sum())
    frequency = np.fft.rfftfreq(len(series), 1 / rate_hz)
    inside = (frequency >= low_hz * (1 - 1e-9)) & (frequency <= high_hz)
    frequency, power = frequency[inside], power[inside]
    if window_s:
        power = power / np.sinc(frequency * window_s) ** 2
    power = np.maximum(power, 1e-15 * power.max())
    bins = max(round(BINS_PER_DECADE * np.log10(high_hz / low_hz)), 3)
    which = np.digitize(frequency, np.geomspace(low_hz, high_hz, bins + 1)[1:-1])
    counts = np.bincount(which, minlength=bins)
    used = counts > 0
    centre = np.exp(np.bincount(which, np.log(frequency), bins)[used] / counts[used])
    mean = np.bincount(which, power, bins)[used] / counts[used]
    weight = np.clip(counts[used] / HANN_OVERLAP, 1.0, MOST_WEIGHT)
    return Spectrum(centre, mean, weight, low_hz, high_hz, frequency, power)


def slope(found: Spectrum, part: slice = slice(None)) -> Slope:
    """Fit S(f) ~ f^-beta through the bins, by the likelihood of Whittle.

    The interval is wider than the likelihood's where the bins scatter more about the line than it
    allows for.

    Parameters
    ----------
    found : Spectrum
        From `spectrum`.
    part : slice
        Of the bins.

    Returns
    -------
    Slope
        beta with its interval of 95 %.

    References
    ----------
    P. Whittle, Ark. Mat. 2 (1953) 423.

    Examples
    --------
    >>> noise = coloured_noise(1.0, 20000, np.random.default_rng(1))
    >>> line = slope(spectrum(noise, 100.0, 0.1, 10.0))
    >>> line.low < 1.0 < line.high
    True
    """
    x = np.log(found.frequency_hz[part])
    log_power, weight = np.log(found.power[part]), found.weight[part]
    beta = 0.0
    x = x - weight @ x / weight.sum()
    level = log_power @ weight / weight.sum()
    for _ in range(100):  # Newton: the likelihood is concave in level and slope
        ratio = np.exp(np.clip(log_power - level + beta * x, -50, 50))
        gradient = np.array([weight @ (ratio - 1), -(weight * x) @ (ratio - 1)])
        pull = weight * ratio
        curvature = np.array([[pull.sum(), -pull @ x], [-pull @ x, pull @ x**2]])
        step = np.linalg.solve(curvature, gradient)
        step *= min(1.0, 2.0 / np.abs(step).max(initial=1e-300))
        level, beta = level + step[0], beta + step[1]
        if np.abs(step).max() < 1e-10:
            break
    deviance = _deviance(log_power, level - beta * x, weight)
    freedom = max(len(x) - 2, 1)
    error = np.sqrt(max(1.0, deviance / freedom) / (weight @ x**2))
    half = float(stats.t.ppf(0.975, freedom) * error)
    return Slope(float(beta), float(beta - half), float(beta + half), float(deviance), len(x))


def halves(found: Spectrum) -> tuple[Slope, Slope]:
    """Return the slopes of the lower and of the upper half of the band."""
    middle = int(np.searchsorted(found.frequency_hz, np.sqrt(found.low_hz * found.high_hz)))
    return slope(found, slice(None, middle)), slope(found, slice(middle, None))


def shapes(found: Spectrum) -> dict[str, Shape]:
    """Return every shape at its greatest likelihood, by name.

    white; power law; Lorentzian (an Ornstein-Uhlenbeck process, random telegraph, pulses that decay
    exponentially); knee: flat, then falling at any rate; and the sums of a Lorentzian or a power
    law with a white floor, of a power law with a Lorentzian, and of two or three Lorentzians
    (relaxations at as many times, as of visits, gestures and slips).
    """
    x = np.log(found.frequency_hz)
    middle = (x[0] + x[-1]) / 2
    half = (x[-1] - x[0]) / 2
    x = x - middle
    log_power = np.log(found.power)
    level = float(log_power @ found.weight / found.weight.sum())
    corners = [-0.6 * half, 0.0, 0.6 * half]
    scale, corner, beta = (-np.inf, np.inf), (-half, half), (-1.0, STEEPEST)
    fits: dict[str, tuple[Curve, list[tuple[float, ...]], list[tuple[float, float]]]] = {
        'white': (_power_law, [(level, 0.0)], [scale, (0.0, 0.0)]),
        'power law': (_power_law, [(level, 1.0)], [scale, beta]),
        'Lorentzian': (_lorentzian, [(level, c) for c in corners], [scale, corner]),
        'knee': (
            _knee, [(level, c, b) for c in corners for b in (1.0, 2.5)],
            [scale, corner, (0.0, STEEPEST)],
        ),
        'Lorentzian and floor': (
            _lorentzian_floor, [(level + 1, c, level - 2) for c in corners], [scale, corner, scale],
        ),
        'power law and floor': (
            _power_law_floor, [(level, 1.0, level - 2), (level - 2, 1.5, level)],
            [scale, (0.0, STEEPEST), scale],
        ),
        'power law and Lorentzian': (
            _power_law_lorentzian,
            [(level - 0.7, b, level - 0.7, c) for c in corners for b in (0.5, 1.5)],
            [scale, (0.0, STEEPEST), scale, corner],
        ),
        'two Lorentzians': (
            _lorentzians,
            [(level + 1, a * half, level - 1, b * half)
             for a, b in ((-0.9, 0.0), (-0.6, 0.3), (-0.3, 0.6), (-0.8, 0.8))],
            [scale, (-2 * half, half), scale, (-half, 2 * half)],
        ),
        'three Lorentzians': (
            _lorentzians,
            [(level + 1, a * half, level, b * half, level - 1, c * half)
             for a, b, c in ((-0.9, -0.2, 0.6), (-0.7, 0.0, 0.7), (-0.5, 0.2, 0.9), (-1, 0, 1))],
            [scale, (-2 * half, half), scale, corner, scale, (-half, 2 * half)],
        ),
    }  # fmt: skip
    made = {}
    for name, (curve, starts, bounds) in fits.items():
        best, deviance = min(
            (_climb(curve, start, bounds, x, log_power, found.weight) for start in starts),
            key=lambda reached: reached[1],
        )
        free = sum(low < high for low, high in bounds)
        made[name] = Shape(name, deviance + 2 * free, np.exp(curve(best, x)))
    return made


def rhythm(found: Spectrum, beta: float) -> tuple[float, float] | None:
    """Return frequency and height (over the power about it) of the greatest line; None without one.

    Ordinates of noise over its spectrum are exponential, so their greatest tells (Fisher, Proc. R.
    Soc. A 125 (1929) 54). What is about a line is the median of half a decade, made flat by
    `beta`. Where that has under 30 ordinates, no line is looked for.
    """
    flat = found.ordinates * found.ordinates_hz**beta
    place = np.log10(found.ordinates_hz / found.low_hz) * 6
    which = np.floor(place).astype(int)
    best: tuple[float, float] | None = None
    for k in range(which[-1] + 1):
        near = flat[np.abs(which - k) <= 1]
        own = which == k
        if len(near) < 30 or not own.any():
            continue
        ratio = flat[own] * np.log(2) / np.median(near)
        top = int(np.argmax(ratio))
        if best is None or ratio[top] > best[1]:
            best = (float(found.ordinates_hz[own][top]), float(ratio[top]))
    if best is None or len(flat) * np.exp(-best[1]) > LINE_CHANCE:
        return None
    return best


def coloured_noise(beta: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return (count,) of Gaussian noise whose spectrum is f^-beta, to test the estimator by."""
    frequency = np.fft.rfftfreq(2 * count)  # of twice the length: half of it does not meet itself
    frequency[0] = frequency[1]
    phase = rng.normal(size=len(frequency)) + 1j * rng.normal(size=len(frequency))
    return np.fft.irfft(phase * frequency ** (-beta / 2), 2 * count)[:count]


def _deviance(log_power: np.ndarray, log_curve: np.ndarray, weight: np.ndarray) -> float:
    """-2 log likelihood of gamma-distributed bins, less that of a curve through them all."""
    off = np.clip(log_power - log_curve, -60, 60)
    return float(2 * weight @ (np.exp(off) - 1 - off))


def _climb(
    curve: Curve,
    start: tuple[float, ...],
    bounds: list[tuple[float, float]],
    x: np.ndarray,
    log_power: np.ndarray,
    weight: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Return values of least deviance, and that: Fisher scoring, damped (Levenberg, Marquardt)."""
    low, high = np.array(bounds, float).T
    free = np.flatnonzero(low < high)
    values = np.clip(np.array(start, float), low, high)
    reached = _deviance(log_power, curve(values, x), weight)
    damping = 1e-2
    for _ in range(60):
        log_curve = curve(values, x)
        slopes = np.stack([curve(values + step, x) - log_curve for step in STEP * np.eye(len(low))])
        slopes = slopes[free] / STEP
        off = np.exp(np.clip(log_power - log_curve, -50, 20)) - 1
        normal = (slopes * weight) @ slopes.T
        pull = slopes @ (weight * off)
        while damping < 1e8:
            damped = normal + np.diag(damping * (np.diag(normal) + 1e-9))
            tried = values.copy()
            tried[free] += np.clip(np.linalg.solve(damped, pull), -2, 2)
            tried = np.clip(tried, low, high)
            gained = reached - _deviance(log_power, curve(tried, x), weight)
            if gained >= 0:
                break
            damping *= 10
        else:
            break
        values, reached, damping = tried, reached - gained, max(damping / 10, 1e-6)
        if gained < 1e-7:
            break
    return values, reached


def _power_law(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return values[0] - values[1] * x


def _lorentzian(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return values[0] - np.logaddexp(0, 2 * (x - values[1]))


def _knee(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return values[0] - np.logaddexp(0, values[2] * (x - values[1]))


def _lorentzian_floor(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.logaddexp(_lorentzian(values[:2], x), values[2])


def _power_law_floor(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.logaddexp(_power_law(values[:2], x), values[2])


def _power_law_lorentzian(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.logaddexp(_power_law(values[:2], x), _lorentzian(values[2:], x))


def _lorentzians(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.logaddexp.reduce([_lorentzian(one, x) for one in values.reshape(-1, 2)])
