# SPDX-License-Identifier: Apache-2.0
"""Size, shape, positions and springs of the table, in metres.

World frame `table`: origin at the platform's centre, x right, y away from the front, z up. Places
are numbered row by row from the front left, `row * columns + column`. Arrays by id have a row for
each place; the row of a place without a block (`absent`) is unused.

The paper prints the rim as 960 cm; the sum of its own parts is 96.0 cm, and that is the default.
"""

import dataclasses
from functools import cached_property
from typing import Any

import numpy as np

from eol_ros.errors import ConfigError
from eol_ros.settings import TableSettings


class Table(TableSettings):
    """A table of rows x columns square blocks in a rim.

    Examples
    --------
    >>> Table().count, Table().pitch_m
    (25, (0.174, 0.174))
    >>> ring = Table(absent=(6, 7, 8, 11, 12, 13, 16, 17, 18))
    >>> ring.count, ring.neighbours(1)
    (16, [0, 2])
    >>> Table(rows=4, columns=6).turns
    (0, 2)
    """

    @classmethod
    def of(cls, settings: TableSettings) -> 'Table':
        """Return the table of these settings."""
        return cls(**dataclasses.asdict(settings))

    @cached_property
    def cells(self) -> int:
        """Number of places, with and without a block: ids are below it."""
        return self.rows * self.columns

    @cached_property
    def present(self) -> np.ndarray:
        """Which places hold a block, (cells,) bool."""
        there = np.ones(self.cells, bool)
        there[list(self.absent)] = False
        return _fixed(there)

    @cached_property
    def ids(self) -> np.ndarray:
        """Ids of the blocks, rising."""
        return _fixed(np.flatnonzero(self.present))

    @cached_property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.ids)

    @cached_property
    def gaps_m(self) -> tuple[float, float]:
        """Length of a mounted spring along x and along y."""
        return self.gap_m, self.gap_y_m or self.gap_m

    @cached_property
    def pitch_m(self) -> tuple[float, float]:
        """Distance of neighbouring blocks at rest along x and along y."""
        return self.block_side_m + self.gaps_m[0], self.block_side_m + self.gaps_m[1]

    @cached_property
    def reach_m(self) -> tuple[float, float]:
        """Distances along x and y that the rim can move from rest, not rotated."""
        x, y = (
            (platform - rim) / 2 - self.rim_width_m
            for platform, rim in zip(self.platform_m, self.rim_m(), strict=True)
        )
        return x, y

    @cached_property
    def scale(self) -> float:
        """Ratio of the smaller pitch to that of the paper's table, for lengths chosen there."""
        return min(self.pitch_m) / min(Table().pitch_m)

    @cached_property
    def rest(self) -> np.ndarray:
        """Centres of the places at rest, (cells, 2); row 0 is nearest (lowest y)."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        x = (column - (self.columns - 1) / 2) * self.pitch_m[0]
        y = (row - (self.rows - 1) / 2) * self.pitch_m[1]
        return _fixed(np.stack([x.ravel(), y.ravel()], axis=1))

    @cached_property
    def _springs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Blocks at both ends of springs: along x, along y, then to the rim (-1), by its side."""
        ids = np.where(self.present, np.arange(self.cells), -1).reshape(self.rows, self.columns)
        pairs = [(ids[:, :-1], ids[:, 1:]), (ids[:-1], ids[1:])]
        found = []
        for first, second in pairs:
            both = (first >= 0) & (second >= 0)
            found.append((first[both], second[both]))
        for outer in (ids[:, 0], ids[:, -1], ids[0], ids[-1]):
            there = outer[outer >= 0]
            found.append((there, np.full(len(there), -1)))
        return found

    @cached_property
    def springs(self) -> np.ndarray:
        """Blocks at the ends of each spring, (n, 2), in the order of `spring_ends`; -1: the rim."""
        return _fixed(np.concatenate([np.stack(pair, axis=1) for pair in self._springs]))

    def spring_ends(self, blocks: np.ndarray, rim: np.ndarray | None = None) -> np.ndarray:
        """Return where the springs end, shape (n, 2, 2) in metres: spring, end, x and y.

        blocks: (cells, 3) x, y in m and yaw in rad; springs pull at the middles of their edges.
        First come those between blocks; with `rim`, (3,) x, y and yaw of its centre, those to the
        rim follow.
        """
        place = blocks[:, 0] + 1j * blocks[:, 1]  # the plane of the table as complex numbers
        edge = np.exp(1j * blocks[:, 2]) * self.block_side_m / 2
        found = []
        for turn, (i, j) in zip((1, 1j), self._springs[:2], strict=True):
            found.append(np.stack([place[i] + turn * edge[i], place[j] - turn * edge[j]], axis=1))
        if rim is not None:
            centre, axis = rim[0] + 1j * rim[1], np.exp(1j * rim[2])
            rest, width, depth = self.rest @ [1, 1j], *self.rim_m()
            sides = zip((-1, 1, -1j, 1j), (width, width, depth, depth), strict=True)
            for (turn, size), (i, _) in zip(sides, self._springs[2:], strict=True):
                along = rest[i] - turn * np.real(rest[i] * np.conj(turn))  # position along the bar
                bar = centre + axis * (along + turn * size / 2)
                found.append(np.stack([place[i] + turn * edge[i], bar], axis=1))
        ends = np.concatenate(found)
        return np.stack([ends.real, ends.imag], axis=2)

    def neighbours(self, block: int, diagonal: bool = False) -> list[int]:
        """Return the ids of the 4 (or, with `diagonal`, 8) lattice neighbours of `block`."""
        row, column = divmod(block, self.columns)
        found = []
        for r in range(max(row - 1, 0), min(row + 2, self.rows)):
            for c in range(max(column - 1, 0), min(column + 2, self.columns)):
                steps, other = abs(r - row) + abs(c - column), r * self.columns + c
                if self.present[other] and (steps == 1 or (diagonal and steps == 2)):
                    found.append(other)
        return found

    def turned(self, quarters: int) -> np.ndarray:
        """Return the id in each place (cells,) after quarter turns, counter-clockwise.

        Only `turns` leave a table as it is.
        """
        row, column = np.divmod(np.arange(self.cells), self.columns)
        rows, columns = self.rows, self.columns
        for _ in range(quarters % 4):
            row, column = columns - 1 - column, row
            rows, columns = columns, rows
        return row * columns + column

    @cached_property
    def turns(self) -> tuple[int, ...]:
        """Quarter turns that map the lattice onto itself: 0; 0 and 2; or all four."""
        square = self.rows == self.columns and self.pitch_m[0] == self.pitch_m[1]
        return tuple(
            quarters
            for quarters in ((0, 1, 2, 3) if square else (0, 2))
            if (self.present[self.turned(quarters)] == self.present).all()
        )

    @cached_property
    def turned_ids(self) -> np.ndarray:
        """`turned` of each of `turns`, (turns, cells)."""
        return _fixed(np.array([self.turned(quarters) for quarters in self.turns]))

    @cached_property
    def unturned_ids(self) -> np.ndarray:
        """Where each id stands after each of `turns`, (turns, cells)."""
        return _fixed(np.argsort(self.turned_ids, axis=1))

    def grid(self, values: np.ndarray) -> np.ndarray:
        """Return values by id, (..., cells), as rows and columns, (..., rows, columns)."""
        return values.reshape(*values.shape[:-1], self.rows, self.columns)


def check_same(
    found: TableSettings, wanted: TableSettings, whose: str, other: str, advice: str
) -> None:
    """Raise ConfigError if the table of `whose` is not the one that `other` has."""

    def listed(value: Any) -> Any:
        return list(value) if isinstance(value, tuple) else value

    fields = dataclasses.asdict(found), dataclasses.asdict(wanted)
    differences = [
        f'{name} {listed(value)}, not {listed(fields[1][name])}'
        for name, value in fields[0].items()
        if value != fields[1][name]
    ]
    if differences:
        raise ConfigError(
            f'{whose}: its table is not that of {other}: {", ".join(differences)}: {advice}'
        )


def _fixed(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False  # callers share it
    return values
