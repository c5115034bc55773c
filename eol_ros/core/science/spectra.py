# SPDX-License-Identifier: Apache-2.0
"""Is it 1/f? The slope of a power spectrum with its interval, and what chance alone would give.

The spectrum said to be 1/f in music and speech is that of the audio *power*, the squared sound
after a low-pass at 20 Hz, below some 10 Hz (Voss and Clarke, Nature 258 (1975) 317), not that of
the waveform. So three series may be asked: audio power, counts of grain triggers, kinetic energy of
the blocks. Each is told with an interval and beside two controls: a Poisson process of the same
rate, and the same intervals in shuffled order. S(f) ~ f^-beta; beta 0 is white, 1 is 1/f, 2 is
brown.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from eol_ros.errors import EolError

BINS = 12
PERIODS = 4  # of the lowest frequency in a segment
MANY_SEGMENTS = 60
WIDER = 1.5  # the bootstrap interval of few segments covers 80 to 88 %, not 95 (see test)
ONE_OVER_F = (0.5, 1.5)


class SeriesError(EolError):
    """A series too short or too empty to have a spectrum."""


@dataclass(frozen=True)
class Slope:
    """S(f) ~ f^-beta between two frequencies; low and high bound the 95 % interval of beta."""

    beta: float
    low: float
    high: float
    r_squared: float
    segments: int
    frequency_hz: np.ndarray
    power: np.ndarray


def slope(
    series: np.ndarray,
    rate_hz: float,
    rng: np.random.Generator,
    low_hz: float = 0.02,
    high_hz: float = 10.0,
    repeats: int = 200,
) -> Slope:
    """Return the spectral slope of `series`, (n,) at `rate_hz`, between `low_hz` and `high_hz`.

    Hann segments of four periods of `low_hz`, half overlapping, 12 logarithmic bins, least squares
    in log-log; the interval is from a bootstrap over segments. Raises SeriesError where it is too
    short.
    """
    series = np.asarray(series, float)
    high_hz = min(high_hz, 0.45 * rate_hz)
    length = round(PERIODS / low_hz * rate_hz)
    if len(series) < 2 * length:
        raise SeriesError(
            f'{len(series) / rate_hz:.0f} s are too short for {low_hz:g} Hz: '
            f'{2 * length / rate_hz:.0f} s are the least, ten minutes are better'
        )
    if not np.isfinite(series).all() or series.std() == 0:
        raise SeriesError('the series does not vary: it has no spectrum')
    window = signal.get_window('hann', length)
    starts = range(0, len(series) - length + 1, length // 2)
    pieces = np.stack([series[s : s + length] for s in starts]) - series.mean()
    powers = np.abs(np.fft.rfft(pieces * window, axis=1)) ** 2
    powers /= rate_hz * (window**2).sum() / 2
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    edges = np.geomspace(low_hz, high_hz, BINS + 1)
    which = np.digitize(frequency, edges) - 1
    used = [k for k in range(BINS) if (which == k).any()]
    centres = np.array([np.exp(np.log(frequency[which == k]).mean()) for k in used])
    binned = np.stack([powers[:, which == k].mean(axis=1) for k in used], axis=1)
    beta, r_squared = _line(centres, binned.mean(axis=0))
    drawn = [
        _line(centres, binned[rng.integers(0, len(binned), len(binned))].mean(axis=0))[0]
        for _ in range(repeats)
    ]
    low, high = np.quantile(drawn, [0.025, 0.975]) - beta
    wider = 1.0 if len(binned) >= MANY_SEGMENTS else WIDER
    return Slope(
        beta,
        beta + wider * float(low),
        beta + wider * float(high),
        r_squared,
        len(binned),
        centres,
        binned.mean(axis=0),
    )


def _line(frequency: np.ndarray, power: np.ndarray) -> tuple[float, float]:
    x, y = np.log(frequency), np.log(power)
    gradient, offset = np.polyfit(x, y, 1)
    rest = y - gradient * x - offset
    return float(-gradient), float(1 - rest.var() / y.var())


def audio_power(sound: np.ndarray, rate_hz: float, out_hz: float = 100.0) -> np.ndarray:
    """Return the power of `sound` at `out_hz`: 100 Hz to 10 kHz, squared, low-pass at 20 Hz."""
    top = min(10_000.0, 0.45 * rate_hz)
    band = signal.butter(4, [100.0, top], 'bandpass', fs=rate_hz, output='sos')
    smooth = signal.butter(4, 20.0, 'lowpass', fs=rate_hz, output='sos')
    power = signal.sosfiltfilt(smooth, signal.sosfilt(band, np.asarray(sound, float)) ** 2)
    at = np.arange(0, len(power), rate_hz / out_hz)
    return power[at.astype(int)]


def event_counts(times_s: np.ndarray, duration_s: float, rate_hz: float = 50.0) -> np.ndarray:
    """Return how many of `times_s` fall into each 1 / `rate_hz` of `duration_s`."""
    bins = round(duration_s * rate_hz)
    return np.histogram(times_s, bins=bins, range=(0.0, duration_s))[0].astype(float)


def poisson_times(count: int, duration_s: float, rng: np.random.Generator) -> np.ndarray:
    """Return the first control: as many events, each at any time."""
    return np.sort(rng.random(count) * duration_s)


def shuffled_times(times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the second control: the same intervals in another order."""
    gaps = np.diff(np.asarray(times_s, float), prepend=0.0)
    return rng.permutation(gaps).cumsum()


def coloured_noise(beta: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return (count,) of noise whose spectrum is f^-beta, to test the estimator by."""
    frequency = np.fft.rfftfreq(count)
    frequency[0] = frequency[1]
    phase = rng.normal(size=len(frequency)) + 1j * rng.normal(size=len(frequency))
    return np.fft.irfft(phase * frequency ** (-beta / 2), count)


def is_one_over_f(found: Slope, controls: list[Slope]) -> bool:
    """Return whether the interval lies within 0.5 .. 1.5 and those of both controls do not."""
    low, high = ONE_OVER_F
    inside = low <= found.low and found.high <= high
    return inside and all(c.high < low or c.low > high for c in controls)
