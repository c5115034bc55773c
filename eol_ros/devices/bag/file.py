# SPDX-License-Identifier: Apache-2.0
"""Reads one MCAP file of a bag, whole, cut or damaged; no ROS.

What cannot be read is skipped and said (`damage`, and a warning): never passed on, and never the
end of the reading. An index is used where its checksum is right; else the file is walked through
once and each chunk proved (see `scan`).
"""

import io
import itertools
import struct
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, TypeVar

import yaml
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Header,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.stream_reader import StreamReader

from eol_ros import yaml_text
from eol_ros.devices.bag import scan
from eol_ros.devices.bag.mcap_file import LIBRARY, BagMessage, BagTopic
from eol_ros.devices.bag.scan import HEAD, MAGIC, DamagedRecord, Found
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, RUN_METADATA
from eol_ros.errors import BagDamaged, ConfigError, DeviceMissing

if TYPE_CHECKING:
    from eol_ros.devices.bag.batches import Batch

FOOTER = struct.Struct('<BQQQI')  # opcode, length, start of the summary, of its offsets, crc
_T = TypeVar('_T')
FOREVER = (1 << 63) - 1  # ns
LARGEST_INDEX = 1 << 26  # bytes of an index that are looked through (chosen): of days
_NAMED = 'offered_qos_profiles', 'topic_type_hash'  # in the metadata of a channel
_OTHERS = {
    b'SQLite': 'a bag in SQLite (.db3): `ros2 bag convert` makes MCAP of it',
    b'#ROSBAG': 'a bag of ROS 1: `rosbags-convert` of the package rosbags makes MCAP of it',
    b'\x28\xb5\x2f\xfd': 'compressed as a whole: `zstd -d` unpacks it',
    b'\x1f\x8b': 'compressed as a whole: `gunzip` unpacks it',
    b'PK\3\4': 'a zip archive: unpack it',
}


class Place(NamedTuple):
    """Where messages lie in a file: a chunk, or one message by itself. Times in ns, true ones."""

    start_ns: int
    end_ns: int
    offset: int
    end: int
    channels: frozenset[int]  # empty: not known
    compression: str  # of a chunk; the record itself may be damaged
    chunk: bool = True


class Damage(NamedTuple):
    """A range of bytes of `file` that cannot be read, and the time span that is missing, in ns.

    Both times are 0 if no message is missing.
    """

    file: str
    start: int
    end: int
    why: str
    start_ns: int = 0
    end_ns: int = 0

    def text(self, bag_start_ns: int) -> str:
        """Describe the damage, with times from the start of the bag."""
        where = f'{self.file}: bytes {self.start} to {self.end} are damaged ({self.why})'
        if not self.end_ns:
            return f'{where}; no message is missing'
        begin = f'{(self.start_ns - bag_start_ns) * 1e-9:.3f} s' if self.start_ns else 'the start'
        end = f'{(self.end_ns - bag_start_ns) * 1e-9:.3f} s' if self.end_ns < FOREVER else 'the end'
        day = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(self.start_ns // 10**9))
        day = f' ({day})' if self.start_ns else ''
        return f'{where}: messages from {begin} to {end} may be missing{day}'


@dataclass
class Contents:
    """What is in a file, and where: as its index says, or as it was found."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)  # messages of each channel
    metadata: list[tuple[int, Metadata]] = field(default_factory=list)  # with their offsets
    data_end: int = len(MAGIC)
    attachments: int = 0
    complete: bool = False  # nothing is cut off of the data
    holes: list[tuple[int, Found]] = field(default_factory=list)  # by number of places before

    def define(self, record: Schema | Channel, trusted: bool) -> None:
        """Take a definition; one with a checksum holds against one without."""
        if trusted or record.id not in self._of(record):
            self._of(record)[record.id] = record

    def defines(self, record: Schema | Channel) -> bool:
        """Return whether a schema or channel is the one that holds for its number."""
        return self._of(record).get(record.id) == record

    def add(self, found: Found) -> None:
        """Take what was found in the file; a chunk is proved."""
        record, data, edges = found.record, b'', None
        self.attachments += not found.why and found.raw[:1] == bytes([Opcode.ATTACHMENT])
        if found.why:
            self.holes.append((len(self.places), found))
        elif isinstance(record, (Schema, Channel)):
            self.define(record, trusted=False)
        elif isinstance(record, Metadata):
            self.metadata.append((found.offset, record))
        elif isinstance(record, Message):
            data = found.raw
        elif isinstance(record, Chunk):
            try:
                data = scan.unpack(record)
                edges = scan.edges_in(data)
                for definition in scan.definitions_in(data, edges):
                    self.define(definition, trusted=bool(record.uncompressed_crc))
            except DamagedRecord as error:
                self.add(found._replace(why=str(error)))
                return
        if not data:
            return
        from eol_ros.devices.bag.batches import heads_in, span_of  # NumPy, which an index needs not

        if not len(heads := heads_in(data, edges)[0]):
            return
        channels = heads['channel'].tolist()
        self.counts.update(channels)
        kind = (record.compression, True) if isinstance(record, Chunk) else ('', False)
        place = *span_of(heads), found.offset, found.end, frozenset(channels), *kind
        self.places.append(Place(*place))

    def _of(self, record: Schema | Channel) -> dict:
        return self.schemas if isinstance(record, Schema) else self.channels


class BagFileReader:
    """One MCAP file: what is in it, and its messages.

    `breathe` is called for each chunk that is read, and for each record of a file without an index.
    `quiet`: no warnings; `damage` has the damage.
    """

    def __init__(
        self, path: Path, breathe: Callable[[], object] = lambda: None, quiet: bool = False
    ):
        self.path, self.breathe, self._quiet = path, breathe, quiet
        self.topics: dict[str, BagTopic] = {}  # by key
        self.keys: dict[int, str] = {}  # of each channel
        self.counts: dict[str, int] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: list[Damage] = []
        self.cut_at: int | None = None  # bytes that could be read of a file cut short
        self.indexed = False  # it has an index, and that is right
        self.ours = False  # this project wrote it, with checksums
        self.size = 0
        self.contents = Contents()
        self.places: list[Place] = []  # of messages, in order of time
        self.start_ns = self.end_ns = 0  # when the first and the last message was received
        try:
            with open(path, 'rb') as file:
                self._read(file)
        except OSError as error:
            raise DeviceMissing(f'{path}: {error.strerror}') from None

    def messages(
        self, topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield the messages in order of reception; skip and tell what cannot be read."""
        for batch in self._in_order(topics, start_ns, end_ns):
            for head, data in zip(batch.heads.tolist(), batch.data, strict=True):
                channel, sequence, log_ns, publish_ns = head
                yield BagMessage(self.keys[channel], data, log_ns, publish_ns, sequence)

    def batches(
        self, topics: Collection[str], start_ns: int, end_ns: int | None
    ) -> Iterator[tuple[str, 'Batch']]:
        """Yield what `messages` yields, some of one topic at a time; each topic in its order."""
        for batch in self._in_order(topics, start_ns, end_ns):
            for channel, own in batch.by_channel():
                yield self.keys[channel], own

    def _in_order(
        self, topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator['Batch']:
        """Yield messages in order of reception, in batches."""
        import numpy as np  # which few need

        from eol_ros.devices.bag.batches import NOTHING, batch_in, joined

        names = {c: key for c, key in self.keys.items() if topics is None or key in topics}
        first: dict[str, int] = {}  # first channel of each topic
        numbers = np.full(1 << 16, -1, np.int32)
        for channel, key in names.items():
            numbers[channel] = first.setdefault(key, channel)
        waiting = NOTHING  # may be later than messages of the next chunk
        found = self.each(lambda _, data: batch_in(data, numbers), names, start_ns, end_ns)
        for place, batch in found:
            ready, waiting = waiting.split(place.start_ns)
            yield ready
            _, batch = batch.split(start_ns)
            if end_ns is not None:
                batch, _ = batch.split(end_ns)
            waiting = joined([waiting, batch])
        yield waiting

    def prove(self) -> int:
        """Read every chunk against its checksum, and return how many messages can be read.

        `damage` then has all that `messages` would skip.
        """
        return sum(len(batch.data) for batch in self._in_order(None, 0, None))

    def rename(self, keys: dict[str, str]) -> None:
        """Give the topics the keys that they have in the bag."""
        self.topics = {keys[key]: topic for key, topic in self.topics.items()}
        self.counts = {keys[key]: count for key, count in self.counts.items()}
        self.keys = {channel: keys[key] for channel, key in self.keys.items()}

    def each(
        self,
        take: Callable[[Chunk, bytes], _T],
        channels: Collection[int] | None = None,
        start_ns: int = 0,
        end_ns: int | None = None,
    ) -> Iterator[tuple[Place, _T]]:
        """Yield what `take` makes of each chunk and its records; skip and tell what is damaged.

        Only those with messages of these `channels` (None: any), received in a span of time.
        """
        with open(self.path, 'rb') as file:
            for place in self.places:
                inside = place.end_ns >= start_ns and (end_ns is None or place.start_ns < end_ns)
                known = channels is not None and place.channels
                wanted = not known or not place.channels.isdisjoint(channels or ())
                self.breathe()
                found = self.read(file, place, take) if inside and wanted else None
                if found is not None:
                    yield place, found

    def read(self, file: BinaryIO, place: Place, take: Callable[[Chunk, bytes], _T]) -> _T | None:
        """Return what `take` makes of a chunk and its records; None, and tell, if it is damaged."""
        try:
            if place.chunk:
                chunk = scan.chunk_at(file, place.offset, place.end, place.compression)
            else:  # one message by itself: taken for a chunk of one
                raw = scan.read_at(file, place.offset, place.end - place.offset)
                chunk = Chunk('', raw, place.end_ns, place.start_ns, 0, len(raw))
            return take(chunk, scan.unpack(chunk))
        except DamagedRecord as error:
            self._damaged(place.offset, place.end, str(error), place.start_ns, place.end_ns)
            return None

    def _damaged(self, start: int, end: int, why: str, start_ns: int = 0, end_ns: int = 0) -> None:
        damage = Damage(self.path.name, start, end, why, start_ns, end_ns)
        if damage not in self.damage:
            self.damage.append(damage)
            if not self._quiet:
                warnings.warn(damage.text(self.start_ns), BagDamaged, stacklevel=2)

    def _read(self, file: BinaryIO) -> None:
        self.size = scan.size_of(file)
        if not self._begins(file):
            return
        self.ours = by_this_project(file)
        size = self.size
        right_end = scan.read_at(file, max(size - len(MAGIC), 0), min(len(MAGIC), size)) == MAGIC
        try:
            found, index_wrong = from_index(file, size, self.ours), False
        except (DamagedRecord, McapError, struct.error, ValueError):
            found, index_wrong = None, True  # and not just left out
        self.indexed = found is not None
        self.contents = contents = found or walked(file, size, self.ours, self.breathe)
        self.places = sorted(contents.places)
        self.start_ns = min((p.start_ns for p in self.places), default=0)
        self.end_ns = max((p.end_ns for p in self.places), default=0)
        for k, hole in contents.holes:
            times = span(hole, contents.places[:k], contents.places[k:])
            self._damaged(hole.offset, hole.end, hole.why, *times)
        if self.indexed and not right_end:
            self._damaged(size - len(MAGIC), size, 'the last bytes')
        elif not self.indexed and not (contents.complete and right_end):
            self.cut_at = contents.data_end
        elif not self.indexed and (self.ours or index_wrong):
            self._damaged_index(file, contents.data_end)
        for channel in contents.channels.values():
            self._add(channel, contents.schemas.get(channel.schema_id))
        self._check_metadata()

    def _damaged_index(self, file: BinaryIO, start: int) -> None:
        """Note that the index is damaged, or that a second file stands behind it (`cat`)."""
        file.seek(start)
        end = file.read(LARGEST_INDEX).find(2 * MAGIC)
        if end < 0:
            self._damaged(start, self.size, 'the index')
        else:
            second = start + end + len(MAGIC)
            why = f'a second file: `tail -c +{second + 1}` takes it out'
            self._damaged(second, self.size, why, self.end_ns, FOREVER)

    def _begins(self, file: BinaryIO) -> bool:
        """Return whether there is anything; raise ConfigError where it is no bag."""
        magic = file.read(len(MAGIC))
        if magic == MAGIC:
            return True
        part = self.path.name.endswith(PART)
        known = part or self.path.name.endswith('.mcap')
        if kind := next((k for head, k in _OTHERS.items() if magic.startswith(head)), ''):
            raise ConfigError(f'{self.path}: not an MCAP file, but {kind}')
        if not (known and scan.anchored(file)):
            if part:
                self.cut_at = 0  # the power failed before the first bytes were on the disk
                return False
            if not magic:
                raise ConfigError(f'{self.path}: not a bag: the file is empty')
            raise ConfigError(f'{self.path}: not a bag: begins with {magic!r}, not {MAGIC!r}')
        self._damaged(0, len(MAGIC), f'the beginning is lost: begins with {magic!r}')
        return True

    def _check_metadata(self) -> None:
        """Keep what has the right checksum; the copy in rosbag2's own record stands in."""
        broken = []
        for offset, record in self.contents.metadata:
            pairs = dict(record.metadata)
            crc = pairs.pop(scan.CRC_KEY, None)
            if crc == scan.pairs_crc(pairs):
                self.metadata[record.name] = pairs
            elif self.ours:
                broken.append((offset, record.name))
            else:
                self.metadata[record.name] = record.metadata
        for offset, name in broken:
            self._damaged(offset, offset + HEAD.size, f'metadata {name}')
        missing = [m for m in (RUN_METADATA, GAPS_METADATA) if m not in self.metadata]
        if self.ours and missing and (custom := _custom_data(self.metadata.get('rosbag2', {}))):
            known = self.metadata.get(GAPS_METADATA, {}) | self.metadata.get(RUN_METADATA, {})
            self.metadata[missing[0]] = {k: v for k, v in custom.items() if k not in known}

    def _add(self, channel: Channel, schema: Schema | None) -> None:
        topic = BagTopic(
            channel.topic,
            schema.name if schema else '',
            schema.data.decode(errors='surrogateescape') if schema else '',
            channel.metadata.get('topic_type_hash', ''),
            channel.metadata.get('offered_qos_profiles', ''),
            channel.message_encoding,
            schema.encoding if schema else '',
            tuple(p for p in sorted(channel.metadata.items()) if p[0] not in _NAMED),
        )
        self.keys[channel.id] = key = add_topic(self.topics, topic)
        self.counts[key] = self.counts.get(key, 0) + self.contents.counts[channel.id]


def span(hole: Found, before: Sequence[Place], after: Sequence[Place]) -> tuple[int, int]:
    """Return the time span, in ns, in which a hole between places of a file may lose messages."""
    if hole.framed:
        return 0, 0
    # between chunks of several messages: an image chunk overlaps them in time
    start_ns = next((p.end_ns for p in reversed(before) if p.start_ns < p.end_ns), 0)
    end_ns = next((p.end_ns for p in after if p.start_ns < p.end_ns), FOREVER)
    if isinstance(hole.record, Chunk):
        said = hole.record.message_start_time, hole.record.message_end_time
        if not said[1]:
            return 0, 0  # definitions
        if start_ns <= said[0] <= said[1] <= end_ns:
            return said
    return start_ns, max(start_ns, end_ns)


def add_topic(topics: dict[str, BagTopic], topic: BagTopic) -> str:
    """Add `topic` to `topics`, by key, if they lack it; return its key there."""
    for variant in itertools.count():
        topic = replace(topic, variant=variant)
        known = topics.setdefault(topic.key, topic)
        if known.same(topic):
            topics[topic.key] = topic  # the last definition of its quality of service
            return topic.key
    raise AssertionError


def by_this_project(file: BinaryIO) -> bool:
    """Return whether the header of a file says that this project wrote it."""
    first = next(scan.walk(file, len(MAGIC), scan.size_of(file)), None)
    return bool(first and isinstance(first.record, Header) and first.record.library == LIBRARY)


def from_index(file: BinaryIO, size: int, ours: bool) -> Contents | None:
    """Return what the index of a file says, None without one; raise DamagedRecord if it is wrong.

    It must have its checksum, where this project wrote it.
    """
    tail = FOOTER.size + len(MAGIC)
    if size < 2 * tail:
        return None
    footer = scan.read_at(file, size - tail, FOOTER.size)
    opcode, length, start, _, crc = FOOTER.unpack(footer)
    if opcode != Opcode.FOOTER or length != 20 or not len(MAGIC) < start < size - tail:
        return None
    data = scan.read_at(file, start, size - tail - start)
    if (crc or ours) and crc != zlib.crc32(footer[:-4], zlib.crc32(data)):
        raise DamagedRecord('wrong checksum')
    found, statistics = Contents(data_end=start, complete=True), None
    for record in StreamReader(io.BytesIO(data + footer + MAGIC), skip_magic=True).records:
        if isinstance(record, ChunkIndex):
            begin, end = record.chunk_start_offset, record.chunk_start_offset + record.chunk_length
            times = record.message_start_time, record.message_end_time
            channels = frozenset(record.message_index_offsets)
            if times[1] or channels:  # else it has only definitions
                found.places.append(Place(*times, begin, end, channels, record.compression))
        elif isinstance(record, (Schema, Channel)):
            found.define(record, trusted=True)
        elif isinstance(record, MetadataIndex):
            _add_metadata(found, file, record.offset, record.length)
        elif isinstance(record, Statistics):
            statistics = record
    if statistics is None or (statistics.message_count and not found.places):
        return None
    found.counts.update(statistics.channel_message_counts)
    found.attachments = statistics.attachment_count
    return found


def _add_metadata(found: Contents, file: BinaryIO, offset: int, length: int) -> None:
    there = scan.record_at(file, offset, offset + length)
    if not isinstance(there.record, Metadata) or there.end != offset + length:
        why = there.why or 'no metadata there'
        there = Found(offset, offset + length, why=why, framed=True)
    found.add(there)


def walked(file: BinaryIO, size: int, ours: bool, breathe: Callable[[], object]) -> Contents:
    """Return what is in a file without an index; each chunk is proved."""
    contents = Contents()
    for found in scan.walk(file, len(MAGIC), size, ours):
        breathe()
        contents.add(found)
        contents.data_end = found.end
        contents.complete = isinstance(found.record, DataEnd) and not found.why
    if contents.complete:
        for known in scan.definitions_at(file, contents.data_end, size):
            contents.define(known, trusted=False)
    return contents


def _custom_data(rosbag2: dict[str, str]) -> dict[str, str]:
    try:
        information = yaml_text.load(rosbag2.get('serialized_metadata', '')) or {}
        return information['rosbag2_bagfile_information']['custom_data'] or {}
    except (yaml.YAMLError, KeyError, TypeError):
        return {}
