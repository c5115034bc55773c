# SPDX-License-Identifier: Apache-2.0
"""Proves a bag to the last byte: every checksum, every index entry, every count."""

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, MessageIndex, Schema

from eol_ros.devices.bag import scan
from eol_ros.devices.bag.reader import (
    BagFileReader,
    BagReader,
    information,
    loads,
    metadata_fault,
)
from eol_ros.devices.bag.recover import ProvedChunk, metadata_of
from eol_ros.devices.bag.scan import MAGIC, ChunkHead, DamagedRecord
from eol_ros.errors import BagDamaged


def verify(
    path: str | Path, through: Callable[[list], Iterator] = iter
) -> tuple[BagReader, list[str]]:
    """Return the bag at `path` and what is wrong with it, one line each; nothing where all is well.

    `through` hands on the files, to show progress. Raises as BagReader.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', BagDamaged)
        bag = BagReader(path)
        found = []
        for file in through(bag.files):
            found += _messages(file) + _records(file)
    found = [*bag.cut_short, *bag.damage, *found]
    return bag, list(dict.fromkeys([*found, *metadata_faults(bag)]))


def metadata_faults(bag: BagReader) -> list[str]:
    """Return the differences between `metadata.yaml` and the files, one line each.

    For bags of other programs only the number of messages is compared.
    """
    if not bag.path.is_dir():
        return []
    fault = metadata_fault(bag.path, sum(bag.counts.values()))
    if fault or not all(file.ours and file.indexed for file in bag.files):
        return [fault] if fault else []
    said, expected = information(bag.path), loads(metadata_of(bag.path))
    if said is None:
        return []
    return [
        f'metadata.yaml: {key} is not what the files say: `eol bag recover` rewrites it'
        for key in dict.fromkeys([*expected, *said])
        if _by_name(said.get(key, KeyError)) != _by_name(expected.get(key, KeyError))
    ]


def _by_name(value: Any) -> Any:
    """Return a value of `metadata.yaml` for comparison: the order of topics does not matter."""
    if isinstance(value, list) and all(isinstance(row, dict) for row in value):
        return sorted(map(repr, value))
    return value


def _messages(file: BagFileReader) -> list[str]:
    """Read all messages, as a user would, and count them."""
    counts = dict.fromkeys(file.counts, 0)
    for message in file.messages(None, 0, None):
        counts[message.topic] += 1
    if file.damage or counts == file.counts:
        return []
    wrong = [f'{t}: {n} of {file.counts[t]}' for t, n in counts.items() if n != file.counts[t]]
    return [f'{file.path.name}: messages that the index counts are not there: {", ".join(wrong)}']


def _records(file: BagFileReader) -> list[str]:
    """Compare what is written twice: chunks and their heads and indexes, definitions."""
    wrong: list[str] = []
    places = {p.offset: p for p in file.places}
    chunk: ProvedChunk | None = None

    def close() -> None:
        place = places.get(chunk.found.offset) if chunk else None
        left_out = place is not None and not place.channels and chunk and not chunk.indexes
        if chunk and not chunk.right() and not left_out:  # a repair leaves wrong ones out
            wrong.append(f'{file.path.name}: byte {chunk.found.end}: wrong message index')

    with open(file.path, 'rb') as stream:
        for found in scan.walk(stream, len(MAGIC), scan.size_of(stream), file.ours):
            at = f'{file.path.name}: byte {found.offset}'
            if chunk and isinstance(found.body, MessageIndex):
                chunk.indexes.append(found)
                continue
            close()
            chunk = None
            if found.why:
                wrong.append(f'{at}: {found.why}')
            elif isinstance(found.body, ChunkHead):
                head = found.body
                try:
                    data = scan.chunk_data(stream, head)
                    chunk = ProvedChunk(found, data)
                except DamagedRecord as error:
                    wrong.append(f'{at}: {error}')
                    continue
                place = places.get(found.offset)
                said = (head.start_ns, head.end_ns)
                if found.opcode != Opcode.CHUNK or said != chunk.span or head.size != len(data):
                    wrong.append(f'{at}: the head of the chunk does not fit what is in it')
                if place and (place.start_ns, place.end_ns) != chunk.span:
                    wrong.append(f'{at}: the index has other times than the chunk')
            elif isinstance(found.body, (Schema, Channel)) and not file.defines(found.body):
                wrong.append(f'{at}: a definition that differs from its copies')
        if file.cut_at is None:  # else it was cut between a chunk and its index
            close()
    return wrong
