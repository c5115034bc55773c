# SPDX-License-Identifier: Apache-2.0
"""Series of known spectrum to try the verdict on 1/f by: some that are, some that only look it."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

from eol_ros.analysis.uncoupled import Uncoupled
from eol_ros.core.physics.scene import from_mapping
from eol_ros.core.physics.twin.live import Coupling, scene_of
from eol_ros.core.physics.twin.play import Play
from eol_ros.lab import choose
from eol_ros.lab.science import one_over_f, sounding, surrogates
from eol_ros.lab.science.spectra import coloured_noise
from eol_ros.settings import GrainsSettings, LedsSettings, TwinSettings

RATE_HZ, HIGH_HZ = 20.0, 5.0  # as `eol report` asks the series of a bag


@dataclass(frozen=True)
class Made:
    """A series (n,) at RATE_HZ, the times of the events it counts, and how else it is asked."""

    values: np.ndarray
    times_s: np.ndarray | None = None
    more: dict[str, Any] = field(default_factory=dict)
    others: one_over_f.Others | None = None


def ask(name: str, duration_s: float, seed: int) -> one_over_f.Answer:
    """Return the verdict on one realisation of a series of SERIES."""
    made = SERIES[name][1](duration_s, np.random.default_rng([seed, 1]))
    series = one_over_f.Series(
        name, made.values, RATE_HZ, HIGH_HZ, times_s=made.times_s, **made.more
    )  # fmt: skip
    return one_over_f.ask(series, np.random.default_rng([seed, 2]), made.others)


def _noise(beta: float) -> Callable:
    return lambda T, rng: Made(coloured_noise(beta, _count(T), rng))


def _bursts(T: float, rng: np.random.Generator) -> Made:
    noise = coloured_noise(1.0, _count(T), rng)
    return Made(np.exp(0.5 * noise / noise.std()))


def _events_of_one_over_f(T: float, rng: np.random.Generator) -> Made:
    """So many of them (300/s) that their own white noise stays below the 1/f of their rate."""
    noise = coloured_noise(1.0, _count(T), rng)
    rate = np.exp(noise / noise.std())
    counts = rng.poisson(300 / RATE_HZ * rate / rate.mean())
    begins = np.repeat(np.arange(len(counts)), counts)
    return _events(np.sort((begins + rng.random(len(begins))) / RATE_HZ), T)


def _brownian(T: float, rng: np.random.Generator) -> Made:
    return Made(rng.normal(size=_count(T)).cumsum())


def _ornstein_uhlenbeck(corner_hz: float, white: float = 0.0) -> Callable:
    def make(T: float, rng: np.random.Generator) -> Made:
        keep = np.exp(-2 * np.pi * corner_hz / RATE_HZ)
        warm = round(20 * RATE_HZ / corner_hz)
        walk = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=_count(T) + warm))[warm:]
        return Made(walk + white * rng.normal(size=len(walk)))

    return make


def _relaxations(*corners_hz: float) -> Callable:
    """Ornstein-Uhlenbeck processes of equal power: visits, gestures and slips make such sums."""

    def make(T: float, rng: np.random.Generator) -> Made:
        return Made(sum(_ornstein_uhlenbeck(hz)(T, rng).values for hz in corners_hz))

    return make


def _trend(T: float, rng: np.random.Generator) -> Made:
    """1/f noise that drifts by three of its standard deviations."""
    noise = coloured_noise(1.0, _count(T), rng)
    return Made(noise / noise.std() + 3 * np.linspace(0, 1, len(noise)))


def _heavy_iaaft(T: float, rng: np.random.Generator) -> Made:
    """Log-normal values with the spectrum of 1/f noise (IAAFT)."""
    values = np.sort(np.exp(rng.normal(size=_count(T))))
    noise = coloured_noise(1.0, _count(T), rng)
    return Made(surrogates.iaaft(values[np.argsort(np.argsort(noise))], rng))


def _telegraph(T: float, rng: np.random.Generator) -> Made:
    """On and off at random, once in a second on average."""
    flips = surrogates.event_counts(surrogates.poisson_times(rng.poisson(T), T, rng), T, RATE_HZ)
    return Made(flips.cumsum() % 2)


def _sines(*hz: float) -> Callable:
    def make(T: float, rng: np.random.Generator) -> Made:
        t = np.arange(_count(T)) / RATE_HZ
        waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) for f in hz]
        return Made(np.sum(waves, axis=0) + 0.5 * rng.normal(size=len(t)))

    return make


def _wobbling(T: float, rng: np.random.Generator) -> Made:
    """A swing of 0.7 Hz whose phase walks off by a period within some ten."""
    phase = 2 * np.pi * 0.7 * np.arange(_count(T)) / RATE_HZ
    phase += (0.1 * rng.normal(size=len(phase))).cumsum()
    return Made(np.sin(phase) + 0.3 * rng.normal(size=len(phase)))


def _poisson(T: float, rng: np.random.Generator) -> Made:
    return _events(surrogates.poisson_times(round(8 * T), T, rng), T)


def _clock(T: float, rng: np.random.Generator) -> Made:
    """One every 0.8 s, each late or early by a few hundredths."""
    beats = np.arange(1, int(T / 0.8)) * 0.8
    return _events(np.sort(beats + 0.03 * rng.normal(size=len(beats))), T)


def _heavy_tailed(T: float, rng: np.random.Generator) -> Made:
    """Independent intervals of power-law length: 1/f without any order among them."""
    gaps = 0.02 / (1 - rng.random(round(20 * T)))
    times = gaps.cumsum()
    return _events(times[times < T], T)


def _events(times_s: np.ndarray, T: float) -> Made:
    return Made(surrogates.event_counts(times_s, T, RATE_HZ), times_s)


def _visitors(name: str) -> Callable:
    """The work's own: the shipped twin under its visitors, asked as a bag of it is."""

    def make(T: float, rng: np.random.Generator) -> Made:
        times_s, control = _played(T, int(rng.integers(1 << 31)))
        more = {'drive_s': one_over_f.GESTURE_S, 'rest': 0.0}
        others = {control.NAME: lambda: control.series(name)}
        if name == 'triggers':
            return Made(surrogates.event_counts(times_s, T, RATE_HZ), times_s, more, others)
        return Made(sounding.power(times_s, T, RATE_HZ, GrainsSettings()), None, more, others)

    return make


@functools.lru_cache(4)  # both series of a seed, of each length
def _played(T: float, seed: int) -> tuple[np.ndarray, Uncoupled]:
    """Return when slips sound under the twin's visitors, (n,) s, and the same without coupling."""
    play, rim = Play(seed), [(0.0, 0.0, 0.0, 0.0)]
    while play.time_s < T:
        play.advance(1 / 60)
        rim.append((play.time_s, *play.table.rim_pose.tolist()))
    scene = scene_of(seed, Coupling(), {'kind': 'poses', 'par': rim}, T)
    run = choose.simulate(from_mapping(scene), sample_s=T, ledger=False)
    begins, rule = run.event_start != 0, GrainsSettings()
    times_s = run.event_t[begins]
    times_s = times_s[sounding.heard(times_s, run.event_block[begins], rule)]
    twin = TwinSettings(seed=seed)
    return times_s, Uncoupled(twin, LedsSettings(), rule, np.array(rim), T)


def _count(T: float) -> int:
    return round(T * RATE_HZ)


# name: (the right answer, how it is made)
SERIES: dict[str, tuple[str, Callable[[float, np.random.Generator], Made]]] = {
    '1/f': ('yes', _noise(1.0)),
    'f^-0.8': ('yes', _noise(0.8)),
    'f^-1.2': ('yes', _noise(1.2)),
    '1/f in bursts': ('yes', _bursts),
    'events of 1/f rate': ('yes', _events_of_one_over_f),
    '1/f, IAAFT of log-normal values': ('yes', _heavy_iaaft),
    '1/f and a trend of 3 sigma': ('undecided', _trend),
    'white': ('no', _noise(0.0)),
    'Brownian': ('no', _brownian),
    'Ornstein-Uhlenbeck, 0.03 Hz': ('no', _ornstein_uhlenbeck(0.03)),
    'Ornstein-Uhlenbeck, 0.3 Hz': ('no', _ornstein_uhlenbeck(0.3)),
    'Ornstein-Uhlenbeck, 2 Hz': ('no', _ornstein_uhlenbeck(2.0)),
    'Ornstein-Uhlenbeck and white': ('no', _ornstein_uhlenbeck(0.1, 1.0)),
    'sum of two relaxations': ('no', _relaxations(0.05, 1.0)),
    'sum of three relaxations': ('no', _relaxations(0.03, 0.3, 3.0)),
    'random telegraph': ('no', _telegraph),
    'periodic': ('no', _sines(0.7)),
    'quasi-periodic': ('no', _sines(0.7, 0.7 * (1 + 5**0.5) / 2)),
    'swing that wobbles': ('no', _wobbling),
    'events by chance': ('no', _poisson),
    'events by the clock': ('no', _clock),
    'heavy-tailed intervals': ('no', _heavy_tailed),
    'triggers of the twin': ('no', _visitors('triggers')),
    'sound of the twin': ('no', _visitors('sound power')),
}
