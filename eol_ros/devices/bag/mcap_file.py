# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of a bag, written chunk by chunk (https://mcap.dev/spec, version 0).

The records are those of the `mcap` package. Its Writer has one open chunk and one zstd level: a
1 MB infrared image takes 8 ms at its level 3 and 1.3 ms, and fewer bytes, at level 1. Images would
also share chunks with small messages.
"""

import os
import struct
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from eol_ros.devices.bag.scan import CRC_KEY, MAGIC, chunk_head, packed, pairs_crc
from eol_ros.devices.files.names import shown
from eol_ros.disk import DISK, Disk
from eol_ros.errors import printable

LIBRARY = 'eol_ros 2'  # its metadata carry a checksum; its definitions are in the first chunk, too
CHUNK_BYTES = 1 << 20  # the most that a killed writer or a flipped bit can lose
CHUNK_NS = 1_000_000_000  # the same in time
BIG_BYTES = 1 << 16  # such messages, images, get a chunk each: who wants the rest skips them
ZSTD_LEVEL = 1
_MESSAGE = struct.Struct('<BQHIQQ')  # opcode, length, channel, sequence, log time, publish time


@dataclass(frozen=True)
class BagTopic:
    """One recorded topic: full name, `package/msg/Name`, definition as `ros2msg`, RIHS01 hash, QoS.

    `qos` is YAML text, a list of one map per publisher, in the words of rosbag2's metadata 9.
    Recorders of other systems have other encodings; bytes of a definition that are no text are
    surrogates in it. `more`: further pairs that belong to the channel. `variant` counts further
    definitions of the same name in a bag.
    """

    name: str
    type: str
    definition: str
    type_hash: str = ''
    qos: str = ''
    encoding: str = 'cdr'
    schema_encoding: str = 'ros2msg'
    more: tuple[tuple[str, str], ...] = ()
    variant: int = 0

    @property
    def key(self) -> str:
        """The printable name of the topic in a bag, unique for each of its definitions."""
        name = printable(self.name)
        return f'{name} (definition {self.variant + 1})' if self.variant else name

    @property
    def foreign(self) -> str:
        """The encodings, where messages are not those of ROS 2; else an empty string."""
        ours = self.encoding == 'cdr' and self.schema_encoding == 'ros2msg'
        return '' if ours else f'{self.encoding or "none"}/{self.schema_encoding or "no schema"}'

    def same(self, other: 'BagTopic') -> bool:
        """Return whether messages of both are read alike."""
        return (self.name, self.schema, self.encoding) == (other.name, other.schema, other.encoding)

    @property
    def schema(self) -> tuple[str, str, str]:
        """What makes a schema: its type, encoding and definition."""
        return self.type, self.schema_encoding, self.definition

    @property
    def latched(self) -> bool:
        """Whether the publisher keeps the last message for those who come late."""
        return 'transient_local' in self.qos

    def metadata(self) -> dict[str, str]:
        """Return what is stored with the channel."""
        ours = {'offered_qos_profiles': self.qos, 'topic_type_hash': self.type_hash}
        if self.foreign:
            ours = {name: text for name, text in ours.items() if text}
        return dict(self.more) | ours


class BagMessage(NamedTuple):
    """One message of a bag: serialised data, reception and sending time in ns since the epoch.

    `topic`: key of its topic; `sequence`: sequence number of the publisher, 0 if unknown.
    """

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int


class _Chunk:
    """Messages that are compressed together, and where each channel's lie in it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.start_ns = self.end_ns = 0
        self.index: dict[int, list[tuple[int, int]]] = {}  # log time, offset; by channel

    def add(self, channel: int, data: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        self.start_ns = min(self.start_ns, log_ns) if self.index else log_ns
        self.end_ns = max(self.end_ns, log_ns)
        self.index.setdefault(channel, []).append((log_ns, len(self.data)))
        self.data += _MESSAGE.pack(
            Opcode.MESSAGE, 22 + len(data), channel, sequence & 0xFFFFFFFF, log_ns, publish_ns
        )
        self.data += data


class BagFile:
    """Writes one MCAP file; every method may raise OSError.

    Channel numbers are 1 + the index into `topics`. Nothing is readable before `flush`, and all
    that was flushed stays readable when the process is killed.
    """

    def __init__(
        self,
        path: Path,
        topics: Collection[BagTopic],
        level: int = ZSTD_LEVEL,
        disk: Disk = DISK,
    ):
        schemas, channels = describe_topics(topics)
        self.path = path
        self._disk = disk
        self.counts = {channel.id: 0 for channel in channels}  # messages
        self.message_count = self.start_ns = self.end_ns = 0
        self._compressor = zstandard.ZstdCompressor(level=level)
        self._chunk = _Chunk()
        self._chunk_count = 0
        self._chunk_index = bytearray()  # packed: images make 200 000 of them an hour
        self._metadata_index: list[bytes] = []
        self._schemas, self._channels = [[packed(r) for r in kind] for kind in (schemas, channels)]
        self.file = disk.create(path)
        described = b''.join([*self._schemas, *self._channels])
        self.file.write(MAGIC + packed(Header('ros2', LIBRARY)) + described)
        # Once more in a chunk: a flipped bit in a definition would change what messages mean, and
        # only chunks have a checksum. Where a file is cut, it has no summary.
        definitions = _Chunk()
        definitions.data += described
        self._write_chunk(definitions)

    @property
    def size_bytes(self) -> int:
        """Bytes of the file so far, with the chunk in progress uncompressed."""
        return self.file.tell() + len(self._chunk.data)

    def write(
        self,
        channel: int,
        data: bytes,
        log_ns: int,
        publish_ns: int,
        sequence: int = 0,
        hurry: bool = False,
    ) -> None:
        """Add one message, stamped with reception and sending time in ns since the epoch.

        In a hurry, an image is stored without compression: half the work, twice the bytes.
        """
        if self._chunk.index and abs(log_ns - self._chunk.start_ns) >= CHUNK_NS:
            self._end_chunk()
        self.start_ns = min(self.start_ns, log_ns) if self.message_count else log_ns
        self.end_ns = max(self.end_ns, log_ns)
        self.counts[channel] += 1
        self.message_count += 1
        big = len(data) >= BIG_BYTES
        chunk = _Chunk() if big else self._chunk
        chunk.add(channel, data, log_ns, publish_ns, sequence)
        if big:
            self._write_chunk(chunk, compressed=not hurry)
        elif len(chunk.data) >= CHUNK_BYTES:
            self._end_chunk()

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a named map of texts, with its checksum: the format has none for it."""
        data = {key: shown(text) for key, text in data.items()}
        record = packed(Metadata(name=name, metadata={**data, CRC_KEY: pairs_crc(data)}))
        at = self.file.tell()
        self._metadata_index.append(packed(MetadataIndex(at, len(record), name)))
        self.file.write(record)

    def flush(self) -> None:
        """Hand all that was written to the operating system, readable from there on."""
        self._end_chunk()
        self.file.flush()

    def sync(self) -> None:
        """Return when all that was written survives a power cut."""
        self._end_chunk()
        self._disk.sync(self.file)

    def second_handle(self) -> BinaryIO:
        """Flush, and return a second handle of the file, which another thread can sync."""
        self.flush()
        return open(os.dup(self.file.fileno()), 'ab')

    def close(self) -> None:
        """Write the index and the end, and force all of it to the disk."""
        self._end_chunk()
        self.file.write(packed(DataEnd(0)))
        start = self.file.tell()
        summary, offsets = bytearray(), b''
        for opcode, records in (
            (Opcode.SCHEMA, b''.join(self._schemas)),
            (Opcode.CHANNEL, b''.join(self._channels)),
            (Opcode.STATISTICS, packed(self._statistics())),
            (Opcode.CHUNK_INDEX, self._chunk_index),
            (Opcode.METADATA_INDEX, b''.join(self._metadata_index)),
        ):
            if records:
                offsets += packed(SummaryOffset(opcode, start + len(summary), len(records)))
                summary += records
        footer = packed(Footer(start, start + len(summary), 0))[:-4]
        summary += offsets + footer
        self.file.write(summary + struct.pack('<I', zlib.crc32(summary)) + MAGIC)
        self._disk.sync(self.file)
        self.file.close()

    def abandon(self) -> None:
        """Let go of the file as it is, without an end; what was flushed can be recovered."""
        self._chunk = _Chunk()
        try:
            self.file.close()
        except OSError:
            pass  # the disk refuses the rest: that is why it is abandoned

    def _end_chunk(self) -> None:
        chunk, self._chunk = self._chunk, _Chunk()
        if chunk.index:
            self._write_chunk(chunk)

    def _write_chunk(self, chunk: _Chunk, compressed: bool = True) -> None:
        """Write a chunk and its message indexes."""
        at, times, size = self.file.tell(), (chunk.start_ns, chunk.end_ns), len(chunk.data)
        stored = self._compressor.compress(chunk.data) if compressed else chunk.data
        compression, count = 'zstd' if compressed else '', len(stored)
        head = chunk_head(times, size, zlib.crc32(chunk.data), compression, count)
        self.file.write(head)
        self.file.write(stored)  # not copied into a record of mcap: an image has a megabyte
        indexes_at = behind = at + len(head) + count
        places = {}
        for channel, entries in chunk.index.items():
            entry = packed(MessageIndex(channel, sorted(entries)))
            places[channel] = behind
            behind += len(entry)
            self.file.write(entry)
        self._chunk_count += 1
        self._chunk_index += packed(ChunkIndex(
            chunk_length=indexes_at - at, chunk_start_offset=at, compression=compression,
            compressed_size=count, message_start_time=times[0], message_end_time=times[1],
            message_index_length=behind - indexes_at, message_index_offsets=places,
            uncompressed_size=size,
        ))  # fmt: skip

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts={channel: n for channel, n in self.counts.items() if n},
            chunk_count=self._chunk_count,
            message_count=self.message_count,
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            metadata_count=len(self._metadata_index),
            schema_count=len(self._schemas),
        )


def describe_topics(topics: Collection[BagTopic]) -> tuple[list[Schema], list[Channel]]:
    """Return the definitions of `topics`: a schema for each type, channel i + 1 for topic i."""
    schemas: dict[tuple[str, str, str], Schema] = {}
    for t in topics:
        if any(t.schema):  # JSON may have none
            definition = t.definition.encode('utf-8', 'surrogateescape')
            schemas.setdefault(
                t.schema, Schema(len(schemas) + 1, definition, t.schema_encoding, t.type)
            )
    numbers = {schema: record.id for schema, record in schemas.items()}
    channels = [
        Channel(number, t.name, t.encoding, t.metadata(), numbers.get(t.schema, 0))
        for number, t in enumerate(topics, 1)
    ]
    return list(schemas.values()), channels
