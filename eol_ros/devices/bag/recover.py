# SPDX-License-Identifier: Apache-2.0
"""Repairs the files of a killed or unplugged recorder: `*.mcap.part` becomes `*.mcap`.

A repair writes all that can be read to a new file beside the old one, and reads it back. Then the
new file takes the place of the old one. A damaged original is renamed, never
deleted.
"""

import contextlib
import fcntl
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from eol_ros.devices.bag.edit import noted, write_file
from eol_ros.devices.bag.file import BagFileReader, add_topic
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.reader import files_of, open_files
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, RUN_METADATA, FileSummary, metadata_text
from eol_ros.disk import DISK
from eol_ros.errors import EolError

BESIDE = '.recovering'  # the new file, which will replace the old one
ASIDE = '.damaged'  # an original with losses
GB = 1e9


class NoRoom(EolError):
    """A repair waits until the disk has room for the new file."""


@dataclass(frozen=True)
class Repaired:
    """Result for one left-over file; `file` is None if nothing in it could be read.

    `aside` is the path of the original, if the repaired file did not replace it.
    """

    part: Path
    file: Path | None
    message_count: int
    damage: tuple[str, ...] = ()
    aside: Path | None = None

    @property
    def words(self) -> str:
        """Describe the result."""
        kept = [f'the original is {self.aside}'] if self.aside else []
        said = f'{self.part.name}: {self.message_count} messages saved'
        return '; '.join([said, *self.damage, *kept])


def leftovers(root: Path) -> list[Path]:
    """Return the `.part` files in `root` and in its bag folders that nobody writes any more."""
    found = {*root.glob(f'*.mcap{PART}'), *root.glob(f'*/*.mcap{PART}')}
    return [path for path in sorted(found) if path.name[0] != '.' and not in_use(path)]


def repair(
    path: Path, breathe: Callable[[], object] = lambda: None, min_free_gb: float = 0.0
) -> Repaired:
    """Give a file the index and the end that it lacks, and bring `metadata.yaml` up to date.

    A file without a readable message, or with losses, is renamed to NAME.damaged, unchanged. A file
    outside a bag folder gets no `metadata.yaml`. Raises OSError, NoRoom,
    BlockingIOError if another process writes the file, and the errors of `breathe`.
    """
    target = path.with_name(path.name.removesuffix(PART))
    work = target.with_name(target.name + BESIDE)
    with open(path, 'rb') as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path != target and target.exists():  # a repair was interrupted before its last step
            count, aside = sum(BagFileReader(target, quiet=True).counts.values()), _set_aside(path)
            _bring_up_to_date(target)
            return Repaired(path, target, count, aside=aside)
        old = BagFileReader(path, breathe, quiet=True)
        count = sum(old.counts.values())
        if count and not old.indexed:  # else it was interrupted just before its rename
            _write(old, work, min_free_gb)
    if not count:
        aside = _set_aside(path)
        if any(path.parent.glob('*.mcap')):
            _bring_up_to_date(target)
        return Repaired(path, None, 0, aside=aside)
    damage = _lost(old)
    kept = _set_aside(path) if damage and not old.indexed else None
    DISK.rename(path if old.indexed else work, target)
    if path != target:
        path.unlink(missing_ok=True)
    _bring_up_to_date(target)
    return Repaired(path, target, count, damage, kept)


def _write(old: BagFileReader, work: Path, min_free_gb: float) -> None:
    """Write the messages of `old` to a complete file `work`, and read them back."""
    path, size, free = old.path, old.size, shutil.disk_usage(old.path.parent).free
    if free - size < min_free_gb * GB:
        raise NoRoom(
            f'{path.name} needs {size / GB:.2f} GB beside it to be recovered, {free / GB:.2f} GB '
            'are free; `--output OUT` writes a new bag on another disk'
        )
    gaps = old.metadata.get(GAPS_METADATA, {}) | {'recovered': f'from {path.name}'}
    kept = {n: m for n, m in old.metadata.items() if n not in (GAPS_METADATA, 'rosbag2')}

    work.unlink(missing_ok=True)
    try:
        messages = old.messages(None, 0, None)
        write_file(work, old.topics.values(), messages, kept, lambda: noted(gaps, _lost(old)))
        made, count = BagFileReader(work, old.breathe, quiet=True), sum(old.counts.values())
        read = made.prove()
        if made.damage or not made.indexed or not read == count == sum(made.counts.values()):
            raise EolError(
                f'{path}: left as it is: of {count} messages {read} could be read back from the '
                'copy; `--output OUT` writes what can be read as a new bag'
            )
    except BaseException:
        work.unlink(missing_ok=True)
        raise


def _lost(old: BagFileReader) -> tuple[str, ...]:
    """Return what is damaged of the data of a file; a new index is written in any case."""
    count = old.contents.attachments
    attached = [f'{old.path.name}: its attachments ({count}) are not copied'] if count else []
    damage = [d.text(old.start_ns) for d in old.damage if d.start < old.contents.data_end]
    return (*damage, *attached)


def _set_aside(path: Path) -> Path:
    """Rename a file to NAME.damaged, or NAME.2.damaged where that is taken; return the new name."""
    name = path.name.removesuffix(PART)
    aside, number = path.with_name(name + ASIDE), 2
    while aside.exists():
        aside, number = path.with_name(f'{name}.{number}{ASIDE}'), number + 1
    DISK.rename(path, aside)
    return aside


def repair_all(
    root: Path, breathe: Callable[[], object] = lambda: None, min_free_gb: float = 0.0
) -> Iterator[Repaired]:
    """Repair every left-over file under `root`, one as each is asked for; raises as `repair`."""
    for part in leftovers(root) if root.is_dir() else []:
        with contextlib.suppress(BlockingIOError, FileNotFoundError):  # somebody else is at it
            yield repair(part, breathe, min_free_gb)


def _bring_up_to_date(file: Path) -> None:
    """Rebuild the `metadata.yaml` of the bag that a file belongs to, if it belongs to one."""
    folder = file.resolve().parent
    if (folder / 'metadata.yaml').exists() or file.name.startswith(f'{folder.name}_'):
        rewrite_metadata(folder)


def rewrite_metadata(folder: Path) -> None:
    """Rebuild `metadata.yaml` of a bag folder from its complete files."""
    DISK.write(folder / 'metadata.yaml', metadata_of(folder))


def metadata_of(folder: Path) -> str:
    """Return the text of `metadata.yaml` for the complete files of a bag folder."""
    paths, _ = files_of(folder)
    bags, _ = open_files([p for p in paths if p.suffix == '.mcap'])
    topics: dict[str, BagTopic] = {}
    custom, files = {}, []
    for bag in sorted(bags, key=lambda b: b.start_ns):
        bag.rename({key: add_topic(topics, topic) for key, topic in bag.topics.items()})
        custom.update(bag.metadata.get(RUN_METADATA, {}) | bag.metadata.get(GAPS_METADATA, {}))
        files.append(FileSummary(bag.path.name, bag.start_ns, bag.end_ns, bag.counts))
    return metadata_text(list(topics.values()), files, custom)


def in_use(part: Path) -> bool:
    """Return whether somebody writes the file, or repairs it."""
    if not part.exists():
        return False
    with open(part, 'rb') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
