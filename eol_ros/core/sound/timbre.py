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

import numpy as np
from scipy.fft import dct, rfft
from scipy.ndimage import median_filter

from eol_ros.core import elementary
from eol_ros.core.sound.descriptors import FRAME, SILENT_SUM, frames_of
from eol_ros.core.sound.loudness import k_weighted, lufs
from eol_ros.settings import MORE_DESCRIPTORS

MELS, MFCCS = 40, 12
PIECE = 1 << 20  # samples that are weighted at a time
MEDIAN = 31  # frames, and bins
FLOOR = 1e-10  # of powers in dB
GATE_LUFS = -70.0


def describe(
    samples: np.ndarray,
    rate: int,
    cuts: np.ndarray,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, np.ndarray]:
    """Describe each grain of a recording further.

    Parameters
    ----------
    samples : ndarray
        (m,) full scale 1.
    rate : int
        Samples a second.
    cuts : ndarray
        (n, 2) first sample of each grain and the one after its last.
    progress : callable
        Is told the share done, 0..1.

    Returns
    -------
    dict of ndarray
        (n,) per name of MORE_DESCRIPTORS; NaN where a grain has no spectrum.

    Examples
    --------
    A tone does not change, and is harmonic.

    >>> tone = np.sin(2 * np.pi * 440 * np.arange(24000) / 48000)
    >>> found = describe(tone, 48000, np.array([[0, 24000]]))
    >>> bool(found['spectral_flux'][0] < 0.01), bool(found['harmonic_ratio'][0] > 0.99)
    (True, True)
    """
    found = {name: np.full(len(cuts), np.nan) for name in MORE_DESCRIPTORS}
    window = 0.5 - 0.5 * elementary.cos(2 * np.pi * np.arange(FRAME) / FRAME)
    bands = mel_bands(rate)
    weighted = _weighted(samples, rate, cuts)
    for i, (first, last) in enumerate(cuts.tolist()):
        spectrum = rfft(frames_of(samples, cuts[i], FRAME) * window)
        magnitude = elementary.hypot(spectrum.real, spectrum.imag)
        total = magnitude.sum(axis=1)
        heard = total >= SILENT_SUM
        if heard.any():
            share = magnitude[heard] / total[heard, None]
            steps = 0.5 * np.abs(np.diff(share, axis=0)).sum(axis=1)
            found['spectral_flux'][i] = steps.mean() if len(steps) else 0.0
            level = 10 * elementary.log10(np.maximum(_per_band(magnitude**2, bands), FLOOR))
            mean = dct(level, norm='ortho', axis=1)[:, 1 : MFCCS + 1].mean(axis=0)
            for k, value in enumerate(mean.tolist(), 1):
                found[f'mfcc_{k}'][i] = value
            found['harmonic_ratio'][i] = harmonic_ratio(magnitude)
        found['attack_time_s'][i] = attack_time(samples[first:last], rate)
        found['loudness_range_lu'][i] = loudness_range(next(weighted), rate)
        progress((i + 1) / len(cuts))
    return found


def _weighted(samples: np.ndarray, rate: int, cuts: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the K-weighted samples of each cut, in order of their starts, piece by piece."""
    found, state, begin, end = np.zeros(0), None, 0, 0
    for first, last in cuts.tolist():
        while end < last:
            piece, state = k_weighted(samples[end : end + PIECE], rate, state)
            kept = min(first, end) - begin
            found, begin = np.concatenate([found[kept:], piece]), begin + kept
            end += len(piece)
        yield found[first - begin : last - begin]


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


def harmonic_ratio(magnitude: np.ndarray) -> float:
    """Return the steady share, 0..1, of the energy of magnitudes (frames, bins)."""
    steady = median_filter(magnitude, (MEDIAN, 1), mode='reflect') ** 2
    struck = median_filter(magnitude, (1, MEDIAN), mode='reflect') ** 2
    both = steady + struck
    mask = np.divide(steady, both, out=np.full_like(both, 0.5), where=both > 0)
    energy = (magnitude * mask) ** 2, (magnitude * (1 - mask)) ** 2
    return float(energy[0].sum() / max(energy[0].sum() + energy[1].sum(), 1e-300))


def _mean_squares(samples: np.ndarray, size: int, hop: int) -> np.ndarray:
    """Return the mean square of each window of `size` samples, every `hop`; one at least."""
    size = min(size, len(samples))
    energy = np.cumsum(np.concatenate([[0.0], samples.astype(np.float64) ** 2]))
    start = np.arange(0, len(samples) - size + 1, hop)
    return (energy[start + size] - energy[start]) / max(size, 1)


def attack_time(samples: np.ndarray, rate: int) -> float:
    """Return the time, s, in which the envelope of `samples` (m,) rises from 20 to 90 %."""
    hop = max(1, round(0.0025 * rate))
    envelope = np.sqrt(_mean_squares(samples, 4 * hop, hop))
    top = envelope.max(initial=0.0)
    if top <= 0:
        return 0.0
    begin, end = int(np.argmax(envelope > 0.2 * top)), int(np.argmax(envelope >= 0.9 * top))
    return (end - begin) * hop / rate


def loudness_range(weighted: np.ndarray, rate: int) -> float:
    """Return the range of the loudness of K-weighted samples (m,), LU."""
    hop = max(1, round(0.0125 * rate))
    level = lufs(_mean_squares(weighted, 4 * hop, hop))
    level = level[level > GATE_LUFS]
    if not len(level):
        return 0.0
    low, high = np.percentile(level, [10, 95])
    return float(high - low)
