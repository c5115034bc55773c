# SPDX-License-Identifier: Apache-2.0
"""Series that keep some of what was found and lose the rest: what chance alone would give.

Of events: as many at random times; the same intervals in another order; a renewal process with
gamma-distributed intervals of the same mean and spread. Of a series that rests in between, the same
three of its bouts, each of which keeps its course. Of any series: the amplitudes and the spectrum
kept, the rest random (IAAFT, Schreiber and Schmitz, Phys. Rev. Lett. 77 (1996) 635).
"""

import itertools
from collections.abc import Callable

import numpy as np

from eol_ros.lab.science.spectra import coloured_noise

CONTROLS = ('random times', 'shuffled intervals', 'gamma renewal')
SEGMENTS = 16
LONGEST = 2048  # values of a series whose stationarity is asked


def event_counts(times_s: np.ndarray, duration_s: float, rate_hz: float) -> np.ndarray:
    """Return how many of `times_s` (n,) fall into each 1 / `rate_hz` of `duration_s`, (m,)."""
    bins = round(duration_s * rate_hz)
    times_s = np.asarray(times_s)
    inside = times_s[(times_s >= 0) & (times_s <= duration_s)]
    which = np.minimum((inside * (bins / duration_s)).astype(np.int64), bins - 1)
    return np.bincount(which, minlength=bins).astype(float)


def poisson_times(count: int, duration_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return the times (count,) of as many events, each at any time, in s and in order."""
    return np.sort(rng.random(count) * duration_s)


def shuffled_times(times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return times (n,) in s with the intervals of `times_s` (n,) in another order."""
    gaps = np.diff(np.asarray(times_s, float), prepend=0.0)
    return rng.permutation(gaps).cumsum()


def gamma_times(times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return times (n,) in s of a renewal process as long as `times_s` (n,).

    Its intervals follow a gamma law of the same relative spread.
    """
    gaps = np.diff(np.asarray(times_s, float), prepend=0.0)
    drawn = _gamma(gaps, rng)
    return drawn.cumsum() * (times_s[-1] / drawn.sum())


def of_events(
    kind: str, times_s: np.ndarray, duration_s: float, rng: np.random.Generator
) -> np.ndarray:
    """Return the times (n,) in s of one control of `kind` (see CONTROLS) of `times_s` (n,)."""
    if kind == 'random times':
        return poisson_times(len(times_s), duration_s, rng)
    if kind == 'shuffled intervals':
        return shuffled_times(times_s, rng)
    return gamma_times(times_s, rng)


def bouts(series: np.ndarray, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return begin and end, (b,) each, of the pieces in which `series` is above `rest`."""
    active = np.concatenate([[False], np.asarray(series) > rest, [False]])
    edges = np.flatnonzero(active[1:] != active[:-1])
    return edges[::2], edges[1::2]


def of_bouts(kind: str, series: np.ndarray, rest: float, rng: np.random.Generator) -> np.ndarray:
    """Return one control of `kind` of a series that rests: its bouts at other times, (n,).

    Bouts keep their course, and at random times they may add up.
    """
    series = np.asarray(series, float)
    begin, end = bouts(series, rest)
    floor = float(series[series <= rest].mean()) if (series <= rest).any() else rest
    made = np.zeros(len(series))
    length = end - begin
    order = rng.permutation(len(begin))
    if kind == 'random times':
        starts = rng.integers(0, len(series), len(begin))
    else:
        gaps = np.diff(np.concatenate([[0], np.stack([begin, end], 1).ravel(), [len(series)]]))[::2]
        rested = float(gaps.sum())
        if kind == 'shuffled intervals':
            gaps = rng.permutation(gaps)
        else:
            gaps = _gamma(gaps, rng)
            gaps = gaps * rested / gaps.sum()
        ahead = np.concatenate([[0], length[order][:-1].cumsum()])
        starts = np.round(gaps[:-1].cumsum()).astype(int) + ahead
    for k, start in zip(order, starts, strict=True):
        piece = series[begin[k] : end[k]] - floor
        piece = piece[: len(series) - start]
        made[start : start + len(piece)] += piece
    return made + floor


def iaaft(series: np.ndarray, rng: np.random.Generator, rounds: int = 8) -> np.ndarray:
    """Return a series of the same values with (nearly) the same spectrum, else random, (n,)."""
    values = np.sort(np.asarray(series, float))
    wanted = np.abs(np.fft.rfft(series))
    made = rng.permutation(values)
    rank = np.argsort(made)
    for _ in range(rounds):
        spectrum = np.fft.rfft(made)
        spectrum *= wanted / np.maximum(np.abs(spectrum), 1e-300)
        before, rank = rank, np.argsort(np.fft.irfft(spectrum, len(values)), kind='stable')
        made = np.empty_like(values)
        made[rank] = values
        if np.array_equal(rank, before):
            break
    return made


def unevenness(series: np.ndarray) -> float:
    """Return how much the spectra of sixteen pieces differ: variance of the log power in 3 bands.

    A stationary series has as much of it as its IAAFT surrogates (Borgnat and others, IEEE Trans.
    Signal Process. 58 (2010) 3459).
    """
    length = len(series) // SEGMENTS
    pieces = np.reshape(series[: length * SEGMENTS], (SEGMENTS, length))
    pieces = pieces - pieces.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(pieces * np.hanning(length), axis=1)) ** 2
    edges = np.unique(np.geomspace(2, power.shape[1], 4).astype(int))
    least = 1e-9 * power.mean() + 1e-300
    bands = [power[:, a:b].mean(axis=1) + least for a, b in itertools.pairwise(edges)]
    return float(sum(np.log(band).var() for band in bands))


def stationarity(series: np.ndarray, rng: np.random.Generator, repeats: int = 39) -> float:
    """Return how often a stationary series of the spectrum and values of `series` is as uneven.

    Long `series` (n,) are taken as means over some of their values.
    """
    series = _shortened(series)
    found = unevenness(series)
    as_uneven = sum(unevenness(iaaft(series, rng)) >= found for _ in range(repeats))
    return (as_uneven + 1) / (repeats + 1)


def trend(series: np.ndarray, beta: float, rng: np.random.Generator, repeats: int = 399) -> float:
    """Return how often noise f^-beta has a straight course (R^2) as `series` (n,) has.

    IAAFT surrogates cannot tell: they keep the power of the trend.
    """
    series = _shortened(series)
    line = np.linspace(-1, 1, len(series))
    found = abs(np.corrcoef(line, series)[0, 1])
    drawn = (coloured_noise(beta, len(series), rng) for _ in range(repeats))
    return (sum(abs(np.corrcoef(line, d)[0, 1]) >= found for d in drawn) + 1) / (repeats + 1)


def _shortened(series: np.ndarray) -> np.ndarray:
    """Means over some values of a long series, LONGEST at most."""
    series = np.asarray(series, float)
    step = -(-len(series) // LONGEST)
    return series[: len(series) // step * step].reshape(-1, step).mean(axis=1)


def slopes(
    make: Callable[[str], np.ndarray], of: Callable[[np.ndarray], float], repeats: int = 19
) -> dict[str, tuple[float, float]]:
    """Return least and greatest slope over `repeats` of each control, by its kind.

    make: returns a fresh series (n,) of one of CONTROLS. of: returns the slope of a series.
    """
    found = {}
    for kind in CONTROLS:
        betas = [of(make(kind)) for _ in range(repeats)]
        found[kind] = (min(betas), max(betas))
    return found


def _gamma(gaps: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    mean, spread = float(np.mean(gaps)), float(np.var(gaps))
    if mean <= 0 or spread <= 0:
        return np.full(len(gaps), mean)
    return rng.gamma(mean**2 / spread, spread / mean, len(gaps))
