# SPDX-License-Identifier: Apache-2.0
"""Cut a recording into grains: fixed lengths, onsets, gate, or not at all.

Every cut returns (n, 2) int64: first sample and one past the last of each grain, in order.
"""

import numpy as np

HOP_S = 0.005  # resolution of the loudness and novelty curves
MIN_S = 0.02  # the shortest grain that a cut may leave


def chop(n_samples: int, rate: int, grain_s: float, overlap: float = 0.0) -> np.ndarray:
    """Cut into equal lengths; `overlap` 0..0.9 is the share of a grain that the next one repeats.

    A rest shorter than half a grain is left out; a recording shorter than a grain is one grain.
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
    min_s: float = 0.05,
    hold_s: float = 0.05,
) -> np.ndarray:
    """Cut where the sound rises above `on_db` until it has been below `off_db` for `hold_s`.

    Levels are RMS in dBFS over 10 ms. Grains shorter than `min_s` are left out.
    """
    hop = max(1, round(HOP_S * rate))
    level = _level_db(samples, hop)
    hold = max(1, round(hold_s / HOP_S))
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
    return cuts[cuts[:, 1] - cuts[:, 0] >= min_s * rate]


def onsets(
    samples: np.ndarray, rate: int, threshold: float = 1.5, min_gap_s: float = 0.05
) -> np.ndarray:
    """Return the samples at which something begins, shape (n,) int64.

    Novelty is the spectral flux: the rise of the log-compressed magnitude spectrum from one 5 ms
    step to the next, summed over frequency (Bello et al. 2005, "A tutorial on onset detection in
    music signals", eq. 9 with log compression). A peak counts when it exceeds `threshold` times
    the median of the 0.4 s around it plus a tenth of the 99th percentile of the whole; peaks are
    `min_gap_s` apart.
    """
    hop = max(1, round(HOP_S * rate))
    size = 1 << max(6, round(np.log2(0.02 * rate)))
    padded = np.concatenate([np.zeros(size, np.float32), samples, np.zeros(size, np.float32)])
    frames = np.lib.stride_tricks.sliding_window_view(padded, size)[::hop]
    window = np.hanning(size + 1)[:-1].astype(np.float32)
    flux = np.zeros(len(frames))
    last = np.zeros(size // 2 + 1)
    for i in range(0, len(frames), 1024):
        spectrum = np.log1p(100 * np.abs(np.fft.rfft(frames[i : i + 1024] * window)))
        rise = np.diff(spectrum, axis=0, prepend=last[None])
        flux[i : i + 1024] = np.maximum(rise, 0).sum(axis=1)
        last = spectrum[-1]
    half = max(1, round(0.2 / HOP_S))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(flux, half, 'edge'), 2 * half + 1)
    bar = threshold * np.median(around, axis=1) + 0.1 * np.percentile(flux, 99)
    rises = flux > np.pad(flux, 1)[:-2]
    falls = flux >= np.pad(flux, 1)[2:]
    peaks = np.nonzero(rises & falls & (flux > bar))[0]
    kept: list[int] = []
    for peak in peaks[np.argsort(-flux[peaks], kind='stable')]:  # the strongest first
        if all(abs(peak - other) * HOP_S >= min_gap_s for other in kept):
            kept.append(int(peak))
    # A frame first feels an onset when the onset enters it at its end.
    starts = np.array(sorted(kept), np.int64) * hop - size // 2
    return np.unique(np.clip(starts, 0, max(len(samples) - 1, 0)))


def onset_cut(
    samples: np.ndarray, rate: int, grain_s: float = 1.0, threshold: float = 1.5
) -> np.ndarray:
    """Cut from each onset to the next, at most `grain_s` long; what precedes the first is lost."""
    starts = onsets(samples, rate, threshold)
    ends = np.minimum(np.append(starts[1:], len(samples)), starts + round(grain_s * rate))
    cuts = np.stack([starts, ends], axis=1)
    return cuts[ends - starts >= MIN_S * rate]


def whole(n_samples: int) -> np.ndarray:
    """Take the recording as one grain."""
    return np.array([[0, n_samples]], np.int64)


def from_labels(labels: np.ndarray, n_samples: int, rate: int) -> np.ndarray:
    """Cut at `labels` (n, 2): start and end of each grain in seconds, clipped to the sound."""
    cuts = np.clip(np.round(np.asarray(labels, float) * rate), 0, n_samples).astype(np.int64)
    return cuts[cuts[:, 1] > cuts[:, 0]]


def _level_db(samples: np.ndarray, hop: int) -> np.ndarray:
    """RMS in dBFS over two hops, one value per hop."""
    squares = np.add.reduceat(samples.astype(np.float64) ** 2, np.arange(0, len(samples), hop))
    pair = (squares + np.append(squares[1:], squares[-1])) / (2 * hop)
    return 10 * np.log10(np.maximum(pair, 1e-20))
