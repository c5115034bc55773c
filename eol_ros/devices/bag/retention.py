# SPDX-License-Identifier: Apache-2.0
"""What of the recordings goes when there are too many: raw images first, then the oldest.

Recordings of the last 30 days on which there were any stay, whatever the clock says: one that was
set to another century must not empty the disk. Marked bags (`eol bag keep`) and what is being
written stay, too. The sound files beside the bags and the logs share the same room.
"""

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eol_ros import folders
from eol_ros.devices.bag.edit import write_file
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.recover import BESIDE, in_use, rewrite_metadata
from eol_ros.devices.bag.writer import PART, RUN_METADATA
from eol_ros.disk import DISK
from eol_ros.errors import EolError
from eol_ros.streams.graph import namespace_of, relative_name

KEPT = 'kept.txt'  # in a bag folder: nobody but its owner removes it
THIN = '.thin'  # a file without its images, in the making
PICTURES_REMOVED = 'pictures_removed'  # in GAPS_METADATA
PROTECTED_DAYS = 30
MARGIN_BYTES = 5e9  # above min_free_gb: a minute of images
DAY_S = 86400.0


@dataclass(frozen=True)
class Stored:
    """One bag, or one sound file or log: bytes, and when it was changed last (s since 1970).

    `stays`: it is marked, or being written.
    """

    path: Path
    size: int
    changed_s: float
    bag: bool
    stays: bool


@dataclass(frozen=True)
class Limits:
    """How much is kept; 0 days or bytes mean any. `free` is what the disk must have left."""

    days: float
    size: float
    free: float


def enforce(store: 'Folder', limits: Limits, now_s: float) -> Iterator[str]:
    """Remove what is too old or too much, piece by piece; yield what was done, in words."""
    stored = sorted(store.stored(), key=lambda s: s.changed_s)
    safe = _first_protected_day(stored, limits)
    loose = [s for s in stored if not s.stays]
    left = []
    for each in loose:
        expired = limits.days and now_s - each.changed_s > limits.days * DAY_S
        if expired and _day(each) < safe:
            yield from _done(store.remove, each, f'removed: older than {limits.days:g} days')
        else:
            left.append(each)
    if not _too_much(store, limits):
        return
    for each in left:
        if each.bag and store.has_pictures(each):
            yield from _done(store.remove_pictures, each, 'raw images removed, for want of room')
            if not _too_much(store, limits):
                return
    old = [s for s in left if _day(s) < safe]
    others = [s for s in left if not s.bag and _day(s) >= safe]
    for each in (*old, *others):
        yield from _done(store.remove, each, 'removed, for want of room')
        if not _too_much(store, limits):
            return


def _done(action: Callable[[Stored], None], stored: Stored, words: str) -> Iterator[str]:
    try:
        action(stored)
    except OSError as error:
        words = f'could not be {words}: {error}'
    yield f'{stored.path.name}: {words}'


def _first_protected_day(stored: Sequence[Stored], limits: Limits) -> tuple[int, ...]:
    count = min(PROTECTED_DAYS, limits.days or PROTECTED_DAYS)
    days = sorted({_day(s) for s in stored if s.bag}, reverse=True)[: max(1, round(count))]
    return days[-1] if days else ()


def _day(stored: Stored) -> tuple[int, ...]:
    return time.localtime(stored.changed_s)[:3]


def _too_much(store: 'Folder', limits: Limits) -> bool:
    total = sum(s.size for s in store.stored())
    return bool(limits.size and total > limits.size) or store.free() < limits.free


class Folder:
    """The bags in `root`, with the sound files beside them and the logs of this machine.

    `writing` returns the bag in the making. `breathe` is called while a bag is being copied.
    """

    def __init__(
        self,
        root: Path,
        images: str,
        writing: Callable[[], Path | None] = lambda: None,
        breathe: Callable[[], None] = lambda: None,
    ):
        # Bags of before may have been recorded in another namespace.
        namespace = namespace_of({images: 'sensor_msgs/msg/Image'})
        self._root, self._images = root, relative_name(images, namespace)
        self._writing, self._breathe = writing, breathe
        self._without: set[Path] = set()  # bags known to have no images

    def stored(self) -> list[Stored]:
        """Return bags, sound files and logs."""
        found = []
        with contextlib.suppress(OSError):
            for path in self._root.iterdir():
                if path.is_dir():
                    found += self._bag(path)
                elif path.match('sound-*.wav'):
                    found += _file(path)
        logs = folders.state_path()
        for path in logs.glob('*.log*') if logs.is_dir() else ():
            found += _file(path)
        return found

    def free(self) -> float:
        """Return the bytes that the disk has left."""
        return shutil.disk_usage(self._root).free

    def has_pictures(self, stored: Stored) -> bool:
        """Return whether a bag has raw images that can be removed."""
        if stored.path in self._without:
            return False
        try:
            bag = BagReader(stored.path, any_span=True)
            if bag.count(self._images) and all(f.indexed for f in bag.files):
                return not bag.damage
        except EolError:
            pass
        self._without.add(stored.path)
        return False

    def remove_pictures(self, stored: Stored) -> None:
        """Rewrite the files of a bag without images; each takes its name when it is complete."""
        self._without.add(stored.path)
        for file in BagReader(stored.path, any_span=True).files:
            thin = file.path.with_name(file.path.name + THIN)
            self._thin(BagReader(file.path), thin)
        rewrite_metadata(stored.path)

    def remove(self, stored: Stored) -> None:
        """Remove the files of a bag, and its folder if nothing else is in it."""
        if not stored.bag:
            stored.path.unlink(missing_ok=True)
            return
        for path in _parts(stored.path):
            path.unlink(missing_ok=True)
        if not any(stored.path.iterdir()):
            stored.path.rmdir()

    def _bag(self, path: Path) -> list[Stored]:
        try:
            parts = [(p, p.stat()) for p in _parts(path)]
            recorded = [s.st_mtime for p, s in parts if '.mcap' in p.name]
            if not recorded:
                return []
            used = any(in_use(p) for p, _ in parts if p.name.endswith(PART))
            stays = (path / KEPT).exists() or path == self._writing() or used
            return [Stored(path, sum(s.st_size for _, s in parts), max(recorded), True, stays)]
        except OSError:  # somebody removes it
            return []

    def _thin(self, bag: BagReader, thin: Path) -> None:
        """Rewrite a file by way of `thin`, which takes its name when it is complete."""
        changed, images = bag.path.stat(), bag.name(self._images)
        thin.unlink(missing_ok=True)
        if not bag.count(self._images):
            return
        gaps = bag.gaps | {PICTURES_REMOVED: str(bag.counts[images])}
        bag.files[0].breathe = self._breathe
        messages = bag.messages(bag.topics.keys() - {images})
        try:
            about = {RUN_METADATA: bag.about}
            write_file(thin, bag.topics.values(), messages, about, lambda: gaps)
            if bag.damage:
                raise OSError(f'{bag.path}: damaged, so it is left as it is')
            os.utime(thin, ns=(changed.st_atime_ns, changed.st_mtime_ns))
            DISK.sync_path(thin)
            DISK.rename(thin, bag.path)
        finally:
            thin.unlink(missing_ok=True)


def _parts(folder: Path) -> list[Path]:
    """Return the files of a bag: what the recorder made in its folder, and nothing else."""
    names = ('*.mcap', f'*.mcap{PART}', f'*.mcap{BESIDE}', f'*.mcap{THIN}', 'metadata.yaml', KEPT)
    return [path for name in names for path in folder.glob(name)]


def _file(path: Path) -> list[Stored]:
    """Return a sound file or a log, which stays for a day after its last change.

    The log that lines go to stays whatever its age: it is open, and what is written to a removed
    file is lost. It is bounded; when it is full it gets a number.
    """
    try:
        stat = path.stat()
    except OSError:
        return []
    stays = path.suffix == '.log' or time.time() - stat.st_mtime < DAY_S
    return [Stored(path, stat.st_size, stat.st_mtime, False, stays)]


def mark(bag: Path, kept: bool) -> None:
    """Mark the bag folder `bag` as one to be kept, or no more; raises OSError."""
    if kept:
        text = f'Marked on {time.strftime("%Y-%m-%d %H:%M:%S")}: never removed by the recorder.\n'
        DISK.write(bag / KEPT, text)
    else:
        (bag / KEPT).unlink(missing_ok=True)
