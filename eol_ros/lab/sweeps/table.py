# SPDX-License-Identifier: Apache-2.0
"""The table of a sweep: a Parquet or CSV file that is resumed and added to.

While a sweep runs, rows go to small files in `FILE.parts`, each there as a whole or not at all, so
that a power cut costs half a minute. At its end they are merged into FILE, sorted by their
parameters: the same rows make the same file, with any worker and at any time. Memory holds
`BATCH_ROWS` of each file at a time.
"""

import csv
import dataclasses
import fcntl
import heapq
import itertools
import json
import os
import time
import typing
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from eol_ros.errors import ConfigError, UsageError, pip_install, writing
from eol_ros.lab.science import sweep

FLUSH_ROWS, FLUSH_S = 5000, 30.0
BATCH_ROWS = 256  # of each file, while files are merged
ROW_GROUP = 10_000
MOST_PARTS = 64  # open at the same time; beyond, parts are merged into one
KEY = 'task'
Row = dict[str, Any]


class Table:
    """Rows of one model; `has` says which tasks are there. Close it, or lose nothing but order."""

    def __init__(self, path: str | Path, model: str, made_by: dict[str, str]) -> None:
        self.path = Path(path)
        self.model, self._made_by = model, made_by
        self._columns = columns(model)
        self._format = _format_of(self.path)
        self._parts = self.path.with_name(self.path.name + '.parts')
        self._rows: list[Row] = []
        self._flushed_s = time.monotonic()
        self._number = 0
        with writing(self.path, '--output'):
            self._parts.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self._parts, os.O_RDONLY)  # held until `close`
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._lock)
            raise ConfigError(f'--output {self.path}: another sweep writes to it') from None
        try:
            self._keys = self._known()
        except BaseException:
            self._unlock()
            raise

    def has(self, key: str) -> bool:
        """Whether this task is in the table."""
        return bytes.fromhex(key) in self._keys

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, rows: Sequence[Row]) -> None:
        """Take rows in, and write them when there are many or it was long ago."""
        self._rows += rows
        self._keys.update(bytes.fromhex(row[KEY]) for row in rows)
        if len(self._rows) >= FLUSH_ROWS or time.monotonic() >= self._flushed_s + FLUSH_S:
            self.flush()

    def flush(self) -> None:
        """Write all rows that are not on the disk yet."""
        self._flushed_s = time.monotonic()
        if not self._rows:
            return
        if len(parts := self._part_files()) >= MOST_PARTS:
            self._merge(self._part(), parts, parts)
        self._write(self._part(), iter(sorted(self._rows, key=self._order)))
        self._rows = []

    def close(self) -> None:
        """Merge all into the file."""
        try:
            self.flush()
            if parts := self._part_files():
                whole = [self.path] if self.path.exists() else []
                self._merge(self.path, [*whole, *parts], parts)
        finally:
            self._unlock()

    def _unlock(self) -> None:
        if not self._part_files():
            for half in self._parts.glob('.*'):  # of a sweep that was killed
                half.unlink()
            self._parts.rmdir()
        os.close(self._lock)

    def _known(self) -> set[bytes]:
        keys: set[bytes] = set()
        whole = [self.path] if self.path.exists() else []
        for file in (*whole, *self._part_files()):
            self._check(file)
            only = {KEY: self._columns[KEY]}
            keys.update(bytes.fromhex(row[KEY]) for row in self._format.rows(file, only))
        return keys

    def _check(self, file: Path) -> None:
        """Refuse rows of another model, or that another version has computed."""
        about = self._format.about(file)
        if about.get('model') != self.model or about.get('columns') != list(self._columns):
            found = about.get('model')
            what = f'the table of a sweep over {found}' if found else 'not the table of a sweep'
            if found == self.model:
                what = f'a table of {found} with other columns'
            raise ConfigError(f'--output {self.path}: {what}; give another file')
        for name, value in self._made_by.items():
            there = about['made_by'].get(name)
            if there != value:
                raise ConfigError(
                    f'--output {self.path}: computed with {name} {there}, here is {name} {value}: '
                    'their rows do not belong together; give another file'
                )

    def _merge(self, path: Path, files: list[Path], parts: list[Path]) -> None:
        rows = [self._format.rows(file, self._columns) for file in files]
        self._write(path, _merged(rows, self._order))
        for file in (file for part in parts for file in self._format.files(part)):
            file.unlink(missing_ok=True)

    def _order(self, row: Row) -> tuple:
        return tuple(
            (row[name] is not None, row[name] if row[name] is not None else 0)
            for name in self._columns
            if name not in sweep.RESULTS
        )

    def _part_files(self) -> list[Path]:
        return sorted(self._parts.glob(f'[0-9]*{self.path.suffix}'))

    def _part(self) -> Path:
        while True:
            self._number += 1
            path = self._parts / f'{self._number:06d}{self.path.suffix}'
            if not path.exists():
                return path

    def _write(self, path: Path, rows: Iterator[Row]) -> None:
        about = {
            'model': self.model, 'columns': list(self._columns), 'made_by': self._made_by,
            'units': {name: c.unit for name, c in self._columns.items()},
            'descriptions': {name: c.text for name, c in self._columns.items()},
        }  # fmt: skip
        half = self._parts / f'.{path.name}'
        with writing(path, '--output'):
            self._format.write(half, rows, self._columns, about)
            with open(half, 'rb') as file:
                os.fsync(file.fileno())
            for made, whole in zip(*map(self._format.files, (half, path)), strict=True):
                made.replace(whole)


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


def _merged(files: list[Iterator[Row]], order: Callable[[Row], tuple]) -> Iterator[Row]:
    """Yield the rows of sorted files, sorted; of rows of one task the first."""
    last = None
    for row in heapq.merge(*files, key=order):
        if row[KEY] != last:
            last = row[KEY]
            yield row


class Parquet:
    """One file that carries its units and its origin in its own metadata."""

    @staticmethod
    def write(path: Path, rows: Iterator[Row], columns: dict[str, Column], about: Row) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        types = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}
        fields = [
            pa.field(n, types[c.kind], metadata={'unit': c.unit, 'description': c.text})
            for n, c in columns.items()
        ]
        schema = pa.schema(fields, metadata={'eol_ros': json.dumps(about)})
        with open(path, 'wb') as file, pq.ParquetWriter(file, schema) as writer:  # of any name
            while some := list(itertools.islice(rows, ROW_GROUP)):
                writer.write_table(pa.Table.from_pylist(some, schema))

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path]

    @staticmethod
    def rows(path: Path, columns: dict[str, Column]) -> Iterator[Row]:
        import pyarrow.parquet as pq

        with open(path, 'rb') as raw, pq.ParquetFile(raw) as file:
            for batch in file.iter_batches(BATCH_ROWS, columns=list(columns)):
                yield from batch.to_pylist()

    @staticmethod
    def about(path: Path) -> Row:
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            with open(path, 'rb') as file:
                metadata = pq.read_schema(file).metadata or {}
        except (OSError, pa.ArrowInvalid) as error:
            raise ConfigError(f'{path}: not a Parquet file ({error})') from None
        return dict(json.loads(metadata.get(b'eol_ros', b'{}')))


class Csv:
    """A CSV file, its floats written so that they come back to the bit, and FILE.json about it."""

    @staticmethod
    def write(path: Path, rows: Iterator[Row], columns: dict[str, Column], about: Row) -> None:
        with open(path, 'w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(columns)
            for row in rows:
                writer.writerow([_text(row[name]) for name in columns])
        Csv.files(path)[0].write_text(json.dumps(about, indent=2) + '\n')

    @staticmethod
    def files(path: Path) -> list[Path]:
        return [path.with_name(path.name + '.json'), path]

    @staticmethod
    def rows(path: Path, columns: dict[str, Column]) -> Iterator[Row]:
        with open(path, newline='', encoding='utf-8') as file:
            for row in csv.DictReader(file):
                yield {n: _value(row[n], c.kind) for n, c in columns.items()}

    @staticmethod
    def about(path: Path) -> Row:
        beside = Csv.files(path)[0]
        try:
            return dict(json.loads(beside.read_text()))
        except OSError:
            raise ConfigError(f'{path}: without {beside.name}, which says what it is') from None
        except ValueError:
            raise ConfigError(f'{beside}: not JSON') from None


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


def _format_of(path: Path) -> type[Parquet] | type[Csv]:
    if path.suffix == '.csv':
        return Csv
    if path.suffix != '.parquet':
        raise UsageError(f'--output {path}: a name that ends in .parquet or .csv is wanted')
    if not has_parquet():
        raise UsageError(
            f'--output {path}: Parquet needs pyarrow: {pip_install("pyarrow")}, or give a name '
            'that ends in .csv'
        )
    return Parquet


def has_parquet() -> bool:
    """Whether pyarrow is installed."""
    import importlib.util

    return importlib.util.find_spec('pyarrow') is not None
