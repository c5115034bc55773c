# SPDX-License-Identifier: Apache-2.0
"""The sound meter: waveform of the last second, spectrum, levels and counters."""

from dataclasses import dataclass

import numpy as np

from eol_ros.core.sound.mixer import Mixer
from eol_ros.core.sound.mixer_layout import LOADS

PAIRS = 1024
BANDS = 128
LOW_HZ, HIGH_HZ = 20.0, 20000.0
FFT = 8192
FLOOR_DB = -120.0


def waveform(mono: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest sample of 1024 equal spans of `mono` (n,)."""
    edges = np.arange(PAIRS) * len(mono) // PAIRS
    if len(mono) < PAIRS:
        mono = np.concatenate([np.zeros(PAIRS - len(mono), np.float32), mono])
        edges = np.arange(PAIRS)
    return np.minimum.reduceat(mono, edges), np.maximum.reduceat(mono, edges)


class Spectrum:
    """Levels in bands of equal width in pitch, from one Hann-windowed transform."""

    def __init__(self, sample_rate: float):
        self._window = np.hanning(FFT + 1)[:-1].astype(np.float32)
        top = min(HIGH_HZ, sample_rate / 2)
        self.edges_hz = np.geomspace(LOW_HZ, top, BANDS + 1)
        self.centres_hz = np.sqrt(self.edges_hz[:-1] * self.edges_hz[1:])
        bin_hz = sample_rate / FFT
        # Every band takes at least the bin nearest its centre: low bands are narrower than a bin.
        first = np.ceil(self.edges_hz[:-1] / bin_hz).astype(int)
        last = np.ceil(self.edges_hz[1:] / bin_hz).astype(int)
        nearest = np.round(self.centres_hz / bin_hz).astype(int)
        self._first = np.where(last > first, first, nearest)
        self._last = np.where(last > first, last, nearest + 1)

    def __call__(self, mono: np.ndarray) -> np.ndarray:
        """Return the level of each band in dB for the newest samples of `mono` (n,), n any.

        A full-scale sine reads about 0 dB in its band (the Hann window's scatter of 1.5 bins summed
        back), silence reads -120 dB.
        """
        piece = np.zeros(FFT, np.float32)
        newest = mono[-FFT:]
        piece[FFT - len(newest) :] = newest
        power = np.abs(np.fft.rfft(piece * self._window)) ** 2
        power *= 4 / (FFT / 2) ** 2 / 1.5
        total = np.concatenate([[0.0], np.cumsum(power)])
        first, last = np.minimum(self._first, len(power)), np.minimum(self._last, len(power))
        band = total[last] - total[first]
        return np.maximum(10 * np.log10(np.maximum(band, 1e-30)), FLOOR_DB).astype(np.float32)


def decibels(amplitude: float) -> float:
    """Return the amplitude in dB relative to full scale, at least -120."""
    return max(FLOOR_DB, 20 * float(np.log10(max(abs(amplitude), 1e-30))))


@dataclass(frozen=True)
class Reading:
    """What the meter shows at one moment."""

    time_s: float  # of the last sample, on the engine's time axis
    wave_min: np.ndarray  # (PAIRS,) f4 of the last second
    wave_max: np.ndarray
    spectrum_db: np.ndarray  # (BANDS,) f4
    peak_dbfs: float  # since the reading before
    rms_dbfs: float
    limiter_db: float  # <= 0, least gain since the reading before
    governor_db: float
    lufs: float  # of the last 30 s
    voices: int
    load: float  # p99 of the share of its time that a callback took


class Meter:
    """Reads a mixer from another thread than the one that renders."""

    def __init__(self, mixer: Mixer):
        self._mixer = mixer
        self._spectrum = Spectrum(mixer.sample_rate)
        self._frame = 0

    def read(self) -> Reading:
        """Return the reading of now; peak, RMS and limiter are those since the last call."""
        mixer, s = self._mixer, self._mixer.state
        frame = int(s['frame'][0])
        last = mixer.recent(int(mixer.sample_rate))
        new = last[-max(1, frame - self._frame) :]
        self._frame = frame
        columns = [np.ascontiguousarray(column) for column in last.T]
        loudest = max(columns, key=lambda c: max(-c.min(), c.max()))  # a sum could cancel
        wave_min, wave_max = waveform(loudest)
        limiter = float(s['limiter_least'][0])
        s['limiter_least'] = 1.0
        used = min(int(s['callbacks'][0]), LOADS)
        load = float(np.percentile(mixer.memory.loads[:used], 99)) if used else 0.0
        return Reading(
            time_s=mixer.time_of(frame),
            wave_min=wave_min,
            wave_max=wave_max,
            spectrum_db=self._spectrum(loudest),
            peak_dbfs=decibels(float(np.abs(new).max())),
            rms_dbfs=decibels(float(np.sqrt(np.mean(np.square(new, dtype=np.float64))))),
            limiter_db=decibels(limiter),
            governor_db=float(s['governor_db'][0]),
            lufs=float(s['lufs'][0]),
            voices=int(s['voices'][0]),
            load=load,
        )
