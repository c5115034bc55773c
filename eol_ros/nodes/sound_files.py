# SPDX-License-Identifier: Apache-2.0
"""Audio files of the corpus on the machines of `grains` and `sound`: located and compared."""

import contextlib
import hashlib
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eol_msgs.msg import NodeState

from eol_ros.devices.files.names import stamp
from eol_ros.errors import DeviceMissing, EolError
from eol_ros.said import said
from eol_ros.streams.requests import values_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

KEY = 'files_sha256'  # in the state of `grains`: digests of the paths, and of the contents
UNREAD = '-'  # a file cannot be read, which the node itself reports


class SoundFiles:
    """`grains` publishes digests of its files in its state; `sound` on another machine compares."""

    def __init__(self, node: 'EolNode'):
        self._node, scene = node, node.scene
        self._machine = scene.machine_of('grains')
        self._apart = self._machine != scene.machine_of('sound')
        self._wanted: list[str] = []
        self._reader: threading.Thread | None = None
        self._marks: list[tuple] = []  # of the files that were read last
        self._here = self._there = ''
        if self._apart and node.NAME == 'grains':
            node.health.values[KEY] = ''  # here: a thread may not insert what others iterate over
        if self._apart and node.NAME == 'sound':
            node.on_states(self._hear)

    def here(self, files: Sequence[str]) -> list[str]:
        """Return the paths of the files of `grains` on this machine.

        A path stays the same if a file is there. Else it is a sound of the scene with that name,
        first in a folder of the same name. Raises ConfigError if the ice recording cannot be made.
        """
        if not self._apart or all(map(os.path.isfile, files)):
            return list(files)
        from eol_ros.devices.corpus.corpus_build import of_this_machine
        from eol_ros.devices.corpus.corpus_file import Options, all_sounds

        settings, sounds, found = self._node.scene.settings('grains'), [], []
        # the loader of the files reports what is missing
        with contextlib.suppress(EolError, OSError):
            sounds = all_sounds(settings.sound, Options.of(settings))
        for file in files:
            there = of_this_machine(file)
            if not os.path.isfile(there):
                same = [each for each in sounds if each.name == there.name]
                there = max(same, key=lambda s: s.parent.name == there.parent.name, default=there)
            found.append(str(there))
        return found

    def look(self, files: Sequence[str]) -> None:
        """Begin to read the files of a corpus, in a thread, if the nodes are on two machines."""
        busy = self._reader is not None and self._reader.is_alive()
        if not self._apart or (busy and self._wanted == list(files)):
            return
        self._wanted = list(files)
        self._reader = threading.Thread(target=self._read, args=(self._wanted,), daemon=True)
        self._reader.start()

    @property
    def trouble(self) -> str:
        """Report of files that differ; '' while none does, or not all have been read."""
        here, there = self._here.split(), self._there.split()
        same_paths = here[:1] == there[:1]  # else of another corpus, or not read yet
        if not same_paths or here == there or UNREAD in (*here, *there):
            return ''
        return said('other_sounds', machine=self._machine)

    def _read(self, files: list[str]) -> None:
        from eol_ros.devices.corpus.corpus_file import sha256

        here = files
        with contextlib.suppress(EolError):  # the loader of the files reports it
            here = self.here(files)
        marks = [(file, *stamp(file)) for file in (*files, *here)]
        if marks == self._marks:
            return
        paths, content = hashlib.sha256(os.fsencode('\n'.join(files))).hexdigest(), hashlib.sha256()
        unread = False
        for file in here:
            try:
                content.update(sha256(Path(file)).encode())
            except DeviceMissing:
                unread = True
            if files is not self._wanted:
                return
        if files is not self._wanted:  # of no files
            return
        self._marks = marks
        self._here = f'{paths[:8]} {UNREAD if unread else content.hexdigest()[:8]}'
        if self._node.NAME == 'grains':
            self._node.health.values[KEY] = self._here

    def _hear(self, state: NodeState) -> None:
        if state.node == 'grains':
            self._there = str(values_of(state.values).get(KEY, ''))
