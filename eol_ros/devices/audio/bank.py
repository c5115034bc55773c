# SPDX-License-Identifier: Apache-2.0
"""The audio of a corpus brought into memory, in a thread of its own: it may take seconds."""

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eol_ros.core.sound.bank import Bank
from eol_ros.core.sound.mixer_layout import GUARD
from eol_ros.devices.audio.audio_file import read_mono
from eol_ros.errors import ConfigError, EolError

KEPT = 3  # corpora that triggers on their way may still speak of
RETRY_S = 3.0  # after a sound that could not be read


def load_bank(
    files: Sequence[str],
    file: np.ndarray,
    start: np.ndarray,
    duration: np.ndarray,
    sample_rate: int,
    places: np.ndarray | None = None,
    descriptors: Mapping[str, np.ndarray] | None = None,
    left_out: Callable[[EolError], None] = lambda error: None,
) -> Bank:
    """Read the `files` at `sample_rate` and return the bank of the grains (g,) cut from them.

    `places` (g, 2): where on the table each lies, m; `descriptors`: values (g,) by name. Grains of
    a file that cannot be read, or ends before them, are silent; `left_out` is called with the
    reason. Raises DeviceMissing or ConfigError if no file is left.
    """
    if len(file) and (not files or np.max(file) >= len(files)):
        raise ConfigError(f'corpus: grain {int(np.argmax(file))} is of a file that is not listed')
    sounds, errors = [], []
    for number, path in enumerate(files):
        try:
            sound = read_mono(path, sample_rate, GUARD).samples
            outside = (file == number) & (start * sample_rate >= len(sound))
            if outside.any():
                raise ConfigError(
                    f'{path}: grain {int(np.argmax(outside))} begins after its end; '
                    'make the corpus again'
                )
        except EolError as error:
            errors.append(error)
            end_s = (start + duration)[file == number].max(initial=0.0)
            size = math.ceil(end_s * sample_rate) + 1 + 2 * GUARD
            sound = np.zeros(size, np.float32)[GUARD:-GUARD]
        sounds.append(sound)
    if errors and len(errors) == len(files):
        raise errors[0]
    for each in errors:
        left_out(each)
    return Bank(sounds, file, start, duration, sample_rate, places, descriptors, True)


class BankLoader:
    """Loads banks behind the scenes, and knows which one a trigger speaks of.

    A corpus is told some time before triggers name its grains; until then those of the one before
    are meant. One that cannot be read is tried again for as long as it is wanted. `here` maps the
    files of the corpus to paths on this machine.
    """

    def __init__(self, sample_rate: int, here: Callable[[Sequence[str]], list[str]] = list):
        self._sample_rate, self._here = sample_rate, here
        self._lock = threading.Lock()
        self._reading = threading.Lock()  # one at a time: a long recording fills the memory
        self._closed = threading.Event()
        self._entries: list[_Entry] = []  # in the order in which they were told
        self._news: list[EolError | None] = []

    def ask(
        self,
        digest: str,
        from_ns: int,
        *grains: Any,
        places: np.ndarray | None = None,
        descriptors: Mapping[str, np.ndarray] | None = None,
    ) -> bool:
        """Begin to load the corpus `digest`, of which triggers speak whose stamp is `from_ns` on.

        `places` (g, 2): where on the table each grain lies, m; `descriptors`: values (g,) by name.
        Return False if it was the last one asked for.
        """
        with self._lock:
            if self._entries and digest == self._entries[-1].digest:
                return False
            entry = _Entry(digest, from_ns, grains, places, descriptors)
            self._entries = [*self._entries[1 - KEPT :], entry]
        threading.Thread(target=self._load, args=(entry,), daemon=True).start()
        return True

    def at(self, stamp_ns: int) -> Bank | None:
        """Return the bank that a trigger with this stamp speaks of; None while it is not there.

        A stamp before all of them, as a replay has, means the first.
        """
        with self._lock:
            past = [e for e in self._entries if e.from_ns <= stamp_ns] or self._entries[:1]
            return past[-1].bank if past else None

    def time_jumped(self, jump_ns: int) -> None:
        """The clock of stamps was set by `jump_ns`: so is from when each corpus counts."""
        with self._lock:
            for entry in self._entries:
                entry.from_ns += jump_ns

    def news(self) -> list[EolError | None]:
        """Return once what came of each request since the last call: None if it was loaded."""
        with self._lock:
            news, self._news = self._news, []
            return news

    def close(self) -> None:
        """Try no more."""
        self._closed.set()

    def _load(self, entry: '_Entry') -> None:
        told = ''
        while entry in self._entries and not self._closed.is_set():
            outcome: EolError | None = None
            try:
                with self._reading:
                    self._read(entry)
            except EolError as error:
                outcome = error
            except (OSError, MemoryError, ValueError) as error:  # said, not lost with the thread
                outcome = EolError(f'the sound of the corpus cannot be read: {error!r}')
            with self._lock:
                if outcome is None or str(outcome) != told:
                    self._news += entry.left_out[:1] or [outcome]
            if outcome is None:
                return
            told = str(outcome)
            self._closed.wait(RETRY_S)

    def _read(self, entry: '_Entry') -> None:
        told, file, start, duration = entry.grains
        files = self._here(told)
        entry.key = [(f, os.stat(f).st_mtime_ns) for f in files if os.path.isfile(f)]
        entry.key += [cut.tobytes() for cut in (file, start, duration)]
        for other in self._entries:  # a grain was moved: the same sound, cut alike
            if other.bank is not None and other.key == entry.key:
                entry.bank = other.bank
                if entry.places is not None:
                    entry.bank = other.bank.placed(entry.places, entry.descriptors)
                return
        entry.bank = load_bank(
            files, file, start, duration, self._sample_rate, entry.places, entry.descriptors,
            entry.left_out.append,
        )  # fmt: skip


@dataclass(eq=False)
class _Entry:
    digest: str
    from_ns: int
    # what load_bank takes, but for the rate
    grains: tuple[Sequence[str], np.ndarray, np.ndarray, np.ndarray]
    places: np.ndarray | None = None
    descriptors: Mapping[str, np.ndarray] | None = None
    bank: Bank | None = None
    key: list | None = None  # equal keys, equal banks
    left_out: list[EolError] = field(default_factory=list)
