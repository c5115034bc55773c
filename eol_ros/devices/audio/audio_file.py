# SPDX-License-Identifier: Apache-2.0
"""Read and write sound files through libsndfile: any format, rate and number of channels."""

import itertools
import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

from eol_ros.core import elementary
from eol_ros.disk import check_file
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import said

BLOCK = 1 << 20  # samples read at a time: a long file never needs all its channels in memory
FRAME = 1152  # samples of a frame of MP3: a read that meets damage drops what it has before
MOST_TRIES = 1000  # reads that fail in a row, 1 KB each: more is the end of an MP3 (chosen)
WRITTEN = 1 << 12  # samples written at a time: libsndfile dies of a long piece of Vorbis
RATES = 1000, 1_000_000  # Hz, of recordings (chosen): hydrophones to laboratory cards
LONGEST_PERIOD = 200_000  # samples, of two rates together: bounds the filter that resamples
ROOM = 160e6  # bytes that a sound may take in memory, beside twice the size of its file
UNRECOGNISED = 1, 7  # errors of libsndfile: no format, no MP3
UNKNOWN_SIZE = 0x7FFF_0000  # from here on the size in a header is what a stream has for one
KAISER, BESSEL_TERMS = 5.0, 26  # SciPy's default shape; terms of the series up to 1e-20
SET_ADD_PEAK_CHUNK = 0x1050  # command of libsndfile
LOUDEST = 16.0  # +24 dB over full scale (chosen): floats may exceed 1, but nobody means more
SHORTEST_S = 0.01  # shorter than this is no sound to make grains of


@dataclass(frozen=True)
class Sound:
    """One channel of sound: the mean of all channels of a file."""

    path: str
    samples: np.ndarray  # (n,) float32, full scale = 1
    rate: int  # samples per second
    channels: int  # how many the file has
    notes: tuple[str, ...] = ()  # what was wrong with the file yet could be lived with

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return len(self.samples) / self.rate


def read_mono(path, rate: int | None = None, guard: int = 0) -> Sound:
    """Read a file as one channel, at its own rate or resampled (polyphase) to `rate`.

    `guard` samples of silence lie before and behind `samples` in the same memory. A file that
    breaks off is read as far as it goes and says so in `notes`. Raises DeviceMissing if there is
    no file and ConfigError if it is not sound, holds none, or is shorter than 10 ms.
    """
    path = Path(path)
    check_file(path)
    if not path.is_file():
        raise DeviceMissing(said('no_sound_file', path=path))
    notes: list[str] = []
    try:
        with soundfile.SoundFile(os.fsencode(path)) as sound:
            own_rate, channels = sound.samplerate, sound.channels
            rate = rate or own_rate
            _check(path, sound, rate)
            taken = _Pieces(sound)
            pieces = taken if rate == own_rate else resampled(taken, own_rate, rate)
            memory = np.zeros(-(-sound.frames * rate // own_rate) + 2 * guard, np.float32)
            at = guard
            for piece in pieces:
                memory[at : at + len(piece)] = piece
                at += len(piece)
            count, whole = taken.count, _said_frames(sound)
            if count < whole:
                broken = 'can be decoded for' if taken.framed else 'breaks off after'
                notes.append(
                    f'{path}: {broken} {count / own_rate:.2f} s of '
                    f'{whole / own_rate:.2f} s; only what is there is used'
                )
            elif 'lacks an end-of-stream bit' in sound.extra_info:  # of Ogg
                notes.append(
                    f'{path}: breaks off after {count / own_rate:.2f} s; only what is there is used'
                )
    except (soundfile.LibsndfileError, TypeError) as error:
        raise ConfigError(
            f'{path}: not a sound that libsndfile reads ({_reason(path, error)}); '
            'give WAV, FLAC, OGG, AIFF or MP3'
        ) from None
    except (MemoryError, ValueError):
        raise ConfigError(f'{path}: claims to be longer than memory holds; cut it up') from None
    if taken.bad > 0.01 * count:
        raise ConfigError(
            f'{path}: {taken.bad} of {count} samples are beyond {LOUDEST:g} times full scale: '
            'whole numbers in a file of floats, or damaged; export it again with full scale 1.0'
        )
    if taken.bad:
        notes.append(
            f'{path}: {taken.bad} samples are not numbers or beyond {LOUDEST:g} times full scale; '
            'silence stands in for them'
        )
    if count < SHORTEST_S * own_rate:
        why = f'give a sound of at least {SHORTEST_S * 1e3:.0f} ms'
        if not whole:  # the header of an interrupted recording
            why += ', or repair its header: ffmpeg -i IN.wav OUT.wav'
        if notes:
            why = notes[0].removeprefix(f'{path}: ').partition(';')[0]
        raise ConfigError(
            f'{path}: {count} samples at {own_rate} Hz are too short for a grain; {why}'
        )
    return Sound(str(path), memory[guard:at], rate, channels, tuple(notes))


def outline(path, start_s: float, duration_s: float, count: int) -> np.ndarray:
    """Return the least and greatest sample of each of `count` parts of a stretch of a sound.

    (count, 2) float32, of the mean of all channels; 0 behind the end of the file. Raises
    DeviceMissing if there is no file and ConfigError if it is not sound.
    """
    path = Path(path)
    if not path.is_file():
        raise DeviceMissing(said('no_sound_file', path=path))
    found = np.zeros((count, 2), np.float32)
    try:
        with soundfile.SoundFile(os.fsencode(path)) as sound:
            edges = np.linspace(start_s, start_s + duration_s, count + 1) * sound.samplerate
            for part, (begin, end) in zip(found, itertools.pairwise(edges.round()), strict=True):
                sound.seek(min(int(begin), sound.frames))
                piece = sound.read(min(int(end - begin), BLOCK), np.float32, always_2d=True)
                if len(piece):
                    samples = piece.mean(axis=1)
                    part[:] = samples.min(), samples.max()
    except (soundfile.LibsndfileError, TypeError) as error:
        raise ConfigError(f'{path}: not a sound ({_reason(path, error)})') from None
    return np.nan_to_num(found, posinf=0.0, neginf=0.0)


def resampled(pieces: Iterable[np.ndarray], rate_from: int, rate_to: int) -> Iterator[np.ndarray]:
    """Yield the pieces of one sound at another rate, by an anti-aliased polyphase filter.

    float32, a step at a time.
    """
    from scipy.signal import resample_poly  # 60 MB, needed only where rates differ

    up, down = (rate // math.gcd(rate_to, rate_from) for rate in (rate_to, rate_from))
    window = _low_pass(max(up, down))
    margin = down * math.ceil(20 * max(up, down) / up / down)  # what the filter reaches, and more
    step = down * max(BLOCK // down, 1)  # SciPy takes 8 bytes a sample
    held, begin, start = np.zeros(0, np.float32), 0, 0  # the sound from sample `begin` on
    for piece in itertools.chain(pieces, [None]):
        if piece is not None:
            held = np.concatenate([held, piece])
        end = begin + len(held)
        while start < end and (piece is None or start + step + margin <= end):
            first = max(start - margin, 0)
            made = resample_poly(
                held[first - begin : start + step + margin - begin], up, down, window=window
            )
            skipped, last = (start - first) * up // down, min(start + step, end) - start
            yield made[skipped : skipped - (-last * up // down)].astype(np.float32)
            start += step
        kept = max(start - margin, 0)
        held, begin = held[kept - begin :], kept


def _low_pass(period: int) -> np.ndarray:
    """Return SciPy's default filter of `resample_poly`, with the same bits on every machine.

    (20 period + 1,), of unit sum: sin(t) / t with a zero every `period`, in a Kaiser window.
    """
    t = np.arange(-10 * period, 10 * period + 1) / period
    angle = np.pi * np.where(t == 0.0, 1.0, t)
    taps = np.where(t == 0.0, 1.0, elementary.sin(angle) / angle)
    quarter = 0.25 * KAISER * KAISER * np.maximum(1.0 - (t / 10.0) * (t / 10.0), 0.0)
    bessel = term = np.ones(len(t))  # power series of I0
    for k in range(1, BESSEL_TERMS):
        term = term * quarter / (k * k)
        bessel = bessel + term
    taps *= bessel
    return taps / taps.sum()


def without_time(file: soundfile.SoundFile) -> soundfile.SoundFile:
    """Turn off libsndfile's PEAK chunk, which has a time stamp, in a new file; return the file."""
    soundfile._snd.sf_command(file._file, SET_ADD_PEAK_CHUNK, soundfile._ffi.NULL, 0)
    return file


def write(path, samples: np.ndarray, rate: int, subtype: str | None = None) -> None:
    """Write (n,) or (n, channels) to a file whose ending names the format."""
    channels = 1 if samples.ndim == 1 else samples.shape[1]
    try:
        with without_time(
            soundfile.SoundFile(os.fsencode(path), 'w', rate, channels, subtype=subtype)
        ) as file:
            for k in range(0, len(samples), WRITTEN):
                file.write(samples[k : k + WRITTEN])
    except (soundfile.LibsndfileError, OSError, ValueError, TypeError) as error:
        raise ConfigError(f'{path}: cannot write this sound ({error})') from None


def _check(path: Path, sound: soundfile.SoundFile, wanted: int) -> None:
    """Raise ConfigError where rate or length of a sound are beyond what can be meant.

    wanted: the rate at which its samples are to be, in Hz.
    """
    rate, count = sound.samplerate, sound.frames
    if not RATES[0] <= rate <= RATES[1]:
        raise ConfigError(
            f'{path}: its header says {rate} samples a second; sounds have {RATES[0]} to '
            f'{RATES[1]}; export it again'
        )
    if max(rate, wanted) // math.gcd(rate, wanted) > LONGEST_PERIOD:
        raise ConfigError(
            f'{path}: {rate} samples a second are no usual rate; export it again at {wanted}'
        )
    taken = 4 * count * max(rate, wanted) // rate
    if taken > 2 * path.stat().st_size + ROOM:
        raise ConfigError(
            f'{path}: {count / rate / 60:.0f} min of sound take {taken * 1e-6:.0f} MB of memory '
            'when decoded, too much for a file of this size; cut it up, or export it as WAV'
        )


def _said_frames(sound: soundfile.SoundFile) -> int:
    """Return how many samples the header speaks of; libsndfile counts those that are there."""
    said = re.search(r'\b(?:data|SSND) *: (\d+) \(should be (\d+)\)', sound.extra_info)
    size, there = map(int, said.groups()) if said else (0, 0)
    cut = there < size < UNKNOWN_SIZE
    return round(sound.frames * size / there) if cut and there else sound.frames


class _Pieces:
    """The mean of the channels of a sound, piece by piece, as far as it goes.

    soundfile seeks between reads, which is not exact within MP3, and drops what precedes damage.
    """

    def __init__(self, sound: soundfile.SoundFile):
        self._sound = sound
        self.framed = sound.format == 'MP3'  # it goes on behind damage
        self.count = 0  # samples so far
        self.bad = 0  # of them, not numbers or too loud: silence stands in for them

    def __iter__(self) -> Iterator[np.ndarray]:
        sound, whole = self._sound, self._sound.frames
        block = np.empty((min(BLOCK, whole), sound.channels), np.float32)
        while count := self._fill(block[: whole - self.count]):
            piece = block[:count].mean(axis=1, dtype=np.float32)
            bad = ~(np.abs(piece) <= LOUDEST)  # not a number, too
            piece[bad] = 0
            self.count += count
            self.bad += int(bad.sum())
            yield piece

    def _fill(self, block: np.ndarray) -> int:
        """Read samples into `block`; return how many, 0 where the sound ends or breaks off."""
        step, tries = (FRAME, MOST_TRIES) if self.framed else (len(block), 1)
        filled = failed = 0
        while filled < len(block) and failed < tries:
            part = block[filled : filled + step]
            place = soundfile._ffi.cast('float *', soundfile._ffi.from_buffer(part))
            count = soundfile._snd.sf_readf_float(self._sound._file, place, len(part))
            failed, filled = (0, filled + count) if count > 0 else (failed + 1, filled)
        return filled


def _reason(path: Path, error: Exception) -> str:
    """Return the first fact about a file that is no sound."""
    with path.open('rb') as file:
        head = file.read(4096)
    if not head.strip(b'\0'):
        return 'only zero bytes, as a power cut leaves' if head else 'it is empty'
    if isinstance(error, TypeError):
        return 'samples without a header, so their rate is unknown'
    if head.startswith(b'ID3'):
        return 'a tag of ID3 without the MP3 that it says lies behind it'
    if getattr(error, 'code', 0) in UNRECOGNISED:
        return f'it begins with {head[:12]!r}'
    return str(getattr(error, 'error_string', error)).strip().rstrip('.')
