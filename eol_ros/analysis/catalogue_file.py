# SPDX-License-Identifier: Apache-2.0
"""The catalogue of cascades as a table that other programs read."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.physics.builders import GRAVITY
from eol_ros.devices.files.names import shown
from eol_ros.settings import TwinSettings

# name: type, unit, what it is
COLUMNS = {
    'onset_ns': ('i8', 'ns', 'onset of the first slip, since 1970-01-01 UTC'),
    'duration_s': ('f8', 's', 'from the first onset to the last rest'),
    'nucleus': ('i8', '', 'block that slipped first: row * columns of the table + column'),
    'x_m': ('f8', 'm', 'place of the nucleus at rest, to the right, from the middle of the table'),
    'y_m': ('f8', 'm', 'the same, away from the viewer'),
    'area': ('i8', 'blocks', 'distinct blocks that slipped'),
    'size': ('i8', '', 'slips'),
    'potency_m': ('f8', 'm', 'distances of all slips, summed'),
    'moment_nm': ('f8', 'N m', 'stiffness of a spring * pitch along a row * potency_m'),
    'energy_j': ('f8', 'J', 'that friction took: mu_kinetic * block_kg * g * potency_m'),
    'bag': ('U64', '', 'recording that it stands in'),
}


def of(bag: Bag, cascades: Table | None, measured: TwinSettings | None = None) -> np.ndarray:
    """Return the cascades of a bag as rows of COLUMNS, in the order in which they were told.

    The law of their areas is asked in that order, which is the one that a live panel knows.
    measured: springs, friction and mass of the table; None: as the bag's twin has them. Without
    them moments and energies are nan. Cascades whose nucleus is no block are not among the rows.
    """
    kinds = [(name, kind) for name, (kind, _, _) in COLUMNS.items()]
    if cascades is None:
        return np.zeros(0, kinds)
    table = recorded_table(bag)
    cascades = cascades[cascades['nucleus'] < table.cells]
    rows = np.zeros(len(cascades), kinds)
    place = table.rest[cascades['nucleus']]
    for name, values in (
        ('onset_ns', cascades['onset'].astype('i8')), ('duration_s', cascades['duration']),
        ('nucleus', cascades['nucleus']), ('x_m', place[:, 0]), ('y_m', place[:, 1]),
        ('area', cascades['area']), ('size', cascades['size']),
        ('potency_m', cascades['distance']), ('bag', shown(bag.path.name)),
    ):  # fmt: skip
        rows[name] = values
    made = measured or recorded_settings(bag, 'twin')
    rows['moment_nm'] = rows['energy_j'] = np.nan
    if made is not None:
        rows['moment_nm'] = made.stiffness * table.pitch_m[0] * rows['potency_m']
        rows['energy_j'] = made.mu_kinetic * made.block_kg * GRAVITY * rows['potency_m']
    return rows


def left_out(cascades: Table | None, rows: np.ndarray) -> list[str]:
    """Return what is to be said of cascades that are not among the rows, nothing where all are."""
    count = 0 if cascades is None else len(cascades)
    if count == len(rows):
        return []
    return [
        f'catalogue: {count - len(rows)} of {count} cascades left out: they begin at no block of'
        ' the table, so the recording is damaged or does not say its table'
    ]


def energy_sentence(rows: np.ndarray, made: TwinSettings | None) -> str:
    """Return what friction took, and the greatest moment, for people."""
    if made is None:
        return (
            'energy and moment: not known without springs, friction and mass of this table: '
            'eol measure springs and friction, then --measured SCENE'
        )
    if not len(rows):
        return 'energy and moment: no cascades'
    errors = made.stiffness_error, made.mu_kinetic_error
    k, mu = (f' +- {e:g}' if e else ' (not measured)' for e in errors)
    return (
        f'energy: friction took {rows["energy_j"].sum():.3g} J in all cascades, at most '
        f'{rows["energy_j"].max():.3g} J in one; moment at most {rows["moment_nm"].max():.3g} N m '
        f'(spring {made.stiffness:g} N/m{k}, mu_k {made.mu_kinetic:g}{mu}, {made.block_kg:g} kg)'
    )


def write(out: Path, rows: np.ndarray, provenance: dict[str, Any]) -> None:
    """Write catalogue.csv, by onset, and catalogue.json, which says what its columns are."""
    about = {
        'provenance': provenance,
        'columns': {n: {'unit': unit, 'is': text} for n, (_, unit, text) in COLUMNS.items()},
    }
    (out / 'catalogue.json').write_text(json.dumps(about, indent=2) + '\n', encoding='utf-8')
    with open(out / 'catalogue.csv', 'w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        writer.writerows(rows[np.argsort(rows['onset_ns'], kind='stable')].tolist())
