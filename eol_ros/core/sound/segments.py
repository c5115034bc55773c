# SPDX-License-Identifier: Apache-2.0
"""Cut a recording into grains: fixed lengths, onsets, gate, or not at all.

Every cut returns (n, 2) int64: first sample and one past the last of each grain, in order.
"""

from collections.abc import Iterator

import numpy as np

from eol_ros.core import elementary

HOP_S = 0.005  # resolution of the loudness and novelty curves
BANDS = 12  # of the novelty curve
MIN_S = 0.02  # the shortest grain that a cut may leave
GATE_HOLD_S = 0.05  # quiet for so long ends a grain of `gate`
GATE_LEAST_S = 0.05  # shorter grains of `gate` are left out


def chop(n_samples: int, rate: int, grain_s: float, overlap: float = 0.0) -> np.ndarray:
    """Cut a recording into equal lengths.

    A rest shorter than half a grain is left out; a recording shorter than a grain is one grain.

    Parameters
    ----------
    n_samples, rate : int
        Length of the recording, and samples a second.
    grain_s : float
        Length of a grain, in s.
    overlap : float
        0..0.9, the share of a grain that the next one repeats.

    Returns
    -------
    ndarray
        (n, 2) int64, first sample of each grain and the one after its last.

    Examples
    --------
    >>> chop(100, 10, 2.5).tolist()
    [[0, 25], [25, 50], [50, 75], [75, 100]]
    """
    length = max(1, round(grain_s * rate))
    step = max(1, round(length * (1 - overlap)))
    starts = np.arange(0, max(n_samples - length // 2, 1), step, dtype=np.int64)
    return np.stack([starts, np.minimum(starts + length, n_samples)], axis=1)


def gate(
    samples: np.ndarray,
    rate: int,
    on_db: float = -40.0,
    off_db: float = -50.0,
) -> np.ndarray:
    """Cut where the sound rises above `on_db` until it has been below `off_db` for 50 ms.

    Levels are RMS in dBFS over 10 ms of `samples` (m,). Grains shorter than 50 ms are left out.
    Returns (n, 2): first sample of each grain and the one after its last.
    """
    hop = max(1, round(HOP_S * rate))
    level = _level_db(samples, hop)
    hold = max(1, round(GATE_HOLD_S / HOP_S))
    found, begin, quiet = [], -1, 0
    for i, db in enumerate(level):
        if begin < 0:
            if db >= on_db:
                begin, quiet = i, 0
        elif db < off_db:
            quiet += 1
            if quiet >= hold:
                found.append((begin, i - quiet + 1))
                begin = -1
        else:
            quiet = 0
    if begin >= 0:
        found.append((begin, len(level)))
    cuts = np.array(found, np.int64).reshape(-1, 2) * hop
    cuts[:, 1] = np.minimum(cuts[:, 1], len(samples))
    return cuts[cuts[:, 1] - cuts[:, 0] >= GATE_LEAST_S * rate]


def onsets(
    samples: np.ndarray, rate: int, threshold_db: float = 4.0, min_gap_s: float = 0.05
) -> np.ndarray:
    """Find the samples at which something begins.

    Novelty is the spectral flux in decibels, which does not depend on the level: the rise of the
    power within 10 ms, with falls counted as 0. It is the mean over 12 bands, about even in log
    frequency. A peak counts when it exceeds the median of the 0.4 s around it by `threshold_db`. Of
    peaks nearer than `min_gap_s` the greater stays. Each is then set to the millisecond at which
    the sound rises most.

    Parameters
    ----------
    samples : ndarray
        (n,) full scale 1.
    rate : int
        Samples a second.
    threshold_db : float
        Least height of a peak above the median, dB.
    min_gap_s : float
        Least time between two onsets, s.

    Returns
    -------
    ndarray
        (k,) int64.

    References
    ----------
    J. P. Bello et al., "A tutorial on onset detection in music signals", IEEE Trans. Speech Audio
    Process. 13 (2005) 1035, section III.A.

    Examples
    --------
    >>> sound = np.zeros(48000, np.float32)
    >>> sound[24000:] = 0.1 * np.random.default_rng(0).standard_normal(24000)
    >>> onsets(sound, 48000).tolist()
    [24000]
    """
    hop = max(1, round(HOP_S * rate))
    rise = _rise_db(samples, rate, hop)
    half = max(1, round(0.2 / HOP_S))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(rise, half, 'edge'), 2 * half + 1)
    novel = np.empty_like(rise)
    for part in _parts(len(rise), 1 << 14):
        novel[part] = rise[part] - np.median(around[part], axis=1)
    peak = (novel > np.pad(novel, 1)[:-2]) & (novel >= np.pad(novel, 1)[2:])
    peaks = np.nonzero(peak & (novel > threshold_db))[0]
    kept: list[int] = []
    for at in peaks[np.argsort(-novel[peaks], kind='stable')]:  # the greatest first
        if all(abs(at - other) * HOP_S >= min_gap_s for other in kept):
            kept.append(int(at))
    return np.unique([_sharpened(samples, at * hop, rate) for at in sorted(kept)]).astype(np.int64)


def _rise_db(samples: np.ndarray, rate: int, hop: int) -> np.ndarray:
    """Mean rise in dB over the bands within two hops; value i belongs to sample i * hop."""
    size = 1 << max(6, round(elementary.log2(0.02 * rate)))
    window = elementary.hann(size + 2)[1:-1]
    edges = (
        (4 * elementary.power((size // 2 + 1) / 4, np.linspace(0, 1, BANDS))).round().astype(int)
    )  # wide: noise averages out
    band = np.searchsorted(edges, np.arange(size // 2 + 1), side='right')
    band = np.minimum(band, BANDS - 1)
    level = np.zeros((len(samples) // hop + 1, BANDS))
    for part in _parts(len(level), 1024):
        end = (min(part.stop, len(level)) - 1) * hop  # frame i ends at i * hop, begins in silence
        piece = samples[max(part.start * hop - size, 0) : end]
        piece = np.pad(piece, (end - part.start * hop + size - len(piece), 0))
        frames = np.lib.stride_tricks.sliding_window_view(piece, size)[::hop]
        spectrum = np.fft.rfft(frames * window)
        power = spectrum.real**2 + spectrum.imag**2
        per_band = np.stack([power[:, band == k].sum(axis=1) for k in range(BANDS)], axis=1)
        total = window.sum()
        level[part] = 10 * elementary.log10(per_band / (total * total) + 1e-9)
    return np.maximum(level - np.pad(level, ((2, 0), (0, 0)), 'edge')[:-2], 0).mean(axis=1)


def _sharpened(samples: np.ndarray, near: int, rate: int) -> int:
    """Return the sample within 15 ms of `near` where 4 ms after are loudest against 4 ms before."""
    step, span = max(1, rate // 1000), max(1, rate // 250)
    reach = round(0.015 * rate)
    at = np.arange(max(near - reach, 0), min(near + reach, len(samples)), step)
    if not len(at):
        return min(near, len(samples) - 1)
    begin = max(near - reach - span, 0)
    around = samples[begin : near + reach + span].astype(np.float64)
    total = np.concatenate([[0.0], np.cumsum(around**2)])
    here = at - begin
    before = total[here] - total[np.maximum(here - span, 0)]
    after = total[np.minimum(here + span, len(around))] - total[here]
    return int(at[np.argmax((after + 1e-9 * span) / (before + 1e-9 * span))])


def onset_cut(
    samples: np.ndarray, rate: int, grain_s: float = 1.0, threshold_db: float = 4.0
) -> np.ndarray:
    """Cut `samples` (m,) from each onset to the next, at most `grain_s` long; return (n, 2).

    What precedes the first onset is lost.
    """
    starts = onsets(samples, rate, threshold_db)
    ends = np.minimum(np.append(starts[1:], len(samples)), starts + round(grain_s * rate))
    cuts = np.stack([starts, ends], axis=1)
    return cuts[ends - starts >= MIN_S * rate]


def from_labels(labels: np.ndarray, n_samples: int, rate: int) -> np.ndarray:
    """Cut at `labels` (n, 2): start and end of each grain in seconds, clipped to the sound."""
    cuts = np.clip(np.round(np.asarray(labels, float) * rate), 0, n_samples).astype(np.int64)
    return cuts[cuts[:, 1] > cuts[:, 0]]


def _level_db(samples: np.ndarray, hop: int) -> np.ndarray:
    """RMS in dBFS over two hops, one value per hop."""
    squares = np.concatenate([
        np.add.reduceat(piece, np.arange(0, len(piece), hop))
        for part in _parts(len(samples), 4096 * hop)
        for piece in [samples[part].astype(np.float64) ** 2]
    ])  # fmt: skip
    pair = (squares + np.append(squares[1:], squares[-1])) / (2 * hop)
    return 10 * elementary.log10(np.maximum(pair, 1e-20))


def _parts(count: int, size: int) -> Iterator[slice]:
    """Yield 0..count in slices of `size`: not all of a long recording needs double precision."""
    return (slice(i, i + size) for i in range(0, count, size))
