# SPDX-License-Identifier: Apache-2.0
"""What grains are described by as a table of numbers, for other programs, and taken back."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from eol_ros.core.sound.corpus import Corpus, widened
from eol_ros.devices.corpus.corpus_file import FURTHER
from eol_ros.errors import ConfigError
from eol_ros.settings import DESCRIPTORS

FIXED = ('start_s', 'duration_s')  # that a sound was cut there no other program can change
CHANGEABLE = (*(name for name in DESCRIPTORS if name not in FIXED), *FURTHER, 'x', 'y')


def table_of(corpus: Corpus) -> tuple[list[str], np.ndarray, np.ndarray]:
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


def check_columns(path: Path, names: list[str]) -> None:
    """Raise ConfigError where one of the columns of `path` is nothing that grains have."""
    for name in names:
        if name not in (*CHANGEABLE, *FIXED):
            raise ConfigError(f'{path}: {name}: no such column; there are {" ".join(CHANGEABLE)}')


def with_values(corpus: Corpus, names: list[str], rows: np.ndarray, table: np.ndarray) -> Corpus:
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
