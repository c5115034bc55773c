# SPDX-License-Identifier: Apache-2.0
"""Sizes of the table, in metres, and the lattice of its blocks.

World frame `table`: origin at the platform's centre, x right, y away from the front, z up.
The paper prints the rim as 960 cm; the sum of its own parts is 96.0 cm, and that stands here.
"""

import numpy as np

ROWS = 5
COLS = 5
N_BLOCKS = ROWS * COLS
BLOCK_SIDE_M = 0.084
BLOCK_MASS_KG = 0.250
BODY_HEIGHT_M = 0.034  # of the open box that carries a cover and what is inside; a choice
BODY_WALL_M = 0.002
SPRING_M = 0.090
PITCH_M = BLOCK_SIDE_M + SPRING_M  # 0.174
RIM_SIDE_M = 5 * BLOCK_SIDE_M + 6 * SPRING_M  # 0.960
RIM_BAR_M = 0.014  # of the rim, outside of RIM_SIDE_M; a choice: so it fits at any yaw
PLATFORM_SIDE_M = 1.40
# From rest until the outside of the rim meets the platform's edge
RIM_REACH_M = (PLATFORM_SIDE_M - RIM_SIDE_M) / 2 - RIM_BAR_M

_IDS = np.arange(N_BLOCKS).reshape(ROWS, COLS)
_OUTER = np.concatenate([_IDS[:, 0], _IDS[:, -1], _IDS[0], _IDS[-1]])
# (60, 2) blocks at the ends of each spring, in the order of `spring_ends`; -1: the rim.
SPRING_BLOCKS = np.concatenate([
    np.stack([_IDS[:, :-1].ravel(), _IDS[:, 1:].ravel()], axis=1),
    np.stack([_IDS[:-1].ravel(), _IDS[1:].ravel()], axis=1),
    np.stack([_OUTER, np.full(len(_OUTER), -1)], axis=1),
])  # fmt: skip


def rest_lattice() -> np.ndarray:
    """Return the block centres at rest, shape (25, 2) in metres; row 0 is nearest (lowest y)."""
    column, row = np.meshgrid(np.arange(COLS), np.arange(ROWS))
    x = (column - (COLS - 1) / 2) * PITCH_M
    y = (row - (ROWS - 1) / 2) * PITCH_M
    return np.stack([x.ravel(), y.ravel()], axis=1)


def spring_ends(blocks: np.ndarray, rim: np.ndarray | None = None) -> np.ndarray:
    """Return where the springs end, shape (n, 2, 2) in metres: spring, end, x and y.

    blocks: (25, 3) x, y in m and yaw in rad; springs pull at the middles of their edges. The first
    40 are those between blocks; with `rim`, (3,) x, y and yaw of its centre, 20 to the rim follow.
    """
    place = blocks[:, 0] + 1j * blocks[:, 1]  # the plane of the table as complex numbers
    edge = np.exp(1j * blocks[:, 2]) * BLOCK_SIDE_M / 2
    ids, found = np.arange(N_BLOCKS).reshape(ROWS, COLS), []
    for turn, first, second in (
        (1, ids[:, :-1], ids[:, 1:]),
        (1j, ids[:-1], ids[1:]),
    ):
        i, j = first.ravel(), second.ravel()
        found.append(np.stack([place[i] + turn * edge[i], place[j] - turn * edge[j]], axis=1))
    if rim is not None:
        centre, axis = rim[0] + 1j * rim[1], np.exp(1j * rim[2])
        rest = rest_lattice() @ [1, 1j]
        for turn, i in ((-1, ids[:, 0]), (1, ids[:, -1]), (-1j, ids[0]), (1j, ids[-1])):
            along = rest[i] - turn * np.real(rest[i] * np.conj(turn))  # without the part outwards
            bar = centre + axis * (along + turn * RIM_SIDE_M / 2)
            found.append(np.stack([place[i] + turn * edge[i], bar], axis=1))
    ends = np.concatenate(found)
    return np.stack([ends.real, ends.imag], axis=2)


def neighbours(block: int, diagonal: bool = False) -> list[int]:
    """Return the ids of the 4 (or, with `diagonal`, 8) lattice neighbours of `block`."""
    row, column = divmod(block, COLS)
    found = []
    for r in range(max(row - 1, 0), min(row + 2, ROWS)):
        for c in range(max(column - 1, 0), min(column + 2, COLS)):
            steps = abs(r - row) + abs(c - column)
            if steps == 1 or (diagonal and steps == 2):
                found.append(r * COLS + c)
    return found
