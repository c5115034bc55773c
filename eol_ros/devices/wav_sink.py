# SPDX-License-Identifier: Apache-2.0
"""A WAV file where there is no sound card: a thread that keeps the pace of one.

The file's header is kept true while it grows: a run that is killed leaves a file that plays.
"""

import threading
import time
import wave
from pathlib import Path

import numpy as np

from eol_ros.core.sound.mixer import Mixer
from eol_ros.devices.sound_callback import turn
from eol_ros.errors import ConfigError

BEHIND_S = 0.5  # further behind than this is not made up for: the samples in between are left out
HEADER_S = 1.0  # how often the header is brought up to date


class WavSink:
    """Renders `mixer` in real time into the file `path`, 16 bit; without a path, into nothing."""

    latency_s = 0.0

    def __init__(self, mixer: Mixer, path: str | Path | None, block_size: int, limit_s: float):
        self.path = free_name(Path(path)) if path else None
        self.name = str(self.path) if self.path else 'nothing'
        self.full = False  # the file has reached its limit; the pace goes on without it
        self._mixer, self._block_size = mixer, block_size
        self._limit = int(limit_s * mixer.sample_rate)
        self._file = _open(self.path, mixer) if self.path else None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='wav sink', daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it still makes samples."""
        return self._thread.is_alive()

    def close(self, timeout_s: float = 2.0) -> bool:
        """Stop and close the file; return whether that was done in time."""
        self._stop.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        mixer, size = self._mixer, self._block_size
        out = np.zeros((size, mixer.channels), np.float32)
        period_s = size / mixer.sample_rate
        due_s = time.monotonic()
        written, unsaved = 0, 0
        try:
            while not self._stop.is_set():
                late_s = time.monotonic() - due_s
                if late_s > BEHIND_S:
                    mixer.state['underruns'] += 1
                    due_s += late_s
                elif late_s < 0:
                    self._stop.wait(-late_s)
                turn(mixer.address, out, 0)
                due_s += period_s
                if self._file is None:
                    continue
                pcm = np.round(np.clip(out, -1, 1) * 32767).astype('<i2')
                self._file.writeframesraw(pcm.tobytes())
                written, unsaved = written + size, unsaved + size
                if unsaved >= HEADER_S * mixer.sample_rate:
                    self._file.writeframes(b'')
                    unsaved = 0
                if written >= self._limit:
                    self._finish()
                    self.full = True
        except OSError as error:  # disk full: the show goes on, and says so
            self.name = f'nothing ({self.path}: {error.strerror})'
            self._file = None
        finally:
            self._finish()

    def _finish(self) -> None:
        if self._file is not None:
            file, self._file = self._file, None
            file.close()


def free_name(path: Path) -> Path:
    """Return `path`, or the same with a number where that exists already."""
    count, free = 1, path
    while free.exists():
        free = path.with_stem(f'{path.stem}-{count}')
        count += 1
    return free


def _open(path: Path, mixer: Mixer) -> wave.Wave_write:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = wave.open(str(path), 'wb')  # noqa: SIM115 (open for the whole run)
    except OSError as error:
        raise ConfigError(
            f'{path}: cannot write the sound here ({error.strerror}); set sound.wav to another file'
        ) from None
    file.setnchannels(mixer.channels)
    file.setsampwidth(2)
    file.setframerate(int(mixer.sample_rate))
    return file
