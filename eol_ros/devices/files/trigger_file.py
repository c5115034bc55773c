# SPDX-License-Identifier: Apache-2.0
"""Grain triggers from a file: the CSV that `eol render` takes."""

from pathlib import Path

import numpy as np

from eol_ros.core.sound.triggers import COLUMNS, TRIGGER
from eol_ros.devices.files import text_table
from eol_ros.errors import ConfigError

MOST_S = 86400.0  # of a file of triggers: a day
CALM_S = 600.0  # between triggers on average (chosen): bounds the length by the size of the file
DEFAULTS = {'gain': 1.0, 'rate': 1.0, 'pan': 0.0, 'attack_s': 0.01, 'release_s': 0.1}


def load_triggers(path: str | Path) -> np.ndarray:
    """Return the triggers (n,) TRIGGER of a CSV with the columns `COLUMNS`, and maybe `block`.

    `time_s` counts from the first sample; columns but `time_s` and `grain` may be left out. Raises
    ConfigError with the line where something is not a number.
    """
    found = []
    for line in text_table.rows(path, COLUMNS, ('time_s', 'grain'), header=True):
        row = np.zeros((), TRIGGER)
        row['block'] = -1
        for name in (*COLUMNS, 'block'):
            cell = line.cells.get(name, '').lower()
            if name == 'time_s':
                row[name] = line.number(name, low=-MOST_S, high=MOST_S, hint=_hint(cell))
            elif cell in ('nan', 'inf', '-inf') and name in DEFAULTS:  # dropped, and counted
                row[name] = float(cell)
            elif cell or name in ('grain', *DEFAULTS):
                row[name] = _value(line, name)
        found.append(row)
    if not found:
        raise ConfigError(f'{path}: no triggers in it')
    times_s = np.array([row['time_s'] for row in found])
    if times_s.max() > CALM_S * (1 + len(found)):
        raise ConfigError(
            f'{path}: {len(found)} triggers in {times_s.max():g} s; are the times milliseconds? '
            'They count in s from the first sample'
        )
    return np.array(found, TRIGGER)


def _value(line: text_table.Row, name: str) -> float:
    kind = TRIGGER[name]
    if kind.kind != 'i':
        return line.number(name, DEFAULTS.get(name))
    limits = np.iinfo(kind)
    value = line.number(name, None, float(limits.min), float(limits.max))
    if value != int(value):
        raise line.wrong(name, f'{name} {value:g} is not a whole number')
    return int(value)


def _hint(cell: str) -> str:
    epoch = text_table.number(cell) > 1e8
    return ': an epoch time? Count in s from the first sample' if epoch else ''
