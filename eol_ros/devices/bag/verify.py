# SPDX-License-Identifier: Apache-2.0
"""Proves a bag to the last byte: every checksum, every index entry, every count."""

import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, MessageIndex, Schema

from eol_ros.devices.bag import scan
from eol_ros.devices.bag.batches import heads_in, span_of
from eol_ros.devices.bag.file import BagFileReader
from eol_ros.devices.bag.reader import BagReader, information, loads
from eol_ros.devices.bag.recover import metadata_of
from eol_ros.devices.bag.scan import MAGIC, DamagedRecord
from eol_ros.errors import BagDamaged, ConfigError

REWRITE = '`eol bag recover` rewrites it'
_INDEX_HEAD = 6  # bytes of a message index before its entries: channel, their length
Expected = tuple[list[bytes], bool] | None  # message indexes of a chunk; whether they must be there


def verify(
    path: str | Path, through: Callable[[list], Iterator] = iter
) -> tuple[BagReader, list[str]]:
    """Return the bag at `path` and what is wrong with it, one line each; nothing where all is well.

    `through` hands on the files, to show progress. Raises as BagReader.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', BagDamaged)
        bag = BagReader(path, any_span=True)
        found = [line for file in through(bag.files) for line in _faults(file)]
    cut = [line for line in bag.cut_short if line not in bag.notes]
    found = [*cut, *bag.damage, *found]
    return bag, list(dict.fromkeys([*found, *metadata_faults(bag)]))


def metadata_faults(bag: BagReader) -> list[str]:
    """Return the differences between `metadata.yaml` and the files, one line each.

    For bags of other programs only the number of messages is compared.
    """
    try:
        said = information(bag.path) if bag.path.is_dir() else None
    except ConfigError as error:
        return [f'{error}: {REWRITE}']
    count = sum(bag.counts.values())
    if said is None:
        return []
    if said.get('message_count', count) != count:
        messages = f'{said["message_count"]} messages, the files of {count}'
        return [f'metadata.yaml speaks of {messages}: {REWRITE}']
    if not all(file.ours and file.indexed for file in bag.files):
        return []
    expected = loads(metadata_of(bag.path))
    return [
        f'metadata.yaml: {key} is not what the files say: {REWRITE}'
        for key in dict.fromkeys([*expected, *said])
        if _by_name(said.get(key, KeyError)) != _by_name(expected.get(key, KeyError))
    ]


def _by_name(value: Any) -> Any:
    """Return a value of `metadata.yaml` for comparison: the order of topics does not matter."""
    if isinstance(value, list) and all(isinstance(row, dict) for row in value):
        return sorted(map(repr, value))
    return value


def _faults(file: BagFileReader) -> Iterator[str]:
    """Go through a file, and compare what is written twice: chunks, heads, indexes, definitions."""
    said, counts = file.contents.counts, Counter[int]()
    at, expected = len(MAGIC), None
    with open(file.path, 'rb') as stream:
        for place in sorted(file.places, key=lambda p: p.offset):
            yield from _between(file, stream, at, place.offset, expected)
            at, expected = place.end, None
            found = file.read(stream, place, lambda c, data: (c, len(data), *heads_in(data)[:2]))
            if found is None:
                continue  # damaged, and told
            chunk, size, heads, begins = found
            counts.update(heads['channel'].tolist())
            if place.chunk:
                where = f'{file.path.name}: byte {place.offset}'
                times, kind, crc = span_of(heads), chunk.compression, chunk.uncompressed_crc
                head = scan.chunk_head(times, size, crc, kind, len(chunk.data))
                if scan.read_at(stream, place.offset, len(head)) != head:
                    yield f'{where}: the head of the chunk does not fit what is in it'
                if (place.start_ns, place.end_ns) != times:
                    yield f'{where}: the index has other times than the chunk'
                expected = _message_indexes(heads, begins), bool(place.channels)
        cut = file.cut_at is not None  # between a chunk and its indexes, maybe
        yield from _between(file, stream, at, file.contents.data_end, None if cut else expected)
    wrong = [
        f'{channel.topic}: {counts[k]} of {said[k]}'
        for k, channel in file.contents.channels.items()
        if counts[k] != said[k]
    ]
    if wrong and not file.damage:
        yield f'{file.path.name}: messages that the index counts are not there: {", ".join(wrong)}'


def _message_indexes(heads: np.ndarray, begins: np.ndarray) -> list[bytes]:
    """Return the records that index the messages of a chunk."""
    found = []
    for channel in np.unique(heads['channel']).tolist():
        own = heads['channel'] == channel
        at = begins[own] - scan.HEAD.size - scan.MESSAGE_HEAD.size
        entries = sorted(zip(heads['log_ns'][own].tolist(), at.tolist(), strict=True))
        found.append(scan.packed(MessageIndex(channel, entries)))
    return found


def _sorted(index: bytes) -> bytes:
    """Return the record of a message index with its entries in order of time: none is required."""
    head = scan.HEAD.size + _INDEX_HEAD
    entries = np.frombuffer(index[head:], '<u8,<u8') if (len(index) - head) % 16 == 0 else None
    return index if entries is None else index[:head] + np.sort(entries).tobytes()


def _between(
    file: BagFileReader, stream: BinaryIO, at: int, end: int, expected: Expected
) -> Iterator[str]:
    """Look at what lies between two places, the message indexes of the first among them."""
    begin, found_indexes, name = at, [], file.path.name
    for found in scan.walk(stream, at, end, file.ours):
        where, record, at = f'{name}: byte {found.offset}', found.record, found.end
        if found.why:
            yield f'{where}: {found.why}'
        elif found.raw[0] == Opcode.MESSAGE_INDEX:
            found_indexes.append(_sorted(found.raw))
        elif isinstance(record, Chunk):
            try:
                scan.unpack(record)
            except DamagedRecord as error:
                yield f'{where}: {error}'
        elif isinstance(record, (Schema, Channel)) and not file.contents.defines(record):
            yield f'{where}: a definition that differs from its copies'
    if at != end:
        yield f'{name}: byte {at}: no record'
    if expected and (found_indexes or expected[1]) and sorted(found_indexes) != sorted(expected[0]):
        yield f'{name}: byte {begin}: wrong message index'
