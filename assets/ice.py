# SPDX-License-Identifier: Apache-2.0
"""A recording of breaking ice that nobody recorded: procedural, seeded, free of rights.

Rumble of the floe, and events that come as a Poisson process with sizes of a power law: stick-slip
groans, cracks (showers of micro-impacts that ring the plate), debris, booms, and moans (a mode of
the floe that the wind of its own motion bows). Sizes follow a Pareto law because the work's own
cascades do. Between them, evenly through the recording, long ones with a beginning, a middle and an
end: cracks that run for seconds, and a calving.

Nothing here is a train of equal intervals, for its harmonics would stand in the spectrum as a comb:
ice sticks and slips irregularly. Intervals are gamma-distributed, modes inharmonic as those of a
plate, and what has a pitch is one mode at a time that glides.
"""

import argparse
import io
import sys

import numpy as np
import soundfile
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import lfilter, sosfilt

from assets.butterworth import band_pass, high_pass, low_pass
from eol_ros.core import elementary

EVENTS_PER_S = 1.1
CALVING_EVERY_S = 40.0
CRACK_EVERY_S = 15.0


def ice(seconds: float = 120.0, rate: int = 48000, seed: int = 1) -> np.ndarray:
    """Return (n,) float32 of peak below 0.8; the same arguments give the same sound."""
    random = np.random.default_rng(seed)
    n = round(seconds * rate)
    sound = _rumble(random, n, rate)
    makers = [
        (start, (_groan, _crack, _debris, _boom, _moan)[random.choice(len(KINDS), p=KINDS)])
        for start in np.sort(random.integers(0, n, random.poisson(EVENTS_PER_S * seconds)))
    ]
    for make, every_s in ((_calving, CALVING_EVERY_S), (_long_crack, CRACK_EVERY_S)):
        count = int(seconds / every_s)
        places = (np.arange(count) + random.uniform(0.15, 0.45, count)) * every_s * rate
        makers += [(int(start), make) for start in places]
    for start, make in makers:
        size = min(random.pareto(1.5) + 1, 20.0)
        _place(sound, make(random, rate, size), start)
    return _mastered(sound, rate)


KINDS = (0.24, 0.36, 0.14, 0.08, 0.18)  # groan, crack, debris, boom, moan


def _mastered(sound: np.ndarray, rate: int) -> np.ndarray:
    """Return `sound` (n,) leaning to no side, its peaks rounded off, faded in and out."""
    sound = sosfilt(high_pass(20.0, rate), sound)  # impulses may all be of one sign
    sound = 0.8 * _tanh(1.2 * sound / np.percentile(np.abs(sound), 99.9))
    for edge, length in ((slice(None), 0.01), (slice(None, None, -1), 0.1)):
        m = min(round(length * rate), len(sound))
        sound[edge][:m] *= 0.5 - 0.5 * elementary.cos(np.pi * np.arange(m) / m)
    return sound.astype(np.float32)


def _tanh(x: np.ndarray) -> np.ndarray:
    return 1.0 - 2.0 / (elementary.exp(2.0 * x) + 1.0)


def _rumble(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    noise = lfilter([1.0], [1.0, -0.9995], random.standard_normal(n))
    noise = _unit(sosfilt(_band(18, 110, rate), noise))
    wind = _unit(sosfilt(_band(60, 900, rate), random.standard_normal(n)))
    return (0.016 * noise + 0.006 * wind) * elementary.exp(0.7 * _slow(random, n, rate, 0.4))


def _slow(random: np.random.Generator, n: int, rate: int, hz: float) -> np.ndarray:
    """Return noise (n,) that changes about `hz` times a second."""
    points = max(4, int(hz * n / rate) + 2)
    return np.interp(
        np.linspace(0, points - 1, n), np.arange(points), random.standard_normal(points)
    )


def _groan(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(0.4, 2.2) * rate)
    slips = _slips(random, n, rate, random.uniform(35, 220), random.uniform(0.4, 2.0), 0.45)
    modes = random.uniform(120, 900) * np.sort(
        elementary.exp(random.uniform(0, 3.2, 9))
    )  # no ladder
    sound = _ring(random, slips, rate, modes, 0.06 / elementary.power(np.arange(1, 10), 0.6))
    return 0.03 * np.sqrt(size) * _unit(sound * np.sqrt(elementary.hann(n)))


def _moan(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(1.0, 3.5) * rate)
    sound = _bowed(random, n, rate, random.uniform(55, 420), random.uniform(0.75, 1.35))
    if random.random() < 0.5:
        sound = sound + 0.4 * _bowed(random, n, rate, random.uniform(150, 700), 1.0)
    return 0.045 * elementary.power(size, 0.3) * _unit(sound * np.sqrt(elementary.hann(n)))


def _bowed(random: np.random.Generator, n: int, rate: int, hz: float, glide: float) -> np.ndarray:
    """One mode that noise keeps going: a tone of wandering level and pitch, without harmonics."""
    along = np.arange(n) / n
    pitch = hz * elementary.power(glide, along) * elementary.exp(0.02 * _slow(random, n, rate, 6.0))
    phase = 2 * np.pi * np.cumsum(pitch) / rate
    breadth = low_pass(min(0.03 * hz + 2, 20), rate)
    level = [sosfilt(breadth, random.standard_normal(n)) for _ in range(2)]
    return level[0] * elementary.cos(phase) - level[1] * elementary.sin(phase)


def _crack(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    spread = 0.06 * np.sqrt(size)
    count = random.poisson(25 * size) + 3
    delays = np.minimum(random.exponential(spread, count), 8 * spread)
    return (
        0.22
        * elementary.power(size, 0.4)
        * _shattered(random, rate, delays, random.uniform(0.15, 0.9))
    )


def _shattered(
    random: np.random.Generator, rate: int, delays: np.ndarray, longest: float
) -> np.ndarray:
    """Micro-impacts at `delays`, s, and the plate that they ring for at most `longest`, s."""
    count = len(delays)
    levels = (random.pareto(1.6, count) + 1) * random.choice([-1.0, 1.0], count)
    n = round((delays.max() + longest) * rate)
    impacts = np.zeros(n)
    np.add.at(impacts, (delays * rate).astype(int), levels)
    grit = np.arange(round(0.012 * rate))
    burst = random.standard_normal(len(grit)) * elementary.exp(-grit / (0.0025 * rate))
    low = elementary.exp(random.uniform(elementary.log(500), elementary.log(9000 / 1.6)))
    burst = sosfilt(_band(low, 1.6 * low, rate), burst)
    hits = _convolved(impacts, burst)[:n]
    modes = random.uniform(180, 3500) * elementary.power(np.arange(1, 9), 1.7)
    plate = _ring(random, impacts, rate, modes, longest / np.sqrt(np.arange(1, 9)))
    return _peak(_peak(hits) + 0.6 * _peak(plate))


def _debris(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(random.uniform(0.5, 2.5) * rate)
    return 0.02 * np.sqrt(size) * _unit(_rain(random, n, rate) * elementary.hann(n))


def _rain(random: np.random.Generator, n: int, rate: int) -> np.ndarray:
    count = random.poisson(random.uniform(400, 2500) * n / rate)
    rain = np.zeros(n)
    np.add.at(
        rain, random.integers(0, n, count), random.pareto(2, count) * random.choice([-1, 1], count)
    )
    band = _band(random.uniform(1200, 4000), min(random.uniform(7000, 15000), 0.45 * rate), rate)
    return sosfilt(band, rain)


def _boom(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    n = round(2.4 * rate)
    strike = np.zeros(n)
    m = round(0.03 * rate)
    strike[:m] = random.standard_normal(m) * elementary.hann(m)
    modes = random.uniform(35, 80) * elementary.power(np.arange(1, 6), 1.15)
    return (
        0.35
        * elementary.power(size, 0.3)
        * _peak(_ring(random, strike, rate, modes, np.full(5, 1.6)))
    )


def _long_crack(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    """It ticks ever faster, runs through the plate with a falling whistle, and shatters away."""
    begin_s, run_s = random.uniform(1.0, 2.0), random.uniform(1.0, 2.5)
    out = np.zeros(round((begin_s + run_s + 3.0) * rate))
    count = 40
    ticks_s = begin_s * (1 - random.uniform(0, 1, count) ** 2)  # the denser the nearer
    _place(out, 0.06 * _shattered(random, rate, ticks_s, 0.1), 0)
    running_s = run_s * elementary.power(np.sort(random.uniform(0, 1, 250)), 0.7)
    _place(out, 0.22 * _shattered(random, rate, running_s, 0.7), begin_s * rate)
    _place(out, 0.16 * _dispersed(random, rate, run_s), begin_s * rate)
    _place(out, 0.7 * _boom(random, rate, size), (begin_s + 0.8 * run_s) * rate)
    tail = round(2.0 * rate)
    fall = elementary.exp(-np.arange(tail) / (0.5 * rate))
    _place(out, 0.03 * _unit(_rain(random, tail, rate)) * fall, (begin_s + run_s) * rate)
    return out * elementary.power(size, 0.15)


def _dispersed(random: np.random.Generator, rate: int, seconds: float) -> np.ndarray:
    """Bending waves of a plate run as the root of their frequency: the high ones are there first.

    So a crack far away is a whistle that falls as 1 / t^2.
    """
    n = round(seconds * rate)
    t = np.arange(n) / rate + 0.12
    hz = np.minimum(random.uniform(25, 60) / t**2, 0.2 * rate) + random.uniform(60, 150)
    wander = elementary.exp(0.05 * _slow(random, n, rate, 30.0))
    sound = elementary.sin(2 * np.pi * np.cumsum(hz * wander) / rate)
    return (
        sound * elementary.exp(-t / (0.25 * seconds)) * np.minimum(1, np.arange(n) / (0.01 * rate))
    )


def _calving(random: np.random.Generator, rate: int, size: float) -> np.ndarray:
    """Cracks that come ever faster, the fall, the wave that it makes, and what still drops."""
    before_s, fall_s, after_s = random.uniform(2.5, 4.0), random.uniform(1.2, 2.2), 6.0
    out = np.zeros(round((before_s + fall_s + after_s) * rate))
    for at in before_s * (
        1 - elementary.power(0.03, np.arange(14) / 13)
    ):  # like foreshocks: Omori's law reversed in time
        few = np.minimum(random.exponential(0.04, 20), 0.3)
        hit = random.uniform(0.04, 0.15) * _shattered(random, rate, few, 0.3)
        _place(out, hit, at * rate)
    begin = before_s * rate
    n = round((fall_s + 2.5) * rate)
    t = np.arange(n) / rate
    swell = np.minimum(t / (0.5 * fall_s), 1) ** 2 * elementary.exp(
        -np.maximum(t - fall_s, 0) / 0.7
    )
    roar = _unit(sosfilt(_band(25, 160, rate), random.standard_normal(n)))
    roar += 0.35 * _unit(sosfilt(_band(160, 2500, rate), random.standard_normal(n)))
    _place(out, 0.16 * roar * swell * elementary.exp(0.3 * _slow(random, n, rate, 9.0)), begin)
    _place(out, _boom(random, rate, 2.0 + size), begin + 0.4 * fall_s * rate)
    slabs_s = fall_s * np.sort(random.uniform(0, 1, 300))
    _place(out, 0.3 * _shattered(random, rate, slabs_s, 0.9), begin)
    n = round(after_s * rate)
    t = np.arange(n) / rate
    wave = _unit(sosfilt(_band(40, 500, rate), random.standard_normal(n)))
    wave *= (
        (1 + 0.6 * elementary.sin(2 * np.pi * 0.7 * t))
        * np.minimum(t / 0.8, 1)
        * elementary.exp(-t / 1.7)
    )
    _place(out, 0.05 * wave, begin + fall_s * rate)
    drops = _unit(_rain(random, n, rate)) * elementary.exp(-t / 1.5)
    _place(out, 0.025 * drops, begin + 0.7 * fall_s * rate)
    return out * elementary.power(size, 0.1)


def _place(out: np.ndarray, sound: np.ndarray, at: float) -> None:
    begin = int(at)
    part = sound[: max(0, len(out) - begin)]
    out[begin : begin + len(part)] += part


def _slips(
    random: np.random.Generator, n: int, rate: int, hz: float, glide: float, spread: float
) -> np.ndarray:
    """Impulses at irregular intervals, whose mean rate goes from `hz` by the factor `glide`.

    Intervals have the gamma distribution with a standard deviation of `spread` of their mean.
    """
    out = np.zeros(n)
    at, shape = 0.0, 1.0 / (spread * spread)
    while at < n:
        out[int(at)] = elementary.exp(0.5 * random.standard_normal())
        at += random.gamma(shape, rate / (hz * elementary.power(glide, at / n)) / shape)
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
            radius = float(elementary.exp10(-3 / (t60 * rate)))
            angle = 2 * np.pi * hz / rate
            sine, cosine = elementary.sincos(angle)
            poles = [1, -2 * radius * cosine, radius * radius]
            out += lfilter([sine], poles, sound) / (k + 1)
    return out


def _band(low_hz: float, high_hz: float, rate: int) -> np.ndarray:
    high = min(high_hz, 0.45 * rate)
    return band_pass(min(low_hz, 0.5 * high), high, rate)


def _convolved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    n = len(a) + len(b) - 1
    size = next_fast_len(n, real=True)
    return irfft(elementary.product(rfft(a, size), rfft(b, size)), size)[:n]


def _unit(sound: np.ndarray) -> np.ndarray:
    return sound / max(float(np.std(sound)), 1e-12)


def _peak(sound: np.ndarray) -> np.ndarray:
    return sound / max(float(np.abs(sound).max()), 1e-12)


def main() -> int:
    """Write a recording as FLAC; `eol_ros/devices/corpus/ice.flac` is that of the defaults."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('output', help='the .flac file to write')
    parser.add_argument('--seconds', type=float, default=120.0, help='length')
    parser.add_argument('--seed', type=int, default=1, help='random seed of the recording')
    args = parser.parse_args()
    wav = io.BytesIO()  # libsndfile rounds otherwise for FLAC
    soundfile.write(wav, ice(args.seconds, 48000, args.seed), 48000, 'PCM_16', format='WAV')
    wav.seek(0)
    soundfile.write(args.output, *soundfile.read(wav, dtype='int16'), compression_level=1.0)
    return 0


if __name__ == '__main__':
    sys.exit(main())
