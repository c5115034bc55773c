# SPDX-License-Identifier: Apache-2.0
"""Grains as a FluCoMa DataSet, and back: what FluidDataSet writes and reads in Max, Pd and SC.

A DataSet is JSON: {"cols": m, "data": {"identifier": [m numbers], ...}}. The identifier of a grain
is its number; a DataSet has no names of columns, so these are in a file of ours beside it.
"""

import json
import math
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from eol_ros.core.sound.corpus import Corpus, widened
from eol_ros.devices.corpus.corpus_file import FURTHER, MOST_CORPUS, write_text
from eol_ros.disk import content, said
from eol_ros.errors import ConfigError, DeviceMissing
from eol_ros.settings import DESCRIPTORS

FIXED = ('start_s', 'duration_s')  # that a sound was cut there no other program can change
CHANGEABLE = (*(name for name in DESCRIPTORS if name not in FIXED), *FURTHER, 'x', 'y')


def save(corpus: Corpus, path: Path) -> list[str]:
    """Write the placed grains as a DataSet; return what its columns are.

    A FluidDataSet holds no NaN: a pitch that is missing is 0 Hz, anything else its mean.
    """
    names, rows, table = _table_of(corpus)
    lines = [f'"{i}": {json.dumps(row)}' for i, row in zip(rows, table.tolist(), strict=True)]
    body = ',\n'.join(lines)
    write_text(path, f'{{"cols": {len(names)}, "data": {{\n{body}\n}}}}\n')
    write_text(_beside(path), json.dumps({'columns': names}) + '\n')
    return names


def apply(corpus: Corpus, path: Path, names: list[str]) -> Corpus:
    """Return `corpus` with the values of a DataSet whose columns are `names`.

    Without names they are those that `save` wrote beside it, or x and y where there are two. Points
    are taken by the numbers of their grains; x and y that leave 0..1 are scaled into it, each from
    its least to its greatest. Grains that it does not have keep what they have.

    Raises
    ------
    ConfigError
        The file is no DataSet, its points are no grains, or its columns no descriptors.
    """
    data, cols = _read(path)
    names = names or _named(path, cols)
    if len(names) != cols:
        raise ConfigError(f'{path}: has {cols} columns; {len(names)} are named: {" ".join(names)}')
    _check_columns(path, names)
    return _with_values(corpus, names, *_points(path, data, cols, len(corpus)))


def _beside(path: Path) -> Path:
    return path.with_name(f'{path.stem}.columns.json')


def _read(path: Path) -> tuple[dict, int]:
    try:
        found = json.loads(content(path, MOST_CORPUS))
        data, cols = found['data'], found['cols']
    except FileNotFoundError:
        raise DeviceMissing(f'{path}: no such file') from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigError(f'{path}: not a FluCoMa DataSet ({said(error)})') from None
    if not isinstance(data, dict) or type(cols) is not int or not data:
        raise ConfigError(f'{path}: not a FluCoMa DataSet (no "cols" and points in "data")')
    return data, cols


def _named(path: Path, cols: int) -> list[str]:
    try:
        names = json.loads(content(_beside(path)))['columns']
        if isinstance(names, list) and len(names) == cols:
            return [str(name) for name in names]
    except (OSError, ValueError, KeyError, TypeError):
        pass  # of another program
    if cols == 2:
        return ['x', 'y']
    raise ConfigError(f'{path}: has {cols} columns; name them with --columns, such as x,y')


def _points(path: Path, data: dict, cols: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rows, table = [], []
    for identifier, values in data.items():
        number = int(identifier) if identifier.isdecimal() else count
        if number >= count:
            raise ConfigError(
                f'{path}: point {identifier!r} is no grain: there are 0 to {count - 1}'
            )
        good = isinstance(values, list) and len(values) == cols
        if not good or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
            raise ConfigError(f'{path}: point {identifier!r} has not {cols} numbers')
        rows.append(number)
        table.append([float(v) for v in values])
    return np.array(rows), np.array(table)


def _table_of(corpus: Corpus) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return the columns, and of the placed grains their numbers (n,) and values (n, columns).

    Others take no NaN: a pitch that is missing is 0 Hz, anything else its mean.
    """
    names = [*FIXED, *(n for n in corpus.descriptors if n not in FIXED), 'x', 'y']
    rows = np.flatnonzero(corpus.placed)
    columns = []
    for name in names:
        values = corpus.grains[name][rows]
        known = np.isfinite(values)
        middle = 0.0 if name == 'pitch_hz' or not known.any() else float(values[known].mean())
        columns.append(np.where(known, values, middle))
    return names, rows, np.stack(columns, axis=1)


def _check_columns(path: Path, names: list[str]) -> None:
    """Raise ConfigError where one of the columns of `path` is nothing that grains have."""
    for name in names:
        if name not in (*CHANGEABLE, *FIXED):
            raise ConfigError(f'{path}: {name}: no such column; there are {" ".join(CHANGEABLE)}')


def _with_values(corpus: Corpus, names: list[str], rows: np.ndarray, table: np.ndarray) -> Corpus:
    """Return `corpus` with `table` (n, columns) as the values of its grains `rows` (n,).

    x and y that leave 0..1 are scaled into it, each from its least to its greatest. Grains that are
    not in it keep what they have.
    """
    grains = widened(corpus.grains, names)
    for name, values in zip(names, table.T, strict=True):
        if name in ('x', 'y') and not (values.min() >= 0 and values.max() <= 1):
            low, high = values.min(), values.max()
            values = (values - low) / (high - low) if high > low else np.full(len(values), 0.5)
        if name not in FIXED:
            grains[name][rows] = values
    key = sha256(f'{corpus.digest} {names} '.encode() + table.tobytes() + rows.tobytes())
    return replace(corpus, grains=grains, digest=key.hexdigest())
