# SPDX-License-Identifier: Apache-2.0
"""All grains with their places: eol_msgs/Corpus."""

from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from eol_ros.settings import DESCRIPTORS
from eol_ros.streams.record import Record

if TYPE_CHECKING:
    from eol_ros.core.sound.corpus import Corpus

DTYPE = np.dtype(
    [('stamp', 'M8[ns]'), ('name', object), ('digest', object), ('sample_rate', 'u4'),
     ('files', object), ('file', object), ('start', object), ('duration', object), ('x', object),
     ('y', object), ('x_name', object), ('y_name', object), ('bounds', object), ('radius', 'f4'),
     ('descriptors', object), ('values', object)]
)  # fmt: skip
MOVED = 'moved_by_hand'  # 1 or 0, among the values where somebody has moved a grain
RECORD = Record('eol_msgs/msg/Corpus', DTYPE, 'table')


def title(corpus: 'Corpus') -> str:
    """Return what people call a corpus: its first sound, and how many more there are."""
    name, more = PurePath(corpus.sources[0].path).name, len(corpus.sources) - 1
    return f'{name} + {more}' if more else name


def of(
    stamp_ns: int,
    corpus: 'Corpus',
    bounds: Sequence[float],
    radius_m: float,
    moved: Sequence[int] = (),
) -> Any:
    """Return the row of a corpus over `bounds`: x min, y min, x max, y max in metres.

    `moved`: the grains that were moved by hand; they are told as if it were a descriptor.
    """
    grains = corpus.grains
    names: tuple[str, ...] = DESCRIPTORS
    values = np.stack([grains[name] for name in names], axis=1)
    if moved:
        by_hand = np.isin(np.arange(len(grains)), moved)[:, None]
        names, values = (*names, MOVED), np.hstack([values, by_hand])
    return RECORD.row(
        stamp_ns, title(corpus), corpus.digest, corpus.sample_rate,
        [source.path for source in corpus.sources], grains['file'].astype('u4'),
        grains['start_s'].copy(), grains['duration_s'].copy(), grains['x'].astype('f4'),
        grains['y'].astype('f4'), corpus.x_name, corpus.y_name, np.array(bounds, 'f8'), radius_m,
        list(names), values.astype('f4').ravel(),
    )  # fmt: skip


def to_core(row: Any) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Return the files, and per grain its file (g,), start (g,) and duration (g,) in seconds.

    row: of DTYPE, or a message.
    """
    return (
        [str(name) for name in row.files],
        np.array(row.file, np.int64),
        np.array(row.start, float),
        np.array(row.duration, float),
    )


def places(row: Any) -> np.ndarray:
    """Return where each grain lies on the table, (g, 2) m; NaN for those without a place.

    row: of DTYPE, or a message.
    """
    if len(row.bounds) != 4 or not len(row.file) == len(row.x) == len(row.y):
        return np.full((len(row.file), 2), np.nan)  # of somebody who places nothing
    left, low, right, high = row.bounds
    x = left + np.array(row.x, float) * (right - left)
    y = low + np.array(row.y, float) * (high - low)
    return np.stack([x, y], axis=1)


def values(row: Any) -> dict[str, np.ndarray]:
    """Return what each grain is described by, (g,) by name; NaN where there is nothing.

    row: of DTYPE, or a message.
    """
    names = list(row.descriptors)
    if len(row.values) != len(names) * len(row.file):
        return {}
    table = np.array(row.values, float).reshape(-1, len(names) or 1)
    return dict(zip(names, table.T, strict=False))


def to_json(message: Any) -> dict[str, Any]:
    """Return a Corpus message as pages read it, its values as one list per descriptor."""
    names = list(message.descriptors)
    count = len(names)
    columns = [list(message.values[i::count]) for i in range(count)]
    by_hand = columns.pop(names.index(MOVED)) if MOVED in names else []
    return {
        'name': message.name, 'digest': message.digest, 'radius': message.radius,
        'x': list(message.x), 'y': list(message.y), 'x_name': message.x_name,
        'y_name': message.y_name, 'start': list(message.start), 'duration': list(message.duration),
        'files': [PurePath(path).stem for path in message.files], 'file': list(message.file),
        'folders': [PurePath(path).parent.name for path in message.files],
        'descriptors': [name for name in names if name != MOVED], 'values': columns,
        'bounds': list(message.bounds),
        'moved': [grain for grain, yes in enumerate(by_hand) if yes],
    }  # fmt: skip
