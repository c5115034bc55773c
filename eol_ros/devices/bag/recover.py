# SPDX-License-Identifier: Apache-2.0
"""Repairs the files of a killed or unplugged recorder: `*.mcap.part` becomes `*.mcap`.

The recorder repairs in place: it verifies the data from start to end, and writes the missing index
and end behind them. This needs almost no disk space and memory. It may be stopped anywhere, since a
small file beside the bag file holds the progress. `eol bag recover` works on a copy. A file without
readable messages is renamed, never deleted.
"""

import contextlib
import fcntl
import itertools
import json
import os
import shutil
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from eol_ros.devices.bag import scan
from eol_ros.devices.bag.disk import DISK
from eol_ros.devices.bag.mcap_file import LIBRARY, Summary, metadata_record, packed
from eol_ros.devices.bag.reader import BagFileReader, by_this_project
from eol_ros.devices.bag.scan import MAGIC, ChunkHead, DamagedRecord, Found
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, RUN_METADATA, FileSummary, metadata_text
from eol_ros.errors import EolError

STATE = '.repair'  # how far a repair has come
BESIDE = '.recovering'  # a copy that will replace the file
LOOK_RECORDS = 20  # the metadata of the run are among the first records
DAMAGED = '.damaged'  # an original of which something is lost
SAVE_BYTES = 64 << 20  # so much is proved again, at most, after a repair was stopped
BUSY_S = 0.25  # after this it is asked again whether the recording is busy
SHARE = 0.25  # of the time a repair works at the side of a recording; then it rests
GB = 1e9


class NoRoom(EolError):
    """A repair waits until the disk has room for the index."""


class Stopped(Exception):
    """Whoever asked for the repair has no more time for it; it goes on at the next start."""


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


@dataclass
class _Progress:
    """What is known of the first `at` bytes of a file: they are as they should be."""

    at: int = len(MAGIC)
    index_bytes: int = 0  # that its index will need, about
    gaps: dict[str, str] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)


class Breather:
    """Called between two chunks: rests, so that the recording comes first, and may say stop.

    `busy` tells that the recording needs all there is: the rest lasts as long.
    """

    def __init__(
        self,
        stop: threading.Event,
        clock: Callable[[], float] = time.monotonic,
        busy: Callable[[], bool] = lambda: False,
    ):
        self._stop, self._clock, self._busy, self._since = stop, clock, busy, clock()

    def begin(self) -> None:
        """Begin to work: what has passed before was no work."""
        self._since = self._clock()

    def __call__(self) -> None:
        """Rest in proportion to the work since the last rest; raise Stopped when told so."""
        worked_s = self._clock() - self._since
        rest_s = worked_s * (1 / SHARE - 1)
        while self._stop.wait(rest_s) or self._busy():
            if self._stop.is_set():
                raise Stopped
            rest_s = BUSY_S
        self._since = self._clock()


def leftovers(root: Path) -> list[Path]:
    """Return the `.part` files in `root` and in its bag folders that nobody writes any more.

    A repair that was cut off between its last two steps counts, too, by the name that it had.
    """
    found = {*root.glob(f'*.mcap{PART}'), *root.glob(f'*/*.mcap{PART}')}
    found |= {p.with_suffix(PART) for p in root.glob(f'*/*.mcap{STATE}')}
    return [path for path in sorted(found) if not in_use(path)]


def repair(
    path: Path,
    breathe: Callable[[], None] = lambda: None,
    min_free_gb: float = 0.0,
    beside: bool = False,
) -> Repaired:
    """Write the index and the end that a file lacks, and bring `metadata.yaml` up to date.

    A file without a readable message is renamed to NAME.damaged, unchanged. `beside` works on a
    copy, which replaces the file when all of it has been read back; a damaged original is then
    renamed, too. A file outside a bag folder gets no `metadata.yaml`. Raises OSError, NoRoom,
    BlockingIOError if another process writes the file, and the errors of `breathe`.
    """
    target = path.with_name(path.name.removesuffix(PART))
    state = target.with_name(target.name + STATE)
    if path != target and target.exists():  # cut off before its last step
        made = BagFileReader(target, with_places=False)
        if not made.indexed:
            return Repaired(path, None, 0, aside=_set_aside(path, state))
        path.unlink(missing_ok=True)
        _bring_up_to_date(target)
        state.unlink(missing_ok=True)
        return Repaired(path, target, sum(made.counts.values()))
    work = target.with_name(target.name + BESIDE) if beside else path
    progress = _Progress()
    with open(path, 'r+b') as held:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        reader = BagFileReader(path, with_places=False, walk=False)
        if reader.indexed:  # cut off just before it got its name
            count, work = sum(reader.counts.values()), path
        elif not _readable(held):
            count = 0
        elif beside:
            count = _recovered(path, work, progress, breathe, min_free_gb)
        else:
            progress = _load(state)
            count = _make_whole(work, progress, state, breathe, path, min_free_gb)
    if not count:
        kept = _set_aside(path, state)
        if any(path.parent.glob('*.mcap')):
            _bring_up_to_date(target)
        return Repaired(path, None, 0, aside=kept)
    aside = _set_aside(path, state) if beside and progress.damage else None
    if work != target:
        DISK.rename(work, target)
    if path not in (work, target) and not aside:
        path.unlink()
    _bring_up_to_date(target)
    state.unlink(missing_ok=True)
    return Repaired(path, target, count, tuple(progress.damage), aside)


def _recovered(
    path: Path,
    work: Path,
    progress: _Progress,
    breathe: Callable[[], None],
    min_free_gb: float,
) -> int:
    """Write the messages of `path` to a complete file `work`; return how many, all read back."""
    size, free = path.stat().st_size, shutil.disk_usage(path.parent).free
    if free - size < min_free_gb * GB:
        raise NoRoom(
            f'{path.name} needs {size / GB:.2f} GB beside it to be recovered, {free / GB:.2f} GB '
            'are free; `--output OUT` writes a new bag on another disk'
        )
    state = work.with_name(work.name + STATE)
    try:
        shutil.copyfile(path, work)
        count = _make_whole(work, progress, state, breathe, path, min_free_gb)
        made = BagFileReader(work)
        read = sum(1 for _ in made.messages(None, 0, None))
        if made.damage or not made.indexed or not read == count == sum(made.counts.values()):
            raise EolError(
                f'{path}: left as it is: of {count} messages {read} could be read back from the '
                'copy; `--output OUT` writes what can be read as a new bag'
            )
        return count
    except BaseException:
        work.unlink(missing_ok=True)
        raise
    finally:
        state.unlink(missing_ok=True)


def _make_whole(
    work: Path,
    progress: _Progress,
    state: Path,
    breathe: Callable[[], None],
    path: Path,
    min_free_gb: float,
) -> int:
    """Mark damage in `work`, write its index and end; return the number of messages."""
    # unbuffered: it is read again after changes
    with open(work, 'r+b') as out, open(work, 'rb', buffering=0) as file:
        if not _begins(file):
            _begin(file, out, progress)
        last = _prove(file, out, progress, state, breathe)
        return _finish(file, out, progress, last, path, min_free_gb)


def _set_aside(path: Path, state: Path) -> Path:
    """Rename a file to NAME.damaged, or NAME.2.damaged where that is taken; return the new name."""
    name = path.name.removesuffix(PART)
    aside, number = path.with_name(name + DAMAGED), 2
    while aside.exists():
        aside, number = path.with_name(f'{name}.{number}{DAMAGED}'), number + 1
    DISK.rename(path, aside)
    state.unlink(missing_ok=True)
    return aside


def _readable(file: BinaryIO) -> bool:
    """Return whether a chunk of the file holds a message that can be read."""
    for found in scan.walk(file, len(MAGIC), scan.size_of(file)):
        if isinstance(found.body, ChunkHead):
            with contextlib.suppress(DamagedRecord):
                data = scan.chunk_data(file, found.body)
                if any(True for _ in scan.messages_in(data)):
                    return True
    return False


def _begin(file: BinaryIO, out: BinaryIO, progress: _Progress) -> None:
    """Write the lost beginning of a file, up to its first verified record."""
    size = scan.size_of(file)
    at = scan.anchor(file, 0, size)
    if at is None:
        return
    found = (f.body for f in itertools.islice(scan.walk(file, at, size), LOOK_RECORDS))
    ours = any(isinstance(body, Metadata) and scan.CRC_KEY in body.metadata for body in found)
    head = MAGIC + packed(Header('ros2', LIBRARY if ours else ''))
    rest = at - len(head) - scan.HEAD.size
    if rest < 0:  # the definitions before a first chunk are not lost
        return
    _overwrite(out, 0, head + scan.HEAD.pack(scan.BLANK, rest))
    progress.damage.append(f'bytes 0 to {at}: the beginning is lost')


def repair_all(
    root: Path, breathe: Callable[[], None] = lambda: None, min_free_gb: float = 0.0
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
    DISK.write_text(folder / 'metadata.yaml', metadata_of(folder))


def metadata_of(folder: Path) -> str:
    """Return the text of `metadata.yaml` for the complete files of a bag folder."""
    bags = [BagFileReader(p, with_places=False) for p in sorted(folder.glob('*.mcap'))]
    topics, custom, files = {}, {}, []
    for bag in sorted(bags, key=lambda b: b.start_ns):
        topics.update(bag.topics)
        custom.update(bag.metadata.get(RUN_METADATA, {}) | bag.metadata.get(GAPS_METADATA, {}))
        files.append(FileSummary(bag.path.name, bag.start_ns, bag.end_ns, bag.counts))
    return metadata_text(list(topics.values()), files, custom)


class ProvedChunk:
    """A chunk that was proved, and the message indexes that belong behind it."""

    def __init__(self, found: Found, data: bytes):
        self.found = found
        self.indexes: list[Found] = []  # those that are behind it
        self.wanted: dict[int, list[tuple[int, int]]] = {}
        for at, kind, body in scan.records_in(data):
            if kind == Opcode.MESSAGE:
                channel, _, log_ns, _ = scan.MESSAGE_HEAD.unpack_from(body)
                self.wanted.setdefault(channel, []).append((log_ns, at))
        stamps = [log_ns for entries in self.wanted.values() for log_ns, _ in entries]
        self.span = (min(stamps), max(stamps)) if stamps else (0, 0)

    def right(self) -> bool:
        """Return whether all message indexes are there, and say what is in the chunk."""
        there = {f.body.channel_id: f.body.records for f in self.indexes}
        return there == {k: sorted(entries) for k, entries in self.wanted.items()}

    @property
    def end(self) -> int:
        """Where its last message index ends."""
        return self.indexes[-1].end if self.indexes else self.found.end


def _prove(
    file: BinaryIO,
    out: BinaryIO,
    progress: _Progress,
    state: Path,
    breathe: Callable[[], None],
) -> ProvedChunk | None:
    """Go through the data; mark as blank what is damaged, and cut off what is behind the end.

    Returns the last chunk if its message indexes are missing. A damaged chunk keeps its bytes, but
    for the first, which becomes the opcode of a private record that readers skip.
    """
    size, saved, chunk = scan.size_of(file), progress.at, None
    ours = by_this_project(file, size)
    try:
        for found in scan.walk(file, progress.at, size, ours):
            if chunk and isinstance(found.body, MessageIndex):
                chunk.indexes.append(found)
                continue
            _settle(out, chunk)
            chunk, progress.at = None, found.offset
            if found.opcode == Opcode.DATA_END and not found.why:
                break
            if isinstance(found.body, ChunkHead):
                chunk = _proved(file, out, found, progress)
                breathe()
            elif isinstance(found.body, Metadata):
                progress.index_bytes += 64
                pairs = dict(found.body.metadata)
                if ours and pairs.pop(scan.CRC_KEY, '') != scan.pairs_crc(pairs):
                    _blank(out, found)
                    progress.damage.append(f'byte {found.offset}: metadata {found.body.name}')
                elif found.body.name == GAPS_METADATA:
                    progress.gaps = pairs
            elif found.why:
                _blank(out, found)
                progress.damage.append(f'bytes {found.offset} to {found.end}: {found.why}')
            if chunk is None:
                progress.at = found.end
            if progress.at - saved >= SAVE_BYTES:
                saved = progress.at
                _save(out, progress, state)
    except BaseException:
        _save(out, progress, state)
        raise
    last = chunk if chunk and not chunk.right() else None
    progress.at = last.found.end if last else chunk.end if chunk else progress.at
    _save(out, progress, state)
    return last


def _proved(file: BinaryIO, out: BinaryIO, found: Found, progress: _Progress) -> ProvedChunk | None:
    head = found.body
    try:
        data = scan.chunk_data(file, head)
        chunk = ProvedChunk(found, data)
    except (DamagedRecord, struct.error) as error:
        _blank(out, found)
        span = f'{head.start_ns * 1e-9:.3f} to {head.end_ns * 1e-9:.3f} s since 1970'
        progress.damage.append(f'bytes {found.offset} to {found.end}: {error}; {span}')
        return None
    if found.opcode != Opcode.CHUNK:
        _overwrite(out, found.offset, bytes([Opcode.CHUNK]))
    says = (*chunk.span, len(data))
    if (head.start_ns, head.end_ns, head.size) != says:
        _overwrite(out, found.offset + scan.HEAD.size, struct.pack('<QQQ', *says))
    progress.index_bytes += 80 + 10 * len(chunk.wanted)
    return chunk


def _settle(out: BinaryIO, chunk: ProvedChunk | None) -> None:
    """Mark message indexes as blank where they are not all there, or not right."""
    if chunk and not chunk.right():
        for found in chunk.indexes:
            _blank(out, found)


def _blank(out: BinaryIO, found: Found) -> None:
    """Make a private record of a stretch; one that is too short for that stays as it is."""
    length = found.end - found.offset - scan.HEAD.size
    if not found.why or found.framed:
        _overwrite(out, found.offset, bytes([scan.BLANK]))
    elif length >= 0:
        _overwrite(out, found.offset, scan.HEAD.pack(scan.BLANK, length))


def _overwrite(out: BinaryIO, offset: int, data: bytes) -> None:
    out.seek(offset)
    out.write(data)
    out.flush()


def _finish(
    file: BinaryIO,
    out: BinaryIO,
    progress: _Progress,
    last: ProvedChunk | None,
    path: Path,
    min_free_gb: float,
) -> int:
    """Write what is missing behind the data; return the number of messages."""
    schemas, channels = _definitions(file, progress.at, out)
    definitions = b''.join(packed(r) for r in (*schemas.values(), *channels.values()))
    needed = progress.index_bytes + len(definitions) + (1 << 16)
    free = shutil.disk_usage(path.parent).free
    if free - needed < min_free_gb * GB:
        raise NoRoom(
            f'{path.name} is not repaired yet: {free / GB:.2f} GB free, the index needs '
            f'{needed / 1e6:.1f} MB, and recorder.min_free_gb is {min_free_gb:g}'
        )
    out.seek(progress.at)
    out.truncate()
    for channel, entries in (last.wanted if last else {}).items():
        out.write(packed(MessageIndex(channel, sorted(entries))))
    gaps = {**progress.gaps, 'recovered': f'from {path.name}'}
    if progress.damage:
        gaps['damaged'] = json.dumps(progress.damage)
    out.write(metadata_record(GAPS_METADATA, gaps))
    out.flush()
    data_end = out.tell()
    out.write(packed(DataEnd(0)))
    summary, index = Summary(out.tell(), out.write), _Index(file, data_end)
    summary.group(Opcode.SCHEMA, map(packed, schemas.values()))
    summary.group(Opcode.CHANNEL, map(packed, channels.values()))
    summary.group(Opcode.CHUNK_INDEX, index.chunks())
    summary.group(Opcode.STATISTICS, [packed(index.statistics(len(schemas), len(channels)))])
    summary.group(Opcode.METADATA_INDEX, map(packed, index.metadata))
    summary.end()
    DISK.sync(out)
    return sum(index.counts.values())


class _Index:
    """Reads the heads of what is in a file, one after the other, for its index."""

    def __init__(self, file: BinaryIO, end: int):
        self.metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}
        self._file, self._end = file, end
        self._chunks, self._start_ns, self._end_ns = 0, 0, 0

    def chunks(self) -> Iterator[bytes]:
        """Yield the packed index of each chunk."""
        chunk: Found | None = None
        indexes: list[Found] = []
        for found in scan.walk(self._file, len(MAGIC), self._end):
            if isinstance(found.body, MessageIndex):
                indexes.append(found)
                continue
            if chunk:
                yield self._packed(chunk, indexes)
            chunk, indexes = None, []
            if isinstance(found.body, ChunkHead):
                chunk = found
            elif isinstance(found.body, Metadata):
                name, length = found.body.name, found.end - found.offset
                self.metadata.append(MetadataIndex(found.offset, length, name))
        if chunk:
            yield self._packed(chunk, indexes)

    def statistics(self, schemas: int, channels: int) -> Statistics:
        """Return the counts, when all chunks have been seen."""
        return Statistics(
            attachment_count=0,
            channel_count=channels,
            channel_message_counts=self.counts,
            chunk_count=self._chunks,
            message_count=sum(self.counts.values()),
            message_start_time=self._start_ns,
            message_end_time=self._end_ns,
            metadata_count=len(self.metadata),
            schema_count=schemas,
        )

    def _packed(self, found: Found, indexes: list[Found]) -> bytes:
        head = found.body
        counts = {f.body.channel_id: len(f.body.records) for f in indexes}
        if not indexes and head.end_ns:  # its message indexes were damaged
            with contextlib.suppress(DamagedRecord):
                for m in scan.messages_in(scan.chunk_data(self._file, head)):
                    counts[m.channel] = counts.get(m.channel, 0) + 1
        for channel, count in counts.items():
            self.counts[channel] = self.counts.get(channel, 0) + count
        self._chunks += 1
        if head.end_ns:
            self._start_ns = min(self._start_ns or head.start_ns, head.start_ns)
            self._end_ns = max(self._end_ns, head.end_ns)
        return packed(
            ChunkIndex(
                chunk_length=found.end - found.offset,
                chunk_start_offset=found.offset,
                compression=head.compression,
                compressed_size=head.data_bytes,
                message_start_time=head.start_ns,
                message_end_time=head.end_ns,
                message_index_length=sum(f.end - f.offset for f in indexes),
                message_index_offsets={f.body.channel_id: f.offset for f in indexes},
                uncompressed_size=head.size,
            )
        )


def _definitions(
    file: BinaryIO, end: int, out: BinaryIO
) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Return schemas and channels by number; those in a chunk, with a checksum, hold.

    Where one outside differs, it is damaged and marked as blank.
    """
    outside: list[Found] = []
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}

    def take(record: object) -> None:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record

    for found in scan.walk(file, len(MAGIC), end):
        take(found.body)
        if isinstance(found.body, (Schema, Channel)):
            outside.append(found)
        elif isinstance(found.body, ChunkHead):
            head = found.body
            if head.end_ns and channels:
                break
            with contextlib.suppress(DamagedRecord):
                data = scan.chunk_data(file, head)
                for _at, kind, body in scan.records_in(data):
                    if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                        take(scan.parse(kind, body))
    for record in scan.definitions_behind(file, end, scan.size_of(file)):
        if record.id not in (schemas if isinstance(record, Schema) else channels):
            take(record)
    for found in outside:
        known: dict = schemas if isinstance(found.body, Schema) else channels
        if known[found.body.id] != found.body:
            _blank(out, found)
    return schemas, channels


def _begins(file: BinaryIO) -> bool:
    file.seek(0)
    return scan.near_magic(file.read(len(MAGIC)))


def _load(state: Path) -> _Progress:
    try:
        return _Progress(**json.loads(state.read_text(encoding='utf-8')))
    except (OSError, ValueError, TypeError):
        return _Progress()


def _save(out: BinaryIO, progress: _Progress, state: Path) -> None:
    out.flush()
    os.fdatasync(out.fileno())  # what was marked as damaged must not come back
    DISK.write_text(state, json.dumps(asdict(progress)))


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
