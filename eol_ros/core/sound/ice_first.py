# SPDX-License-Identifier: Apache-2.0
"""The first recipe of the ice recording: bags name its grains, and are still to sound as they did.

Rumble of the floe, and events that come as a Poisson process with sizes of a power law: stick-slip
groans (an impulse train of gliding pitch through plate modes), cracks, debris, booms and moans.
`ice.py` has the recipe of today, and what both share.
"""

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from eol_ros.core.sound.ice import _band, _boom, _debris, _mastered, _peak, _ring, _slow, _unit

EVENTS_PER_S = 1.25


def ice(seconds: float = 40.0, rate: int = 48000, seed: int = 1) -> np.ndarray:
    """Return (n,) float32 of peak below 0.8; the same arguments give the same sound."""
    random = np.random.default_rng(seed)
    n = round(seconds * rate)
    sound = _rumble(random, n, rate)
    count = random.poisson(EVENTS_PER_S * seconds)
    for start in np.sort(random.integers(0, n, count)):
        size = min(random.pareto(1.5) + 1, 20.0)
        make = (_groan, _crack, _debris, _boom, _moan)[random.choice(len(KINDS), p=KINDS)]
        event = make(random, rate, size)[: n - start]
        sound[start : start + len(event)] += event
    return _mastered(sound, rate)


KINDS = (0.27, 0.39, 0.14, 0.08, 0.12)  # groan, crack, debris, boom, moan


def _rumble(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    noise = lfilter([1.0], [1.0, -0.9995], random.standard_normal(n))
    noise = _unit(sosfilt(_band(18, 110, rate), noise))
    swell = _slow(random, n, rate, 0.4)
    wind = _unit(sosfilt(_band(60, 900, rate), random.standard_normal(n)))
    return (0.016 * noise + 0.006 * wind) * np.exp(0.7 * swell)


def _groan(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(0.4, 2.2) * rate)
    train = _train(random, n, rate, random.uniform(45, 260), random.uniform(0.5, 1.9), 0.01, 0.25)
    modes = random.uniform(150, 1400) * np.arange(1, 11) ** 1.3
    sound = _ring(random, train, rate, modes, 0.06 / np.arange(1, 11) ** 0.6)
    return 0.03 * size**0.5 * _unit(sound * np.sqrt(np.hanning(n)))


def _moan(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(0.8, 2.5) * rate)
    train = _train(random, n, rate, random.uniform(55, 190), random.uniform(0.7, 1.4), 0.002, 0.05)
    modes = random.uniform(90, 320) * np.arange(1, 5) ** 1.1
    sound = _ring(random, train, rate, modes, 0.05 / np.arange(1, 5))
    sound = sosfilt(butter(2, 700 / (rate / 2), output='sos'), sound)
    return 0.045 * size**0.3 * _unit(sound * np.sqrt(np.hanning(n)))


def _crack(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    spread = 0.06 * size**0.5
    count = random.poisson(25 * size) + 3
    delays = np.minimum(random.exponential(spread, count), 8 * spread)
    levels = (random.pareto(1.6, count) + 1) * random.choice([-1.0, 1.0], count)
    longest = random.uniform(0.15, 0.9)
    n = round((delays.max() + longest) * rate)
    impacts = np.zeros(n)
    np.add.at(impacts, (delays * rate).astype(int), levels)
    grit = np.arange(round(0.012 * rate))
    burst = random.standard_normal(len(grit)) * np.exp(-grit / (0.0025 * rate))
    low = np.exp(random.uniform(np.log(500), np.log(9000 / 1.6)))
    burst = sosfilt(_band(low, 1.6 * low, rate), burst)
    size_fft = 1 << (n + len(burst) - 1).bit_length()
    hits = np.fft.irfft(np.fft.rfft(impacts, size_fft) * np.fft.rfft(burst, size_fft), size_fft)[:n]
    modes = random.uniform(180, 3500) * np.arange(1, 9) ** 1.7
    plate = _ring(random, impacts, rate, modes, longest / np.arange(1, 9) ** 0.5)
    return 0.22 * size**0.4 * _peak(_peak(hits) + 0.6 * _peak(plate))


def _train(
    random: np.random.Generator,
    n: int,
    rate: int,
    hz: float,
    glide: float,
    wander: float,
    uneven: float,
) -> np.ndarray:
    """Impulses whose pitch glides from `hz` by the factor `glide`, with a random walk."""
    out = np.zeros(n)
    at, walk = 0.0, 0.0
    while at < n:
        out[int(at)] = 1 + random.uniform(-uneven, uneven)
        walk += wander * random.standard_normal()
        at += rate / (hz * glide ** (at / n) * np.exp(np.clip(walk, -0.3, 0.3)))
    return out
