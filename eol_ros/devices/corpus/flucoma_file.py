# SPDX-License-Identifier: Apache-2.0
"""Grains as a FluCoMa DataSet, and back: what FluidDataSet writes and reads in Max, Pd and SC.

A DataSet is JSON: {"cols": m, "data": {"identifier": [m numbers], ...}}. The identifier of a grain
is its number; a DataSet has no names of columns, so these are in a file of ours beside it.
"""

import json
import math
from pathlib import Path

import numpy as np

from eol_ros.core.sound.corpus import Corpus
from eol_ros.devices.corpus.corpus_file import MOST_CORPUS, write_text
from eol_ros.devices.corpus.exchange import check_columns, table_of, with_values
from eol_ros.disk import content
from eol_ros.errors import ConfigError, DeviceMissing


def save(corpus: Corpus, path: Path) -> list[str]:
    """Write the placed grains as a DataSet; return what its columns are.

    A FluidDataSet holds no NaN: a pitch that is missing is 0 Hz, anything else its mean.
    """
    names, rows, table = table_of(corpus)
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
    check_columns(path, names)
    return with_values(corpus, names, *_points(path, data, cols, len(corpus)))


def _beside(path: Path) -> Path:
    return path.with_name(f'{path.stem}.columns.json')


def _read(path: Path) -> tuple[dict, int]:
    try:
        found = json.loads(content(path, MOST_CORPUS))
        data, cols = found['data'], found['cols']
    except FileNotFoundError:
        raise DeviceMissing(f'{path}: no such file') from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigError(f'{path}: not a FluCoMa DataSet ({error!r})') from None
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
