# SPDX-License-Identifier: Apache-2.0
"""The audio of a corpus brought into memory, in a thread of its own: it may take seconds."""

import threading
from collections.abc import Sequence

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
    """Loads banks behind the scenes and keeps the last few alive, for voices still read them."""

    def __init__(self, sample_rate: int):
        self._sample_rate = sample_rate
        self._kept: list[Bank] = []
        self._lock = threading.Lock()
        self._wanted = ''
        self._outcome: tuple[str, Bank | EolError] | None = None

    def ask(self, digest: str, *grains) -> bool:
        """Begin to load the corpus `digest`; return False if it was the last one asked for."""
        with self._lock:
            if digest == self._wanted:
                return False
            self._wanted = digest
        threading.Thread(target=self._load, args=(digest, grains), daemon=True).start()
        return True

    def take(self) -> Bank | EolError | None:
        """Return what came of the last request, once; None while there is no news."""
        with self._lock:
            outcome, self._outcome = self._outcome, None
            if outcome is None or outcome[0] != self._wanted:
                return None
            if isinstance(outcome[1], Bank):
                self._kept = self._kept[1 - KEPT :] + [outcome[1]]
            return outcome[1]

    def _load(self, digest: str, grains) -> None:
        try:
            outcome: Bank | EolError = load_bank(*grains, self._sample_rate)
        except EolError as error:
            outcome = error
        with self._lock:
            if digest == self._wanted:
                self._outcome = (digest, outcome)
