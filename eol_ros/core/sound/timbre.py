# SPDX-License-Identifier: Apache-2.0
"""Descriptors that take longer than those of `descriptors.py`: described where they are asked for.

Frames, window and magnitudes M are those of `descriptors.py`, all inside one grain.
- spectral_flux: mean over successive frames of half the sum of |p_k - p'_k|, p = M / sum M: 0 for a
  spectrum that stays, 1 for one without a line in common with that before; loudness has no part.
- mfcc_1 .. mfcc_12: mean over frames of the type-II cosine transform (orthonormal) of the power in
  40 mel bands (Slaney's scale and areas, 0 to half the rate) in dB, without its 0th, the level.
- harmonic_ratio: share of the energy that median filters over 31 frames and 31 bins give to what is
  steady, with soft masks of power 2 (FitzGerald, DAFx-10, 2010).
- attack_time_s: from where the envelope first exceeds 20 % of its maximum to where it reaches 90 %;
  the envelope is the RMS of 10 ms, every 2.5 ms.
- loudness_range_lu: 95th less 10th percentile of BS.1770 loudness in windows of 50 ms, every 12.5
  ms, of those above -70 LUFS. (EBU Tech 3342 has windows of 3 s, longer than grains.)
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import dct, rfft
from scipy.ndimage import median_filter

from eol_ros.core import elementary
from eol_ros.core.sound.descriptors import FRAME, HOP, SILENT_SUM, frames_of
from eol_ros.core.sound.loudness import k_weighted, lufs
from eol_ros.settings import MORE_DESCRIPTORS

MELS, MFCCS = 40, 12
PIECE = 1 << 20  # samples that are weighted at a time
FRAMES = 1024  # frames of a long grain that are described at a time
MEDIAN = 31  # frames, and bins
FLOOR = 1e-10  # of powers in dB
GATE_LUFS = -70.0


def describe(
    samples: np.ndarray,
    rate: int,
    cuts: np.ndarray,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, np.ndarray]:
    """Return further descriptors of each grain, (n,) by name of MORE_DESCRIPTORS.

    samples: (m,) full scale 1; cuts: (n, 2) first sample of each grain and the one after its last;
    progress: called with the share done. NaN where a grain has no spectrum.
    """
    found = {name: np.full(len(cuts), np.nan) for name in MORE_DESCRIPTORS}
    window = 0.5 - 0.5 * elementary.cos(2 * np.pi * np.arange(FRAME) / FRAME)
    bands = mel_bands(rate)
    weighted = _Weighted(samples, rate)
    for i, (first, last) in enumerate(cuts.tolist()):
        flux, mean, energy = _Mean(), _Mean(), np.zeros(2)
        before = np.zeros((0, FRAME // 2 + 1))  # the last frame so far with a sound
        for magnitude, inner in _magnitudes(samples, first, last, window):
            energy += _energies(magnitude)[:, inner].sum(axis=(1, 2))
            magnitude = magnitude[inner]
            total = magnitude.sum(axis=1)
            heard = total >= SILENT_SUM
            if heard.any():
                share = np.concatenate([before, magnitude[heard] / total[heard, None]])
                flux.add(0.5 * np.abs(np.diff(share, axis=0)).sum(axis=1))
                before = share[-1:]
                level = 10 * elementary.log10(np.maximum(_per_band(magnitude**2, bands), FLOOR))
                mean.add(dct(level, norm='ortho', axis=1)[:, 1 : MFCCS + 1])
        if len(before):
            found['spectral_flux'][i] = flux.value if flux.count else 0.0
            for k, value in enumerate(mean.value.tolist(), 1):
                found[f'mfcc_{k}'][i] = value
            found['harmonic_ratio'][i] = _share(energy)
        found['attack_time_s'][i] = attack_time(samples[first:last], rate)
        found['loudness_range_lu'][i] = loudness_range(weighted.part(first, last), rate)
        progress((i + 1) / len(cuts))
    return found


class _Mean:
    """The mean of rows that come in pieces."""

    def __init__(self) -> None:
        self.count = 0
        self._sum: Any = 0.0

    def add(self, rows: np.ndarray) -> None:
        self._sum = self._sum + rows.sum(axis=0)
        self.count += len(rows)

    @property
    def value(self) -> Any:
        return self._sum / self.count


def _magnitudes(
    samples: np.ndarray, first: int, last: int, window: np.ndarray
) -> Iterator[tuple[np.ndarray, slice]]:
    """Yield magnitudes (k, bins) of a grain and which of them are new, in pieces of FRAMES.

    The others are of the frames around, as far as a median reaches.
    """
    count, reach = max((last - first - FRAME) // HOP + 1, 1), MEDIAN // 2
    for start in range(0, count, FRAMES):
        stop = min(start + FRAMES, count)
        a, b = max(start - reach, 0), min(stop + reach, count)
        cut = np.array([first + a * HOP, min(first + (b - 1) * HOP + FRAME, last)])
        spectrum = rfft(frames_of(samples, cut, FRAME) * window)
        yield elementary.hypot(spectrum.real, spectrum.imag), slice(start - a, stop - a)


class _Weighted:
    """The K-weighted samples of a sound, in pieces of which only the last two are kept."""

    def __init__(self, samples: np.ndarray, rate: int):
        self._samples, self._rate = samples, rate
        self._states: list[np.ndarray | None] = [None]  # of the filter, before each piece
        self._pieces: dict[int, np.ndarray] = {}

    def part(self, first: int, last: int) -> '_Part':
        return _Part(self, first, last)

    def take(self, first: int, last: int) -> np.ndarray:
        begin = first // PIECE
        pieces = [self._piece(k) for k in range(begin, -(-last // PIECE))]
        return np.concatenate(pieces)[first - begin * PIECE : last - begin * PIECE]

    def _piece(self, number: int) -> np.ndarray:
        while len(self._states) <= number:
            self._piece(len(self._states) - 1)
        if number not in self._pieces:
            piece = self._samples[number * PIECE : (number + 1) * PIECE]
            weighted, state = k_weighted(piece, self._rate, self._states[number])
            if len(self._states) == number + 1:
                self._states.append(state)
            self._pieces = {**dict(list(self._pieces.items())[-1:]), number: weighted}
        return self._pieces[number]


@dataclass
class _Part:
    """A part of a weighted sound, to be sliced like an array."""

    weighted: _Weighted
    first: int
    last: int

    def __len__(self) -> int:
        return self.last - self.first

    def __getitem__(self, part: slice) -> np.ndarray:
        return self.weighted.take(self.first + part.start, self.first + part.stop)


def mel_bands(rate: int) -> np.ndarray:
    """Return the weight of each bin of a spectrum in each mel band, (MELS, FRAME / 2 + 1).

    Slaney's scale (Auditory Toolbox, 1998): linear up to 1 kHz, logarithmic above; triangles of
    equal area.
    """
    knee, per_hz, step = 1000.0, 3 / 200, elementary.log(6.4) / 27
    top = rate / 2
    mels = per_hz * top if top < knee else knee * per_hz + elementary.log(top / knee) / step
    at = np.linspace(0, mels, MELS + 2)
    low = at < knee * per_hz
    edges = np.where(low, at / per_hz, knee * elementary.exp(step * (at - knee * per_hz)))
    hz = np.arange(FRAME // 2 + 1) * rate / FRAME
    rise = (hz - edges[:-2, None]) / np.diff(edges)[:-1, None]
    fall = (edges[2:, None] - hz) / np.diff(edges)[1:, None]
    return np.maximum(0, np.minimum(rise, fall)) * (2 / (edges[2:] - edges[:-2]))[:, None]


def _per_band(power: np.ndarray, bands: np.ndarray) -> np.ndarray:
    """Return the power (frames, MELS) in each of `bands` (MELS, bins) of `power` (frames, bins)."""
    return np.stack([(power * weight).sum(axis=1) for weight in bands], axis=1)


def _share(energy: np.ndarray) -> float:
    return float(energy[0] / max(energy[0] + energy[1], 1e-300))


def _energies(magnitude: np.ndarray) -> np.ndarray:
    """Return the energy (2, frames, bins) of magnitudes that is steady, and that is struck."""
    steady = median_filter(magnitude, (MEDIAN, 1), mode='reflect') ** 2
    struck = median_filter(magnitude, (1, MEDIAN), mode='reflect') ** 2
    both = steady + struck
    mask = np.divide(steady, both, out=np.full_like(both, 0.5), where=both > 0)
    return np.stack([(magnitude * mask) ** 2, (magnitude * (1 - mask)) ** 2])


def _mean_squares(samples: 'np.ndarray | _Part', size: int, hop: int) -> np.ndarray:
    """Return the mean square of each window of `size` samples, every `hop`; one at least."""
    size = min(size, len(samples))
    starts = np.arange(0, len(samples) - size + 1, hop)
    found = np.empty(len(starts))
    step = max(PIECE // hop, 1)
    for k in range(0, len(starts), step):
        start = starts[k : k + step]
        piece = samples[int(start[0]) : int(start[-1]) + size].astype(np.float64)
        energy = np.cumsum(np.concatenate([[0.0], piece**2]))
        start = start - start[0]
        found[k : k + step] = (energy[start + size] - energy[start]) / max(size, 1)
    return found


def attack_time(samples: np.ndarray, rate: int) -> float:
    """Return the time, s, in which the envelope of `samples` (m,) rises from 20 to 90 %."""
    hop = max(1, round(0.0025 * rate))
    envelope = np.sqrt(_mean_squares(samples, 4 * hop, hop))
    top = envelope.max(initial=0.0)
    if top <= 0:
        return 0.0
    begin, end = int(np.argmax(envelope > 0.2 * top)), int(np.argmax(envelope >= 0.9 * top))
    return (end - begin) * hop / rate


def loudness_range(weighted: 'np.ndarray | _Part', rate: int) -> float:
    """Return the range of the loudness of K-weighted samples (m,), LU."""
    hop = max(1, round(0.0125 * rate))
    level = lufs(_mean_squares(weighted, 4 * hop, hop))
    level = level[level > GATE_LUFS]
    if not len(level):
        return 0.0
    low, high = np.percentile(level, [10, 95])
    return float(high - low)
