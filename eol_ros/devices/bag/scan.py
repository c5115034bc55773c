# SPDX-License-Identifier: Apache-2.0
"""Walks through an MCAP file that may be cut or damaged anywhere, and leaves out nothing unsaid.

The `mcap` package reads up to the first broken byte. Here a record is taken only where its lengths
agree to the byte (and its checksum, where it has one); behind a stretch that makes no sense the
next chunk with a right checksum is searched, and the stretch is yielded as what it is.
"""

import io
import os
import re
import struct
import zlib
from collections.abc import Collection, Iterator
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Header, MessageIndex, Metadata, Schema

from eol_ros.errors import pip_install

MAGIC = b'\x89MCAP0\r\n'
WITHOUT_MESSAGES = (
    Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.MESSAGE_INDEX,
)  # fmt: skip
BLANK = 0xFF  # private record: a stretch that was found damaged; no flip of one bit makes it
CRC_KEY = 'crc32'  # in the metadata that this project writes: of all the other pairs
NEAR = 6  # so many of the eight first bytes must be right for a file to be a damaged bag
MOST_BYTES = 1 << 30  # of a chunk: more is a damaged length
WINDOW = 1 << 20
HEAD = struct.Struct('<BQ')  # of a record: opcode, length
MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
CHUNK = struct.Struct('<QQQII')  # start, end, uncompressed size, its crc, length of compression
_ANCHOR = re.compile(rb'(?=[\x06\x0c\x0f][\s\S]{4}\0{4})')  # a record of less than 4 GB


class DamagedRecord(Exception):
    """The bytes are not what a record of this kind can be; says why."""


class ChunkHead(NamedTuple):
    """What a chunk says of itself, unprotected but for its data: times in ns, offsets in bytes."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    data_at: int
    data_bytes: int


class Found(NamedTuple):
    """A record from `offset` to `end`; `body` is a ChunkHead or a record of mcap, None if neither.

    With `why`, a stretch that is damaged; `framed` where it is one record, of a kind that holds no
    messages, and the next one follows where it should.
    """

    offset: int
    end: int
    opcode: int
    body: Any = None
    why: str = ''
    framed: bool = False


class ChunkMessage(NamedTuple):
    """One message of a chunk."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


class Body:
    """The bytes of one record, taken apart from the front."""

    def __init__(self, data: bytes):
        self.data, self.at = data, 0

    def take(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self.data):
            raise DamagedRecord('a length within it goes beyond its end')
        got = self.data[self.at : end]
        self.at = end
        return got

    def number(self, count: int) -> int:
        return int.from_bytes(self.take(count), 'little')

    def text(self) -> str:
        try:
            return self.take(self.number(4)).decode()
        except UnicodeDecodeError:
            raise DamagedRecord('a text in it is not UTF-8') from None

    def pairs(self) -> dict[str, str]:
        end = self.number(4) + self.at
        pairs = {}
        while self.at < end:
            key = self.text()
            pairs[key] = self.text()
        if self.at != end:
            raise DamagedRecord('a length within it goes beyond its end')
        return pairs

    def done(self) -> None:
        if self.at != len(self.data):
            raise DamagedRecord('lengths within it do not agree')


def pairs_crc(pairs: dict[str, str]) -> str:
    """Return the checksum of named texts, as `CRC_KEY` holds it."""
    texts = [text for key in sorted(pairs) if key != CRC_KEY for text in (key, pairs[key])]
    return str(zlib.crc32('\0'.join(texts).encode()))


def parse(opcode: int, data: bytes) -> Any:
    """Return the record of `data`, None for a kind that nobody here reads; raise DamagedRecord."""
    body = Body(data)
    record: Any = None
    if opcode == Opcode.HEADER:
        record = Header(body.text(), body.text())
    elif opcode == Opcode.SCHEMA:
        number, name, encoding = body.number(2), body.text(), body.text()
        record = Schema(id=number, name=name, encoding=encoding, data=body.take(body.number(4)))
        if not number:
            raise DamagedRecord('a schema cannot have number 0')
    elif opcode == Opcode.CHANNEL:
        number, schema, topic, encoding = body.number(2), body.number(2), body.text(), body.text()
        record = Channel(
            id=number, schema_id=schema, topic=topic, message_encoding=encoding,
            metadata=body.pairs(),
        )  # fmt: skip
    elif opcode == Opcode.METADATA:
        record = Metadata(name=body.text(), metadata=body.pairs())
    elif opcode == Opcode.MESSAGE_INDEX:
        channel, count = body.number(2), body.number(4)
        places = body.take(count)
        if count % 16:
            raise DamagedRecord('a part of an entry is missing')
        record = MessageIndex(channel, list(struct.iter_unpack('<QQ', places)))
    elif opcode == Opcode.MESSAGE:
        channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack(body.take(22))
        return ChunkMessage(channel, sequence, log_ns, publish_ns, data[22:])
    else:
        return None
    body.done()
    return record


def near_magic(magic: bytes) -> bool:
    """Return whether the first bytes of a file are those of an MCAP file, but for damage."""
    return sum(a == b for a, b in zip(magic, MAGIC, strict=False)) >= NEAR


def size_of(file: BinaryIO) -> int:
    """Return how long an open file is."""
    return file.seek(0, io.SEEK_END)


def read_at(file: BinaryIO, offset: int, count: int) -> bytes:
    """Return `count` bytes from `offset`; raise DamagedRecord where the file ends before."""
    # Both may be any number that a damaged file holds: nothing is allocated before they are proved.
    if count < 0 or offset + count > os.fstat(file.fileno()).st_size:
        raise DamagedRecord('the file ends within it')
    file.seek(offset)
    return file.read(count)


def chunk_head(file: BinaryIO, offset: int, end: int) -> ChunkHead:
    """Return the head of the chunk from `offset` to `end`; raise DamagedRecord if it is none."""
    head = read_at(file, offset + HEAD.size, min(CHUNK.size + 24, end - offset - HEAD.size))
    if len(head) < CHUNK.size + 8:
        raise DamagedRecord('too short for a chunk')
    start_ns, end_ns, size, crc, count = CHUNK.unpack_from(head)
    kind = head[CHUNK.size : CHUNK.size + count]
    data_at = offset + HEAD.size + CHUNK.size + count + 8
    if count > 16 or int.from_bytes(head[CHUNK.size + count :][:8], 'little') != end - data_at:
        raise DamagedRecord('lengths within the chunk do not agree')
    return ChunkHead(start_ns, end_ns, size, crc, kind.decode('latin-1'), data_at, end - data_at)


def unpack(head: ChunkHead, data: bytes) -> bytes:
    """Return the records in a chunk, from its stored `data`; raise DamagedRecord."""
    if head.compression == 'zstd':
        try:
            size = zstandard.frame_content_size(data)
            size = head.size if size < 0 else size
            if size > MOST_BYTES:
                raise DamagedRecord('says that it is larger than any chunk')
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        except zstandard.ZstdError:
            raise DamagedRecord('cannot be decompressed') from None
    elif head.compression == 'lz4':
        data = _unlz4(data)
    elif head.compression:
        raise DamagedRecord(f'compressed with {head.compression!r}, which is not known here')
    if head.crc and zlib.crc32(data) != head.crc:
        raise DamagedRecord('wrong checksum')
    return data


def chunk_data(file: BinaryIO, head: ChunkHead) -> bytes:
    """Return the records in a chunk of `file`; raise DamagedRecord."""
    return unpack(head, read_at(file, head.data_at, head.data_bytes))


def _unlz4(data: bytes) -> bytes:
    try:
        import lz4.frame
    except ImportError:
        raise DamagedRecord(f'compressed with lz4: {pip_install("lz4")}') from None
    try:
        return lz4.frame.decompress(data)
    except RuntimeError:
        raise DamagedRecord('cannot be decompressed') from None


def records_in(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield (offset, opcode, body) of the records in a chunk; raise DamagedRecord."""
    at = 0
    while at < len(data):
        if at + HEAD.size > len(data):
            raise DamagedRecord('ends within a record')
        opcode, length = HEAD.unpack_from(data, at)
        begin = at + HEAD.size
        if begin + length > len(data):
            raise DamagedRecord('ends within a record')
        yield at, opcode, data[begin : begin + length]
        at = begin + length


def messages_in(data: bytes, channels: Collection[int] | None = None) -> Iterator[ChunkMessage]:
    """Yield the messages of a chunk, of these `channels` (None: all); raise DamagedRecord.

    Most of a chunk is skipped where few topics are wanted, so nothing is made of what is skipped.
    """
    at, size = 0, len(data)
    while at < size:
        if at + HEAD.size > size:
            raise DamagedRecord('ends within a record')
        opcode, length = HEAD.unpack_from(data, at)
        begin = at + HEAD.size
        at = begin + length
        if at > size:
            raise DamagedRecord('ends within a record')
        if opcode != Opcode.MESSAGE:
            continue
        if length < MESSAGE_HEAD.size:
            raise DamagedRecord('ends within a message')
        channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(data, begin)
        if channels is None or channel in channels:
            body = data[begin + MESSAGE_HEAD.size : at]
            yield ChunkMessage(channel, sequence, log_ns, publish_ns, body)


def walk(file: BinaryIO, start: int, end: int, ours: bool = False) -> Iterator[Found]:
    """Yield all that lies in `file` from `start` to `end`, or to the end of its data section.

    What is cut off, or damaged up to the end, is not yielded: the last `end` tells. Chunks are not
    unpacked. `ours`: a kind of record that this project does not write is damage, too.
    """
    at = start
    while at + HEAD.size <= end:
        found = record_at(file, at, end, ours)
        if found.why:
            begin = anchor(file, at + 1, end)
            follows = (
                0 < found.end <= end - HEAD.size and not record_at(file, found.end, end, ours).why
            )
            if begin is None and not follows:
                return
            if begin is not None and not (follows and found.end <= begin):
                found = found._replace(end=begin)
            elif found.opcode in WITHOUT_MESSAGES:
                found = found._replace(framed=True)
        yield found
        if found.opcode == Opcode.DATA_END and not found.why:
            return
        at = found.end


def definitions_behind(file: BinaryIO, at: int, end: int) -> Iterator[Schema | Channel]:
    """Yield the schemas and channels in the summary of a file whose data section ends at `at`."""
    found = record_at(file, at, end)
    while not found.why and (found.opcode == Opcode.DATA_END or found.body is not None):
        if isinstance(found.body, (Schema, Channel)):
            yield found.body
        found = record_at(file, found.end, end)


def record_at(file: BinaryIO, at: int, end: int, ours: bool = False) -> Found:
    """Return the record at `at`, or the damage there; `end` 0 where it cannot be known."""
    if at + HEAD.size > end:
        return Found(at, 0, 0, why='the file ends within it')
    try:
        opcode, length = HEAD.unpack(read_at(file, at, HEAD.size))
    except DamagedRecord as error:
        return Found(at, 0, 0, why=str(error))
    after = at + HEAD.size + length
    if after > end:
        return Found(at, 0, opcode, why='the file ends within it')
    try:
        if opcode == Opcode.CHUNK:
            return Found(at, after, opcode, chunk_head(file, at, after))
        if opcode == BLANK:
            return Found(at, after, opcode)
        if opcode == Opcode.DATA_END:
            return Found(at, after, opcode, why='' if length == 4 else 'wrong length')
        if opcode in WITHOUT_MESSAGES or (opcode == Opcode.MESSAGE and not ours):
            if length > MOST_BYTES:
                raise DamagedRecord('too long')
            return Found(at, after, opcode, parse(opcode, read_at(file, at + HEAD.size, length)))
        foreign = opcode in (Opcode.ATTACHMENT,) or opcode >= 0x80
        if foreign and not ours:
            return Found(at, after, opcode)
        raise DamagedRecord(f'no record is of kind {opcode:#04x}')
    except (DamagedRecord, struct.error) as error:
        try:  # a chunk whose opcode is damaged is a chunk
            return Found(at, after, opcode, chunk_head(file, at, after))
        except DamagedRecord:
            return Found(at, after, opcode, why=str(error))


def anchor(file: BinaryIO, start: int, end: int) -> int | None:
    """Return where the next record begins that proves itself, None if there is none."""
    base = start
    while base < end:
        file.seek(base)
        window = file.read(min(WINDOW + HEAD.size, end - base))
        for match in _ANCHOR.finditer(window):
            at = base + match.start()
            if at >= base + WINDOW:
                break
            if _proves_itself(file, at, end):
                return at
        base += WINDOW
    return None


def _proves_itself(file: BinaryIO, at: int, end: int) -> bool:
    found = record_at(file, at, end)
    if found.why:
        return False
    if isinstance(found.body, ChunkHead):
        try:
            chunk_data(file, found.body)
        except DamagedRecord:
            return False
        return True
    if isinstance(found.body, Metadata):
        pairs = found.body.metadata
        return pairs.get(CRC_KEY) == pairs_crc(pairs)
    if found.opcode == Opcode.DATA_END:  # the summary begins behind it
        after = record_at(file, found.end, end)
        return isinstance(after.body, Schema) and not after.why
    return False
