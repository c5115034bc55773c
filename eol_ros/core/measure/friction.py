# SPDX-License-Identifier: Apache-2.0
"""Friction of the blocks on the grit, from how the inner ones slip while the rim is pulled.

The camera sees all four neighbours of an inner block, so the force of its springs is known at each
image, whatever the rim does. Forces are counted in weights of a block, so friction is a plain
number; with the torque over the mean lever arm as a third component, as the twin has it
(physics/rotation/taylor.py: Goyal, Ruina and Papadopoulos, Wear 143, 1991).

Kinetic: a block rests before and after a slip, so what the springs did on its way went into
friction: mu_k = work / length of the way. That asks for no velocity and no acceleration. Static:
the force when it broke loose, between two images. How far it had come in the first image of the
slip says when: it was accelerated by the force less mu_k.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from eol_ros.core.measure.estimate import Estimate, SampleMean
from eol_ros.core.measure.springs import NATURAL_SIGMA_M
from eol_ros.core.physics.builders import GRAVITY
from eol_ros.core.physics.rotation.taylor import LEVER
from eol_ros.core.table import Table
from eol_ros.errors import EolError

QUIET_M, MOST_QUIET_M = 6e-5, 3e-4  # less from image to image is rest, and at most so much
NOISES = 6.0  # above this and so many times the noise it is motion
RESTS = 4  # images at rest before a slip
SHORTEST_M = 1e-3
LEAST_SLIPS, LEAST_BLOCKS = 3, 6  # of a block; fewer blocks have no interval of 95 %
BUSY = 0.6  # share of the time of motion in which a block slides: then it never rests
GRIDS = 200  # steps in which the time of breaking loose is sought


class Track(NamedTuple):
    """Images of the blocks: stamps (n,) s, places (n, cells, 3) m, m, rad; seen (n, cells)."""

    stamp_s: np.ndarray
    places: np.ndarray
    seen: np.ndarray
    table: Table = Table()


def track_of(
    images: Sequence[tuple[float, np.ndarray, np.ndarray]], table: Table = Table()
) -> Track:
    """Return the track of images one by one: stamp s, places (cells, 3), who was seen (cells,)."""
    stamp_s, places, seen = map(np.array, zip(*images, strict=True))
    return Track(stamp_s, places, seen, table)


@functools.cache
def inner(table: Table) -> np.ndarray:
    """Return the ids of the blocks with four neighbours; raise EolError where they are too few."""
    found = np.array([b for b in table.ids.tolist() if len(table.neighbours(b)) == 4], int)
    if len(found) < LEAST_BLOCKS:
        raise EolError(
            f'{len(found)} blocks of this table have four neighbours, and friction needs'
            f' {LEAST_BLOCKS}: measure it on a larger one, such as 4 x 5, of the same blocks'
        )
    return found


def _beside(table: Table) -> tuple[tuple[complex, int], ...]:
    """Return the edges of a block, as directions, and how far the id beyond is from its own."""
    return ((1, 1), (1j, table.columns), (-1, -1), (-1j, -table.columns))


class Slip(NamedTuple):
    """One slip of an inner block: when, m of way, mu_k, and mu_s, which may be nan."""

    block: int
    stamp_s: float
    way_m: float
    kinetic: float
    static: float


class Friction(NamedTuple):
    """Of the mean block, with errors that hold for it; of single blocks (n,) each mu_s and mu_k.

    `each` (n, 2) is nan where a block slipped too seldom.
    """

    static: SampleMean
    kinetic: SampleMean
    each: np.ndarray
    slips: list[Slip]
    blocks: np.ndarray


def force(places: np.ndarray, natural_m: float, table: Table = Table()) -> np.ndarray:
    """Return the force (n, b, 3) m of springs of 1 N/m on the inner blocks; places (n, cells, 3).

    The third component is the torque over the lever arm of friction.
    """
    at = places[..., 0] + 1j * places[..., 1]
    edge = 0.5 * table.block_side_m * np.exp(1j * places[..., 2])
    blocks = inner(table)
    total = np.zeros((*at.shape[:-1], len(blocks), 3))
    for outwards, step in _beside(table):
        arm, far = outwards * edge[..., blocks], blocks + step
        way = at[..., far] - outwards * edge[..., far] - at[..., blocks] - arm
        pull = (1 - natural_m / np.abs(way)) * way
        total[..., 0] += pull.real
        total[..., 1] += pull.imag
        total[..., 2] += (arm.conj() * pull).imag / (LEVER * table.block_side_m)
    return total


def find_slips(track: Track, stiffness: float, mass_kg: float, natural_m: float) -> list[Slip]:
    """Return the slips of the inner blocks that stood still before and after.

    stiffness: N/m. Slips in which an image is missing, or a block or a neighbour was not seen, are
    left out. Raises EolError where nothing moved, or all did without rest.
    """
    stamp_s, places, seen, table = track
    blocks = inner(table)
    if len(stamp_s) < 2 * RESTS:
        raise EolError(f'{len(stamp_s)} images with all blocks: does the tracker see the table?')
    scale = stiffness / (mass_kg * GRAVITY)
    own = places[:, blocks].copy()
    own[..., 2] *= LEVER * table.block_side_m
    steps = np.diff(own, axis=0)
    length = np.linalg.norm(steps, axis=2)
    noise = np.quantile(length, 0.2, axis=0)
    moving = length > np.minimum(QUIET_M + NOISES * noise, MOST_QUIET_M)
    span = np.diff(stamp_s)
    period = float(np.median(span))
    known = seen[:, blocks].copy()
    for _, step in _beside(table):
        known &= seen[:, blocks + step]
    good = known[1:] & known[:-1] & (np.abs(span / period - 1) < 0.2)[:, None]
    pull = scale * force(places, natural_m, table)
    work = np.sum(0.5 * (pull[1:] + pull[:-1]) * steps, axis=2)
    found = []
    for b, block in enumerate(blocks.tolist()):

        def loads(held: np.ndarray, b: int = b) -> np.ndarray:
            return np.linalg.norm(scale * force(held, natural_m, table)[:, b], axis=1)

        # in the interval before image `first` it still stood, from image `last` on it does again
        change = np.diff(np.concatenate([[0], moving[:, b].astype(np.int8), [0]]))
        begins, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        before = 0
        for k, (first, last) in enumerate(zip(begins, ends, strict=True)):
            after = begins[k + 1] if k + 1 < len(begins) else len(moving)
            rested, rests = first - before, after - last
            before = int(last)
            way = float(length[first:last, b].sum())
            if rested < RESTS or rests < 1 or way < SHORTEST_M:
                continue
            if not good[first - RESTS : last + 1, b].all():
                continue
            kinetic = float(work[first:last, b].sum()) / way
            here = slice(first - RESTS, first + 3)
            static = _broke(
                places[here], own[here, b], pull[here, b], block, period, kinetic, loads
            )
            found.append(Slip(block, float(stamp_s[first]), way, kinetic, static))
    if not moving.any():
        raise EolError('no block inside moved: pull the rim until the middle of the table slips')
    stirs = moving.any(axis=1)
    if len(found) < LEAST_SLIPS and moving[stirs].mean() > BUSY:
        raise EolError(
            'the rim was pulled too fast: blocks slid on without coming to rest. Some 3 cm/s is'
            ' right, 10 cm in three seconds'
        )
    return sorted(found, key=lambda slip: slip.stamp_s)


def _broke(
    places: np.ndarray,
    own: np.ndarray,
    pull: np.ndarray,
    block: int,
    period: float,
    kinetic: float,
    loads_on: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Return the force at which inner `block` broke loose, between images RESTS and RESTS + 1.

    Of those: all blocks, its own x, y and lever times yaw, and the force on it; `loads_on` returns
    the size of that with all blocks elsewhere. That of its neighbours on it where it stood is a
    straight line between the two images; nan where its motion does not go with that.
    """
    last = RESTS - 1  # it may have begun to move by less than is seen, in image RESTS
    stood = places[last - 1 : last + 1, block].mean(axis=0)
    held = places[RESTS : RESTS + 2].copy()
    held[:, block] = stood
    loads = loads_on(held)
    came = float(np.linalg.norm(own[RESTS + 1] - own[last - 1 : last + 1].mean(axis=0)))
    rate = float(loads[1] - loads[0]) / period
    # by how much the force falls on the way: its own springs
    slack = float(loads[1] - np.linalg.norm(pull[RESTS + 1])) / came
    ago = np.linspace(0, 1.6 * period, GRIDS + 1)[1:]
    broke = loads[1] - rate * ago
    lead = broke - kinetic
    comes = GRAVITY * (lead * ago**2 / 2 + rate * ago**3 / 6 - slack * GRAVITY * lead * ago**4 / 24)
    grows = int(np.argmin(np.append(np.diff(comes) > 0, False))) + 1  # beyond it would have stopped
    if not comes[0] <= came <= comes[grows - 1]:
        return math.nan
    return float(np.interp(came, comes[:grows], broke[:grows]))


def fit(
    slips: list[Slip], track: Track, stiffness: Estimate, mass: Estimate, natural_m: float
) -> Friction:
    """Return friction from `slips`, which `find_slips` found with the values of the same arguments.

    Blocks differ, and those at the rim are not measured: so the error of the mean is that of the
    inner ones as a sample, of which it is known only that blocks lie as often above the true one as
    below. Errors of stiffness (N/m), mass (kg) and of the ruler go into it. Raises EolError where
    too few blocks have slipped.
    """
    rows, blocks = [], inner(track.table)
    for block in blocks:
        mine = [slip for slip in slips if slip.block == block and math.isfinite(slip.static)]
        if len(mine) >= LEAST_SLIPS:
            way = np.array([slip.way_m for slip in mine])
            kinetic = float(np.array([slip.kinetic for slip in mine]) @ way / way.sum())
            rows.append((float(np.median([slip.static for slip in mine])), kinetic))
        else:
            rows.append((math.nan, math.nan))
    each = np.array(rows)
    there = each[np.isfinite(each[:, 0])]
    if len(there) < LEAST_BLOCKS:
        count = len(slips)
        raise EolError(
            f'{count} slip{"" if count == 1 else "s"} in the middle, and {len(there)} of its'
            f' {len(blocks)} blocks with {LEAST_SLIPS} or more: {LEAST_BLOCKS} are needed.'
            ' Pull further and longer, to and fro'
        )
    other = find_slips(track, stiffness.value, mass.value, natural_m + NATURAL_SIGMA_M)
    by_ruler = _means(other) / _means(slips) - 1
    shares = stiffness.sigma / stiffness.value, mass.sigma / mass.value
    both = [
        SampleMean(column).widened(float(np.mean(column)) * math.hypot(*shares, ruler))
        for column, ruler in zip(there.T, by_ruler, strict=True)
    ]
    return Friction(both[0], both[1], each, slips, blocks)


def _means(slips: list[Slip]) -> np.ndarray:
    both = np.array([(slip.static, slip.kinetic) for slip in slips])
    return np.nanmean(both, axis=0)
