# SPDX-License-Identifier: Apache-2.0
"""Read and write sound files through libsndfile: any format, rate and number of channels."""

import io
import math
import os
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

from eol_ros.core import elementary
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.said import said

BLOCK = 1 << 20  # samples read at a time: a long file never needs all its channels in memory
LAST = 1 << 12  # where a file breaks off, this many samples at most are lost before the break
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


def read_mono(path, rate: int | None = None) -> Sound:
    """Read a file as one channel, at its own rate or resampled (polyphase) to `rate`.

    A file that breaks off is read as far as it goes and says so in `notes`. Raises DeviceMissing if
    there is no file and ConfigError if it is not sound, holds none, or is shorter than 10 ms.
    """
    path = Path(path)
    samples, own_rate, channels, notes = _read(path)
    count = 0
    for start in range(0, len(samples), BLOCK):
        piece = samples[start : start + BLOCK]
        bad = ~(np.abs(piece) <= LOUDEST)  # not a number, too
        count += int(bad.sum())
        piece[bad] = 0
    if count > 0.01 * len(samples):
        raise ConfigError(
            f'{path}: {count} of {len(samples)} samples are beyond {LOUDEST:g} times full scale: '
            'whole numbers in a file of floats, or damaged; export it again with full scale 1.0'
        )
    if count:
        notes.append(
            f'{path}: {count} samples are not numbers or beyond {LOUDEST:g} times full scale; '
            'silence stands in for them'
        )
    if len(samples) < SHORTEST_S * own_rate:
        raise ConfigError(
            f'{path}: {len(samples)} samples at {own_rate} Hz are too short for a grain; '
            f'give a sound of at least {SHORTEST_S * 1e3:.0f} ms'
        )
    if rate is not None and rate != own_rate:
        samples, own_rate = resample(samples, own_rate, rate), rate
    return Sound(str(path), samples, own_rate, channels, tuple(notes))


def resample(samples: np.ndarray, rate_from: int, rate_to: int) -> np.ndarray:
    """Return (n,) float32 at another rate by an anti-aliased polyphase filter."""
    from scipy.signal import resample_poly  # 60 MB, needed only where rates differ

    most = max(rate_to, rate_from) // math.gcd(rate_to, rate_from)
    return resample_poly(samples, rate_to, rate_from, window=_low_pass(most)).astype(np.float32)


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
            for k in range(0, len(samples), LAST):  # libsndfile dies of a long piece of Vorbis
                file.write(samples[k : k + LAST])
    except (soundfile.LibsndfileError, OSError, ValueError, TypeError) as error:
        raise ConfigError(f'{path}: cannot write this sound ({error})') from None


def _read(path: Path) -> tuple[np.ndarray, int, int, list[str]]:
    if not path.is_file():
        raise DeviceMissing(said('no_sound_file', path=path))
    notes: list[str] = []
    try:
        with soundfile.SoundFile(_streamed(path) or os.fsencode(path)) as sound:
            samples = np.empty(sound.frames, np.float32)
            # Between two reads soundfile seeks, and a seek within MP3 is not exact: take it in one.
            count = _fill(samples, sound, sound.frames if sound.format == 'MPEG' else BLOCK)
            if count < sound.frames:
                with soundfile.SoundFile(os.fsencode(path)) as again:
                    count = _fill(samples, again, LAST, count)
                notes.append(
                    f'{path}: breaks off after {count / sound.samplerate:.2f} s of '
                    f'{sound.frames / sound.samplerate:.2f} s; only what is there is used'
                )
            rate, channels = sound.samplerate, sound.channels
    except (soundfile.LibsndfileError, TypeError) as error:
        raise ConfigError(
            f'{path}: not a sound that libsndfile reads ({_reason(error)}); '
            'give WAV, FLAC, OGG, AIFF or MP3'
        ) from None
    except (MemoryError, ValueError):
        raise ConfigError(f'{path}: claims to be longer than memory holds; cut it up') from None
    return samples[:count], rate, channels, notes


def _streamed(path: Path) -> io.BytesIO | None:
    """Return the content of a WAV whose data has size 0, as a recorder that was cut off leaves it.

    The size is then that of the rest of the file. None for any other file.
    """
    with path.open('rb') as file:
        head = file.read(4096)
        if head[:4] != b'RIFF' or head[8:12] != b'WAVE':
            return None
        at = 12
        while at + 8 <= len(head):
            kind, size = struct.unpack_from('<4sI', head, at)
            if kind == b'data':
                rest = file.seek(0, os.SEEK_END) - at - 8
                if size or rest <= 0:
                    return None
                file.seek(0)
                data = bytearray(file.read())
                struct.pack_into('<I', data, at + 4, min(rest, 0xFFFFFFFF))
                struct.pack_into('<I', data, 4, min(len(data) - 8, 0xFFFFFFFF))
                return io.BytesIO(data)
            at += 8 + size + size % 2
    return None


def _fill(out: np.ndarray, sound: soundfile.SoundFile, size: int, start: int = 0) -> int:
    """Write the mean of the channels from `start` on, as far as it goes; return how far that is."""
    try:
        if start:
            sound.seek(start)
        while len(block := sound.read(size, dtype='float32', always_2d=True)):
            end = min(start + len(block), len(out))
            out[start:end] = block[: end - start].mean(axis=1, dtype=np.float32)
            if end == len(out):
                return end
            start = end
    except soundfile.LibsndfileError:
        pass  # broken off: what was read before stands
    return start


def _reason(error: Exception) -> str:
    return str(getattr(error, 'error_string', error)).strip().rstrip('.')
