# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of a bag, written chunk by chunk (https://mcap.dev/spec, version 0).

The records are those of the `mcap` package. Its own Writer is not used because it fixes the zstd
level: a 1 MB infrared image takes 8 ms at its level 3 and 1.3 ms at level 1, where it also
becomes smaller.
"""

import os
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from eol_ros.devices.bag.disk import DISK, Disk
from eol_ros.devices.bag.scan import CRC_KEY, MAGIC, pairs_crc

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
    """

    name: str
    type: str
    definition: str
    type_hash: str = ''
    qos: str = ''

    @property
    def latched(self) -> bool:
        """Whether the publisher keeps the last message for those who come late."""
        return 'transient_local' in self.qos

    def metadata(self) -> dict[str, str]:
        """Return what rosbag2 stores with the channel."""
        return {'offered_qos_profiles': self.qos, 'topic_type_hash': self.type_hash}


class _Chunk:
    """Messages that are compressed together, and where each channel's lie in it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.start_ns = self.end_ns = 0
        self.offsets: dict[int, list[tuple[int, int]]] = {}

    def add(self, channel: int, data: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        self.start_ns = min(self.start_ns, log_ns) if self.offsets else log_ns
        self.end_ns = max(self.end_ns, log_ns)
        self.offsets.setdefault(channel, []).append((log_ns, len(self.data)))
        self.data += _MESSAGE.pack(
            Opcode.MESSAGE, 22 + len(data), channel, sequence & 0xFFFFFFFF, log_ns, publish_ns
        )
        self.data += data


class Summary:
    """What stands behind the data of a file, from offset `at`: groups of records, then the footer.

    `write` takes it piece by piece, so that an index of any length needs no memory.
    """

    def __init__(self, at: int, write: Callable[[bytes], object]):
        self._write = write
        self._start = self._at = at
        self._crc = 0
        self._offsets = b''

    def group(self, opcode: Opcode, records: Iterable[bytes]) -> None:
        """Write all records of one kind."""
        begin = self._at
        for record in records:
            self._add(record)
        if self._at > begin:
            self._offsets += packed(
                SummaryOffset(group_opcode=opcode, group_start=begin, group_length=self._at - begin)
            )

    def end(self) -> None:
        """Write where the groups are, and the footer with the checksum of it all."""
        offsets_at = self._at
        self._add(self._offsets)
        footer = packed(
            Footer(summary_start=self._start, summary_offset_start=offsets_at, summary_crc=0)
        )[:-4]
        self._write(footer + struct.pack('<I', zlib.crc32(footer, self._crc)) + MAGIC)

    def _add(self, piece: bytes) -> None:
        self._write(piece)
        self._crc = zlib.crc32(piece, self._crc)
        self._at += len(piece)


class BagFile:
    """Writes one MCAP file; every method may raise OSError.

    Channel numbers are 1 + the index into `topics`. Nothing is readable before `flush`, and all
    that was flushed stays readable when the process is killed.
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[BagTopic],
        level: int = ZSTD_LEVEL,
        disk: Disk = DISK,
    ):
        self.path = path
        self._disk = disk
        self.message_count = 0
        self.counts = [0] * len(topics)
        self.start_ns = 0
        self.end_ns = 0
        self._compressor = zstandard.ZstdCompressor(level=level)
        self._chunk = _Chunk()
        self._chunk_count = 0
        self._chunk_index = bytearray()  # packed: images make 200 000 of them an hour
        self._metadata_index: list[MetadataIndex] = []
        self._schemas, self._channels = describe_topics(topics)
        self.file = disk.create(path)
        definitions = b''.join(map(packed, [*self._schemas, *self._channels]))
        self.file.write(MAGIC + packed(Header('ros2', LIBRARY)) + definitions)
        # Once more in a chunk: a flipped bit in a definition would change what messages mean, and
        # only chunks have a checksum. Where a file is cut, it has no summary.
        first = _Chunk()
        first.data += definitions
        self._write_chunk(first)

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
        big = len(data) >= BIG_BYTES
        if self._chunk.offsets and abs(log_ns - self._chunk.start_ns) >= CHUNK_NS:
            self._end_chunk()
        chunk = _Chunk() if big else self._chunk
        chunk.add(channel, data, log_ns, publish_ns, sequence)
        self.start_ns = min(self.start_ns, log_ns) if self.message_count else log_ns
        self.end_ns = max(self.end_ns, log_ns)
        self.counts[channel - 1] += 1
        self.message_count += 1
        if big:
            self._write_chunk(chunk, compress=not hurry)
        elif len(chunk.data) >= CHUNK_BYTES:
            self._end_chunk()

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a named map of texts, with its checksum: the format has none for it."""
        record = metadata_record(name, data)
        at = self.file.tell()
        self._metadata_index.append(MetadataIndex(offset=at, length=len(record), name=name))
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
        summary = Summary(self.file.tell(), self.file.write)
        summary.group(Opcode.SCHEMA, map(packed, self._schemas))
        summary.group(Opcode.CHANNEL, map(packed, self._channels))
        summary.group(Opcode.STATISTICS, [packed(self._statistics())])
        summary.group(Opcode.CHUNK_INDEX, [bytes(self._chunk_index)])
        summary.group(Opcode.METADATA_INDEX, map(packed, self._metadata_index))
        summary.end()
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
        if chunk.offsets:
            self._write_chunk(chunk)

    def _write_chunk(self, chunk: '_Chunk', compress: bool = True) -> None:
        data = self._compressor.compress(chunk.data) if compress else bytes(chunk.data)
        kind = 'zstd' if compress else ''
        at = self.file.tell()
        record = packed(
            Chunk(
                compression=kind,
                data=data,
                message_start_time=chunk.start_ns,
                message_end_time=chunk.end_ns,
                uncompressed_crc=zlib.crc32(chunk.data),
                uncompressed_size=len(chunk.data),
            )
        )
        self.file.write(record)
        index_at, places = self.file.tell(), {}
        for channel, records in chunk.offsets.items():
            places[channel] = self.file.tell()
            self.file.write(packed(MessageIndex(channel, sorted(records))))
        self._chunk_count += 1
        self._chunk_index += packed(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=at,
                compression=kind,
                compressed_size=len(data),
                message_start_time=chunk.start_ns,
                message_end_time=chunk.end_ns,
                message_index_length=self.file.tell() - index_at,
                message_index_offsets=places,
                uncompressed_size=len(chunk.data),
            )
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts={i + 1: n for i, n in enumerate(self.counts) if n},
            chunk_count=self._chunk_count,
            message_count=self.message_count,
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            metadata_count=len(self._metadata_index),
            schema_count=len(self._schemas),
        )


def packed(record: McapRecord) -> bytes:
    """Return the bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def metadata_record(name: str, data: Mapping[str, str]) -> bytes:
    """Return the bytes of named texts with their checksum."""
    pairs = {**data, CRC_KEY: pairs_crc(dict(data))}
    return packed(Metadata(name=name, metadata=pairs))


def describe_topics(topics: Sequence[BagTopic]) -> tuple[list[Schema], list[Channel]]:
    """Return the definitions of `topics`: a schema for each type, channel i + 1 for topic i."""
    schemas: dict[str, Schema] = {}
    channels = []
    for number, topic in enumerate(topics, 1):
        schema = schemas.setdefault(
            topic.type,
            Schema(
                id=len(schemas) + 1,
                data=topic.definition.encode(),
                encoding='ros2msg',
                name=topic.type,
            ),
        )
        channels.append(
            Channel(
                id=number,
                topic=topic.name,
                message_encoding='cdr',
                metadata=topic.metadata(),
                schema_id=schema.id,
            )
        )
    return list(schemas.values()), channels
