# SPDX-License-Identifier: Apache-2.0
"""Reads bags: a rosbag2 folder of MCAP files, or one such file, whole, cut or damaged; no ROS."""

import functools
import heapq
import itertools
import os
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import yaml
from mcap.records import Chunk, Message, Metadata

from eol_ros import yaml_text
from eol_ros.devices.bag import scan
from eol_ros.devices.bag.file import BagFileReader, add_topic
from eol_ros.devices.bag.mcap_file import BagMessage as BagMessage
from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.scan import MAGIC
from eol_ros.devices.bag.writer import GAPS_METADATA, PART, REPLAY_OF, RUN_METADATA, SAMPLE
from eol_ros.devices.files.names import natural, visible
from eol_ros.disk import check_file
from eol_ros.errors import ConfigError, DeviceMissing, EolError, nearest
from eol_ros.settings import TableSettings
from eol_ros.streams.graph import FORMER_TYPES, TOPICS, full_name, namespace_of

if TYPE_CHECKING:
    from eol_ros.devices.bag.batches import Batch

LONGEST_NS = 366 * 86400 * 10**9  # longest recording: a year
MERGED = 4096  # messages of files that overlap in time, in memory at a time
LOOK_BACK_NS = 60_000_000_000


class Unreadable(NamedTuple):
    """Cost of damage: lost messages, of files whose index counts them, and length of time spans."""

    messages: int
    seconds: float


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
    any_span : bool
        Accept a bag that spans more than a year, to keep or to repair it.

    Raises
    ------
    DeviceMissing
        There is no such file.
    ConfigError
        It is not a bag, or spans more than a year without `any_span`.

    Examples
    --------
    >>> bag = BagReader('bags/sample')
    >>> bag.topics['/eol/slips'].type
    'eol_msgs/msg/Slip'
    """

    def __init__(self, path: str | Path, any_span: bool = False):
        if not str(path):
            raise ConfigError('the name of the bag is empty')
        self.path = _newest(Path(path))
        paths, self.notes = files_of(self.path)
        self.files, left_out = open_files(paths)
        self.notes += left_out
        self.files.sort(key=lambda f: (f.start_ns, f.path.name))
        self.topics: dict[str, BagTopic] = {}  # by key: the name, but for further definitions
        self.counts: dict[str, int] = {}
        for file in self.files:
            keys = {key: add_topic(self.topics, topic) for key, topic in file.topics.items()}
            file.rename(keys)
            for key, count in file.counts.items():
                self.counts[key] = self.counts.get(key, 0) + count
            if count := file.contents.attachments:
                self.notes.append(f'{file.path.name}: its attachments ({count}) are left out')
        self.namespace = namespace_of({t.name: t.type for t in self.topics.values()})
        filled = [f for f in self.files if f.places]
        self.start_ns = min((f.start_ns for f in filled), default=0)
        self.end_ns = max((f.end_ns for f in filled), default=0)
        if self.end_ns - self.start_ns > LONGEST_NS and not any_span:
            raise ConfigError(
                f'{self.path}: its messages lie more than a year apart, probably since the clock '
                'was set while recording; select a part by `mcap filter` with --start or --end'
            )

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
        """One line for each file that has no end, and for what else of the bag is left out."""
        return self.notes + [
            f'{f.path.name} has no end: {f.cut_at} of {f.size} bytes read, '
            f'{sum(f.counts.values())} messages'
            for f in self.files
            if f.cut_at is not None
        ]

    @property
    def damage(self) -> list[str]:
        """One line for each stretch found damaged so far: `verify` finds all before reading."""
        return [d.text(self.start_ns) for f in self.files for d in f.damage]

    def prove(self, through: Callable[[list], Iterator] = iter) -> Unreadable:
        """Read every chunk against its checksum, and return what is lost; `damage` says where.

        `through` hands on the files, to show progress.
        """
        missing, spans = 0, []
        for file in through(self.files):
            read = file.prove()
            missing += sum(file.counts.values()) - read if file.damage else 0
            for d in file.damage:
                if d.end_ns:
                    spans.append((d.start_ns or self.start_ns, min(d.end_ns, self.end_ns)))
        return Unreadable(missing, lasting_s(spans))

    def name(self, topic: str) -> str:
        """Return the full name that a topic of the graph has, or would have, in this bag."""
        return full_name(topic, self.namespace)

    def count(self, topic: str) -> int:
        """Return how many messages of a topic of the graph there are, of its own kind."""
        found = self.topics.get(self.name(topic))
        return self.counts[found.key] if found and not self.misfit(topic) else 0

    def misfit(self, topic: str) -> str:
        """Return why a topic of the graph is not what has that name here, or an empty string."""
        found = self.topics.get(self.name(topic))
        if not found or topic not in TOPICS:
            return ''
        kind = f'{found.type} {found.foreign}'.rstrip()
        ours = TOPICS[topic].type_name
        known = kind in (ours, FORMER_TYPES.get(topic))
        return '' if known else f'{found.name} has the type {kind}, not {ours}'

    def own(self, topic: str) -> str:
        """Return the full name of a topic of the graph; raise ConfigError where it is another's."""
        name = self.find(topic)
        if why := self.misfit(topic):
            raise ConfigError(f'{self.path}: {why}')
        return name

    def variants(self, key: str) -> list[str]:
        """Return the keys of all definitions of a topic."""
        return [k for k, t in self.topics.items() if t.name == self.topics[key].name]

    def find(self, name: str) -> str:
        """Return the full name of topic `name`, with or without namespace; raise ConfigError."""
        for candidate in (name, f'/{name}', self.name(name)):
            if candidate in self.topics:
                return candidate
        hint = nearest(name, sorted(self.topics))
        raise ConfigError(f'{self.path}: no topic {name} in this bag. {hint}')

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
            Topic, CDR bytes, times in ns and sequence number.

        Examples
        --------
        >>> first = next(BagReader('bags/sample').messages(['/eol/slips']))
        >>> first.topic, len(first.data)
        ('/eol/slips', 97)
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
        import numpy as np  # which few need

        from eol_ros.devices.bag.batches import MESSAGE_DTYPE, Batch

        files, apart = self._files(start_ns, end_ns)
        if apart:
            for f in files:
                yield from f.batches(topics, start_ns, end_ns)
            return
        messages = self.messages(topics, start_ns, end_ns)
        while some := list(itertools.islice(messages, MERGED)):
            for topic in {m.topic: None for m in some}:
                own = [m for m in some if m.topic == topic]
                heads = [(0, m.sequence, m.log_ns, m.publish_ns) for m in own]
                yield topic, Batch(np.array(heads, MESSAGE_DTYPE), [m.data for m in own])

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
        open_ = {t.key for t in self.topics.values() if t.latched}
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


def lasting_s(spans: Sequence[tuple[int, int]]) -> float:
    """Return the total length in s of time spans in ns; overlaps count once."""
    seconds, until_ns = 0.0, 0
    for start_ns, end_ns in sorted(spans):
        seconds += max(end_ns - max(start_ns, until_ns), 0) * 1e-9
        until_ns = max(until_ns, end_ns)
    return seconds


def open_files(paths: Collection[Path]) -> tuple[list[BagFileReader], list[str]]:
    """Return the files of a bag, and lines on those that are none; raise if nothing is left."""
    files, errors = [], []
    for path in paths:
        try:
            files.append(BagFileReader(path))
        except EolError as error:
            errors.append(error)
    if errors and not files:
        raise errors[0]
    return files, [f'{error}; left out' for error in errors]


def bags_in(path: Path) -> list[Path]:
    """Return the bag folders in `path`; none where that is a bag itself, or a file.

    A file beside them, such as a stretch that was cut out of one, does not make `path` a bag.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted({p.parent for p in path.glob('*/*') if _is_mcap(p) and p.parent.name[0] != '.'})


def _is_mcap(path: Path) -> bool:
    return path.name[0] != '.' and path.name.endswith(('.mcap', '.mcap' + PART))


def _newest(path: Path) -> Path:
    """Return the newest run in `path`; a bag is returned as it is.

    A replay records too, beside the bag that it plays: it must not find itself.
    """
    bags = bags_in(path)
    sample = None
    for bag in sorted(bags, key=lambda p: (p.stat().st_mtime_ns, p.name), reverse=True):
        try:
            about = _run_metadata(files_of(bag)[0][0])
        except EolError:  # one of many
            continue
        if about is None or REPLAY_OF in about:
            continue
        if SAMPLE not in about:
            return bag
        sample = min(sample or bag, bag)  # of those that ship, by name
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
                record = found.record
                if isinstance(record, Metadata) and record.name == RUN_METADATA:
                    return record.metadata
                chunk = isinstance(record, Chunk) and record.message_end_time
                if chunk or isinstance(record, Message):
                    return {}  # of another program
    except OSError:  # renamed meanwhile: it is whole now
        return {}
    return None if path.name.endswith(PART) else {}


def files_of(path: Path) -> tuple[list[Path], list[str]]:
    """Return the files of a bag, and what is in its folder and left out, in words."""
    if not path.exists():
        raise DeviceMissing(f'{path}: no such bag')
    check_file(path)
    if path.is_file():
        return [path], []
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
    others = [
        p
        for p in visible(path)
        if p.name.endswith(_NOT_READ) and p.name.partition('.mcap')[0] not in names
    ]
    for other in others:
        if not files or any(other.name.startswith(name) for name in missing):
            BagFileReader(other)  # its error says what the file is, and how to open it
    if missing:
        raise DeviceMissing(f'{path}: {missing[0]} is named in metadata.yaml and is not there')
    if not files:
        raise ConfigError(f'{path}: not a bag: a folder without .mcap files')
    return _own_files(sorted(files, key=natural), listed)


_NOT_READ = ('.db3', '.db3.zstd', '.mcap.zstd', '.mcap.gz', '.bag')


def _own_files(files: list[Path], listed: list[str]) -> tuple[list[Path], list[str]]:
    """Return those of `files` that are the bag's, and lines on the others.

    Without metadata.yaml all are, but for copies. With it also the next ones in its row: a recorder
    that is killed has not named them yet.
    """
    row = re.compile(re.escape(listed[0].rpartition('_')[0]) + r'_\d+\.mcap') if listed else None
    own: dict[bytes, Path] = {}
    notes = []
    for path in sorted(files, key=lambda p: (p.name not in listed, len(p.name), natural(p))):
        name = path.name.removesuffix(PART)
        if row and path.name not in listed and not row.fullmatch(name):
            notes.append(f'{path.name}: not named in metadata.yaml; left out')
            continue
        end = _end_of(path)
        if end in own:
            notes.append(f'{path.name}: a copy of {own[end].name}; left out')
            continue
        own[end] = path
    return sorted(own.values(), key=natural), notes


def _end_of(path: Path) -> bytes:
    """Return size and end of a file, which hold a checksum of its index: equal only for copies."""
    try:
        with path.open('rb') as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(size - 4096, 0))
            return f'{size} '.encode() + (file.read() if size else path.name.encode())
    except OSError:
        return path.name.encode()


def information(folder: Path) -> dict | None:
    """Return what `metadata.yaml` of a bag says, None without one; raise ConfigError."""
    file = folder / 'metadata.yaml'
    if not file.exists():
        return None
    try:
        return loads(file.read_text(encoding='utf-8'))
    except (yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        raise ConfigError(f'{file}: not the metadata of a rosbag2 folder') from None


def loads(text: str) -> dict:
    """Parse the text of a `metadata.yaml`; raises the errors of YAML and of a wrong text."""
    found = yaml_text.load(text)['rosbag2_bagfile_information']
    return {**found, 'relative_file_paths': [str(p) for p in found['relative_file_paths']]}


@functools.lru_cache(8)
def table_in(settings: str) -> TableSettings | None:
    """Return the table of a scene as a bag holds it; None where that is no scene.

    Raises ConfigError where its table is none.
    """
    try:
        said = yaml_text.load(settings)
    except yaml.YAMLError:
        return None
    if not isinstance(said, dict):
        return None
    try:
        return TableSettings.parsed(said.get('table', {}))
    except ValueError as error:
        raise ConfigError(
            f'the bag says of its table: {error}: another version of eol wrote it, or it is '
            'damaged (eol bag verify)'
        ) from None
