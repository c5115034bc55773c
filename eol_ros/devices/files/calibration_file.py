# SPDX-License-Identifier: Apache-2.0
"""Calibrations as YAML, in the form that ROS gives camera_info, plus what ties camera and table.

A camera_info file of the ROS camera_calibration tool lacks `homography`, and that is said.
"""

import dataclasses
import datetime
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from eol_ros.core.table import Table, check_same
from eol_ros.core.vision.calibration.covers import CoverOutlines
from eol_ros.core.vision.calibration.model import Calibration
from eol_ros.devices.files import camera_info
from eol_ros.disk import DISK, content
from eol_ros.errors import ConfigError, DeviceMissing

_NO_TABLE = ': a camera_info file knows the lens but not the table; run `eol calibrate` with it'
LEFT_HANDED = (
    'the homography is left-handed, as of a table seen in a mirror. If the camera looks '
    'through one,'
)
_NUMBERS = ('cover_height_m', 'residual_px', 'residual_mm')


def save(path: str | Path, calibration: Calibration) -> None:
    """Write `calibration` to `path`, whole or not at all.

    Raises:
        ConfigError: the folder is absent or cannot be written.
    """
    try:
        DISK.write(Path(path), _text(calibration))
    except OSError as error:
        raise ConfigError(
            f'{path}: cannot write the calibration ({error.strerror}); '
            'choose a folder that exists and can be written'
        ) from None


def _text(calibration: Calibration) -> str:
    content = {
        'image_width': int(calibration.image_width),
        'image_height': int(calibration.image_height),
        'camera_name': 'eol',
        'camera_matrix': _matrix(calibration.camera_matrix),
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': _matrix(calibration.distortion_coefficients[None]),
        'homography': _matrix(calibration.homography),
        'mirror': calibration.mirrored,
        'cover_height_m': float(calibration.cover_height_m),
        'date': calibration.date,
        'residual_px': float(calibration.residual_px),
        'residual_mm': float(calibration.residual_mm),
    }
    if calibration.table != Table():
        content['table'] = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(calibration.table).items()
        }
    if calibration.covers is not None:
        sides = calibration.covers.land_mm.reshape(-1, calibration.covers.land_mm.shape[2])
        content['covers'] = {
            'lower_mm': float(calibration.covers.lower_mm),
            'land_mm': [' '.join(repr(float(h)) for h in side) for side in sides],
        }
    return (
        '# Pixels: u right, v down. homography: table metres (x right, y away, cover height)\n'
        '# to undistorted pixels of camera_matrix. mirror: the camera sees the table in one.\n'
        '# covers: heights over the platform of lower rim and land; sides +x, +y, -x, -y a block.\n'
        '# Written by `eol calibrate`.\n'
        + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
    )


def load(path: str | Path, mirror: bool = False, table: Table | None = None) -> Calibration:
    """Return the calibration in `path`.

    What the file says of a mirror must be what its homography does: mostly a left-handed one comes
    from a y that was counted downwards, and would exchange the blocks' names. mirror: the user says
    that there is one, so the file must say so too. table: that of the scene, which must be the one
    that the calibration is of.

    Raises:
        DeviceMissing: no such file.
        ConfigError: not YAML, or a field absent or wrong; all are named at once.
    """
    found = loads(_read(path), path, mirror)
    if table is not None:
        advice = 'calibrate with `eol calibrate --scene SCENE`, or set `table` in the scene'
        check_same(found.table, table, str(path), 'the scene', advice)
    return found


def _read(path: str | Path) -> bytes:
    try:
        return content(path)
    except FileNotFoundError:
        raise DeviceMissing(
            f'{path}: no such calibration file; make one with `eol calibrate`'
        ) from None
    except OSError as error:
        raise DeviceMissing(f'{path}: cannot read the calibration ({error.strerror})') from None


def loads(text: str | bytes, path: str | Path, mirror: bool = False) -> Calibration:
    """Return the calibration in a text that was found at `path`.

    Raises:
        ConfigError: as `load`.
    """
    content = camera_info.read(text, path)
    wrong: list[str] = []
    fields: dict = {}
    size = fields['image_width'], fields['image_height'] = camera_info.size(content, wrong)
    fields['camera_matrix'], fields['distortion_coefficients'] = camera_info.lens(
        content, size, wrong
    )
    fields['homography'] = camera_info.matrix(content, 'homography', (3, 3), wrong, _NO_TABLE)
    for name in _NUMBERS:
        value = fields[name] = content.get(name, 0.0)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (number and math.isfinite(value)):
            wrong.append(f'{name} is {value!r}, not a number')
    said = content.get('mirror', False)
    if not isinstance(said, bool):
        wrong.append(f'mirror is {said!r}, not true or false')
    table = fields['table'] = _read_table(content.get('table'), wrong)
    fields['covers'] = _read_covers(content.get('covers'), table, wrong)
    if wrong:
        raise ConfigError(f'{path}: ' + '; '.join(wrong))
    date = content.get('date', '')
    fields['date'] = date.isoformat() if isinstance(date, datetime.date) else str(date)
    try:
        calibration = Calibration(**fields)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None
    if fault := _mirror_fault(calibration.mirrored, said, mirror):
        raise ConfigError(f'{path}: {fault}')
    return calibration


def _mirror_fault(mirrored: bool, said: bool, wanted: bool) -> str:
    """Return where homography, file and setting contradict each other, or an empty string."""
    if mirrored and not said:
        return (
            f'{LEFT_HANDED} add `mirror: true` to this file; else y was '
            'counted downwards: calibrate again with y pointing away'
        )
    if said and not mirrored:
        return (
            'says `mirror: true`, but its homography is that of a camera '
            'without a mirror: take that line out, or calibrate with --mirror'
        )
    if wanted and not said:
        return (
            'is the calibration of a camera without a mirror, but `mirror` '
            'is set: leave it out, or calibrate with --mirror'
        )
    return ''


def _matrix(values: np.ndarray) -> dict:
    return {
        'rows': values.shape[0],
        'cols': values.shape[1],
        'data': [float(v) for v in values.ravel()],
    }


def _read_table(value: Any, wrong: list[str]) -> Table:
    """Return the table that a calibration is of, or note what is wrong."""
    if value is None:
        return Table()
    try:
        return Table.parsed(value)
    except ValueError as error:
        wrong.append(f'table: {error}')
        return Table()


def _read_covers(value: Any, table: Table, wrong: list[str]) -> CoverOutlines | None:
    """Return the heights of covers, None where the file names none, or note what is wrong."""
    if value is None:
        return None
    try:
        sides = [[float(h) for h in side.split()] for side in value['land_mm']]
        lower = float(value['lower_mm'])
        count = 4 * table.cells
        if len(sides) != count or len({len(side) for side in sides}) != 1:
            wrong.append(f'covers has {len(sides)} sides, not {count} with as many heights each')
            return None
        return CoverOutlines(lower, np.reshape(sides, (table.cells, 4, -1)))
    except (TypeError, ValueError, KeyError, AttributeError):
        wrong.append('covers must have lower_mm, a number, and land_mm, a line of heights a side')
    except ConfigError as error:
        wrong.append(str(error))
    return None


def load_lens(path: str | Path) -> tuple[int, int, np.ndarray, np.ndarray]:
    """Return width, height, camera matrix (3, 3) and distortion (5,) of a camera_info file.

    Raises:
        DeviceMissing, ConfigError: as `load`.
    """
    content, wrong = camera_info.read(_read(path), path), list[str]()
    width, height = camera_info.size(content, wrong)
    camera, lens = camera_info.lens(content, (width, height), wrong)
    if wrong or camera is None or lens is None:
        raise ConfigError(f'{path}: ' + '; '.join(wrong))
    return width, height, camera, lens
