# SPDX-License-Identifier: Apache-2.0
"""A message type as a row of a table, whatever carries it.

What becomes of core's result, a message of rclpy and a row of a bag's table have the same fields in
the same precision, so what is computed offline can be compared with what was recorded. A row is a
named tuple; its times are whole nanoseconds.
"""

from array import array
from collections import namedtuple
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from eol_ros.streams.cdr import NS

M = TypeVar('M')


def seconds(stamp: Any) -> float:
    """Return a stamp message in seconds."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


class Record:
    """The rows of one message type, and how they are carried.

    dtype: its fields in order of the definition, but `stamp` for the header; times are M8[ns],
    strings and sequences are objects. frame_id: what the header says.
    """

    def __init__(self, type_name: str, dtype: np.dtype, frame_id: str = ''):
        self.type, self.dtype, self.frame_id = type_name, dtype, frame_id
        names: tuple[str, ...] = dtype.names or ()
        # mypy wants a literal name; this one is read from the definition
        self.row: Any = namedtuple(type_name.split('/')[-1], names)  # type: ignore[misc]
        self._kinds = [(name, dtype[name].kind) for name in names]

    def rows(self, rows: Sequence[Any]) -> np.ndarray:
        """Return rows as one array, (n,) of dtype."""
        return np.array(rows, self.dtype) if rows else np.empty(0, self.dtype)

    def each(self, table: Mapping[str, np.ndarray] | np.ndarray) -> Iterator[Any]:
        """Yield the rows of an array with the fields of dtype, such as a bag's table."""
        columns = (
            table[name].astype('i8').tolist() if kind == 'M' else table[name].tolist()
            for name, kind in self._kinds
        )
        return map(self.row._make, zip(*columns, strict=True))

    def fill(self, message: M, row: Any, frame_prefix: str = '') -> M:
        """Write a row into a new message, and return the message."""
        header = message.header  # type: ignore[attr-defined]  # of any class with these fields
        header.frame_id = self.frame_id and frame_prefix + self.frame_id
        for (name, kind), value in zip(self._kinds, row, strict=True):
            if kind == 'M':
                stamp = header.stamp if name == 'stamp' else getattr(message, name)
                stamp.sec, stamp.nanosec = divmod(value, NS)
                continue
            if kind == 'O' and isinstance(value, np.ndarray):
                value = array(value.dtype.char, value.tobytes())  # others it looks at one by one
            setattr(message, name, value)
        return message

    def take(self, message: Any) -> Any:
        """Return the row of a message."""
        values = []
        for name, kind in self._kinds:
            value = message.header.stamp if name == 'stamp' else getattr(message, name)
            if kind == 'M':
                value = value.sec * NS + value.nanosec
            values.append(value)
        return self.row._make(values)
