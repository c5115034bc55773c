# SPDX-License-Identifier: Apache-2.0
"""A recording of breaking ice that nobody recorded: procedural, seeded, free of rights.

Rumble of the floe, and events that come as a Poisson process with sizes of a power law: stick-slip
groans (an impulse train of gliding pitch through plate modes), cracks (showers of micro-impacts
that ring the plate), debris, calving booms, and low moans for the corner of the space that is
dark and periodic. Sizes follow a Pareto law because the work's own cascades do.
"""

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

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
    lean = butter(2, 20 / (rate / 2), 'high', output='sos')  # impulse trains are all of one sign
    sound = sosfilt(lean, sound)
    sound = 0.8 * np.tanh(1.2 * sound / np.percentile(np.abs(sound), 99.9))
    for edge, length in ((slice(None), 0.01), (slice(None, None, -1), 0.1)):
        m = min(round(length * rate), n)
        sound[edge][:m] *= 0.5 - 0.5 * np.cos(np.pi * np.arange(m) / m)
    return sound.astype(np.float32)


KINDS = (0.27, 0.39, 0.14, 0.08, 0.12)  # groan, crack, debris, boom, moan


def _rumble(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    noise = lfilter([1.0], [1.0, -0.9995], random.standard_normal(n))
    noise = _unit(sosfilt(_band(18, 110, rate), noise))
    points = max(4, int(0.4 * n / rate) + 2)  # a slow swell of about 0.2 Hz
    swell = np.interp(
        np.linspace(0, points - 1, n), np.arange(points), random.standard_normal(points)
    )
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


def _debris(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(0.5, 2.5) * rate)
    count = random.poisson(random.uniform(400, 2500) * n / rate)
    rain = np.zeros(n)
    np.add.at(
        rain, random.integers(0, n, count), random.pareto(2, count) * random.choice([-1, 1], count)
    )
    band = _band(random.uniform(1200, 4000), min(random.uniform(7000, 15000), 0.45 * rate), rate)
    return 0.02 * size**0.5 * _unit(sosfilt(band, rain) * np.hanning(n))


def _boom(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(2.4 * rate)
    strike = np.zeros(n)
    m = round(0.03 * rate)
    strike[:m] = random.standard_normal(m) * np.hanning(m)
    modes = random.uniform(35, 80) * np.arange(1, 6) ** 1.15
    return 0.35 * size**0.3 * _peak(_ring(random, strike, rate, modes, np.full(5, 1.6)))


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


def _ring(
    random: np.random.Generator,
    sound: np.ndarray,
    rate: int,
    modes_hz: np.ndarray,
    t60_s: np.ndarray,
) -> np.ndarray:
    """Drive a bank of damped resonators, each of unit peak gain at the start of its ringing."""
    out = np.zeros(len(sound))
    for k, (hz, t60) in enumerate(
        zip(modes_hz * random.normal(1, 0.01, len(modes_hz)), t60_s, strict=True)
    ):
        if 15 < hz < 0.45 * rate:
            radius = 10 ** (-3 / (t60 * rate))
            angle = 2 * np.pi * hz / rate
            out += lfilter([np.sin(angle)], [1, -2 * radius * np.cos(angle), radius**2], sound) / (
                k + 1
            )
    return out


def _band(low_hz: float, high_hz: float, rate: int) -> np.ndarray:
    high = min(high_hz, 0.45 * rate)
    return butter(
        2, [min(low_hz, 0.5 * high) / (rate / 2), high / (rate / 2)], 'band', output='sos'
    )


def _unit(sound: np.ndarray) -> np.ndarray:
    return sound / max(float(np.std(sound)), 1e-12)


def _peak(sound: np.ndarray) -> np.ndarray:
    return sound / max(float(np.abs(sound).max()), 1e-12)
