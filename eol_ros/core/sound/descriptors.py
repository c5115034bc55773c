# SPDX-License-Identifier: Apache-2.0
"""What a grain sounds like, in numbers, each defined so that another program can check it.

All are taken at the recording's own rate from one channel. Frames lie wholly inside the grain; a
grain shorter than a frame is one frame, filled up with silence.
- Spectrum: 1024 samples every 256, periodic Hann, M_k = |DFT|, k = 0..512.
  centroid = sum f_k M_k / sum M_k; flatness = geometric over arithmetic mean of max(M_k^2, 1e-10);
  roll-off = the first f_k up to which 95 % of sum M_k lies. Frames with sum M_k < 1e-10 are
  skipped; a grain of skipped frames only is silent. The grain gets the plain mean over its
  frames.
- Periodicity and pitch: YIN (de Cheveigne & Kawahara 2002, eq. 6 and 8, steps 2-5), 2048 samples
  every 256: difference function over 1024 samples, lags rate/4000 up to rate/40 or 1024; of the
  dips (local minima) of the normalised function the first below 0.15, else the deepest; parabolic
  interpolation; periodicity = 1 - its value, 0 without a dip, mean over frames. Pitch: median of
  rate/lag over frames of periodicity > 0.8.
- RMS in dB of full scale; loudness after BS.1770-4, both over the grain's own span.
"""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.fft import irfft, rfft
from scipy.signal import sosfilt

from eol_ros.core import elementary
from eol_ros.core.sound.corpus import GRAIN
from eol_ros.core.sound.loudness import k_weighting, lufs

FRAME, HOP = 1024, 256
YIN_FRAME, YIN_SPAN = 2048, 1024
YIN_TOLERANCE = 0.15
HIGHEST_HZ, LOWEST_HZ = 4000.0, 40.0
PITCHED = 0.8
SILENT_SUM = 1e-10
BATCH = 512  # frames at a time: their spectra stay in the processor's cache


def analyse(
    samples: np.ndarray,
    rate: int,
    cuts: np.ndarray,
    silence_db: float = -70.0,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[np.ndarray, np.ndarray]:
    """Describe each grain of a recording.

    Parameters
    ----------
    samples : ndarray
        (m,) full scale 1.
    rate : int
        Samples a second.
    cuts : ndarray
        (n, 2) first sample of each grain and the one after its last.
    silence_db : float
        Grains of an RMS below are silent, and those without any spectrum.
    progress : callable
        Called with the share done, 0..1.

    Returns
    -------
    grains : ndarray
        (n,) GRAIN, without places.
    silent : ndarray
        (n,) bool.

    Examples
    --------
    >>> from eol_ros.core.sound.segments import chop
    >>> tone = np.sin(2 * np.pi * 440 * np.arange(48000) / 48000).astype(np.float32)
    >>> grains, silent = analyse(tone, 48000, chop(48000, 48000, 0.5))
    >>> grains['pitch_hz'].round(1).tolist(), silent.tolist()
    ([440.0, 440.0], [False, False])
    """
    grains = np.zeros(len(cuts), GRAIN)
    grains['start_s'] = cuts[:, 0] / rate
    grains['duration_s'] = (cuts[:, 1] - cuts[:, 0]) / rate
    grains['x'] = grains['y'] = np.nan
    half = [lambda s: progress(0.3 * s), lambda s: progress(0.3 + 0.7 * s)]
    centroid, flatness, rolloff, sounding = _spectral(samples, rate, cuts, half[0])
    grains['centroid_mean_hz'], grains['flatness'], grains['rolloff95_hz'] = (
        centroid,
        flatness,
        rolloff,
    )
    grains['periodicity_mean'], grains['pitch_hz'] = _periodic(samples, rate, cuts, half[1])
    grains['rms_db'] = 10 * elementary.log10(np.maximum(_mean_square(samples, cuts), 1e-20))
    grains['loudness_lufs'] = lufs(_mean_square(samples, cuts, k_weighting(rate)))
    progress(1.0)
    return grains, ~sounding | (grains['rms_db'] < silence_db)


def frame_starts(cuts: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first sample of every frame and the grain it belongs to, both (m,) int64."""
    lengths = cuts[:, 1] - cuts[:, 0]
    counts = np.maximum((lengths - size) // HOP + 1, 1)
    owner = np.repeat(np.arange(len(cuts)), counts)
    nth = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return cuts[owner, 0] + nth * HOP, owner


def _batches(
    samples: np.ndarray,
    cuts: np.ndarray,
    size: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield (slice of frames, (k, size) frames); what lies past a grain's end is silence."""
    starts, owner = frame_starts(cuts, size)
    rest = max(len(samples) - size, 0)  # only what follows is copied, with silence behind it
    padded = np.concatenate([samples[rest:], np.zeros(size, samples.dtype)])
    last = np.lib.stride_tricks.sliding_window_view(padded, size)
    inside = np.lib.stride_tricks.sliding_window_view(samples, size) if rest else last
    room = cuts[owner, 1] - starts  # less than a frame only in short grains
    for i in range(0, len(starts), BATCH):
        part = slice(i, min(i + BATCH, len(starts)))
        frames = inside[np.minimum(starts[part], rest)].astype(np.float64)
        late = starts[part] > rest
        frames[late] = last[starts[part][late] - rest]
        if (room[part] < size).any():
            frames[np.arange(size) >= room[part, None]] = 0
        yield part, frames
        progress(part.stop / len(starts))


def _spectral(
    samples: np.ndarray, rate: int, cuts: np.ndarray, progress: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return centroid, flatness, roll-off (NaN where silent) and whether it sounds, per grain."""
    owner = frame_starts(cuts, FRAME)[1]
    rows = np.zeros((3, len(owner)))
    heard = np.zeros(len(owner), bool)
    window = 0.5 - 0.5 * elementary.cos(2 * np.pi * np.arange(FRAME) / FRAME)
    hz = np.arange(FRAME // 2 + 1) * rate / FRAME
    for part, frames in _batches(samples, cuts, FRAME, progress):
        spectrum = rfft(frames * window)
        magnitude = elementary.hypot(spectrum.real, spectrum.imag)
        total = magnitude.sum(axis=1)
        heard[part] = total >= SILENT_SUM
        rows[0, part] = (magnitude * hz).sum(axis=1) / np.maximum(total, SILENT_SUM)
        power = np.maximum(magnitude**2, 1e-10)
        rows[1, part] = elementary.exp(elementary.log(power).mean(axis=1)) / power.mean(axis=1)
        within = np.cumsum(magnitude, axis=1) < 0.95 * total[:, None]
        rows[2, part] = hz[np.minimum(within.sum(axis=1), FRAME // 2)]
    count = np.bincount(owner, heard, len(cuts))
    with np.errstate(invalid='ignore'):
        centroid, flatness, rolloff = (
            np.bincount(owner, np.where(heard, row, 0), len(cuts)) / count for row in rows
        )
    return centroid, flatness, rolloff, count > 0


def _periodic(
    samples: np.ndarray, rate: int, cuts: np.ndarray, progress: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean periodicity and median pitch (NaN where there is none), per grain."""
    owner = frame_starts(cuts, YIN_FRAME)[1]
    periodicity, pitch = np.zeros(len(owner)), np.zeros(len(owner))
    for part, frames in _batches(samples, cuts, YIN_FRAME, progress):
        periodicity[part], lag = yin(frames, rate)
        pitch[part] = rate / lag
    mean = np.bincount(owner, periodicity, len(cuts)) / np.bincount(owner, minlength=len(cuts))
    median = np.full(len(cuts), np.nan)
    clear = np.nonzero(periodicity > PITCHED)[0]
    for voiced in np.split(clear, np.nonzero(np.diff(owner[clear]))[0] + 1):
        if len(voiced):
            median[owner[voiced[0]]] = np.median(pitch[voiced])
    return mean, median


def yin(frames: np.ndarray, rate: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimate periodicity and pitch of frames.

    Parameters
    ----------
    frames : ndarray
        (k, 2048).
    rate : int
        Samples a second.

    Returns
    -------
    periodicity : ndarray
        (k,) 0..1.
    lag : ndarray
        (k,) period in samples, between samples by a parabola.

    References
    ----------
    A. de Cheveigne, H. Kawahara, "YIN, a fundamental frequency estimator for speech and music",
    J. Acoust. Soc. Am. 111 (2002) 1917.

    Examples
    --------
    >>> tone = np.sin(2 * np.pi * 480 * np.arange(2048) / 48000)
    >>> periodicity, lag = yin(tone[None], 48000)
    >>> float(lag[0].round(2)), bool(periodicity[0] > 0.99)
    (100.0, True)
    """
    k = len(frames)
    lags = YIN_FRAME - YIN_SPAN
    # c(t) = sum_j x_j x_(j+t), j < 1024: a circular transform of 2048 does not wrap up to t = 1024.
    head = np.zeros_like(frames)
    head[:, :YIN_SPAN] = frames[:, :YIN_SPAN]
    product = irfft(elementary.product(np.conj(rfft(head)), rfft(frames)), YIN_FRAME)[:, : lags + 1]
    energy = np.cumsum(np.pad(frames**2, ((0, 0), (1, 0))), axis=1)
    span = energy[:, YIN_SPAN:] - energy[:, :-YIN_SPAN]  # of x_t .. x_(t+1023)
    difference = np.maximum(span[:, :1] + span - 2 * product, 0)
    running = np.cumsum(difference[:, 1:], axis=1)
    # Of a pure tone or of silence only rounding is left: the floor makes that 1, not chance.
    floor = 1e-12 * YIN_SPAN * np.maximum(energy[:, -1:], 1e-20)
    normal = np.ones_like(difference)
    normal[:, 1:] = (difference[:, 1:] * np.arange(1, lags + 1) + floor) / (running + floor)
    shortest = max(2, int(rate / HIGHEST_HZ))
    longest = min(lags - 1, int(np.ceil(rate / LOWEST_HZ)))
    inner = normal[:, shortest : longest + 1]
    dip = inner <= normal[:, shortest - 1 : longest]
    dip[:, :-1] &= inner[:, :-1] <= inner[:, 1:]
    if longest < lags - 1:  # where the lags end with the frame, a fall up to there counts
        dip[:, -1] &= inner[:, -1] <= normal[:, longest + 1]
    depth = np.where(dip, inner, np.inf)
    low = depth < YIN_TOLERANCE
    at = np.where(low.any(axis=1), low.argmax(axis=1), depth.argmin(axis=1)) + shortest
    rows = np.arange(k)
    left, middle, right = normal[rows, at - 1], normal[rows, at], normal[rows, at + 1]
    bend = left - 2 * middle + right
    with np.errstate(divide='ignore', invalid='ignore'):
        shift = np.where(bend > 0, 0.5 * (left - right) / bend, 0.0)
    shift = np.clip(shift, -1, 1)
    value = np.where(dip.any(axis=1), middle - 0.25 * (left - right) * shift, 1.0)
    return np.clip(1 - value, 0, 1), at + shift


def _mean_square(
    samples: np.ndarray, cuts: np.ndarray, sections: np.ndarray | None = None
) -> np.ndarray:
    """Return the mean square of each cut, of the signal filtered by `sections` if there are any.

    Goes through the recording piece by piece, so that an hour of it needs no more than a minute.
    """
    edges = np.unique(cuts)
    energy = np.zeros(len(edges))  # of all that lies before the edge
    state = None if sections is None else np.zeros((len(sections), 2))
    total, reach = 0.0, 1 << 20
    for start in range(0, len(samples), reach):
        piece = samples[start : start + reach].astype(np.float64)
        if sections is not None:
            piece, state = sosfilt(sections, piece, zi=state)
        within = (edges > start) & (edges <= start + len(piece))
        summed = np.cumsum(piece**2)
        energy[within] = total + summed[edges[within] - start - 1]
        total += summed[-1]
    first, last = (energy[np.searchsorted(edges, cuts[:, i])] for i in (0, 1))
    return (last - first) / np.maximum(cuts[:, 1] - cuts[:, 0], 1)
