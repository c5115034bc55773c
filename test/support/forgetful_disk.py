# SPDX-License-Identifier: Apache-2.0
"""A disk that forgets what was not synchronised, and a clock that only the test moves.

Files are written to a real folder, and every write, sync, new name and rename is kept with its
time. `after_cut` makes the folder that a power cut at some moment may have left: of each file what
was synchronised, and of the rest any pages, as zeros where they were not written; of the names
those of synchronised folders, and of the others the first few.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eol_ros.disk import Disk

PAGE = 4096


class Clock:
    """Seconds that pass when told so."""

    def __init__(self):
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class _Content:
    """One file: its bytes, and how many there were, or were on the disk, from when on."""

    data: bytearray = field(default_factory=bytearray)
    written: list[tuple[float, int]] = field(default_factory=list)
    synced: list[tuple[float, int]] = field(default_factory=list)


class _File:
    def __init__(self, disk, path):
        self._disk, self.content = disk, _Content()
        self._file = open(path, 'xb', buffering=0)  # noqa: SIM115 - closed in close()

    def write(self, data):
        self.content.data += data
        self.content.written.append((self._disk.clock(), len(self.content.data)))
        return self._file.write(data)

    def tell(self):
        return len(self.content.data)

    def flush(self):
        pass

    def fileno(self):
        return self._file.fileno()

    def close(self):
        self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class ForgetfulDisk(Disk):
    """See above; a sync takes a random time of up to `slow_s` on the clock."""

    def __init__(self, clock: Clock, rng: np.random.Generator, slow_s: float):
        self.clock, self._rng, self._slow_s = clock, rng, slow_s
        self._names = []  # (time, 'create' or 'rename' or 'sync', path or folder, content or path)

    def create(self, path):
        file = _File(self, path)
        self._names.append((self.clock(), 'create', path, file.content))
        return file

    def sync(self, file):
        size = len(file.content.data)
        self._wait()
        file.content.synced.append((self.clock(), size))

    def sync_folder(self, folder):
        seen = len(self._names)
        self._wait(0.1)
        self._names.append((self.clock(), 'sync', folder, seen))

    def rename(self, old, new):
        os.replace(old, new)
        self._names.append((self.clock(), 'rename', old, new))
        self.sync_folder(new.parent)

    def _wait(self, share=1.0):
        self.clock.now_s += share * self._rng.uniform(0.0, self._slow_s)

    def after_cut(self, time_s: float, root: Path, out: Path, rng) -> None:
        """Make in `out` what may be left of `root` after a power cut at `time_s`."""
        happened = [n for n in self._names if n[0] <= time_s]
        safe = {folder: seen for _, kind, folder, seen in happened if kind == 'sync'}
        lost: set[Path] = set()  # folders that lost a name: all later ones are lost, too
        there: dict[Path, _Content] = {}
        for index, (_, kind, path, other) in enumerate(happened):
            if kind == 'sync':
                continue
            if index >= safe.get(path.parent, 0) and (path.parent in lost or rng.random() < 0.5):
                lost.add(path.parent)
            elif kind == 'create':
                there[path] = other
            else:
                there[other] = there.pop(path)
        for path, content in there.items():
            place = out / path.relative_to(root)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(_left(content, time_s, rng))


def _left(content: _Content, time_s: float, rng) -> bytes:
    synced = max((size for at, size in content.synced if at <= time_s), default=0)
    written = max((size for at, size in content.written if at <= time_s), default=0)
    left = bytearray(content.data[: int(rng.integers(synced, written + 1))])
    for page in range(synced - synced % PAGE, len(left), PAGE):
        begin, end = max(page, synced), min(page + PAGE, len(left))
        if rng.random() < 0.3:
            left[begin:end] = bytes(end - begin)
    return bytes(left)
