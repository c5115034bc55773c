# SPDX-License-Identifier: Apache-2.0
"""What the `mcap` package lacks: proof of each record and chunk, and reading on behind damage.

The package parses records, and takes what it finds. Here a record counts only if the bytes that it
stands for are those of the file, and a chunk only with its checksum. Behind bytes that are no
record, `walk` continues at the next chunk that proves itself, and yields the stretch as damage.
"""

import io
import itertools
import os
import re
import struct
import zlib
from collections.abc import Iterator
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Metadata, Schema
from mcap.stream_reader import StreamReader

from eol_ros.errors import pip_install

MAGIC = b'\x89MCAP0\r\n'
BLANK = 0xFF  # private record: damage that a repair in place (v0.2.0) has marked
CRC_KEY = 'crc32'  # in the metadata that this project writes: of all the other pairs
MOST_BYTES = 1 << 30  # of a chunk: more is a damaged length
CALM_BYTES = 1 << 28  # of one that is less than half as large when compressed
WINDOW = 1 << 20
HEAD = struct.Struct('<BQ')  # of a record: opcode, length
LENGTH = struct.Struct('<Q')
MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
CHUNK = struct.Struct('<BQQQQII')  # a record, its times, uncompressed size, crc, length of a name
WITHOUT_MESSAGES = (
    Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.MESSAGE_INDEX,
)  # fmt: skip
_READ = (*WITHOUT_MESSAGES, Opcode.DATA_END)
OVERLAP = 24  # bytes of a record that _ANCHOR looks at, and more
# A chunk of less than 4 GB, or metadata of this project: dark images are full of what looks like
# the head of a record.
_ANCHOR = re.compile(
    rb'(?=\x06[\s\S]{4}\0{4}|\x0c[\s\S]{4}\0{4}[\x07\x0c]\0{3}(?:eol_ros|rosbag2))'
)


class DamagedRecord(Exception):
    """The bytes are not what a record of this kind can be; says why."""


class Found(NamedTuple):
    """What lies from `offset` to `end`: a record of mcap and its bytes, None where nobody reads it.

    With `why`, a stretch that is damaged; `framed` where it is one record, of a kind that holds no
    messages, and the next one follows where it should.
    """

    offset: int
    end: int  # 0: cannot be known
    raw: bytes = b''
    record: Any = None
    why: str = ''
    framed: bool = False


def packed(record: McapRecord) -> bytes:
    """Return the bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def pairs_crc(pairs: dict[str, str]) -> str:
    """Return the checksum of named texts, as `CRC_KEY` holds it."""
    texts = [text for key in sorted(pairs) if key != CRC_KEY for text in (key, pairs[key])]
    return str(zlib.crc32('\0'.join(texts).encode()))


def parse(raw: bytes) -> Any:
    """Return the record that `raw` is, to the byte; raise DamagedRecord."""
    try:
        record = next(StreamReader(io.BytesIO(raw), skip_magic=True).records)
    except (McapError, struct.error, ValueError, OverflowError):
        record = None
    if record is None or packed(record) != raw:
        raise DamagedRecord('lengths within it do not agree')
    return record


def size_of(file: BinaryIO) -> int:
    """Return how long an open file is."""
    return os.fstat(file.fileno()).st_size


def read_at(file: BinaryIO, offset: int, count: int) -> bytes:
    """Return `count` bytes from `offset`; raise DamagedRecord where the file ends before."""
    # Both may be any number that a damaged file holds: nothing is allocated before they are proved.
    if count < 0 or offset + count > size_of(file):
        raise DamagedRecord('the file ends within it')
    file.seek(offset)
    return file.read(count)


def chunk_head(times: tuple[int, int], size: int, crc: int, compression: str, stored: int) -> bytes:
    """Return the bytes of a chunk before the `stored` ones of its data."""
    kind = compression.encode()
    length = CHUNK.size - HEAD.size + len(kind) + LENGTH.size + stored
    head = CHUNK.pack(Opcode.CHUNK, length, *times, size, crc, len(kind))
    return head + kind + LENGTH.pack(stored)


def chunk_at(file: BinaryIO, offset: int, end: int, compression: str | None = None) -> Chunk:
    """Return the chunk from `offset` to `end`, whatever its opcode; raise DamagedRecord.

    Its lengths agree, or its `compression` is known; `unpack` proves its data, nothing its times.
    """
    head = read_at(file, offset, min(CHUNK.size + 24, end - offset))
    if len(head) < CHUNK.size + 8:
        raise DamagedRecord('too short for a chunk')
    _, _, start_ns, end_ns, size, crc, count = CHUNK.unpack_from(head)
    count = count if compression is None else len(compression)
    data_at = CHUNK.size + count + 8
    stored = end - offset - data_at
    if compression is None:
        if count > 16 or int.from_bytes(head[data_at - 8 : data_at], 'little') != stored:
            raise DamagedRecord('lengths within the chunk do not agree')
        compression = head[CHUNK.size : CHUNK.size + count].decode('latin-1')
    return Chunk(compression, read_at(file, offset + data_at, stored), end_ns, start_ns, crc, size)


def unpack(chunk: Chunk) -> bytes:
    """Return the records in a chunk; raise DamagedRecord."""
    data = chunk.data
    most = min(MOST_BYTES, max(CALM_BYTES, 2 * len(data)))
    if chunk.compression == 'zstd':
        try:
            size = zstandard.frame_content_size(data)
            size = chunk.uncompressed_size if size < 0 else size
            if size > most:
                raise DamagedRecord('says that it is larger than any chunk')
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        except zstandard.ZstdError:
            raise DamagedRecord('cannot be decompressed') from None
    elif chunk.compression == 'lz4':
        data = _unlz4(data, most)
    elif chunk.compression:
        raise DamagedRecord(f'compressed with {chunk.compression!r}, which is not known here')
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedRecord('wrong checksum')
    return data


def _unlz4(data: bytes, most: int) -> bytes:
    try:
        import lz4.frame
    except ImportError:
        raise DamagedRecord(f'compressed with lz4: {pip_install("lz4")}') from None
    try:
        with lz4.frame.LZ4FrameDecompressor() as frame:
            found: bytes = frame.decompress(data, max_length=most)
            whole = frame.eof
    except RuntimeError:
        raise DamagedRecord('cannot be decompressed') from None
    if not whole:
        raise DamagedRecord('is cut, or larger than any chunk')
    return found


def edges_in(data: bytes) -> list[int]:
    """Return where the records in a chunk or summary begin, and its end; raise DamagedRecord."""
    edges, at, size = [0], 0, len(data)
    try:
        while at < size:
            length = LENGTH.unpack_from(data, at + 1)[0]
            if length < MESSAGE_HEAD.size and data[at] == Opcode.MESSAGE:
                raise DamagedRecord('ends within a message')
            at += HEAD.size + length
            edges.append(at)
    except struct.error:
        at = -1
    if at != size:
        raise DamagedRecord('ends within a record')
    return edges


def definitions_in(data: bytes, edges: list[int]) -> Iterator[Schema | Channel]:
    """Yield the definitions in a chunk whose records have these edges; raise DamagedRecord."""
    for at, end in itertools.pairwise(edges):
        if data[at] in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield parse(data[at:end])


def definitions_at(file: BinaryIO, at: int, end: int) -> Iterator[Schema | Channel]:
    """Yield the schemas and channels with which the summary at `at` begins."""
    found = record_at(file, at, end)
    while isinstance(found.record, (Schema, Channel)) and not found.why:
        yield found.record
        found = record_at(file, found.end, end)


def walk(file: BinaryIO, start: int, end: int, ours: bool = False) -> Iterator[Found]:
    """Yield all that lies in `file` from `start` to `end`, or to the end of its data section.

    What is cut off, or damaged up to the end, is not yielded: the last `end` tells. `ours`: a kind
    of record that this project does not write is damage, too.
    """
    at = start
    while at + HEAD.size <= end:
        found = record_at(file, at, end, ours)
        if found.why:
            begin = _anchor(file, at + 1, end)
            follows = bool(found.end) and not record_at(file, found.end, end, ours).why
            if begin is None and not follows:
                return
            if begin is not None and not (follows and found.end <= begin):
                found = found._replace(end=begin)
            elif found.raw[0] in WITHOUT_MESSAGES:
                found = found._replace(framed=True)
        yield found
        if isinstance(found.record, DataEnd) and not found.why:
            return
        at = found.end


def record_at(file: BinaryIO, at: int, end: int, ours: bool = False) -> Found:
    """Return the record at `at`, or the damage there."""
    try:
        head = read_at(file, at, min(HEAD.size, end - at))
        opcode, length = HEAD.unpack(head)
    except (DamagedRecord, struct.error):
        return Found(at, 0, why='the file ends within it')
    after = at + HEAD.size + length
    if after > end:
        return Found(at, 0, head, why='the file ends within it')
    foreign = opcode == Opcode.ATTACHMENT or opcode >= 0x80
    if opcode == BLANK or (foreign and not ours):
        return Found(at, after, head)
    try:
        if opcode in _READ or (opcode == Opcode.MESSAGE and not ours):
            if length > MOST_BYTES:
                raise DamagedRecord('too long')
            raw = head + file.read(length)
            if opcode != Opcode.MESSAGE_INDEX:
                return Found(at, after, raw, parse(raw))
            if len(raw) < 15 or len(raw) - 15 != int.from_bytes(raw[11:15], 'little'):
                raise DamagedRecord('lengths within it do not agree')
            return Found(at, after, raw)
        if opcode != Opcode.CHUNK:
            raise DamagedRecord(f'no record is of kind {opcode:#04x}')
    except DamagedRecord as error:
        why = str(error)
    try:  # a chunk whose opcode is damaged is a chunk
        return Found(at, after, head, chunk_at(file, at, after))
    except DamagedRecord as error:
        return Found(at, after, head, why=str(error) if opcode == Opcode.CHUNK else why)


def anchored(file: BinaryIO) -> bool:
    """Return whether anything in the file proves itself."""
    return _anchor(file, 0, size_of(file)) is not None


def _anchor(file: BinaryIO, start: int, end: int) -> int | None:
    """Return where the next record begins that proves itself, None if there is none."""
    for base in range(start, end, WINDOW):
        file.seek(base)
        window = file.read(min(WINDOW + OVERLAP, end - base))
        for match in _ANCHOR.finditer(window):
            if match.start() < WINDOW and _proves_itself(file, base + match.start(), end):
                return base + match.start()
    return None


def _proves_itself(file: BinaryIO, at: int, end: int) -> bool:
    record = record_at(file, at, end).record
    if isinstance(record, Metadata):
        return record.metadata.get(CRC_KEY) == pairs_crc(record.metadata)
    try:
        return isinstance(record, Chunk) and bool(unpack(record))
    except DamagedRecord:
        return False
