# SPDX-License-Identifier: Apache-2.0
"""Audio files of the corpus on the machines of `grains` and of `sound`, compared by content."""

import hashlib
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eol_msgs.msg import NodeState

from eol_ros.errors import FEW_NAMES, DeviceMissing
from eol_ros.said import said
from eol_ros.streams.requests import values_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

KEY = 'files_sha256'  # in the state of `grains`: digests of the paths and of each group of files
GROUPS = 64  # digests in a state, 0.6 KB (chosen): it is sent and recorded every second
DIGITS = 8  # of a digest, hex: two contents have the same in one of 4e9 cases
UNREAD = '-'  # a file of the group cannot be read, and the node says so itself


class SoundFiles:
    """`grains` publishes digests of its files in its state; `sound` on another machine compares."""

    def __init__(self, node: 'EolNode'):
        self._node, scene = node, node.scene
        self._machine = scene.machine_of('grains')
        self._apart = self._machine != scene.machine_of('sound')
        self._lock = threading.Lock()
        self._wanted: list[tuple[str, tuple[int, int] | None]] = []  # path, mtime and size
        self._reading = False
        self._here: tuple[list[str], str] = [], ''  # paths, and their digests
        self._there = ''
        if self._apart and node.NAME == 'grains':
            node.health.values[KEY] = ''  # here: a thread may not insert what others iterate over
        if self._apart and node.NAME == 'sound':
            node.on_states(self._hear)

    def look(self, files: Sequence[str]) -> None:
        """Begin to read the files of a corpus, in a thread, if the nodes are on two machines.

        Files that have been read and have the same times and sizes are not read again.
        """
        if not self._apart:
            return
        wanted = [(file, _version(file)) for file in files]
        with self._lock:
            if wanted == self._wanted:
                return
            self._wanted = wanted
            if self._reading:  # its thread goes on with these
                return
            self._reading = True
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def trouble(self) -> str:
        """Which files differ; '' while none does, or not all have been read."""
        paths, digests = self._here
        here, there = digests.split(), self._there.split()
        if here[:1] != there[:1]:  # of another corpus, or not read yet
            return ''
        names = [
            _name(group)
            for group, one, other in zip(_groups(paths), here[1:], there[1:], strict=False)
            if one != other and UNREAD not in (one, other)
        ]
        if not names:
            return ''
        if len(names) > FEW_NAMES:
            names[FEW_NAMES:] = [f'… ({len(names)})']
        return said('other_sounds', names=', '.join(names), machine=self._machine)

    def _read(self) -> None:
        while True:
            wanted = self._wanted
            paths = [path for path, _ in wanted]
            digests = [_digest(os.fsencode('\n'.join(paths)))]
            for group in _groups(paths):
                digests.append(_of_group(group))
                if wanted is not self._wanted:
                    break
            with self._lock:
                if wanted is self._wanted:
                    self._here = paths, ' '.join(digests)
                    if self._node.NAME == 'grains':
                        self._node.health.values[KEY] = self._here[1]
                    self._reading = False
                    return

    def _hear(self, state: NodeState) -> None:
        if state.node == 'grains':
            self._there = str(values_of(state.values).get(KEY, ''))


def _version(file: str) -> tuple[int, int] | None:
    try:
        found = os.stat(file)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def _groups(paths: list[str]) -> list[list[str]]:
    """Return at most GROUPS groups of paths that follow each other: of one while there are few."""
    size = -(-len(paths) // GROUPS) or 1
    return [paths[at : at + size] for at in range(0, len(paths), size)]


def _name(group: list[str]) -> str:
    """Return the name of a file, or of the first and the last of several."""
    return ' … '.join(Path(path).name for path in dict.fromkeys((group[0], group[-1])))


def _of_group(group: list[str]) -> str:
    from eol_ros.devices.corpus.corpus_file import sha256

    try:
        return _digest(''.join(sha256(Path(path)) for path in group).encode())
    except DeviceMissing:
        return UNREAD


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]
