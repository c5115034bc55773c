# SPDX-License-Identifier: Apache-2.0
"""Serialised ROS 2 messages to arrays, by the definition that a bag carries. No ROS needed.

Plain CDR as ROS 2 writes it (OMG DDS-XTypes 1.3, 7.4.3, encoding version 1): every value lies at a
multiple of its size behind the 4-byte header. Messages whose strings and sequences are equally long
have one layout; it is worked out once, and all of them are read as columns of one byte matrix.
"""

import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eol_ros.errors import ConfigError

HEADER = 4
PRIMITIVES = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'float32': 'f4', 'float64': 'f8',
    'int8': 'i1', 'uint8': 'u1', 'int16': 'i2', 'uint16': 'u2',
    'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8',
}  # fmt: skip
TIMES = {
    'builtin_interfaces/Time': 'datetime64[ns]',
    'builtin_interfaces/Duration': 'timedelta64[ns]',
}
_FIELD = re.compile(
    r'(?P<type>[A-Za-z]\w*(?:/\w+){0,2})(?:<=\d+)?(?P<array>\[[^\]]*\])?'
    r'\s+(?P<name>[a-z]\w*)\b(?!\s*=)'
)


class Field(NamedTuple):
    """One field: `length` is None for one value, -1 for a sequence, else that of the array."""

    name: str
    type: str
    length: int | None
    comment: str

    @property
    def plain(self) -> bool:
        """A number or bool, or an array of them."""
        return self.type in PRIMITIVES


def parse(definition: str, type_name: str) -> dict[str, list[Field]]:
    """Return the fields of each `package/Name` in a `ros2msg` schema."""
    package, name = type_name.split('/')[0], type_name.split('/')[-1]
    types: dict[str, list[Field]] = {}
    first, *others = re.split(r'^=+$\n^MSG: (\S+)$', definition, flags=re.MULTILINE)
    pairs = [(f'{package}/{name}', first), *zip(others[::2], others[1::2], strict=True)]
    for full, text in pairs:
        full = re.sub('/msg/', '/', full)
        types[full] = [_field(m, full.split('/')[0]) for m in _lines(text)]
    return types


def _lines(text: str) -> Iterator[tuple[re.Match, str]]:
    for line in text.splitlines():
        code, _, comment = line.partition('#')
        match = _FIELD.match(code.strip())
        if match:
            yield match, comment.strip()


def _field(line: tuple[re.Match, str], package: str) -> Field:
    match, comment = line
    kind, array = match['type'], match['array']
    if kind not in PRIMITIVES and kind not in ('string', 'wstring'):
        parts = kind.split('/')
        kind = f'{parts[0] if len(parts) > 1 else package}/{parts[-1]}'
    count = None
    if array is not None:
        inside = array[1:-1]
        count = int(inside) if inside.isdigit() else -1
    return Field(match['name'], kind, count, comment)


@dataclass
class _Layout:
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


class Decoder:
    """Turns messages of one type into a structured array, one row a message."""

    def __init__(self, type_name: str, definition: str):
        self.type = type_name
        self.types = parse(definition, type_name)
        self.root = re.sub('/msg/', '/', type_name)
        self._layouts: list[_Layout] = []

    @cached_property
    def comments(self) -> dict[str, str]:
        """Return the comment of each field, by its dotted name: unit and meaning."""
        found: dict[str, str] = {}

        def walk(kind: str, prefix: str) -> None:
            for field in self.types.get(kind, ()):
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
        return np.dtype([self._slot(f) for f in self.types[kind]] or [('nothing', 'u1')])

    def _slot(self, field: Field) -> tuple:
        if field.length == -1 or field.type in ('string', 'wstring'):
            return field.name, object
        if field.plain:
            base: Any = PRIMITIVES[field.type]
        else:
            base = TIMES.get(field.type) or self.dtype(field.type)
        return (field.name, base) if field.length is None else (field.name, base, field.length)

    def table(self, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
        """Return the columns, in order of the definition; the header becomes stamp and frame_id.

        Strings are `U`, times datetime64[ns]; sequences of one length become (n, length), others
        an object array of arrays.
        """
        columns: dict[str, list] = {}
        rows: list[np.ndarray] = []
        for layout, index, raw in self._groups(messages):
            rows.append(index)
            for name, values in self._message(layout.tree, raw, top=True).items():
                columns.setdefault(name, []).append(values)
        if not rows:
            return self._empty(self.root)
        order = np.argsort(np.concatenate(rows), kind='stable')
        return {name: _joined(parts)[order] for name, parts in columns.items()}

    def _empty(self, kind: str) -> dict[str, np.ndarray]:
        columns = {}
        for field in self.types[kind]:
            if field.type == 'std_msgs/Header' and field.length is None:
                columns.update(self._empty(field.type))
            else:
                slot = np.dtype([self._slot(field)])
                columns[field.name] = np.empty(0, slot)[field.name]
        return columns

    def offset(self, name: str, data: bytes) -> int:
        """Return where the top-level field `name` lies in the message `data`."""
        tree = self._walk(data).tree
        return next(node[1] for field, node in tree.items() if field.name == name)

    def _groups(
        self, messages: Sequence[bytes]
    ) -> Iterator[tuple[_Layout, np.ndarray, np.ndarray]]:
        sizes = np.array([len(m) for m in messages], int)
        if sizes.min(initial=HEADER) < HEADER:
            raise ConfigError(f'{self.type}: a message of {sizes.min()} bytes')
        for size in np.unique(sizes):
            left = np.flatnonzero(sizes == size)
            joined = b''.join([messages[i] for i in left.tolist()])
            raw = np.frombuffer(joined, 'u1').reshape(-1, size)
            if np.any(raw[:, 1] != 1):
                raise ConfigError(f'{self.type}: not little-endian plain CDR, which ROS 2 writes')
            while len(left):
                known = (x for x in self._layouts if x.size == size and x.holds(raw)[0])
                layout = next(known, None)
                if layout is None:
                    layout = self._walk(messages[left[0]])
                    self._layouts = [layout, *self._layouts[:31]]
                same = layout.holds(raw)
                yield layout, left[same], raw[same]
                left, raw = left[~same], raw[~same]

    def _walk(self, data: bytes) -> _Layout:
        lengths: list[tuple[int, int]] = []
        at = HEADER

        def aligned(size: int) -> int:
            nonlocal at
            at += -(at - HEADER) % size
            return at

        def length() -> int:
            nonlocal at
            place = aligned(4)
            (value,) = struct.unpack_from('<I', data, place)
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
            fields = self.types[kind]
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
        return _Layout(len(data), tree, np.array(lengths, int).reshape(-1, 2))

    def _message(self, tree: dict, raw: np.ndarray, top: bool) -> dict[str, np.ndarray]:
        out = {}
        for field, node in tree.items():
            if top and field.type == 'std_msgs/Header' and field.length is None:
                out.update(self._message(node, raw, top))
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
            return (seconds * 1_000_000_000 + nanoseconds).view(TIMES[kind])
        table = np.empty(len(raw), self.dtype(kind))
        for name, values in self._message(node, raw, False).items():
            table[name] = values
        return table


def counter(type_name: str, definition: str, field: str) -> Callable[[bytes], int]:
    """Return a function from a message to 1 + its uint32 `field`, so that 0 stays "not known"."""
    places: dict[bytes, int] = {}  # length of frame_id -> offset: all that moves the field
    decoder = Decoder(type_name, definition)

    def read(data: bytes) -> int:
        key = bytes(data[12:16])
        if key not in places:
            places[key] = decoder.offset(field, data)
        return struct.unpack_from('<I', data, places[key])[0] + 1

    return read


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
