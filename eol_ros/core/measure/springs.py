# SPDX-License-Identifier: Apache-2.0
"""Stiffness of the springs, from known weights that pull one block while the camera looks.

Between two weights the block must come to rest, and friction holds it anywhere within a band. It
stands at that edge of the band from which it came, so weights are added and taken off again: what
friction keeps has the sign of the last motion, and is estimated with the stiffness.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eol_ros.core.measure.estimate import Estimate
from eol_ros.core.physics.builders import GRAVITY
from eol_ros.core.table import Table
from eol_ros.errors import EolError

REST_S = 4.0  # nobody holds a weight so still for so long
STILL_M = 2e-4  # what a block may be seen to move by at rest
MOVED_M = 5e-4  # and between two rests
# What a ruler leaves open: standard deviations.
NATURAL_SIGMA_M, RIM_SIGMA_M = 0.0005, 0.002
LEAST_WEIGHTS = 5


class Rest(NamedTuple):
    """All blocks while the one that is pulled stood still: (cells, 3) m, m, rad, and when, s."""

    places: np.ndarray
    stamp_s: float


class Rests:
    """Finds the rests of `block` between its motions, image by image."""

    def __init__(self, block: int, table: Table = Table()):
        self.block = block
        self.found: list[Rest] = []
        self._needed = [block, *table.neighbours(block)]
        self._seen: deque[tuple[float, np.ndarray]] = deque()

    def add(self, stamp_s: float, places: np.ndarray, seen: np.ndarray) -> Rest | None:
        """Take the blocks of one image; return the rest that is known by now, if it is new.

        places: (cells, 3); seen: (cells,), which were.
        """
        images = self._seen
        if not seen[self._needed].all() or (images and stamp_s <= images[-1][0]):
            images.clear()
            return None
        while images and np.hypot(*(places - images[0][1])[self.block, :2]) > STILL_M:
            images.popleft()
        images.append((stamp_s, places.copy()))
        if stamp_s - images[0][0] < REST_S:
            return None
        middle = np.mean([image[1] for image in images], axis=0)
        begin_s = images[0][0]
        while stamp_s - images[0][0] >= REST_S:
            images.popleft()
        if self.found:
            way = middle[self.block, :2] - self.found[-1].places[self.block, :2]
            if np.hypot(*way) < MOVED_M:
                return None
        self.found.append(Rest(middle, begin_s))
        return self.found[-1]


class Springs(NamedTuple):
    """What the weights said: N/m, the friction that held the block, N, and each rest beside it.

    pull (n,) is the weight in N, reach (n,) the pull of springs of 1 N/m, m, and `missed` (n,) what
    the fit leaves over, N; `way` (n,) is the sign of the motion before.
    """

    stiffness: Estimate
    friction_n: float
    pull: np.ndarray
    reach: np.ndarray
    missed: np.ndarray
    way: np.ndarray


def usual(table: Table) -> int:
    """Return the block in the middle of the right edge, or the one nearest to it.

    Raises EolError where the last column has no block.
    """
    last = table.columns - 1
    rows = [row for row in range(table.rows) if table.present[row * table.columns + last]]
    if not rows:
        raise EolError('the right edge of the table has no block: name one at another, --block')
    row = min(rows, key=lambda row: abs(2 * row - table.rows + 1))
    return row * table.columns + last


def outwards(block: int, table: Table = Table()) -> np.ndarray:
    """Return the direction (2,) in which a thread at `block` leads over the edge of the table.

    Raises EolError for blocks from which none does without crossing others.
    """
    row, column = divmod(block, table.columns)
    if column in (0, table.columns - 1):
        return np.array([-1.0 if column == 0 else 1.0, 0.0])
    if row in (0, table.rows - 1):
        return np.array([0.0, -1.0 if row == 0 else 1.0])
    raise EolError(
        f'block {block} stands inside, where a thread would cross others: take one at the rim,'
        f' such as {usual(table)}'
    )


def pull_of_springs(
    places: np.ndarray,
    block: int,
    natural_m: float,
    rim: np.ndarray | None = None,
    table: Table = Table(),
) -> np.ndarray:
    """Return the force (2,) m on `block` of springs of 1 N/m, all blocks at `places` (cells, 3)."""
    ends = table.spring_ends(places, np.zeros(3) if rim is None else rim)
    way = ends[:, 1] - ends[:, 0]
    force = (1 - natural_m / np.hypot(*way.T))[:, None] * way
    first, second = table.springs.T
    return force[first == block].sum(axis=0) - force[second == block].sum(axis=0)


def fit(
    rests: Sequence[Rest],
    weights_kg: Sequence[float],
    block: int,
    natural_m: float,
    table: Table = Table(),
) -> Springs:
    """Return the stiffness that `weights_kg` (n,) say, which hung one after the other.

    The first of the n + 1 `rests` is that before the first weight. Weight = stiffness * reach +
    friction * way + constant, by least squares; the constant takes what the rim stands off its
    place. What the ruler leaves open is in the error. Raises EolError where they say too little.
    """
    if len(rests) != len(weights_kg) + 1:
        raise EolError(
            f'block {block} came to rest {len(rests)} times for {len(weights_kg)} weights and none:'
            f' each must move it, by {1e3 * MOVED_M:g} mm at least, and hang still for'
            f' {REST_S:g} s'
        )
    if len(weights_kg) < LEAST_WEIGHTS:
        raise EolError(
            f'{len(weights_kg)} weights leave nothing to know the error by: hang {LEAST_WEIGHTS} or'
            ' more, up and down again'
        )
    out = outwards(block, table)
    along = np.array([rest.places[block, :2] @ out for rest in rests])
    way = np.sign(np.diff(along))
    if abs(way.sum()) == len(way):
        raise EolError(
            'every weight was heavier than the one before, so stiffness and friction are not to be'
            ' told apart: take the weights off one by one, too'
        )
    pull = GRAVITY * np.asarray(weights_kg, float)

    def reach(natural: float, rim: np.ndarray | None = None) -> np.ndarray:
        return np.array(
            [-pull_of_springs(rest.places, block, natural, rim, table) @ out for rest in rests[1:]]
        )

    def solved(reached: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        columns = np.column_stack([reached, way, np.ones(len(pull))])
        found, *_ = np.linalg.lstsq(columns, pull, rcond=None)
        return found, columns, pull - columns @ found

    reached = reach(natural_m)
    found, columns, missed = solved(reached)
    dof = len(pull) - columns.shape[1]
    spread = np.linalg.pinv(columns.T @ columns) * (missed @ missed) / dof
    stiffness = Estimate(float(found[0]), float(np.sqrt(spread[0, 0])), dof)
    if not found[0] > 3 * stiffness.sigma:
        raise EolError(
            f'the weights and how far they pulled do not go together: {found[0]:.0f} +- '
            f'{stiffness.sigma:.0f} N/m. Were they hung in the order that was said?'
        )
    by_ruler = [
        solved(reach(natural_m + NATURAL_SIGMA_M))[0][0],
        *(solved(reach(natural_m, RIM_SIGMA_M * unit))[0][0] for unit in np.eye(3)[:2]),
    ]
    for other in by_ruler:
        stiffness = stiffness.widened(abs(float(other - found[0])))
    return Springs(stiffness, float(found[1]), pull, reached, missed, way)
