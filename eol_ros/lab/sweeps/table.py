# SPDX-License-Identifier: Apache-2.0
"""The table of a sweep: a CSV file that is resumed and added to, and FILE.json about it.

Rows are appended as they are computed, so that a power cut costs half a minute. In the end they are
sorted by their parameters: the same rows make the same file, with any worker and at any time.
Floats are written so that they come back to the bit.
"""

import csv
import dataclasses
import fcntl
import io
import json
import os
import sys
import time
import typing
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from eol_ros.disk import DISK
from eol_ros.errors import ConfigError, UsageError, writing
from eol_ros.lab.science import sweep

FLUSH_S = 30.0
KEY = 'task'
Row = dict[str, Any]


class Table:
    """Rows of one model; `has` says which tasks are there. Close it, or lose nothing but order."""

    def __init__(self, path: str | Path, model: str, made_by: dict[str, str]) -> None:
        self.path = Path(path)
        if self.path.suffix != '.csv':
            raise UsageError(f'--output {path}: the name must end in .csv')
        self._columns = columns(model)
        self._rows: dict[str, list[str]] = {}  # by task, in the order of the file
        self._flushed_s = time.monotonic()
        with writing(self.path, '--output'):
            self._file = self.path.open('a+', newline='', encoding='utf-8')  # locked until `close`
        try:
            self._lock()
            self._begin(model, made_by)
        except BaseException:
            self._file.close()
            raise

    def has(self, key: str) -> bool:
        """Whether this task is in the table."""
        return key in self._rows

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, rows: Sequence[Row]) -> None:
        """Take rows in, and force them to the disk where it was long ago."""
        new = {row[KEY]: [_text(row[name]) for name in self._columns] for row in rows}
        self._write(new.values())
        self._rows |= new
        if time.monotonic() >= self._flushed_s + FLUSH_S:
            self._flush()

    def close(self) -> None:
        """Sort the rows, and let go of the file."""
        try:
            self._flush()
            rows = sorted(self._rows.values(), key=self._order)
            if rows != [*self._rows.values()]:  # by several workers, or in several runs
                with (
                    writing(self.path, '--output'), DISK.replacing(self.path) as part,
                    open(part, 'w', newline='', encoding='utf-8') as file,
                ):  # fmt: skip
                    csv.writer(file, lineterminator='\n').writerows([[*self._columns], *rows])
        finally:
            self._file.close()

    def _lock(self) -> None:
        """Refuse a file that another sweep writes, or replaced between our opening and locking."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            ours = os.path.samestat(os.fstat(self._file.fileno()), self.path.stat())
        except OSError:
            ours = False
        if not ours:
            raise ConfigError(f'--output {self.path}: another sweep writes to it')

    def _begin(self, model: str, made_by: dict[str, str]) -> None:
        """Read what is there without a last row that is not whole: the sweep before was killed."""
        there = self.path.read_bytes()
        beside = self.path.with_name(self.path.name + '.json')
        if there:
            self._check(beside, model, made_by)
        else:
            about = {
                'model': model, 'columns': list(self._columns), 'made_by': made_by,
                'units': {name: c.unit for name, c in self._columns.items()},
                'descriptions': {name: c.text for name, c in self._columns.items()},
            }  # fmt: skip
            with writing(beside, '--output'):
                DISK.write(beside, json.dumps(about, indent=2) + '\n')
        whole = there[: there.rfind(b'\n') + 1]
        self._file.truncate(len(whole))
        if whole:
            self._rows = self._parsed(whole)
        else:
            self._write([[*self._columns]])
            self._flush()

    def _check(self, beside: Path, model: str, made_by: dict[str, str]) -> None:
        """Refuse rows of another model, or of another version."""
        try:
            about = json.loads(beside.read_text(encoding='utf-8'))
            found, there = about['model'], about['made_by']
        except (OSError, ValueError, KeyError, TypeError):
            raise ConfigError(
                f'--output {self.path}: not the table of a sweep: {beside.name}, which '
                'describes it, cannot be read; give another file'
            ) from None
        if (found, about['columns']) != (model, list(self._columns)):
            other = ' with other columns' if found == model else ''
            raise ConfigError(
                f'--output {self.path}: the table of a sweep over {found}{other}; give another file'
            )
        for name, value in made_by.items():
            if there.get(name) != value:
                raise ConfigError(
                    f'--output {self.path}: computed with {name} {there.get(name)}, here is '
                    f'{name} {value}: their rows do not belong together; give another file'
                )

    def _parsed(self, whole: bytes) -> dict[str, list[str]]:
        csv.field_size_limit(sys.maxsize)  # a list of many areas is one field
        try:
            rows = list(csv.reader(io.StringIO(whole.decode(), newline=''), strict=True))[1:]
            if any(len(row) != len(self._columns) for row in rows):
                raise ValueError('a row has another number of columns')
        except (ValueError, csv.Error) as error:
            raise ConfigError(
                f'--output {self.path}: damaged ({error}); give another file'
            ) from None
        at = list(self._columns).index(KEY)
        return {row[at]: row for row in rows}

    def _order(self, row: list[str]) -> tuple:
        """Return what a row is sorted by: its parameters, those without a value first."""
        return tuple(
            (text != '', _value(text, column.kind) or 0) if column.kind is not str else (True, text)
            for text, (name, column) in zip(row, self._columns.items(), strict=True)
            if name not in sweep.RESULTS
        )

    def _write(self, rows: Iterable[list[str]]) -> None:
        with writing(self.path, '--output'):
            csv.writer(self._file, lineterminator='\n').writerows(rows)

    def _flush(self) -> None:
        self._flushed_s = time.monotonic()
        with writing(self.path, '--output'):
            self._file.flush()
            os.fsync(self._file.fileno())


@dataclasses.dataclass(frozen=True)
class Column:
    """Of the table; `kind` is int, float, bool or str, and any value may be None."""

    kind: type
    unit: str
    text: str


def columns(model: str) -> dict[str, Column]:
    """Return the columns of a model's table: its parameters, what is most its own first; results.

    Rows are sorted by the parameters, in this order.
    """
    found: dict[str, Column] = {}
    parents = [c for c in sweep.MODELS[model].__mro__ if dataclasses.is_dataclass(c)]
    for kind in (*parents, sweep.Result):
        for field in dataclasses.fields(kind):
            unit, text = (field.metadata.get(name, '') for name in ('unit', 'doc'))
            if field.name in kind.__annotations__:
                found[field.name] = Column(_plain_kind(field.type), unit, text)
    return found | {KEY: Column(str, '', 'names the task: a digest of model and parameters')}


def row_of(key: str, parameters: Row, result: sweep.Result) -> Row:
    """Return the row of a task."""
    return {**parameters, **vars(result), KEY: key}


def _plain_kind(kind: Any) -> type:
    """Return int of `int | None`."""
    return next(k for k in (*typing.get_args(kind), kind) if k is not type(None))


def _text(value: Any) -> str:
    if value is None:
        return ''
    return str(value).lower() if isinstance(value, bool) else str(value)


def _value(text: str, kind: type) -> Any:
    if kind is str:
        return text
    if not text:
        return None
    return text == 'true' if kind is bool else kind(text)
