# SPDX-License-Identifier: Apache-2.0
"""A bag as arrays: `open_bag(path).table('blocks')`, and CSV. No ROS needed.

from eol_ros.analysis.bag import open_bag
blocks = open_bag('bags').table('blocks')
x = blocks['blocks']['x']          # (n, 25), m
t = blocks['stamp']                # datetime64[ns], mid-exposure
"""

import csv
import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from eol_ros.devices.bag.batches import NOTHING, Batch, joined
from eol_ros.devices.bag.reader import BagReader
from eol_ros.errors import ConfigError, UsageError
from eol_ros.streams import blocks, cascades, corpus, felt, leds, slips, taps, triggers
from eol_ros.streams.cdr import Decoder
from eol_ros.streams.definition import Message, parse, short
from eol_ros.streams.graph import TOPICS

BATCH = 4096  # messages decoded at a time
TIMES = ('log_time', 'publish_time')
DTYPES = {
    m.RECORD.type: m.RECORD.dtype for m in (cascades, corpus, felt, leds, slips, taps, triggers)
}
DTYPES['eol_msgs/msg/Blocks'] = blocks.dtype()


class Table(np.ndarray):
    """A structured array, one row a message, that knows the meaning and unit of its fields.

    `log_time` is when DDS received the message for the recorder, `publish_time` when it was sent,
    `stamp` is the message's own; all are datetime64[ns]. `comments` maps dotted field names to
    what the definition says of them.
    """

    topic: str
    comments: dict[str, str]

    def __array_finalize__(self, other: Any) -> None:
        """Keep topic and comments in views and slices."""
        self.topic = getattr(other, 'topic', '')
        self.comments = getattr(other, 'comments', {})

    def __getitem__(self, key: Any) -> Any:
        """Return a field as a plain array, rows as a table."""
        try:
            got = super().__getitem__(key)
        except ValueError:
            if self.topic and isinstance(key, str):
                names = ', '.join(self.dtype.names or ())
                raise ConfigError(
                    f'{self.topic}: its messages have no field {key}, but {names}'
                ) from None
            raise
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
            left = list(itertools.chain.from_iterable(_cells(row[n], row.dtype[n]) for n in one))
            if not spread:
                yield left
                continue
            for item in row[spread]:
                yield left + _cells(item, item.dtype)

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


class Gatherer(Protocol):
    """Gathers something from messages that do not fit into memory together."""

    def __init__(self, bag: 'Bag'): ...

    @property
    def fields(self) -> Mapping[str, tuple[str, ...]]:
        """By topic: fields of a message and (`blocks.x`) of the blocks in it."""

    def add(self, table: Table) -> None:
        """Take the rows that follow, BATCH at most."""


Gathers = TypeVar('Gathers', bound=Gatherer)


class Bag(BagReader):
    """A bag whose topics can be read as tables; see BagReader for what else it knows."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        if self.end_ns >= 1 << 63:
            raise ConfigError(
                f'{self.path}: messages were received after the year 2262, where times of ROS end: '
                'the clock of the recorder was wrong'
            )
        self.notes += [f'{why}; left out' for why in map(self.misfit, TOPICS) if why]
        self._kept: dict[tuple, Any] = {}  # results of collectors, by kind and topic

    def __repr__(self) -> str:
        """Return scene, time and length of the bag, and its topics with their counts."""
        begun = np.datetime64(self.start_ns, 'ns').astype('datetime64[s]')
        rows = [f'  {topic.name:32} {self.counts[key]:8}' for key, topic in self.topics.items()]
        scene = self.about.get('scene_name', 'not known')
        head = f'{self.path}: scene {scene}, {self.duration_s:.1f} s from {begun} UTC, '
        return '\n'.join([f'<Bag {head}{len(rows)} topics', *sorted(rows)]) + '>'

    def misfit(self, topic: str) -> str:
        """Return why a topic of the graph is not what has that name here, or an empty string."""
        found = self.topics.get(self.name(topic))
        if (why := super().misfit(topic)) or not found or found.type not in DTYPES:
            return why
        try:
            messages = parse(found.definition, found.type)
        except ValueError:
            return ''  # the decoder says what is wrong
        field = _no_number(messages, short(found.type), DTYPES[found.type])
        return field and f'{found.name} has another definition of {found.type}: {field}'

    def keep(
        self, topics: Mapping[str, Collection[str]], gatherers: Collection[type['Gatherer']] = ()
    ) -> None:
        """Read the bag once, so that what follows need not; topics without messages are left out.

        Parameters
        ----------
        topics : mapping
            What `table` then takes from memory: the fields of each topic, none for all of them.
        gatherers : collection of types
            What `gathered` then returns, for topics too large for memory; the `stamps` of these
            topics are kept.
        """

        def there(asked: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
            return ((self.name(t), value) for t, value in asked.items() if self.count(t))

        wanted: dict[tuple, _Collector] = {}
        for name, fields in there(topics):
            wanted['table', name] = self._rows(name, fields)
        calls: dict[tuple, list[Callable[[Table], object]]] = {}
        for kind in gatherers:
            one = self._kept['gathered', kind] = kind(self)
            for name, fields in there(one.fields):
                calls.setdefault((name, fields), []).append(one.add)
        for (name, fields), called in calls.items():
            wanted['each', name, fields] = _Each(self._rows(name, fields, 0), called)
            wanted['stamps', name] = self._rows(name, ('stamp',))
        self._kept |= self._collect(wanted)

    def gathered(self, kind: type[Gathers]) -> Gathers:
        """Return what a gatherer has found in this bag."""
        if ('gathered', kind) not in self._kept:
            self.keep({}, (kind,))
        found: Gathers = self._kept['gathered', kind]
        return found

    def release(self) -> None:
        """Keep nothing any more: what follows is read from the bag, with all its fields."""
        self._kept = {}

    def _collect(
        self, wanted: dict[tuple, '_Collector'], start_ns: int = 0, end_ns: int | None = None
    ) -> dict[tuple, Any]:
        """Read the bag once, and return the result of each collector."""
        for name, batch in self._large({key[1] for key in wanted}, start_ns, end_ns):
            for key, collector in wanted.items():
                if key[1] == name:
                    try:
                        collector.add(batch)
                    except ConfigError as error:  # in the bytes of a message
                        raise ConfigError(f'{self.path}: {name}: {error}') from None
        return {key: collector.found() for key, collector in wanted.items()}

    def _rows(self, name: str, fields: Collection[str] = (), most: int | None = None) -> '_Rows':
        """Return an empty table of a topic that has room for `most` messages, None: for all."""
        decoder = self.decoder(name, ['header.stamp' if f == 'stamp' else f for f in fields])
        return _Rows(name, decoder, self.counts[name] if most is None else most, fields)

    def _large(
        self, topics: Collection[str], start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[tuple[str, Batch]]:
        """Yield the messages of `topics`, full names, BATCH of one at a time or those left over."""
        waiting: dict[str, list[Batch]] = {}
        count = dict.fromkeys(topics, 0)
        for name, batch in self.batches(topics, start_ns, end_ns):
            waiting.setdefault(name, []).append(batch)
            count[name] += len(batch.data)
            while count[name] >= BATCH:
                whole = joined(waiting[name])
                yield name, whole.part(0, BATCH)
                waiting[name] = [whole.part(BATCH, count[name])]
                count[name] -= BATCH
        for name, batches in waiting.items():
            if count[name]:
                yield name, joined(batches)

    def stamps(self, topic: str) -> tuple[np.ndarray, np.ndarray]:
        """Return reception and stamp of each message, two (n,) datetime64[ns], no more decoded."""
        name = self.find(topic)
        key = ('table' if ('table', name) in self._kept else 'stamps'), name
        if key not in self._kept:
            self._kept |= self._collect({key: self._rows(name, ('stamp',))})
        return self._kept[key]['log_time'], self._kept[key]['stamp']

    def decoder(self, name: str, only: Collection[str] = ()) -> Decoder:
        """Return the decoder of the full topic name; see `Decoder` for `only`."""
        topic = self.topics[name]
        if topic.foreign:
            raise ConfigError(
                f'{self.path}: {name}: its messages are {topic.foreign}; only those of ROS 2 '
                '(cdr/ros2msg) can be decoded'
            )
        try:
            return Decoder(topic.type, topic.definition, only)
        except ConfigError as error:
            raise ConfigError(f'{self.path}: {name}: {error}') from None

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
        ((447,), dtype('<M8[ns]'))
        """
        name = self.find(topic)
        start_ns = self.start_ns + round(start_s * 1e9)
        end_ns = None if end_s is None else self.start_ns + round(end_s * 1e9)
        if ('table', name) in self._kept:
            whole: Table = self._kept['table', name]
            received = whole['log_time'].astype('i8')
            first = np.searchsorted(received, start_ns)
            last = len(whole) if end_ns is None else np.searchsorted(received, end_ns)
            return whole[first:last]
        wanted: dict[tuple, _Collector] = {('table', k): self._rows(k) for k in self.variants(name)}
        tables = list(self._collect(wanted, start_ns, end_ns).values())
        return tables[0] if len(tables) == 1 else _of_all(tables)


def _no_number(messages: Mapping[str, Message], kind: str, dtype: np.dtype) -> str:
    """Return the first field of a definition that should be a number, or numbers, and is not."""
    for field in messages[kind].fields if kind in messages else ():
        if field.name not in (dtype.names or ()):
            continue
        wanted = dtype[field.name].base
        if wanted.names and (wrong := _no_number(messages, field.type, wanted)):
            return wrong
        single = field.length is None or dtype[field.name].shape
        if wanted.kind in 'biuf' and not (field.plain and single):
            return (
                f'{field.name} is {field.type}{"" if field.length is None else "[]"}, not a number'
            )
    return ''


class _Collector(Protocol):
    """Collects a result from the messages of a topic, batch by batch."""

    def add(self, batch: Batch) -> None:
        """Add the next messages."""

    def found(self) -> Any:
        """Return the result, and start again."""


class _Each:
    """Calls functions with the table of each batch."""

    def __init__(self, rows: '_Rows', calls: list[Callable[[Table], object]]):
        self._rows, self._calls = rows, calls

    def add(self, batch: Batch) -> None:
        self._rows.add(batch)
        table = self._rows.found()
        for call in self._calls:
            call(table)

    def found(self) -> None: ...


class _Rows:
    """A table that grows without a second copy of itself: memory is taken for all rows at once."""

    def __init__(self, name: str, decoder: Decoder, most: int, fields: Collection[str] = ()):
        self._name, self._decoder = name, decoder
        self._fields = list(dict.fromkeys(field.split('.')[0] for field in fields))
        self._left = most
        self._parts: list[np.ndarray] = []  # of one dtype each: as long as strings have one width
        self._count = 0  # rows of the last one

    def add(self, batch: Batch) -> None:
        """Take the messages that follow; a few thousand, for each is held twice meanwhile."""
        times = batch.log_ns.view('M8[ns]'), batch.publish_ns.view('M8[ns]')
        columns = dict(zip(TIMES, times, strict=True)) | self._decoder.table(batch.data)
        kept = (*TIMES, *self._fields) if self._fields else tuple(columns)
        kinds = np.dtype([(f, columns[f].dtype, columns[f].shape[1:]) for f in kept])
        if not self._parts or kinds != self._parts[-1].dtype:
            self._close()
            self._parts.append(np.empty(max(self._left, len(batch.data)), kinds))
        last = self._count + len(batch.data)
        rows = self._parts[-1][self._count : last]
        for field in kept:
            rows[field] = columns[field]
        self._left -= len(batch.data)
        self._count = last

    def found(self) -> Table:
        if not self._parts:
            self.add(NOTHING)
        self._close()
        parts, self._parts = self._parts, []
        whole = parts[0] if len(parts) == 1 else _stacked(parts, parts[0].dtype.names or ())
        table = whole.view(Table)
        table.topic, table.comments = self._name, self._decoder.comments
        return table

    def _close(self) -> None:
        if self._parts and self._count < len(self._parts[-1]):
            self._parts[-1] = self._parts[-1][: self._count].copy()
        self._count = 0


def _stacked(parts: Sequence[np.ndarray], names: Sequence[str]) -> np.ndarray:
    """Return the fields `names` of tables of several dtypes as one array."""
    columns = {name: _joined([part[name] for part in parts]) for name in names}
    kinds = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    whole = np.empty(sum(map(len, parts)), kinds)
    for name, column in columns.items():
        whole[name] = column
    return whole


def _of_all(tables: Sequence[Table]) -> Table:
    """Merge tables of several definitions of a topic; keep the columns that all have."""
    first = tables[0]
    names = [
        n for n in first.dtype.names or ()
        if all(n in (t.dtype.names or ()) for t in tables)
        and len({(t[n].shape[1:], t[n].dtype.names) for t in tables}) == 1
    ]  # fmt: skip
    whole = _stacked(tables, names)
    table = whole[np.argsort(whole['log_time'], kind='stable')].view(Table)
    table.topic, table.comments = first.topic, first.comments
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
    (2255, 40)
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
    return [key for name in names for key in bag.variants(name)]


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


def _cells(value: Any, dtype: np.dtype) -> list:
    if dtype.names:
        inner = (_cells(value[name], dtype[name]) for name in dtype.names)
        return list(itertools.chain.from_iterable(inner))
    if dtype.kind in 'mM':
        ns = int(value.astype('i8'))
        return [f'{ns // 10**9}.{ns % 10**9:09d}']
    if isinstance(value, np.ndarray):
        return [' '.join(map(str, value.tolist()))] if dtype.kind == 'O' else value.tolist()
    return [value.item() if isinstance(value, np.generic) else value]
