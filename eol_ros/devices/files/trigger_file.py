# SPDX-License-Identifier: Apache-2.0
"""Grain triggers from a file: the CSV that `eol render` takes."""

import csv
import math
from pathlib import Path

import numpy as np

from eol_ros.core.sound.triggers import COLUMNS, TRIGGER
from eol_ros.errors import ConfigError, DeviceMissing

DEFAULTS = {'gain': 1.0, 'rate': 1.0, 'pan': 0.0, 'attack_s': 0.01, 'release_s': 0.1}


def load_triggers(path: str | Path) -> np.ndarray:
    """Return the triggers (n,) TRIGGER of a CSV with the columns `COLUMNS`, and maybe `block`.

    `time_s` counts from the first sample; columns but `time_s` and `grain` may be left out. Raises
    ConfigError with the line where something is not a number.
    """
    try:
        with open(path, newline='', encoding='utf-8-sig') as file:
            return _rows(path, csv.reader(file))
    except OSError as error:
        raise DeviceMissing(f'{path}: {error.strerror}') from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f'{path}: not a CSV of triggers ({error})') from None


def _rows(path, reader) -> np.ndarray:
    header = [name.strip() for name in next(reader, [])]
    missing = [name for name in COLUMNS if name not in header and name not in DEFAULTS]
    if missing:
        raise ConfigError(
            f'{path}:1 no column {missing[0]}; the first line names the columns: '
            + ','.join(COLUMNS)
        )
    found = []
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        row = np.zeros((), TRIGGER)
        row['block'] = -1
        for name, value in DEFAULTS.items():
            row[name] = value
        for name, cell in zip(header, cells, strict=False):
            if name not in (TRIGGER.names or ()):
                continue
            try:
                value = float(cell)
                row[name] = int(value) if name in ('grain', 'block') else value
            except (ValueError, OverflowError):
                raise ConfigError(
                    f'{path}:{reader.line_num} {name} is {cell!r}, not a number'
                ) from None
        if not math.isfinite(row['time_s']) or len(cells) < len(header):
            raise ConfigError(f'{path}:{reader.line_num} the row has no time or is too short')
        found.append(row)
    return np.array(found, TRIGGER) if found else np.zeros(0, TRIGGER)
