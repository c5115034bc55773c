# SPDX-License-Identifier: Apache-2.0
"""The scores that are played, and our own engine playing them: speed, and error against float64."""

import time
from dataclasses import dataclass

import numpy as np
from support.sound_reference import reference, score

from eol_ros.core.sound.bank import Bank, voice_rows
from eol_ros.core.sound.mixer import Mixer, render
from eol_ros.core.sound.mixer_layout import RING
from eol_ros.core.sound.offline import play
from eol_ros.core.sound.voicing import Voicing, new_mixer
from eol_ros.settings import SoundSettings

FS = 48000
SOURCE_S = 40.0
GRAIN_S = (0.05, 0.19)  # 0.12 s in the mean
GAIN = 0.1


@dataclass(frozen=True)
class Score:
    """Hann-windowed grains at random times, so that `overlap` of them sound at once."""

    overlap: int
    span_s: float
    triggers: np.ndarray  # (n,) TRIGGER; grain k is the k-th grain
    first: np.ndarray  # (n,) samples into the source
    size: np.ndarray  # (n,) samples


def source(seed: int = 1) -> np.ndarray:
    """Return the sound that all engines read: 40 s of pink noise, (n,) f4."""
    rng = np.random.default_rng(seed)
    n = int(SOURCE_S * FS)
    spectrum = np.fft.rfft(rng.standard_normal(n))
    spectrum /= np.sqrt(np.maximum(np.arange(len(spectrum)), 20))
    x = np.fft.irfft(spectrum, n)
    return (0.3 * x / np.abs(x).max()).astype(np.float32)


def make_score(overlap: int, span_s: float, varied: bool, seed: int = 2) -> Score:
    """Return a score; `varied` draws the speed of reading from 0.5 .. 2, else it is 1."""
    rng = np.random.default_rng(seed)
    count = round(overlap * span_s / np.mean(GRAIN_S))
    rate = np.exp2(rng.uniform(-1, 1, count)).astype(np.float32) if varied else 1.0
    triggers = score(rng, count, span_s, 1, rate=rate, gain=GAIN)
    triggers['grain'] = np.arange(count)
    lengths = np.round(rng.uniform(*GRAIN_S, count) * FS)
    size = np.floor(lengths * triggers['rate']).astype(np.int64)  # as long in time at any speed
    triggers['attack_s'] = triggers['release_s'] = 1.0  # longer than the grain: halves it
    first = rng.integers(0, int((SOURCE_S - 1) * FS), count)
    return Score(overlap, span_s, triggers, first, size)


def bank_of(sound: np.ndarray, s: Score) -> Bank:
    """Return the bank whose k-th grain is the k-th of the score."""
    return Bank([sound], np.zeros(len(s.first), int), s.first / FS, s.size / FS, FS)


class _Voicing(Voicing):
    """All grains are of single slips; each tenth lets its rupture grow."""

    def _grown(self, triggers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = np.arange(len(triggers))
        return np.ones(len(count), np.int64), np.zeros(len(count)), count % 10 == 0


def speed(sound: np.ndarray, s: Score, block: int, repeats: int = 3) -> dict:
    """Return voices per core and nanoseconds a voice and sample, the best of `repeats`.

    Voices per core: seconds of grains rendered in a second of CPU. All of the mixer works, limiter
    and governor included; triggers are given to it block by block, as live.
    """
    bank = bank_of(sound, s)
    settings = SoundSettings(polyphony=4 * s.overlap)
    rows = _Voicing(settings).rows(s.triggers, bank)[0]
    rows = rows[np.argsort(rows['time_s'], kind='stable')]
    out = np.empty((block, settings.channels), np.float32)
    blocks = int((s.span_s + 0.4) * FS) // block
    best, loads = np.inf, []
    for _ in range(repeats):
        mixer = new_mixer(settings)
        mixer.state['ingest'] = RING
        begins = rows['time_s'] * FS - mixer.look_ahead
        due = np.searchsorted(begins, np.arange(1, blocks + 1) * block)
        given, loads = 0, []
        for until in due:
            begun = time.thread_time()
            if until > given:
                mixer.push(rows[given:until])
                given = until
            render(mixer.address, out)
            loads.append(time.thread_time() - begun)
        best = min(best, sum(loads))
        if mixer.state['stolen'][0] or mixer.state['dropped'][0]:
            raise RuntimeError('the score does not fit into the mixer')
    seconds = float(rows['length'].sum()) / FS
    return {
        'voices_per_core': seconds / best,
        'ns_per_voice_sample': best / (seconds * FS) * 1e9,
        'load_p99': float(np.percentile(loads, 99)) / (block / FS),
    }


def truth(sound: np.ndarray, s: Score, frames: int) -> np.ndarray:
    """Return the same in double precision, (frames, 2)."""
    grains = [(0, int(f), int(n)) for f, n in zip(s.first, s.size, strict=True)]
    ahead = Mixer(FS).look_ahead
    return reference(s.triggers, [sound], grains, FS, frames, 1.0, ahead, True)


def ours(sound: np.ndarray, s: Score, frames: int, block: int) -> np.ndarray:
    """Return what our mixer makes of the score, (frames, 2) f4, with the governor off."""
    mixer = Mixer(FS, max_voices=4 * s.overlap, gain_db=0, governor_db=0)
    bank = bank_of(sound, s)
    return np.concatenate(list(play(mixer, voice_rows(s.triggers, bank, 2), frames, block)))
