# SPDX-License-Identifier: Apache-2.0
"""Audio files of the corpus on the machines of `grains` and of `sound`, compared by content."""

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eol_msgs.msg import NodeState

from eol_ros.errors import DeviceMissing
from eol_ros.said import said
from eol_ros.streams.requests import values_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

KEY = 'files_sha256'  # in the state of `grains`: lines of digest and path


class SoundFiles:
    """`grains` publishes digests of its files in its state; `sound` on another machine compares."""

    def __init__(self, node: 'EolNode'):
        self._node, scene = node, node.scene
        self._machine = scene.machine_of('grains')
        self._apart = self._machine != scene.machine_of('sound')
        self._files: list[str] = []
        self._here: set[str] = set()
        self._there: set[str] = set()
        if self._apart and node.NAME == 'sound':
            node.subscribe('node_states', self._hear)

    def look(self, files: Sequence[str]) -> None:
        """Begin to read the files of a corpus, in a thread, if the nodes are on two machines."""
        if self._apart:
            self._files = list(files)
            threading.Thread(target=self._read, args=(self._files,), daemon=True).start()

    @property
    def trouble(self) -> str:
        """Which files differ; '' while none does, or not all have been read."""
        paths = {line.partition(' ')[2] for line in self._here ^ self._there}
        both = [{line.partition(' ')[2] for line in lines} for lines in (self._here, self._there)]
        names = sorted(Path(path).name for path in paths & both[0] & both[1])
        if not names:
            return ''
        return said('other_sounds', names=', '.join(names), machine=self._machine)

    def _read(self, files: list[str]) -> None:
        from eol_ros.devices.corpus.corpus_file import sha256

        lines = []
        for file in files:
            try:
                lines.append(f'{sha256(Path(file))} {file}')
            except DeviceMissing:  # the node says so itself
                continue
        if files is self._files:
            self._here = set(lines)
            if self._node.NAME == 'grains':
                self._node.health.values[KEY] = lines

    def _hear(self, state: NodeState) -> None:
        if state.node == 'grains':
            self._there = set(values_of(state.values).get(KEY, ()))
