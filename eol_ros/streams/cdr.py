# SPDX-License-Identifier: Apache-2.0
"""Serialised ROS 2 messages to arrays and back, by their definition. No ROS needed.

Plain CDR as ROS 2 writes it (OMG DDS-XTypes 1.3, 7.4.3, encoding version 1): every value lies at a
multiple of its size behind the 4-byte header. Messages whose strings and sequences are equally long
have one layout; it is worked out once. `Decoder` then reads many of them as columns of one byte
matrix, `Fixed` reads and writes one at a time in place.
"""

import struct
from collections import namedtuple
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.streams.definition import PRIMITIVES, STRINGS, Field, parse, short

HEADER = 4
NS = 1_000_000_000
TIMES = {
    'builtin_interfaces/Time': 'datetime64[ns]',
    'builtin_interfaces/Duration': 'timedelta64[ns]',
}
TIME = np.dtype([('sec', '<i4'), ('nanosec', '<u4')])  # as it lies in a message


Time = namedtuple('Time', 'sec nanosec')
Header = namedtuple('Header', 'stamp frame_id')


@dataclass
class Layout:
    """Where everything lies in one message: a tree of offsets, and the lengths that fixed it."""

    size: int
    tree: Any
    lengths: np.ndarray  # (k, 2): offset of a uint32 length, its value

    def holds(self, raw: np.ndarray) -> np.ndarray:
        """Return which rows of `raw`, (n, size) bytes, have this layout."""
        same = np.ones(len(raw), bool)
        for offset, value in self.lengths:
            same &= _gather(raw, offset, '<u4')[:, 0] == value
        return same

    def at(self, *path: str | int) -> tuple[str, int, int]:
        """Return kind, offset and count of the value at the end of a path of names and indices."""
        node = self.tree
        for step in path:
            if isinstance(step, str):
                node = next((below for field, below in node.items() if field.name == step), None)
                if node is None:
                    raise ValueError(f'its message has no field {step}')
            else:
                node = node[step]
        kind, offset, count = node
        return kind, offset, count


class Decoder:
    """Turns messages of one type into a structured array, one row a message.

    only: dotted names of fields, as they stand in the definition; the others are left out.
    """

    def __init__(self, type_name: str, definition: str, only: Collection[str] = ()):
        self.type = type_name
        try:
            self.types = parse(definition, type_name)
        except ValueError as error:
            raise ConfigError(f'{type_name}: its definition cannot be read: {error}') from None
        self.root = short(type_name)
        self._check(self.root, ())
        self._layouts: list[Layout] = []
        self._only: dict[str, set[str]] = {}
        for path in only:
            kind = self.root
            for name in path.split('.'):
                self._only.setdefault(kind, set()).add(name)
                fields = {f.name: f.type for f in self.types[kind].fields}
                if name not in fields:
                    raise ConfigError(
                        f'{type_name}: has no {path}, but {", ".join(fields) or "nothing"}'
                    )
                kind = fields[name]

    @cached_property
    def comments(self) -> dict[str, str]:
        """Return the comment of each field, by its dotted name: unit and meaning."""
        found: dict[str, str] = {}

        def walk(kind: str, prefix: str) -> None:
            for field in self.types[kind].fields if kind in self.types else ():
                name = prefix + field.name
                if field.type == 'std_msgs/Header' and not prefix:
                    found['stamp'] = field.comment
                    continue
                found[name] = field.comment
                if field.type not in TIMES:
                    walk(field.type, name + '.')

        walk(self.root, '')
        return found

    def dtype(self, kind: str) -> np.dtype:
        """Return the dtype of message type `kind` inside an array of messages."""
        return np.dtype([self._slot(f) for f in self._fields(kind)] or [('nothing', 'u1')])

    def _fields(self, kind: str) -> list[Field]:
        """Return the fields of a type that are wanted."""
        fields = self.types[kind].fields
        return [f for f in fields if f.name in self._only[kind]] if kind in self._only else fields

    def _slot(self, field: Field) -> tuple[Any, ...]:
        if field.length == -1 or field.type in ('string', 'wstring'):
            return field.name, object
        if field.plain:
            base: Any = PRIMITIVES[field.type]
        else:
            base = TIMES.get(field.type) or self.dtype(field.type)
        return (field.name, base) if field.length is None else (field.name, base, field.length)

    def _check(self, kind: str, within: tuple[str, ...]) -> None:
        """Raise ConfigError where a type that fields have is not defined, or holds itself."""
        if kind not in self.types:
            raise ConfigError(f'{self.type}: its definition does not say what {kind} is')
        if kind in within:
            raise ConfigError(f'{self.type}: by its definition {kind} holds itself')
        for field in self.types[kind].fields:
            if not field.plain and field.type not in STRINGS and field.type not in TIMES:
                self._check(field.type, (*within, kind))

    def table(self, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
        """Return the columns, in order of the definition; the header becomes stamp and frame_id.

        Strings are `U`, times datetime64[ns]; sequences of one length become (n, length), others
        an object array of arrays.
        """
        columns: dict[str, list[np.ndarray]] = {}
        rows: list[np.ndarray] = []
        for layout, index, raw in self._groups(messages):
            rows.append(index)
            for name, values in self._message(self.root, layout.tree, raw, top=True).items():
                columns.setdefault(name, []).append(values)
        if not rows:
            return self._empty(self.root)
        order = np.argsort(np.concatenate(rows), kind='stable')
        return {name: _joined(parts)[order] for name, parts in columns.items()}

    def _empty(self, kind: str) -> dict[str, np.ndarray]:
        columns = {}
        for field in self._fields(kind):
            if field.type == 'std_msgs/Header' and field.length is None:
                columns.update(self._empty(field.type))
            else:
                slot = np.dtype([self._slot(field)])
                columns[field.name] = np.empty(0, slot)[field.name]
        return columns

    def _groups(self, messages: Sequence[bytes]) -> Iterator[tuple[Layout, np.ndarray, np.ndarray]]:
        sizes = np.array([len(m) for m in messages], int)
        if sizes.min(initial=HEADER) < HEADER:
            raise ConfigError(f'{self.type}: a message of {sizes.min()} bytes, 4 are needed')
        for size in np.unique(sizes):
            left = np.flatnonzero(sizes == size)
            joined = b''.join([messages[i] for i in left.tolist()])
            raw = np.frombuffer(joined, 'u1').reshape(-1, size)
            if np.any(raw[:, 1] != 1):
                raise ConfigError(f'{self.type}: not little-endian plain CDR, which ROS 2 writes')
            while len(left):
                known = (x for x in self._layouts if x.size == size and x.holds(raw[:1])[0])
                layout = next(known, None)
                if layout is None:
                    layout = self.layout(messages[left[0]])
                    self._layouts = [layout, *self._layouts[:31]]
                same = layout.holds(raw)
                yield layout, left[same], raw[same]
                left, raw = left[~same], raw[~same]

    def layout(self, data: bytes | bytearray) -> Layout:
        """Return where everything lies in one message; raise ConfigError where it is too short."""
        lengths: list[tuple[int, int]] = []
        at = HEADER

        def aligned(size: int) -> int:
            nonlocal at
            at += -(at - HEADER) % size
            return at

        def length() -> int:
            nonlocal at
            place = aligned(4)
            value = int(struct.unpack_from('<I', data, place)[0])
            if value > len(data):
                raise struct.error(f'length {value} at byte {place} of {len(data)}')
            lengths.append((place, value))
            at += 4
            return value

        def one(kind: str) -> Any:
            nonlocal at
            if kind == 'string':
                count = length()
                at += count
                return 'string', at - count, max(count - 1, 0)
            if kind in PRIMITIVES:
                return many(kind, 1)
            if kind in TIMES:
                place = aligned(4)
                at += 8
                return kind, place, 1
            if kind not in self.types:
                raise ConfigError(f'{self.type}: its definition does not say what {kind} is')
            fields = self.types[kind].fields
            if not fields:
                at += 1  # the member that an empty struct gets in IDL
            return {f: value(f) for f in fields}

        def many(kind: str, count: int) -> Any:
            nonlocal at
            size = np.dtype(PRIMITIVES[kind]).itemsize
            place = aligned(size) if count else at
            at += size * count
            return kind, place, count

        def value(field: Field) -> Any:
            if field.length is None:
                return one(field.type)
            count = length() if field.length == -1 else field.length
            if field.plain:
                return many(field.type, count)
            return [one(field.type) for _ in range(count)]

        try:
            tree = one(self.root)
        except struct.error as error:
            raise ConfigError(f'{self.type}: a message is shorter than its type: {error}') from None
        if at > len(data):
            raise ConfigError(f'{self.type}: a message of {len(data)} bytes, {at} are needed')
        return Layout(len(data), tree, np.array(lengths, int).reshape(-1, 2))

    def _message(
        self, kind: str, tree: dict[Field, Any], raw: np.ndarray, top: bool
    ) -> dict[str, np.ndarray]:
        out = {}
        for field in self._fields(kind):
            node = tree[field]
            if top and field.type == 'std_msgs/Header' and field.length is None:
                out.update(self._message(field.type, node, raw, top))
            else:
                out[field.name] = self._value(field, node, raw, top)
        return out

    def _value(self, field: Field, node: Any, raw: np.ndarray, top: bool) -> np.ndarray:
        n = len(raw)
        if field.plain:
            _kind, place, count = node
            values = _gather(raw, place, '<' + PRIMITIVES[field.type], count)
            if field.length is None:
                return values[:, 0]
            return values if top or field.length >= 0 else _objects(values)
        if field.length is None:
            return self._single(field.type, node, raw, top)
        if field.type == 'string':
            words = np.empty((n, len(node)), object)
            for k, item in enumerate(node):
                words[:, k] = self._single('string', item, raw, False)
            return words if top or field.length >= 0 else _objects(words)
        base = TIMES.get(field.type) or self.dtype(field.type)
        table = np.empty((n, len(node)), base)
        for k, item in enumerate(node):
            table[:, k] = self._single(field.type, item, raw, False)
        return table if top or field.length >= 0 else _objects(table)

    def _single(self, kind: str, node: Any, raw: np.ndarray, top: bool) -> np.ndarray:
        if kind == 'string':
            _kind, place, count = node
            cells = np.ascontiguousarray(raw[:, place : place + count])
            words = np.empty(len(raw), object)
            words[:] = [bytes(row).decode('utf-8', 'replace') for row in cells]
            return words.astype(str) if top else words
        if kind in TIMES:
            place = node[1]
            seconds = _gather(raw, place, '<i4')[:, 0].astype('i8')
            nanoseconds = _gather(raw, place + 4, '<u4')[:, 0]
            times: np.ndarray = seconds * NS + nanoseconds
            return times.view(TIMES[kind])
        table = np.empty(len(raw), self.dtype(kind))
        for name, values in self._message(kind, node, raw, False).items():
            table[name] = values
        return table


class Fixed:
    """Named values of all messages that have the layout of an example, read and written in place.

    names: dotted, of numbers, times (as seconds and nanoseconds) and strings (as bytes). `dtype` is
    a record that holds them where they lie, and behind them the lengths that fix the layout.
    """

    def __init__(self, layout: Layout, names: Sequence[str]):
        places = [layout.at(*name.split('.')) for name in names]
        places += [('uint32', offset, 1) for offset in layout.lengths[:, 0].tolist()]
        self._lengths = tuple(layout.lengths[:, 1].tolist())
        self._count = len(names)
        self.dtype = np.dtype(
            {
                'names': [*names, *(f'length {k}' for k in range(len(self._lengths)))],
                'formats': [_format(kind, count) for kind, _, count in places],
                'offsets': [offset for _, offset, _ in places],
                'itemsize': layout.size,
            }
        )

    def values(self, raw: bytes) -> tuple[Any, ...] | None:
        """Return the values in order of the names; None where `raw` has another layout."""
        if len(raw) < self.dtype.itemsize or raw[:2] != b'\0\1':
            return None
        found = np.ndarray((), self.dtype, raw).item()
        return found[: self._count] if found[self._count :] == self._lengths else None

    def writer(self, raw: bytearray) -> Callable[..., None]:
        """Return a function that writes the values, in order of the names, into `raw`."""
        record = np.ndarray((), self.dtype, raw)
        lengths = self._lengths

        def write(*values: Any) -> None:
            record[()] = (*values, *lengths)

        return write


class Flat:
    """Reads messages of a header, numbers and times as named tuples, in a third of rclpy's time."""

    def __init__(self, decoder: Decoder):
        fields = decoder.types[decoder.root].fields
        self._decoder = decoder
        self._fixed: Fixed | None = None
        # mypy knows names of fields only where they stand in the code
        self._row: Any = namedtuple('_row', [f.name for f in fields])  # type: ignore[misc]
        self._times = [k for k, f in enumerate(fields) if f.type in TIMES]

    @classmethod
    def of(cls, type_name: str, definition: str) -> 'Flat | None':
        """Return what reads messages of a type; None where it has other fields."""
        decoder = Decoder(type_name, definition)
        fields = decoder.types[decoder.root].fields
        flat = all(f.length is None and (f.plain or f.type in TIMES) for f in fields[1:])
        headed = [f.type for f in fields[:1]] == ['std_msgs/Header']
        return cls(decoder) if flat and headed else None

    def read(self, raw: bytes) -> Any:
        """Return a message; None where it has another layout than the first, or is damaged."""
        if self._fixed is None:
            names = ('header.stamp', 'header.frame_id', *self._row._fields[1:])
            self._fixed = Fixed(self._decoder.layout(raw), names)
        values = self._fixed.values(raw)
        if values is None:
            return None
        row = [Header(Time(*values[0]), values[1].decode('utf-8', 'replace')), *values[2:]]
        for k in self._times:
            row[k] = Time(*row[k])
        return self._row._make(row)


def _format(kind: str, count: int) -> Any:
    if kind in TIMES:
        return TIME
    # With its end: numpy cuts off the zero, and another byte there stays
    return f'S{count + 1}' if kind == 'string' else '<' + PRIMITIVES[kind]


def words(*values: int | str | bytes) -> bytearray:
    """Return the CDR header followed by `values`: uint32, strings, and raw bytes."""
    out = bytearray(b'\0\1\0\0')
    for value in values:
        if isinstance(value, bytes):
            out += value
            continue
        text = value.encode() + b'\0' if isinstance(value, str) else b''
        number = value if isinstance(value, int) else len(text)
        out += bytes(-len(out) % 4) + struct.pack('<I', number) + text
    return out


def stamp_ns(raw: bytes) -> int:
    """Return the stamp of a message that begins with a std_msgs/Header, in nanoseconds.

    0, as for a message without a time, if it is too short for a stamp.
    """
    if len(raw) < HEADER + TIME.itemsize:
        return 0
    seconds, nanoseconds = struct.unpack_from('<iI', raw, HEADER)
    return int(seconds * NS + nanoseconds)


def _gather(raw: np.ndarray, place: int, kind: str, count: int = 1) -> np.ndarray:
    """Return the (n, count) values that lie at byte `place` of each row."""
    size = np.dtype(kind).itemsize
    if not count:
        return np.empty((len(raw), 0), kind)
    return np.ascontiguousarray(raw[:, place : place + size * count]).view(kind)


def _objects(values: np.ndarray) -> np.ndarray:
    """Return (n, k, ...) values as n arrays in an object array."""
    out = np.empty(len(values), object)
    for i, row in enumerate(values):
        out[i] = row
    return out


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Return the groups' values one behind the other; of unequal shapes, as objects."""
    if len({part.shape[1:] for part in parts}) == 1:
        return np.concatenate(parts)
    return np.concatenate([_objects(part) for part in parts])
