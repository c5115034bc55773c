# SPDX-License-Identifier: Apache-2.0
"""Reads bags: a rosbag2 folder of MCAP files, or one such file, whole or cut short; no ROS."""

import heapq
import itertools
import re
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

from eol_ros.devices.bag.mcap_file import MAGIC, BagTopic
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, REPLAY_OF, RUN_METADATA, SAMPLE
from eol_ros.errors import ConfigError, DeviceMissing

DAMAGE = (McapError, ZstdError, ValueError, struct.error)  # what broken bytes raise in mcap


class BagMessage(NamedTuple):
    """One recorded message: serialised data, reception and sending time in ns since the epoch."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


class _File:
    """One MCAP file: what is in it, and its messages."""

    def __init__(self, path: Path):
        self.path = path
        self.topics: dict[str, BagTopic] = {}
        self.counts: dict[str, int] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.start_ns, self.end_ns = 0, 0
        self.cut_at: int | None = None  # bytes that could be read of a file cut short
        try:
            with open(path, 'rb') as file:
                magic = file.read(len(MAGIC))
                if magic != MAGIC:
                    raise ConfigError(f'{path}: not a bag: begins with {magic!r}, not {MAGIC!r}')
                if not self._read_summary(file):
                    self._read_all(file)
        except OSError as error:
            raise DeviceMissing(f'{path}: {error.strerror}') from None

    def messages(
        self, topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[BagMessage]:
        """Yield the messages in order of reception."""
        with open(self.path, 'rb') as file:
            if self.cut_at is None:
                reader = SeekingReader(file, validate_crcs=True)
                try:
                    for _schema, channel, m in reader.iter_messages(
                        topics, starting_at=start_ns, ending_before=end_ns
                    ):
                        yield BagMessage(
                            channel.topic, m.log_time, m.publish_time, m.sequence, m.data
                        )
                except DAMAGE as error:
                    raise ConfigError(f'{self.path}: damaged: {error}') from None
                return
            for message in _whole_messages(file):
                log_ns = message.log_ns
                inside = log_ns >= start_ns and (end_ns is None or log_ns < end_ns)
                if inside and (topics is None or message.topic in topics):
                    yield message

    def _read_summary(self, file: BinaryIO) -> bool:
        try:
            file.seek(0)
            reader = SeekingReader(file)
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                return False
            for metadata in reader.iter_metadata():
                self.metadata[metadata.name] = metadata.metadata
        except DAMAGE:
            return False
        for channel in summary.channels.values():
            self._add(channel, summary.schemas.get(channel.schema_id))
        statistics = summary.statistics
        for number, count in statistics.channel_message_counts.items():
            topic = summary.channels[number].topic
            self.counts[topic] = self.counts.get(topic, 0) + count
        self.start_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        return True

    def _read_all(self, file: BinaryIO) -> None:
        schemas: dict[int, Schema] = {}
        names: dict[int, str] = {}
        stamps: tuple[int, int] | None = None
        self.cut_at = len(MAGIC)
        for self.cut_at, record in whole_records(file):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                self._add(record, schemas.get(record.schema_id))
                names[record.id] = record.topic
            elif isinstance(record, Metadata):
                self.metadata[record.name] = record.metadata
            elif isinstance(record, Message):
                self.counts[names[record.channel_id]] += 1
                first, last = stamps or (record.log_time, record.log_time)
                stamps = (min(first, record.log_time), max(last, record.log_time))
        if stamps:
            self.start_ns, self.end_ns = stamps

    def _add(self, channel: Channel, schema: Schema | None) -> None:
        self.counts.setdefault(channel.topic, 0)
        self.topics[channel.topic] = BagTopic(
            channel.topic,
            schema.name if schema else '',
            schema.data.decode() if schema else '',
            channel.metadata.get('topic_type_hash', ''),
            channel.metadata.get('offered_qos_profiles', ''),
        )


def whole_records(file: BinaryIO) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records of an MCAP file up to where it was cut or damaged, chunks taken apart.

    With each comes the offset up to which the file is whole.
    """
    file.seek(0)
    records = StreamReader(file, emit_chunks=True, record_size_limit=1 << 30).records
    while True:
        try:
            record = next(records)
            inner = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else ()
        except (StopIteration, *DAMAGE):
            return
        end = file.tell()
        for item in inner or (record,):
            yield end, item


def _whole_messages(file: BinaryIO) -> Iterator[BagMessage]:
    names: dict[int, str] = {}
    for _end, record in whole_records(file):
        if isinstance(record, Channel):
            names[record.id] = record.topic
        elif isinstance(record, Message):
            yield BagMessage(
                names[record.channel_id],
                record.log_time,
                record.publish_time,
                record.sequence,
                record.data,
            )


class BagReader:
    """A bag, opened to be read: `topics`, `counts`, times, `about`, `gaps`, and `messages()`.

    A folder that holds bags stands for the newest run in it, or for the sample that ships where
    there is no run; recordings of a replay count only where they are named themselves. Raises
    DeviceMissing when there is no such file, ConfigError when it is not a bag.
    """

    def __init__(self, path: str | Path):
        self.path = _newest(Path(path))
        self.files = [_File(p) for p in _mcap_files(self.path)]
        self.files.sort(key=lambda f: (f.start_ns, f.path.name))
        self.topics: dict[str, BagTopic] = {}
        self.counts: dict[str, int] = {}
        for file in self.files:
            self.topics.update(file.topics)
            for topic, count in file.counts.items():
                self.counts[topic] = self.counts.get(topic, 0) + count
        filled = [f for f in self.files if f.start_ns]
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
            f'{f.path.name} was cut short: {f.cut_at} of {f.path.stat().st_size} bytes read, '
            f'{sum(f.counts.values())} messages'
            for f in self.files
            if f.cut_at is not None
        ]

    def find(self, name: str) -> str:
        """Return the full name of topic `name`, with or without namespace; raise ConfigError."""
        for candidate in (name, f'/{name}', f'/eol/{name}'):
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
        """Yield messages of `topics` (None: all) with start_ns <= reception < end_ns, in order."""
        files = [
            f
            for f in self.files
            if f.start_ns and f.end_ns >= start_ns and (end_ns is None or f.start_ns < end_ns)
        ]
        streams = [f.messages(topics, start_ns, end_ns) for f in files]
        apart = all(a.end_ns <= b.start_ns for a, b in itertools.pairwise(files))
        if apart:  # one file at a time in memory
            for stream in streams:
                yield from stream
        else:
            yield from heapq.merge(*streams, key=lambda m: m.log_ns)

    def _metadata(self, name: str) -> dict[str, str]:
        for file in reversed(self.files):
            if name in file.metadata:
                return file.metadata[name]
        return {}


def _newest(path: Path) -> Path:
    """Return the newest run in `path`; a bag is returned as it is.

    A replay records too, beside the bag that it plays: it must not find itself.
    """
    if not path.is_dir() or any(path.glob('*.mcap*')):
        return path
    bags = {p.parent for p in path.glob('*/*.mcap*') if p.name.endswith(('.mcap', '.mcap' + PART))}
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
            for _end, record in whole_records(file):
                if isinstance(record, Metadata) and record.name == RUN_METADATA:
                    return record.metadata
                if isinstance(record, Message):  # of another program
                    return {}
    except OSError:  # renamed meanwhile: it is whole now
        return {}
    return None if path.name.endswith(PART) else {}


def _mcap_files(path: Path) -> list[Path]:
    if not path.exists():
        raise DeviceMissing(f'{path}: no such bag')
    if path.is_file():
        return [path]
    files = [p for p in path.iterdir() if re.search(rf'\.mcap({re.escape(PART)})?$', p.name)]
    names = {p.name for p in files}
    files = [p for p in files if p.name.removesuffix(PART) not in names - {p.name}]
    missing = sorted(set(_listed(path)) - names)
    if missing:
        raise DeviceMissing(f'{path}: {missing[0]} is named in metadata.yaml and is not there')
    if not files:
        raise ConfigError(f'{path}: not a bag: a folder without .mcap files')
    return sorted(files)


def _listed(folder: Path) -> list[str]:
    """Return the files that `metadata.yaml` names; none when there is no such file."""
    file = folder / 'metadata.yaml'
    if not file.exists():
        return []
    try:
        information = yaml.safe_load(file.read_text(encoding='utf-8'))
        return [str(p) for p in information['rosbag2_bagfile_information']['relative_file_paths']]
    except (yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError):
        raise ConfigError(f'{file}: not the metadata of a rosbag2 folder') from None
