# SPDX-License-Identifier: Apache-2.0
"""Scenes by name: the paper's table, the Brown plate, the Burridge-Knopoff train, N x M of each.

`rotation={'side': shape.block_side_m}` lets the blocks rotate; springs then pull at their edges.
All return plain mappings, so that what is built can be saved, read and changed.
"""

from typing import Any

import numpy as np

from eol_ros.core.table import Table
from eol_ros.settings import TableSettings, TwinSettings

STIFFNESS = 40.0  # N/m, a small extension spring; a choice, to be measured on the real table
MU_STATIC = 0.9  # grit on grit; a choice, to be measured on the real table
MU_KINETIC = 0.65
NATURAL_M = 0.06  # natural length of a spring installed at 9 cm: pre-tension 1.2 N
GRAVITY = 9.81

Plain = dict[str, Any]  # as a scene file has it


def offsets(n: int, size_m: float, seed: int, along_x: bool = False) -> list[list[float]]:
    """Return n starting offsets, uniform in +-size_m, the same for the same seed."""
    drawn = np.random.default_rng(seed).uniform(-size_m, size_m, (n, 2))
    if along_x:
        drawn[:, 1] = 0.0
    return drawn.tolist()


def _scene(
    n: int,
    between: list[Plain],
    to_frame: list[Plain],
    drive: Plain,
    duration_s: float,
    **more: Any,
) -> Plain:
    scene = {
        'n': n,
        'mass': TwinSettings.block_kg,
        'mu_s': MU_STATIC,
        'mu_k': MU_KINETIC,
        'g': GRAVITY,
        'geometric': False,
        'dim1': False,
        'springs_between_blocks': between,
        'springs_to_frame': to_frame,
        'drive': drive,
        'u0': [[0.0, 0.0]] * n,
        'v0': 'zero',
        'T': duration_s,
    }
    unknown = set(more) - set(scene) - {'rotation'}
    if unknown:
        raise TypeError(f'a scene has no {sorted(unknown)}')
    return scene | more


def _number(table: Table) -> list[int]:
    """Return the number in the scene of the block at each place; -1: there is none."""
    return np.where(table.present, np.cumsum(table.present) - 1, -1).tolist()


def _lattice_springs(table: Table, k: float, natural_m: float = NATURAL_M) -> list[Plain]:
    number, springs = _number(table), []
    for cell, i in enumerate(number):
        row, column = divmod(cell, table.columns)
        for axis, step, there in (
            (0, 1, column < table.columns - 1), (1, table.columns, row < table.rows - 1),
        ):  # fmt: skip
            if there and min(i, j := number[cell + step]) >= 0:
                way = [1.0 - axis, float(axis)]
                springs.append(_spring(i, k, way, natural_m, table.gaps_m[axis], j=j))
    return springs


def _spring(
    i: int, k: float, direction: list[float], natural_m: float, length_m: float, **end: Any
) -> Plain:
    return {'i': i, **end, 'k': k, 'L0': natural_m, 'dir': direction, 'Lnom': length_m}


def _plate_spring(i: int, k: float, at: tuple[float, float]) -> Plain:
    return {'i': i, 'k': k, 'L0': 0.0, 'dir': [0.0, 0.0], 'Lnom': 0.0, 'anchor': list(at)}


def table(
    drive: Plain,
    duration_s: float,
    rows: int = TableSettings.rows,
    columns: int = TableSettings.columns,
    k: float = STIFFNESS,
    natural_m: float = NATURAL_M,
    shape: Table | None = None,
    **more: Any,
) -> Plain:
    """Build a table like the paper's: the outer blocks are tied to the rim, corners by two springs.

    Parameters
    ----------
    drive : dict
        How the rim moves: kind and par, as docs/reference/physics_scene.md lists them.
    duration_s : float
        Time to simulate.
    rows, columns : int
        Of blocks of the paper's size, where no `shape` is given.
    k : float
        Stiffness of a spring, N/m.
    natural_m : float
        Its length while nothing pulls, m; built in it is 0.09 m, or as `shape` says.
    shape : Table, optional
        Any table; its blocks are numbered in order of their ids, without the absent ones.
    **more
        Other keys of a scene, such as u0 (n, 2) m, mu_s, geometric or rotation.

    Returns
    -------
    dict
        A plain mapping, for `from_mapping` or a JSON file.

    Raises
    ------
    TypeError
        A key that scenes do not have.

    Examples
    --------
    >>> scene = table({'kind': 'constant_velocity', 'par': [0.02, 0.0]}, 5.0)
    >>> scene['n'], len(scene['springs_between_blocks']), len(scene['springs_to_frame'])
    (25, 40, 20)
    """
    shape = shape or Table(rows=rows, columns=columns)
    number, to_frame = _number(shape), []
    for cell, (x, y) in enumerate(shape.rest.tolist()):
        row, column = divmod(cell, shape.columns)
        sides = [
            (column == 0, -1.0, 0.0),
            (column == shape.columns - 1, 1.0, 0.0),
            (row == 0, 0.0, -1.0),
            (row == shape.rows - 1, 0.0, 1.0),
        ]
        for there, dx, dy in sides:
            if there and number[cell] >= 0:
                length = shape.gaps_m[0 if dx else 1]
                reach = shape.block_side_m / 2 + length
                anchor = [x + reach * dx, y + reach * dy]
                to_frame.append(
                    _spring(number[cell], k, [dx, dy], natural_m, length, anchor=anchor)
                )
    springs = _lattice_springs(shape, k, natural_m)
    return _scene(shape.count, springs, to_frame, drive, duration_s, **more)


def plate(
    drive: Plain,
    duration_s: float,
    rows: int = TableSettings.rows,
    columns: int = TableSettings.columns,
    k_plate: float = 20.0,
    k_between: float = 40.0,
    **more: Any,
) -> Plain:
    """Return the plate of Brown, Scholz and Rundle (1991): every block is tied to it from above.

    With `rotation={'side': w}` each plate spring is two of half its stiffness, at the middles of
    the left and the right edge: a leaf as wide as the block, which holds its angle too.
    """
    shape = Table(rows=rows, columns=columns)
    springs = _lattice_springs(shape, k_between)
    to_frame = []
    reach = 0.5 * more['rotation']['side'] if more.get('rotation') else 0.0
    for i, (x, y) in enumerate(shape.rest.tolist()):
        if reach:
            for arm in (-reach, reach):
                half = _plate_spring(i, 0.5 * k_plate, (x + arm, y))
                to_frame.append(half | {'arm': [arm, 0.0]})
        else:
            to_frame.append(_plate_spring(i, k_plate, (x, y)))
    return _scene(shape.count, springs, to_frame, drive, duration_s, **more)


def train(
    drive: Plain,
    duration_s: float,
    n: int = 5,
    k_plate: float = 20.0,
    k_between: float = 40.0,
    **more: Any,
) -> Plain:
    """Return the train of Burridge and Knopoff (1967): a row along x, tied to the plate."""
    return plate(drive, duration_s, 1, n, k_plate, k_between, **{'dim1': True, **more})


def single(drive: Plain, duration_s: float, k: float = STIFFNESS, **more: Any) -> Plain:
    """Return one block pulled along x by one linear spring."""
    return _scene(
        1, [], [_plate_spring(0, k, (0.0, 0.0))], drive, duration_s, **{'dim1': True, **more}
    )


def uncoupled(scene: Plain, shape: Table) -> Plain:
    """Return a table or plate without springs between blocks: what the drive makes of each alone.

    A block that no spring ties to the rim gets one from above, as stiff as the first of theirs.
    """
    held = scene['springs_to_frame']
    tied = {spring['i'] for spring in held}
    leaves = [
        _plate_spring(i, held[0]['k'], at)
        for i, at in enumerate(shape.rest[shape.ids].tolist())
        if i not in tied
    ]
    return scene | {'springs_between_blocks': [], 'springs_to_frame': [*held, *leaves]}
