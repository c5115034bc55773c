# SPDX-License-Identifier: Apache-2.0
"""What people asked of the nodes, on the disk: a power cut does not unmute the work.

Nodes tell with every heartbeat what they must take up when they are started again: asleep, muted,
settings changed live. Bringup gives it to a node that is restarted within a run; this keeps it for
the next run. A run that ends as it was asked to forgets it, so that the next one begins as its
scene says; one that a service manager starts at every boot remembers always.
"""

import contextlib
import queue
import threading
from typing import Any

from eol_ros.devices.files.day_file import DayFile
from eol_ros.disk import DISK, Disk
from eol_ros.errors import ConfigError
from eol_ros.scene import Scene, check_value, plain, public
from eol_ros.settings import by_today, live_fields

Kept = dict[str, dict[str, Any]]  # by node
FLAGS = ('asleep', 'muted')
HEEDED = 'heeded_s'  # the opening or closing time that was last requested


class Memory:
    """Keeps one small file for a scene, written by a thread of its own: a slow disk stops nobody.

    Of the states noted while the disk was busy, only the newest is written. `always`: a run that
    ends on request is remembered, too.
    """

    def __init__(self, scene: Scene, domain: int, always: bool = False, disk: Disk = DISK):
        self._file = DayFile(f'{scene.name}-{domain}-{scene.namespace}', 'kept', disk)
        self.path = self._file.path
        self._always = always
        self._scene, self._settings = scene, plain(public(scene))['nodes']
        self._table = plain(scene).get('table', {})
        self.left_out = ''  # what `recall` did not return, in words
        self._noted: Kept | None = None
        self._queue: queue.SimpleQueue[Kept | None] = queue.SimpleQueue()  # None: the end
        self._thread = threading.Thread(target=self._write_all, name='memory', daemon=True)

    @property
    def trouble(self) -> str:
        """Why the state cannot be saved; empty if it can."""
        return self._file.trouble

    def recall(self) -> Kept:
        """Return what the nodes kept in a run before this one; nothing where the scene has changed.

        What is no setting any more, or out of its range, is left out.
        """
        found = self._file.load(self._found) or {}
        return {node: kept for node, kept in found.items() if kept}

    def _found(self, rows: dict[str, Any]) -> Kept:
        found = {
            node: self._sane(node, row['kept'])
            for node, row in rows.items()
            if node in self._settings and row['scene'] == self._settings[node]
        }
        for node, kept in found.items():
            if rows[node].get('table', {}) != self._table and kept.pop('covers', ''):
                self.left_out = 'learnt covers of another table'
        return found

    def note(self, kept: Kept) -> None:
        """Take note of what the nodes keep now."""
        kept = {node: dict(state) for node, state in kept.items() if state}
        if kept != self._noted:
            self._noted = kept
            if not self._thread.is_alive():
                self._thread.start()
            self._queue.put(kept)

    def end(self, asked: bool) -> None:
        """Write what waits; forget it all where the run has ended because it was asked to."""
        if asked and not self._always:
            self.note({})
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join()

    def _sane(self, node: str, kept: dict[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {flag: True for flag in FLAGS if kept.get(flag) is True}
        if type(kept.get(HEEDED)) in (int, float):
            found[HEEDED] = kept[HEEDED]
        if isinstance(kept.get('covers'), str):  # as the tracker learned them; it verifies it
            found['covers'] = kept['covers']
        kind = type(self._scene.nodes[node])
        fields = {f: kind.__dataclass_fields__[f] for f in live_fields(kind)}
        settings = {}
        for name, value in by_today(kind, kept.get('settings', {})).items():
            with contextlib.suppress(ConfigError, KeyError):
                check_value(fields[name], value)
                settings[name] = value
        return found | ({'settings': settings} if settings else {})

    def _write_all(self) -> None:
        for kept in iter(self._queue.get, None):
            if kept is self._noted:
                rows = {
                    node: {'scene': self._settings[node], 'table': self._table, 'kept': state}
                    for node, state in kept.items()
                    if node in self._settings
                }
                self._file.save(rows, float('inf'))


def words(kept: Kept) -> str:
    """Return it in words: `montage asleep; grains radius 0.11`."""
    found = []
    for node, state in sorted(kept.items()):
        what = [flag for flag in FLAGS if state.get(flag)]
        what += [f'{name} {value}' for name, value in state.get('settings', {}).items()]
        if what:
            found.append(f'{node} {", ".join(what)}')
    return '; '.join(found)
