# SPDX-License-Identifier: Apache-2.0
"""A bag as arrays: `open_bag(path).table('blocks')`, and CSV. No ROS needed.

from eol_ros.analysis.bag import open_bag
blocks = open_bag('bags').table('blocks')
x = blocks['blocks']['x']          # (n, 25), m
t = blocks['stamp']                # datetime64[ns], mid-exposure
"""

import csv
import itertools
import struct
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.devices.bag.reader import BagMessage, BagReader
from eol_ros.errors import UsageError
from eol_ros.streams.cdr import Decoder

BATCH = 4096  # messages decoded at a time


class Table(np.ndarray):
    """A structured array, one row a message, that knows the meaning and unit of its fields.

    `log_time` and `publish_time` are those of the recorder, `stamp` is the message's own; all are
    datetime64[ns]. `comments` maps dotted field names to what the definition says of them.
    """

    topic: str
    comments: dict[str, str]

    def __array_finalize__(self, other: Any) -> None:
        """Keep topic and comments in views and slices."""
        self.topic = getattr(other, 'topic', '')
        self.comments = getattr(other, 'comments', {})

    def __getitem__(self, key: Any) -> Any:
        """Return a field as a plain array, rows as a table."""
        got = super().__getitem__(key)
        return got.view(np.ndarray) if isinstance(key, str) else got

    def rows(self) -> Iterator[list]:
        """Yield the header, then rows of plain values.

        A message with an array of messages, such as Blocks, becomes one row for each of them.
        Other arrays become one column per item, or text parted by spaces where their lengths vary.
        """
        spread = next((n for n in self.dtype.names or () if _records(self[n])), None)
        one = [n for n in self.dtype.names or () if n != spread]
        yield list(itertools.chain.from_iterable(_titles(n, self[n]) for n in one)) + (
            [f'{spread}.{n}' for n in _inner(self[spread]).names or ()] if spread else []
        )
        for row in self:
            left = list(itertools.chain.from_iterable(_cells(row[n]) for n in one))
            if not spread:
                yield left
                continue
            for item in row[spread]:
                yield left + list(itertools.chain.from_iterable(_cells(v) for v in item))

    def to_csv(self, path: str | Path) -> None:
        """Write `rows()` as CSV; times in s since the epoch with nine decimals.

        Parameters
        ----------
        path : str or Path
            The file, which is replaced.

        Examples
        --------
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / 'cascades.csv'
        >>> open_bag('bags/sample').table('cascades').to_csv(file)
        >>> file.read_text()[:26]
        'log_time,publish_time,stam'
        """
        with open(path, 'w', newline='', encoding='utf-8') as file:
            csv.writer(file, lineterminator='\n').writerows(self.rows())


class Bag(BagReader):
    """A bag whose topics can be read as tables; see BagReader for what else it knows."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._kept: dict[str, Table] = {}
        self._stamps: dict[str, tuple[np.ndarray, ...]] = {}

    def keep(self, topics: Sequence[str]) -> None:
        """Read `topics` once into memory: `table` then takes them from there."""
        self._kept |= {table.topic: table for table in self.tables(topics).values()}

    def stamps(self, topic: str) -> tuple[np.ndarray, np.ndarray]:
        """Return reception and stamp of each message, two (n,) datetime64[ns], nothing decoded.

        The message begins with a header, as all of the graph do that have a stamp.
        """
        name = self.find(topic)
        if name in self._kept:
            return self._kept[name]['log_time'], self._kept[name]['stamp']
        if name not in self._stamps:
            received, stamped = array('q'), array('q')
            for m in self.messages([name]):
                received.append(m.log_ns)
                stamped.append(_stamp_ns(m.data))
            both = (np.array(times, np.int64).view('M8[ns]') for times in (received, stamped))
            self._stamps[name] = tuple(both)
        received_at, stamp = self._stamps[name]
        return received_at, stamp

    def thinned(self, topic: str, step_s: float) -> Table:
        """Return the first row of each `step_s` by the stamps, and decode no others.

        The message begins with a header; a row has half a step of distance at least.
        """
        name = self.find(topic)
        decoder, parts = self.decoder(name), []
        some = self._thinned(name, round(step_s * 1e9))
        while batch := list(itertools.islice(some, BATCH)):
            parts.append(_decoded(decoder, batch))
        return _table(name, decoder, parts)

    def _thinned(self, name: str, step_ns: int) -> Iterator[BagMessage]:
        last_ns, last_step = -(1 << 62), None
        for m in self.messages([name]):
            at_ns = _stamp_ns(m.data)
            step = (at_ns - self.start_ns) // step_ns
            if step != last_step and at_ns >= last_ns + step_ns // 2:
                last_ns = at_ns
                yield m
            last_step = step

    def decoder(self, name: str) -> Decoder:
        """Return the decoder of the full topic name."""
        return Decoder(self.topics[name].type, self.topics[name].definition)

    def table(self, topic: str, start_s: float = 0.0, end_s: float | None = None) -> Table:
        """Decode the messages of a topic into one array.

        Parameters
        ----------
        topic : str
            With or without its namespace.
        start_s, end_s : float
            Only messages received in [start_s, end_s), in s from the start of the bag; None: to
            its end.

        Returns
        -------
        Table
            A structured array (n,) with `log_time`, `publish_time` and the fields of the message.
            Times are datetime64[ns]; `stamp` is that of the header.

        Raises
        ------
        ConfigError
            The bag has no such topic.

        Examples
        --------
        >>> slips = open_bag('bags/sample').table('slips', 10, 20)
        >>> slips.shape, slips['stamp'].dtype
        ((166,), dtype('<M8[ns]'))
        """
        name = self.find(topic)
        start_ns = self.start_ns + round(start_s * 1e9)
        end_ns = None if end_s is None else self.start_ns + round(end_s * 1e9)
        if name in self._kept:
            whole = self._kept[name]
            received = whole['log_time'].astype('i8')
            first = np.searchsorted(received, start_ns)
            last = len(whole) if end_ns is None else np.searchsorted(received, end_ns)
            return whole[first:last]
        decoder = self.decoder(name)
        messages = self.messages([name], start_ns, end_ns)
        parts = []
        while batch := list(itertools.islice(messages, BATCH)):
            parts.append(_decoded(decoder, batch))
        return _table(name, decoder, parts)

    def tables(self, topics: Sequence[str]) -> dict[str, Table]:
        """Return the tables of those of `topics` that have messages; the bag is read once."""
        names = {self.name(topic): topic for topic in topics if self.count(topic)}
        decoders = {name: self.decoder(name) for name in names}
        waiting: dict[str, list[BagMessage]] = {name: [] for name in names}
        parts: dict[str, list[dict]] = {name: [] for name in names}
        for message in self.messages(list(names)) if names else ():
            batch = waiting[message.topic]
            batch.append(message)
            if len(batch) == BATCH:
                parts[message.topic].append(_decoded(decoders[message.topic], batch))
                batch.clear()
        for name, batch in waiting.items():
            if batch:
                parts[name].append(_decoded(decoders[name], batch))
        return {topic: _table(name, decoders[name], parts[name]) for name, topic in names.items()}


def _stamp_ns(data: bytes) -> int:
    """Return the stamp of a serialised message that begins with a header."""
    seconds, ns = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    return int(seconds * 10**9 + ns)


def _decoded(decoder: Decoder, batch: list[BagMessage]) -> dict[str, np.ndarray]:
    times = {
        'log_time': np.array([m.log_ns for m in batch], 'datetime64[ns]'),
        'publish_time': np.array([m.publish_ns for m in batch], 'datetime64[ns]'),
    }
    return times | decoder.table([m.data for m in batch])


def _table(name: str, decoder: Decoder, parts: list[dict[str, np.ndarray]]) -> Table:
    if not parts:
        none = np.empty(0, 'datetime64[ns]')
        parts = [{'log_time': none, 'publish_time': none} | decoder.table([])]
    columns = {field: _joined([part[field] for part in parts]) for field in parts[0]}
    kinds = [(n, c.dtype, c.shape[1:]) for n, c in columns.items()]
    table = np.empty(len(columns['log_time']), kinds).view(Table)
    for field, values in columns.items():
        table[field] = values
    table.topic, table.comments = name, decoder.comments
    return table


def open_bag(path: str | Path) -> Bag:
    """Open a recording, without ROS.

    Parameters
    ----------
    path : str or Path
        A bag folder, an .mcap file, or a folder of bags for the newest run in it.

    Returns
    -------
    Bag
        Its topics, counts, times in ns, gaps, and `table`.

    Raises
    ------
    DeviceMissing
        There is no such file.
    ConfigError
        It is not a bag.

    Examples
    --------
    >>> bag = open_bag('bags/sample')
    >>> bag.count('blocks'), round(bag.duration_s)
    (3015, 55)
    """
    return Bag(path)


def seconds(times: np.ndarray) -> np.ndarray:
    """Convert times to float seconds, good to 0.2 us.

    Parameters
    ----------
    times : ndarray of datetime64[ns]
        Of any shape.

    Returns
    -------
    ndarray of float
        Seconds since the epoch, of the same shape.

    Examples
    --------
    >>> round(float(seconds(np.array(['1970-01-01T00:01:00.5'], 'M8[ns]'))[0]), 6)
    60.5
    """
    return times.astype('i8') * 1e-9


def topic_names(bag: BagReader, asked: str | None) -> list[str]:
    """Return the full names of the topics `asked`, parted by commas; None: all with messages.

    Raises ConfigError for one that is not there, UsageError for an empty list.
    """
    if asked is None:
        return [name for name, count in bag.counts.items() if count]
    names = [bag.find(name.strip()) for name in asked.split(',') if name.strip()]
    if not names:
        raise UsageError(f'{asked!r}: names no topic')
    return names


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    if len({p.shape[1:] for p in parts}) == 1:
        return np.concatenate(parts)  # strings take the longest width
    total = np.empty(sum(len(p) for p in parts), object)
    for i, row in enumerate(itertools.chain.from_iterable(parts)):
        total[i] = row
    return total


def _inner(values: np.ndarray) -> np.dtype:
    if values.dtype.names:
        return values.dtype
    return next((v.dtype for v in values if isinstance(v, np.ndarray)), np.dtype('u1'))


def _records(values: np.ndarray) -> bool:
    """Whether a column holds arrays of messages."""
    if values.dtype.names:
        return values.ndim > 1
    return values.dtype == object and _inner(values).names is not None


def _titles(name: str, values: np.ndarray) -> list[str]:
    if values.dtype.names:
        inner = itertools.chain.from_iterable(_titles(n, values[n]) for n in values.dtype.names)
        return [f'{name}.{title}' for title in inner]
    if values.ndim > 1:
        return [f'{name}[{i}]' for i in range(values.shape[1])]
    return [name]


def _cells(value: Any) -> list:
    if isinstance(value, np.void):
        names = value.dtype.names or ()
        return list(itertools.chain.from_iterable(_cells(value[name]) for name in names))
    if isinstance(value, (np.datetime64, np.timedelta64)):
        ns = int(value.astype('i8'))
        return [f'{ns // 10**9}.{ns % 10**9:09d}']
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [' '.join(str(v) for v in value)]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [value.item() if isinstance(value, np.generic) else value]
