# SPDX-License-Identifier: Apache-2.0
"""Load a corpus while the show goes on: one thread, and the newest spec wins."""

import subprocess
import threading

from eol_ros import folders
from eol_ros.core.sound.corpus import Corpus
from eol_ros.devices.corpus import corpus_build, corpus_file
from eol_ros.devices.corpus.corpus_file import Options
from eol_ros.errors import EolError
from eol_ros.settings import GrainsSettings

CorpusSpec = tuple[str, Options]
Seen = tuple[CorpusSpec, list[tuple[str, int]]]  # when its files were changed


def corpus_spec(settings: GrainsSettings) -> CorpusSpec:
    """Return what the settings ask for; equal specs mean the same corpus."""
    return settings.sound, Options.of(settings)


class CorpusLoader:
    """`ask` in one thread, `take` the outcome in the same thread whenever it suits."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._outcome: Corpus | EolError | None = None
        self._child: subprocess.Popen | None = None
        self._thread: threading.Thread | None = None
        self._seen: Seen | None = None
        self._asked = 0

    def at_once(self, spec: CorpusSpec) -> Corpus | None:
        """Return the corpus without waiting, or None if it must be made first.

        Raises DeviceMissing if its sound is absent, ConfigError if it is no corpus.
        """
        self._seen = _look(spec)
        return corpus_build.ready(*spec)

    def ask(self, spec: CorpusSpec) -> None:
        """Begin to load; an older spec is given up."""
        self._seen = _look(spec)
        with self._lock:
            self._give_up()
            self._thread = threading.Thread(
                target=self._work, args=(spec, self._asked), name='corpus', daemon=True
            )
            self._thread.start()

    def changed(self, spec: CorpusSpec) -> bool:
        """Whether a file that the corpus is made of has changed since this was last asked."""
        seen = _look(spec)
        before, self._seen = self._seen, seen
        return before is not None and before[0] == spec and before[1] != seen[1]

    def take(self) -> Corpus | EolError | None:
        """Return the corpus last asked for, or why it cannot be had, once; else None."""
        with self._lock:
            outcome, self._outcome = self._outcome, None
            return outcome

    def close(self) -> None:
        """Give up whatever is being made."""
        with self._lock:
            self._give_up()
            thread = self._thread
        if thread is not None:
            thread.join(2.0)

    def _give_up(self) -> None:
        self._asked, self._outcome = self._asked + 1, None
        if self._child is not None and self._child.poll() is None:
            self._child.kill()

    def _work(self, spec: CorpusSpec, number: int) -> None:
        outcome = self._load(spec, number)
        with self._lock:
            if number == self._asked:
                self._child, self._outcome = None, outcome

    def _load(self, spec: CorpusSpec, number: int) -> Corpus | EolError:
        def started(child: subprocess.Popen) -> None:
            with self._lock:
                if number != self._asked:
                    child.kill()
                else:
                    self._child = child

        try:
            return corpus_build.apart(*spec, started)
        except EolError as error:
            return error
        except OSError as error:
            return EolError(f'{folders.cache("corpus")}: {error}')


def _look(spec: CorpusSpec) -> Seen:
    return spec, corpus_file.times(*spec)
