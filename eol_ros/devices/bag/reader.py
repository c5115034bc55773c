# SPDX-License-Identifier: Apache-2.0
"""Reads bags: a rosbag2 folder of MCAP files, or one such file, whole, cut or damaged; no ROS.

What cannot be read is skipped and said (`BagReader.damage`, and a warning): never passed on, and
never the end of the reading. An index is used where its checksum is right; else the file is walked
through once and each chunk proved (see `scan`).
"""

import heapq
import itertools
import struct
import time
import warnings
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import yaml
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from eol_ros.devices.bag import scan
from eol_ros.devices.bag.mcap_file import LIBRARY, BagTopic
from eol_ros.devices.bag.scan import MAGIC, ChunkHead, ChunkMessage, DamagedRecord
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, REPLAY_OF, RUN_METADATA, SAMPLE
from eol_ros.errors import BagDamaged, ConfigError, DeviceMissing
from eol_ros.streams.graph import TOPICS, full_name, namespace_of

if TYPE_CHECKING:
    from eol_ros.devices.bag.batches import Batch

FOOTER = struct.Struct('<BQQQI')  # opcode, length, start of the summary, of its offsets, crc
FOREVER = (1 << 63) - 1
MERGED = 4096  # messages of files that overlap in time, in memory at a time
LOOK_BACK_NS = 60_000_000_000
_INDEX = struct.Struct('<QQQQI')  # start, end, offset, length, bytes of the map that follows
_COUNTS = struct.Struct('<QHIIIIQQI')  # messages, schemas, ..., start, end, bytes of the map


class BagMessage(NamedTuple):
    """One recorded message: serialised data, reception and sending time in ns since the epoch."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class Damage(NamedTuple):
    """A stretch of bytes of `file` that cannot be read, and which time of it is missing, in ns.

    Where no message is missing the times are 0.
    """

    file: str
    start: int
    end: int
    why: str
    start_ns: int = 0
    end_ns: int = 0

    def text(self, bag_start_ns: int) -> str:
        """Return it in words, with times from the start of the bag, too."""
        where = f'{self.file}: bytes {self.start} to {self.end} are damaged ({self.why})'
        if not self.end_ns:
            return f'{where}; no message is missing'
        begin = f'{(self.start_ns - bag_start_ns) * 1e-9:.3f} s' if self.start_ns else 'the start'
        end = f'{(self.end_ns - bag_start_ns) * 1e-9:.3f} s' if self.end_ns < FOREVER else 'the end'
        day = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(self.start_ns // 10**9))
        day = f' ({day})' if self.start_ns else ''
        return f'{where}: messages from {begin} to {end} may be missing{day}'


class Unreadable(NamedTuple):
    """What damage has cost: messages, of files whose index counts them, and how long it lasts."""

    messages: int
    seconds: float


class Place(NamedTuple):
    """Where messages lie in a file: a chunk, or one message by itself. Times in ns, true ones."""

    start_ns: int
    end_ns: int
    offset: int
    end: int
    channels: frozenset[int]  # empty: not known
    compression: str  # of a chunk; the record itself may be damaged
    chunk: bool = True


class BagFileReader:
    """One MCAP file: what is in it, where, and its messages.

    `with_places` off: only what there is of each topic and when, without the memory for an index.
    `walk` off: nothing is known of a file without an index, but that.
    """

    def __init__(self, path: Path, with_places: bool = True, walk: bool = True):
        self.path = path
        self._walk = walk
        self._with_places = with_places
        self.topics: dict[str, BagTopic] = {}
        self.counts: dict[str, int] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: list[Damage] = []
        self.start_ns, self.end_ns = 0, 0
        self.cut_at: int | None = None  # bytes that could be read of a file cut short
        self.places: list[Place] = []
        self.names: dict[int, str] = {}  # topic by number of the channel
        self.indexed = False  # it has an index, and that is right
        self._index_wrong = False
        self.ours = False  # this project wrote it, with checksums
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._metadata: list[tuple[int, Metadata]] = []
        try:
            with open(path, 'rb') as file:
                self._read(file)
        except OSError as error:
            raise DeviceMissing(f'{path}: {error.strerror}') from None

    def messages(
        self, topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield the messages in order of reception; skip and tell what cannot be read."""
        wanted = {k for k, name in self.names.items() if topics is None or name in topics}
        waiting: list[tuple[int, int, int, ChunkMessage]] = []
        with open(self.path, 'rb') as file:
            for place in self._places(wanted, start_ns, end_ns):
                while waiting and waiting[0][0] < place.start_ns:
                    yield self._message(heapq.heappop(waiting)[3])
                for count, m in enumerate(self._load(file, place, wanted)):
                    inside = m.log_ns >= start_ns and (end_ns is None or m.log_ns < end_ns)
                    if inside:
                        heapq.heappush(waiting, (m.log_ns, place.offset, count, m))
            while waiting:
                yield self._message(heapq.heappop(waiting)[3])

    def prove(self) -> None:
        """Read every chunk against its checksum: `damage` has all that `messages` would skip."""
        with open(self.path, 'rb') as file:
            for place in self.places:
                self._load(file, place, set())

    def batches(
        self, topics: Collection[str], start_ns: int, end_ns: int | None
    ) -> Iterator[tuple[str, 'Batch']]:
        """Yield what `messages` yields, some of one topic at a time; each topic in its order."""
        from eol_ros.devices.bag.batches import joined  # brings NumPy, which few need

        wanted = {k for k, name in self.names.items() if name in topics}
        waiting: dict[str, Batch] = {}  # may lie behind messages of the next chunk
        with open(self.path, 'rb') as file:
            for place in self._places(wanted, start_ns, end_ns):
                for topic, batch in list(waiting.items()):
                    ready, waiting[topic] = batch.split(place.start_ns)
                    if ready.data:
                        yield topic, ready
                for number, batch in self._load_batches(file, place, wanted).items():
                    topic = self.names[number]
                    _, batch = batch.split(start_ns)
                    if end_ns is not None:
                        batch, _ = batch.split(end_ns)
                    before = waiting.get(topic)
                    waiting[topic] = joined([before, batch]) if before else batch
            for topic, batch in waiting.items():
                if batch.data:
                    yield topic, batch

    def defines(self, record: Schema | Channel) -> bool:
        """Return whether a schema or channel is the one that holds for its number."""
        known: dict = self._schemas if isinstance(record, Schema) else self._channels
        return known.get(record.id) == record

    def _places(self, wanted: set[int], start_ns: int, end_ns: int | None) -> Iterator[Place]:
        for place in self.places:
            if place.end_ns < start_ns or (end_ns is not None and place.start_ns >= end_ns):
                continue
            if not place.channels or place.channels & wanted:
                yield place

    def _message(self, m: ChunkMessage) -> BagMessage:
        return BagMessage(self.names[m.channel], m.log_ns, m.publish_ns, m.sequence, m.data)

    def _load(self, file: BinaryIO, place: Place, wanted: set[int]) -> list[ChunkMessage]:
        try:
            if not place.chunk:
                body = scan.read_at(file, place.offset, place.end - place.offset)
                found = [scan.parse(Opcode.MESSAGE, body[scan.HEAD.size :])]
                return [m for m in found if m.channel in wanted]
            return list(scan.messages_in(unpacked(file, place), wanted))
        except DamagedRecord as error:
            self._damaged(place.offset, place.end, str(error), place.start_ns, place.end_ns)
            return []

    def _load_batches(self, file: BinaryIO, place: Place, wanted: set[int]) -> dict[int, 'Batch']:
        from eol_ros.devices.bag.batches import batch_of, batches_in

        if not place.chunk:
            return {m.channel: batch_of([m]) for m in self._load(file, place, wanted)}
        try:
            return batches_in(unpacked(file, place), wanted)
        except DamagedRecord as error:
            self._damaged(place.offset, place.end, str(error), place.start_ns, place.end_ns)
            return {}

    def _damaged(self, start: int, end: int, why: str, start_ns: int = 0, end_ns: int = 0) -> None:
        damage = Damage(self.path.name, start, end, why, start_ns, end_ns)
        if damage not in self.damage:
            self.damage.append(damage)
            warnings.warn(damage.text(self.start_ns), BagDamaged, stacklevel=2)

    def _read(self, file: BinaryIO) -> None:
        size, magic = scan.size_of(file), b''
        file.seek(0)
        magic = file.read(len(MAGIC))
        if magic != MAGIC:
            near = scan.near_magic(magic)
            part = self.path.name.endswith(PART)
            if not near and part and scan.anchor(file, 0, size) is None:
                self.cut_at = 0  # the power failed before the first bytes were on the disk
                return
            if not magic:
                raise ConfigError(f'{self.path}: not a bag: the file is empty')
            known = part or self.path.name.endswith('.mcap')
            if not near and (not known or scan.anchor(file, 0, size) is None):
                raise ConfigError(f'{self.path}: not a bag: begins with {magic!r}, not {MAGIC!r}')
            self._damaged(0, len(MAGIC), f'begins with {magic!r}')
        self.ours = by_this_project(file, size)
        if not self._read_summary(file, size):
            self.places, self._schemas, self._channels = [], {}, {}
            if not self._walk:
                return
            self._read_all(file, size)
        for channel in self._channels.values():
            self._add(channel, self._schemas.get(channel.schema_id))
        self._check_metadata()

    def _read_summary(self, file: BinaryIO, size: int) -> bool:
        """Take what is in the file from its index; return whether that is whole and right."""
        tail = FOOTER.size + len(MAGIC)
        if size < 2 * tail:
            return False
        opcode, length, start, _, crc = FOOTER.unpack(scan.read_at(file, size - tail, FOOTER.size))
        places: list[tuple[int, int]] = []  # offset and length of each record of metadata
        if opcode != Opcode.FOOTER or length != 20 or not len(MAGIC) < start < size - tail:
            return False
        counts, per_channel = None, []
        found_crc, at, end = 0, start, size - tail
        try:
            while at < end:
                head = scan.read_at(file, at, scan.HEAD.size)
                kind, length = scan.HEAD.unpack(head)
                at += scan.HEAD.size + length
                if at > end:
                    return False
                body = file.read(length)
                found_crc = zlib.crc32(body, zlib.crc32(head, found_crc))
                if kind == Opcode.STATISTICS:
                    counts = _COUNTS.unpack_from(body)
                    per_channel = list(struct.iter_unpack('<HQ', body[_COUNTS.size :]))
                elif kind == Opcode.CHUNK_INDEX and self._with_places:
                    self._add_place(body)
                elif kind == Opcode.METADATA_INDEX:
                    places.append(struct.unpack_from('<QQ', body))
                elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._define(scan.parse(kind, body), trusted=True)
        except (DamagedRecord, struct.error):
            return False
        found_crc = zlib.crc32(scan.read_at(file, end, FOOTER.size - 4), found_crc)
        if crc != found_crc and (crc or self.ours):
            self._index_wrong = True  # and not just left out
            return False
        if counts is None or (counts[0] and self._with_places and not self.places):
            return False
        for offset, length in places:
            self._add_metadata(file, offset, length)
        self._count(per_channel)
        self.start_ns, self.end_ns = counts[6], counts[7]
        self.places.sort()
        self.indexed = True
        if scan.read_at(file, size - len(MAGIC), len(MAGIC)) != MAGIC:
            self._damaged(size - len(MAGIC), size, 'the last bytes')
        return True

    def _add_place(self, body: bytes) -> None:
        start_ns, end_ns, offset, length, count = _INDEX.unpack_from(body)
        channels = frozenset(k for k, _ in struct.iter_unpack('<HQ', body[36 : 36 + count]))
        kind = scan.Body(body[44 + count :]).text()
        if end_ns or channels:  # else definitions only
            self.places.append(Place(start_ns, end_ns, offset, offset + length, channels, kind))

    def _add_metadata(self, file: BinaryIO, offset: int, length: int) -> None:
        found = scan.record_at(file, offset, offset + length)
        if isinstance(found.body, Metadata) and found.end == offset + length:
            self._metadata.append((offset, found.body))
        else:
            self._damaged(offset, offset + length, found.why or 'no metadata there')

    def _define(self, record: Schema | Channel, trusted: bool) -> None:
        """Take a definition; one with a checksum holds against one without."""
        known: dict = self._schemas if isinstance(record, Schema) else self._channels
        if trusted:
            known[record.id] = record
        else:
            known.setdefault(record.id, record)

    def _read_all(self, file: BinaryIO, size: int) -> None:
        """Walk through a file without an index, and prove each chunk."""
        self.cut_at = len(MAGIC)
        counts: dict[int, int] = {}
        holes = []  # damage that messages may have been in, by number of places before it
        for found in scan.walk(file, len(MAGIC), size, self.ours):
            self.cut_at = found.end
            record = found.body
            if found.why:
                holes.append((len(self.places), found))
            elif isinstance(record, (Schema, Channel)):
                self._define(record, trusted=False)
            elif isinstance(record, Metadata):
                self._metadata.append((found.offset, record))
            elif isinstance(record, ChunkHead):
                why = self._take_chunk(file, found, record, counts)
                if why:
                    holes.append((len(self.places), found._replace(why=why)))
            elif isinstance(record, ChunkMessage):
                self._take_messages([record], found, '', counts)
            elif found.opcode == Opcode.DATA_END:
                if scan.read_at(file, size - len(MAGIC), len(MAGIC)) == MAGIC:
                    self.cut_at = None  # the data are whole
                    if self.ours or self._index_wrong:
                        self._damaged(found.end, size, 'the index')
                for known in scan.definitions_behind(file, found.offset, size):
                    self._define(known, trusted=False)
                break
        if self.places:
            self.start_ns = min(p.start_ns for p in self.places)
            self.end_ns = max(p.end_ns for p in self.places)
        for index, hole in holes:
            self._damaged(hole.offset, hole.end, hole.why, *self._span_of(hole, index))
        self.places.sort()
        self._count(counts.items())

    def _span_of(self, hole: scan.Found, index: int) -> tuple[int, int]:
        """Return from when to when messages may be lost in a hole before `places[index]`, ns."""
        # between the neighbours of many messages, for images lie among them
        before = [p.end_ns for p in self.places[:index] if p.start_ns < p.end_ns]
        after = [p.end_ns for p in self.places[index:] if p.start_ns < p.end_ns]
        return _span(hole, before[-1] if before else 0, after[0] if after else FOREVER)

    def _count(self, per_channel: Iterable[tuple[int, int]]) -> None:
        """Add up the messages of each topic, from those of each channel."""
        for number, count in per_channel:
            if number in self._channels:
                topic = self._channels[number].topic
                self.counts[topic] = self.counts.get(topic, 0) + count

    def _take_chunk(self, file, found: scan.Found, head: ChunkHead, counts: dict) -> str:
        """Prove a chunk and take note of what is in it; return why not, empty if it is right."""
        try:
            data = scan.chunk_data(file, head)
            for _at, kind, body in scan.records_in(data):
                if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._define(scan.parse(kind, body), trusted=bool(head.crc))
            self._take_messages(list(scan.messages_in(data)), found, head.compression, counts)
        except DamagedRecord as error:
            return str(error)
        return ''

    def _take_messages(self, messages: list, found: scan.Found, kind: str, counts: dict) -> None:
        if not messages:
            return
        for m in messages:
            counts[m.channel] = counts.get(m.channel, 0) + 1
        stamps = [m.log_ns for m in messages]
        channels = frozenset(m.channel for m in messages)
        chunk = isinstance(found.body, ChunkHead)
        self.places.append(
            Place(min(stamps), max(stamps), found.offset, found.end, channels, kind, chunk)
        )

    def _check_metadata(self) -> None:
        """Keep what has the right checksum; the copy in rosbag2's own record stands in."""
        broken = {}
        for offset, record in self._metadata:
            pairs = dict(record.metadata)
            crc = pairs.pop(scan.CRC_KEY, None)
            if crc == scan.pairs_crc(pairs):
                self.metadata[record.name] = pairs
            elif self.ours:
                broken[offset] = record
            else:
                self.metadata[record.name] = record.metadata
        for offset, record in broken.items():
            self._damaged(offset, offset + 9, f'metadata {record.name}')
        about, gaps = self.metadata.get(RUN_METADATA), self.metadata.get(GAPS_METADATA)
        if not self.ours or (about is not None and gaps is not None):
            return
        custom = _custom_data(self.metadata.get('rosbag2', {}))
        if about is None and custom:
            self.metadata[RUN_METADATA] = {k: v for k, v in custom.items() if k not in (gaps or ())}
        elif gaps is None and custom:
            self.metadata[GAPS_METADATA] = {
                k: v for k, v in custom.items() if k not in (about or ())
            }

    def _add(self, channel: Channel, schema: Schema | None) -> None:
        self.names[channel.id] = channel.topic
        self.counts.setdefault(channel.topic, 0)
        self.topics[channel.topic] = BagTopic(
            channel.topic,
            schema.name if schema else '',
            schema.data.decode(errors='replace') if schema else '',
            channel.metadata.get('topic_type_hash', ''),
            channel.metadata.get('offered_qos_profiles', ''),
        )


def by_this_project(file: BinaryIO, size: int) -> bool:
    """Return whether the header of a file says that this project wrote it."""
    first = next(scan.walk(file, len(MAGIC), size), None)
    return bool(first and isinstance(first.body, Header) and first.body.library == LIBRARY)


def unpacked(file: BinaryIO, place: Place) -> bytes:
    """Return the records of the chunk at `place`; raise DamagedRecord.

    Only its checksum and its data are taken from the record itself: what they say holds, whatever
    else of the head is damaged.
    """
    kind = place.compression
    data_at = place.offset + scan.HEAD.size + scan.CHUNK.size + len(kind) + 8
    head = scan.read_at(file, place.offset, data_at - place.offset)
    size, crc = struct.unpack_from('<QI', head, scan.HEAD.size + 16)
    data_bytes = place.end - data_at
    return scan.chunk_data(
        file, ChunkHead(place.start_ns, place.end_ns, size, crc, kind, data_at, data_bytes)
    )


def _span(hole: scan.Found, before_ns: int, after_ns: int) -> tuple[int, int]:
    """Return from when to when messages may be missing: what a head says, where that can be."""
    if hole.framed:
        return 0, 0
    if isinstance(hole.body, ChunkHead):
        head = hole.body
        if not head.end_ns:
            return 0, 0  # definitions
        if before_ns <= head.start_ns <= head.end_ns <= after_ns:
            return head.start_ns, head.end_ns
    return before_ns, max(before_ns, after_ns)


def _custom_data(rosbag2: dict[str, str]) -> dict[str, str]:
    try:
        information = yaml.safe_load(rosbag2.get('serialized_metadata', '')) or {}
        return information['rosbag2_bagfile_information']['custom_data'] or {}
    except (yaml.YAMLError, KeyError, TypeError):
        return {}


class BagReader:
    """A bag, opened to be read: `topics`, `counts`, times, `about`, `gaps`, and `messages()`.

    `namespace` is that of the graph that was recorded; `name` and `count` speak of the topics of
    the table of the graph (`streams.graph`), which are in that namespace.

    Parameters
    ----------
    path : str or Path
        A bag folder, an .mcap file, or a folder that holds bags. This stands for the newest run in
        it, or for the sample that ships where there is no run; recordings of a replay count only
        where they are named themselves.

    Raises
    ------
    DeviceMissing
        There is no such file.
    ConfigError
        It is not a bag.

    Examples
    --------
    >>> bag = BagReader('bags/sample')
    >>> bag.topics['/eol/slips'].type
    'eol_msgs/msg/Slip'
    """

    def __init__(self, path: str | Path):
        self.path = _newest(Path(path))
        self.files = [BagFileReader(p) for p in _mcap_files(self.path)]
        self.files.sort(key=lambda f: (f.start_ns, f.path.name))
        self.topics: dict[str, BagTopic] = {}
        self.counts: dict[str, int] = {}
        for file in self.files:
            self.topics.update(file.topics)
            for topic, count in file.counts.items():
                self.counts[topic] = self.counts.get(topic, 0) + count
        self.namespace = namespace_of({t.name: t.type for t in self.topics.values()})
        filled = [f for f in self.files if f.places]
        self.start_ns = min((f.start_ns for f in filled), default=0)
        self.end_ns = max((f.end_ns for f in filled), default=0)

    @property
    def duration_s(self) -> float:
        """From the first message to the last."""
        return (self.end_ns - self.start_ns) * 1e-9

    @property
    def about(self) -> dict[str, str]:
        """Scene text, versions and seeds of the run."""
        return self._metadata(RUN_METADATA)

    @property
    def gaps(self) -> dict[str, str]:
        """What was lost on the way, as counted by the recorder."""
        return self._metadata(GAPS_METADATA)

    @property
    def cut_short(self) -> list[str]:
        """One line for each file that has no end: how much of it could be read."""
        return [
            f'{f.path.name} has no end: {f.cut_at} of {f.path.stat().st_size} bytes read, '
            f'{sum(f.counts.values())} messages'
            for f in self.files
            if f.cut_at is not None
        ]

    @property
    def damage(self) -> list[str]:
        """One line for each stretch found damaged so far: `verify` finds all before reading."""
        return [d.text(self.start_ns) for f in self.files for d in f.damage]

    def prove(self, through: Callable[[list], Iterator] = iter) -> 'Unreadable':
        """Read every chunk against its checksum, and return what is lost; `damage` says where.

        `through` hands on the files, to show progress.
        """
        missing, spans = 0, []
        for file in through(self.files):
            file.prove()
            for d in file.damage:
                if d.end_ns:
                    spans.append((d.start_ns or self.start_ns, min(d.end_ns, self.end_ns)))
            if file.damage and file.indexed:
                missing += sum(file.counts.values())
                missing -= sum(1 for _ in file.messages(None, 0, None))
        seconds, until_ns = 0.0, 0
        for start_ns, end_ns in sorted(spans):
            seconds += max(end_ns - max(start_ns, until_ns), 0) * 1e-9
            until_ns = max(until_ns, end_ns)
        return Unreadable(missing, seconds)

    def name(self, topic: str) -> str:
        """Return the full name that a topic of the graph has, or would have, in this bag."""
        was = TOPICS[topic].was if topic in TOPICS else ''
        name = full_name(topic, self.namespace)
        before = full_name(was, self.namespace)
        return before if was and before in self.topics and name not in self.topics else name

    def count(self, topic: str) -> int:
        """Return how many messages of a topic of the graph there are."""
        return self.counts.get(self.name(topic), 0)

    def find(self, name: str) -> str:
        """Return the full name of topic `name`, with or without namespace; raise ConfigError."""
        for candidate in (name, f'/{name}', self.name(name)):
            if candidate in self.topics:
                return candidate
        raise ConfigError(
            f'{self.path}: no topic {name} in this bag; there are ' + ', '.join(sorted(self.topics))
        )

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int = 0,
        end_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Read serialised messages in order of their reception.

        Parameters
        ----------
        topics : collection of str, optional
            Full names; None means all.
        start_ns, end_ns : int
            Only messages with start_ns <= reception < end_ns, in ns since the epoch.

        Yields
        ------
        BagMessage
            Topic, times in ns, sequence number and CDR bytes.

        Examples
        --------
        >>> first = next(BagReader('bags/sample').messages(['/eol/slips']))
        >>> first.topic, len(first.data)
        ('/eol/slips', 100)
        """
        files, apart = self._files(start_ns, end_ns)
        streams = [f.messages(topics, start_ns, end_ns) for f in files]
        if apart:  # one file at a time in memory
            for stream in streams:
                yield from stream
        else:
            yield from heapq.merge(*streams, key=lambda m: m.log_ns)

    def batches(
        self, topics: Collection[str], start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[tuple[str, 'Batch']]:
        """Yield what `messages` yields, full topic and some of its messages at a time.

        Each topic is in order of reception; one is not in order with another.
        """
        from eol_ros.devices.bag.batches import batch_of

        files, apart = self._files(start_ns, end_ns)
        if apart:
            for f in files:
                yield from f.batches(topics, start_ns, end_ns)
            return
        messages = self.messages(topics, start_ns, end_ns)
        while some := list(itertools.islice(messages, MERGED)):
            for topic in {m.topic: None for m in some}:
                yield topic, batch_of([m for m in some if m.topic == topic])

    def _files(self, start_ns: int, end_ns: int | None) -> tuple[list[BagFileReader], bool]:
        """Return the files with messages of a span, and whether they follow each other in time."""
        files = [
            f
            for f in self.files
            if f.places and f.end_ns >= start_ns and (end_ns is None or f.start_ns < end_ns)
        ]
        return files, all(a.end_ns <= b.start_ns for a, b in itertools.pairwise(files))

    def latched(self, topics: Collection[str] | None, at_ns: int) -> list[BagMessage]:
        """Return what holds at a time: of each latched topic the last message received before it.

        topics: of these alone (None: all). The messages come in order of reception.
        """
        open_ = {t.name for t in self.topics.values() if t.latched}
        open_ = {name for name in open_ if self.counts[name] and (topics is None or name in topics)}
        found: dict[str, BagMessage] = {}
        end_ns, span_ns = at_ns, LOOK_BACK_NS
        while open_ and end_ns > self.start_ns:  # backwards: most were told again a while ago
            begin_ns = max(end_ns - span_ns, self.start_ns)
            found |= {m.topic: m for m in self.messages(open_, begin_ns, end_ns)}
            open_ -= set(found)
            end_ns, span_ns = begin_ns, 4 * span_ns
        return sorted(found.values(), key=lambda m: m.log_ns)

    def _metadata(self, name: str) -> dict[str, str]:
        for file in reversed(self.files):
            if name in file.metadata:
                return file.metadata[name]
        return {}


def bags_in(path: Path) -> list[Path]:
    """Return the bag folders in `path`; none where that is a bag itself, or a file.

    A file beside them, such as a stretch that was cut out of one, does not make `path` a bag.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted({p.parent for p in path.glob('*/*') if _is_mcap(p)})


def _is_mcap(path: Path) -> bool:
    return path.name.endswith(('.mcap', '.mcap' + PART))


def _newest(path: Path) -> Path:
    """Return the newest run in `path`; a bag is returned as it is.

    A replay records too, beside the bag that it plays: it must not find itself.
    """
    bags = bags_in(path)
    sample = None
    for bag in sorted(bags, key=lambda p: (p.stat().st_mtime_ns, p.name), reverse=True):
        about = _run_metadata(_mcap_files(bag)[0])
        if about is None or REPLAY_OF in about:
            continue
        if SAMPLE not in about:
            return bag
        sample = bag
    if sample:
        return sample
    if bags:
        raise ConfigError(f'{path}: only recordings of replays in it; name the one that you want')
    return path


def _run_metadata(path: Path) -> dict[str, str] | None:
    """Return what a file says of its run, read from its beginning; None if it just begins."""
    try:
        with open(path, 'rb') as file:
            for found in scan.walk(file, len(MAGIC), scan.size_of(file)):
                record = found.body
                if isinstance(record, Metadata) and record.name == RUN_METADATA:
                    return record.metadata
                if isinstance(record, ChunkMessage) or (
                    isinstance(record, ChunkHead) and record.end_ns
                ):
                    return {}  # of another program
    except OSError:  # renamed meanwhile: it is whole now
        return {}
    return None if path.name.endswith(PART) else {}


def _mcap_files(path: Path) -> list[Path]:
    if not path.exists():
        raise DeviceMissing(f'{path}: no such bag')
    if path.is_file():
        return [path]
    files = [p for p in path.iterdir() if _is_mcap(p)]
    names = {p.name for p in files}
    files = [p for p in files if p.name.removesuffix(PART) not in names - {p.name}]
    try:
        listed = (information(path) or {}).get('relative_file_paths', [])
    except ConfigError:
        if not files:
            raise
        listed = []  # damaged; the files say it all again
    missing = sorted(set(listed) - names)
    if missing:
        raise DeviceMissing(f'{path}: {missing[0]} is named in metadata.yaml and is not there')
    if not files:
        raise ConfigError(f'{path}: not a bag: a folder without .mcap files')
    return sorted(files)


def information(folder: Path) -> dict | None:
    """Return what `metadata.yaml` of a bag says, None without one; raise ConfigError."""
    file = folder / 'metadata.yaml'
    if not file.exists():
        return None
    try:
        return loads(file.read_text(encoding='utf-8'))
    except (yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError, ValueError):
        raise ConfigError(f'{file}: not the metadata of a rosbag2 folder') from None


def loads(text: str) -> dict:
    """Parse the text of a `metadata.yaml`; raises the errors of YAML and of a wrong text."""
    found = yaml.safe_load(text)['rosbag2_bagfile_information']
    return {**found, 'relative_file_paths': [str(p) for p in found['relative_file_paths']]}


def metadata_fault(folder: Path, count: int) -> str:
    """Return what is wrong with `metadata.yaml` of a bag of `count` messages, empty if nothing."""
    try:
        said = (information(folder) or {}).get('message_count', count)
    except ConfigError as error:
        return f'{error}: `eol bag recover` rewrites it'
    if said != count:
        return (
            f'metadata.yaml speaks of {said} messages, the files of {count}: '
            '`eol bag recover` rewrites it'
        )
    return ''
