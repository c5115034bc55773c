# SPDX-License-Identifier: Apache-2.0
"""The catalogue of cascades as files that other programs read: ZMAP, and Parquet or CSV."""

import csv
import datetime
import json
from pathlib import Path
from typing import Any

import numpy as np

from eol_ros.analysis.bag import Bag, Table
from eol_ros.analysis.recorded_settings import recorded_settings, recorded_table
from eol_ros.core.physics.builders import GRAVITY
from eol_ros.devices.files.names import shown
from eol_ros.lab.sweeps.table import Column, Csv, Parquet, has_parquet
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
    'magnitude': ('f8', '', 'log10 of potency_m'),
    'moment_nm': ('f8', 'N m', 'stiffness of a spring * pitch along a row * potency_m'),
    'energy_j': ('f8', 'J', 'that friction took: mu_kinetic * block_kg * g * potency_m'),
    'bag': ('U64', '', 'recording that it stands in'),
}
ZMAP = ('x', 'y', 'decimal year', 'month', 'day', 'magnitude', 'depth', 'hour', 'minute', 'second')


def of(bag: Bag, cascades: Table | None, measured: TwinSettings | None = None) -> np.ndarray:
    """Return the cascades of a bag as rows of COLUMNS, in the order in which they were told.

    The law of their areas is asked in that order, which is the one that a live panel knows.
    measured: springs, friction and mass of the table; None: as the bag's twin has them. Without
    them moments and energies are nan.
    """
    count = 0 if cascades is None else len(cascades)
    rows = np.zeros(count, [(name, kind) for name, (kind, _, _) in COLUMNS.items()])
    if cascades is None:
        return rows
    table = recorded_table(bag)
    place = table.rest[cascades['nucleus']]
    with np.errstate(divide='ignore'):
        magnitude = np.log10(cascades['distance'])
    for name, values in (
        ('onset_ns', cascades['onset'].astype('i8')), ('duration_s', cascades['duration']),
        ('nucleus', cascades['nucleus']), ('x_m', place[:, 0]), ('y_m', place[:, 1]),
        ('area', cascades['area']), ('size', cascades['size']),
        ('potency_m', cascades['distance']), ('magnitude', magnitude),
        ('bag', shown(bag.path.name)),
    ):  # fmt: skip
        rows[name] = values
    made = measured or recorded_settings(bag, 'twin')
    rows['moment_nm'] = rows['energy_j'] = np.nan
    if made is not None:
        rows['moment_nm'] = made.stiffness * table.pitch_m[0] * rows['potency_m']
        rows['energy_j'] = made.mu_kinetic * made.block_kg * GRAVITY * rows['potency_m']
    return rows


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


def write(out: Path, rows: np.ndarray, provenance: dict[str, Any]) -> list[Path]:
    """Write catalogue_zmap.tsv, catalogue.parquet (or .csv without pyarrow) and catalogue.json.

    By onset.
    """
    rows = rows[np.argsort(rows['onset_ns'], kind='stable')]
    zmap = out / 'catalogue_zmap.tsv'
    with open(zmap, 'w', newline='', encoding='ascii') as file:
        # tabs: with commas ObsPy reads events without a value, and says nothing
        csv.writer(file, delimiter='\t', lineterminator='\n').writerows(_zmap_rows(rows))
    about = {
        'provenance': provenance,
        'columns': {n: {'unit': unit, 'is': text} for n, (_, unit, text) in COLUMNS.items()},
        'catalogue_zmap.tsv': {
            'columns': ZMAP, 'is': 'no head; x, y in m stand for degrees, depth is 0, UTC; '
            'a cascade without a distance has the magnitude nan',
        },
    }  # fmt: skip
    (out / 'catalogue.json').write_text(json.dumps(about, indent=2) + '\n', encoding='utf-8')
    kinds: dict[str, type] = {'i': int, 'f': float, 'U': str}
    columns = {n: Column(kinds[kind[0]], unit, text) for n, (kind, unit, text) in COLUMNS.items()}
    form, name = (Parquet, 'catalogue.parquet') if has_parquet() else (Csv, 'catalogue.csv')
    told = (dict(zip(COLUMNS, row, strict=True)) for row in rows.tolist())
    form.write(out / name, told, columns, provenance)
    return [zmap, out / name, out / 'catalogue.json']


def _zmap_rows(rows: np.ndarray) -> Any:
    for row in rows:
        whole_s, rest_ns = divmod(int(row['onset_ns']), 10**9)
        at = datetime.datetime.fromtimestamp(whole_s, datetime.timezone.utc)
        begin, end = (
            datetime.datetime(year, 1, 1, tzinfo=datetime.timezone.utc)
            for year in (at.year, at.year + 1)
        )
        year = (
            at.year
            + ((at - begin).total_seconds() + rest_ns * 1e-9) / (end - begin).total_seconds()
        )
        magnitude = row['magnitude']
        yield [
            f'{row["x_m"]:.3f}', f'{row["y_m"]:.3f}', f'{year:.13f}', at.month, at.day,
            f'{magnitude:.4f}' if np.isfinite(magnitude) else 'nan', 0, at.hour, at.minute,
            f'{at.second}.{rest_ns // 1000:06}',
        ]  # fmt: skip
