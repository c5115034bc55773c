# SPDX-License-Identifier: Apache-2.0
"""The audio of a corpus brought into memory, in a thread of its own: it may take seconds."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eol_ros.core.sound.mixer import Bank
from eol_ros.devices.audio_file import read_mono
from eol_ros.errors import ConfigError, EolError

KEPT = 3  # banks that voices may still read after a change of the corpus


def load_bank(
    files: Sequence[str],
    file: np.ndarray,
    start: np.ndarray,
    duration: np.ndarray,
    sample_rate: int,
) -> Bank:
    """Read the `files` at `sample_rate` and return the bank of the grains (g,) cut from them.

    Raises DeviceMissing if a file is gone, ConfigError if it cannot be read or a grain is outside.
    """
    if len(file) and (not files or np.max(file) >= len(files)):
        raise ConfigError(f'corpus: grain {int(np.argmax(file))} is of a file that is not listed')
    sounds = [read_mono(path, sample_rate).samples for path in files]
    for number, sound in enumerate(sounds):
        outside = (file == number) & (start * sample_rate >= len(sound))
        if outside.any():
            raise ConfigError(
                f'{files[number]}: grain {int(np.argmax(outside))} begins after its end; '
                'make the corpus anew'
            )
    return Bank(sounds, file, start, duration, sample_rate)


class BankLoader:
    """Loads banks behind the scenes, and knows which one a trigger speaks of.

    A corpus is told some time before triggers name its grains; until then those of the one before
    are meant. The last few banks are kept, for voices still read them.
    """

    def __init__(self, sample_rate: int):
        self._sample_rate = sample_rate
        self._lock = threading.Lock()
        self._entries: list[_Entry] = []  # in the order in which they were told
        self._news: list[EolError | None] = []

    def ask(self, digest: str, from_ns: int, *grains) -> bool:
        """Begin to load the corpus `digest`, of which triggers speak whose stamp is `from_ns` on.

        Return False if it was the last one asked for.
        """
        with self._lock:
            if self._entries and digest == self._entries[-1].digest:
                return False
            entry = _Entry(digest, from_ns)
            self._entries = [*self._entries[1 - KEPT :], entry]
        threading.Thread(target=self._load, args=(entry, grains), daemon=True).start()
        return True

    def at(self, stamp_ns: int) -> Bank | None:
        """Return the bank that a trigger with this stamp speaks of; None while it is not there.

        A stamp before all of them, as a replay has, means the first.
        """
        with self._lock:
            past = [e for e in self._entries if e.from_ns <= stamp_ns] or self._entries[:1]
            return past[-1].bank if past else None

    def news(self) -> list[EolError | None]:
        """Return once what came of each request since the last call: None if it was loaded."""
        with self._lock:
            news, self._news = self._news, []
            return news

    def _load(self, entry: '_Entry', grains) -> None:
        outcome: EolError | None = None
        bank = None
        try:
            bank = load_bank(*grains, self._sample_rate)
        except EolError as error:
            outcome = error
        except (OSError, MemoryError, ValueError) as error:  # said, not lost with the thread
            outcome = EolError(f'the sound of the corpus cannot be read: {error!r}')
        with self._lock:
            entry.bank = bank
            self._news.append(outcome)


@dataclass
class _Entry:
    digest: str
    from_ns: int
    bank: Bank | None = None
