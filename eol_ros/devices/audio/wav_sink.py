# SPDX-License-Identifier: Apache-2.0
"""A WAV file where there is no sound card: a thread that keeps the pace of one.

Its clock is exact, and its frames lie on the same grid as those of `eol render`, which begins with
each whole second; so the file holds, bit for bit, what the triggers of the run are rendered to.
The file's header is kept true while it grows: a run that is killed leaves a file that plays.
"""

import contextlib
import math
import shutil
import threading
import time
import wave
from pathlib import Path

import numpy as np

from eol_ros.core.sound.clock import RELOCK_S, set_clock
from eol_ros.core.sound.mixer import Mixer
from eol_ros.devices.audio.callback import turn
from eol_ros.devices.carrier_thread import carrier_thread
from eol_ros.errors import ConfigError

BEHIND_S = 0.5  # further behind than this is not made up for: the samples in between are left out
LOOKS = 10  # at both clocks at most, until there is no pause between them
HEADER_S = 1.0  # how often the header is brought up to date
RETRY_S = 10.0  # time from a write error to the next file
ROOM_BYTES = 64 << 20  # free space that the next file needs


class WavSink:
    """Renders `mixer` in real time into the file `path`, 16 bit; without a path, into nothing."""

    latency_s = 0.0

    def __init__(self, mixer: Mixer, path: str | Path | None, block_size: int, limit_s: float):
        self.path = free_name(Path(path)) if path else None
        self.name = str(self.path) if self.path else 'nothing'
        self.full = False  # the file has reached its limit; the pace goes on without it
        self._mixer, self._block_size = mixer, block_size
        self._limit, self._written = int(limit_s * mixer.sample_rate), 0
        self._header_every = int(HEADER_S * mixer.sample_rate)
        turn(mixer.address, np.zeros((0, mixer.channels), np.float32), 0)  # compile before
        self._file = _open(self.path, mixer) if self.path else None
        self._again_s: float | None = None  # when to begin the next file after a write error
        self._stop = threading.Event()
        # One that is put aside while it has Python's lock holds up those who bring triggers.
        self._thread = carrier_thread('wav sink', self._run)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it still makes samples."""
        return self._thread.is_alive()

    @property
    def writes(self) -> bool:
        """Whether the samples go into a file."""
        return self._file is not None

    def close(self, timeout_s: float = 2.0) -> bool:
        """Stop and close the file; return whether that was done in time."""
        self._stop.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        mixer = self._mixer
        out = np.zeros((self._block_size, mixer.channels), np.float32)
        period_s = self._block_size / mixer.sample_rate
        begun_s, offset_s = self._begin(time.monotonic())
        blocks = 0
        while not self._stop.is_set():
            due_s = begun_s + blocks * period_s
            late_s = time.monotonic() - due_s
            if late_s > BEHIND_S:
                mixer.state['underruns'] += 1
                begun_s, offset_s = self._begin(time.monotonic())
                blocks = 0
            elif late_s < 0:
                self._stop.wait(-late_s)
                now_s, unsure_s = _clock_offset()
                if abs(now_s - offset_s) > RELOCK_S + unsure_s:  # the system clock was set
                    begun_s, offset_s = self._begin(due_s)
                    blocks = 0
            turn(mixer.address, out, 0)
            blocks += 1
            if self._file is None and self._again_s is not None:
                self._reopen(time.monotonic())
            if self._file is not None:
                self._write(self._file, out)
        self._finish()

    def _begin(self, now_s: float) -> tuple[float, float]:
        """Set the mixer's clock: its next frame is the first of the grid from `now_s` on.

        Return when that is, and how far the system clock is ahead, both by the monotonic clock.
        """
        rate, epoch_s = self._mixer.sample_rate, float(self._mixer.state['epoch'][0])
        offset_s = _clock_offset()[0]
        first = math.ceil((now_s + offset_s - epoch_s) * rate)
        set_clock(self._mixer.state, first / rate)
        return first / rate + epoch_s - offset_s, offset_s

    def _write(self, file: wave.Wave_write, out: np.ndarray) -> None:
        before = self._written
        self._written += len(out)
        try:
            file.writeframesraw(np.round(np.clip(out, -1, 1) * 32767).astype('<i2').tobytes())
            if self._written // self._header_every > before // self._header_every:
                file.writeframes(b'')  # brings the header up to date
            if self._written >= self._limit:
                self._finish()
                self.full = True
        except OSError as error:  # disk full: the show goes on, and says so
            self.name = f'nothing ({self.path}: {error.strerror})'
            self._again_s = time.monotonic() + RETRY_S if self.path else None
            self._finish()

    def _reopen(self, now_s: float) -> None:
        """Begin another file once the disk has room again; the limit counts all files."""
        assert self._again_s is not None and self.path is not None
        if now_s < self._again_s:
            return
        self._again_s = now_s + RETRY_S
        try:
            if shutil.disk_usage(self.path.parent).free < ROOM_BYTES:
                return
            path = free_name(self.path)
            self._file = _open(path, self._mixer)
        except (OSError, ConfigError):
            return
        self.path, self.name, self._again_s = path, str(path), None

    def _finish(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                file.close()


def _clock_offset() -> tuple[float, float]:
    """Return how far the system clock is ahead of the monotonic one, and by how much that errs.

    A thread that is put aside between two looks would take the pause for a clock that was set.
    """
    best = 0.0, math.inf
    for _ in range(LOOKS):
        before_s = time.monotonic()
        system_s = time.time()
        after_s = time.monotonic()
        if after_s - before_s < best[1]:
            best = system_s - (before_s + after_s) / 2, after_s - before_s
        if best[1] < RELOCK_S / 10:
            break
    return best


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
