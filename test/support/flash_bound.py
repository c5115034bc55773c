# SPDX-License-Identifier: Apache-2.0
"""How many flashes a second a viewer's 10 degree field of view can hold, from geometry alone.

WCAG 2.2 (general flash threshold) and ITU-R BT.1702 count the flashes that concurrently cover more
than a quarter of a field of 10 degrees: 0.006 sr. A plane seen at `distance_m` under `elevation`
shows a block of side s as s^2 sin(elevation) / distance^2 steradians, and the field as a disc of
radius distance * tan(5 degrees), stretched on the table by 1 / sin(elevation).

A flash of a field is a set of blocks that together cover more than 0.006 sr of it. If every block
flashes at most n times a second and every square of 2 x 2 blocks m times, the number of such sets
is bounded by a linear programme: maximise the sum of x_S over the sets S, where the x_S of the sets
that contain a block sum to at most n, and those of a square, block by block, to at most m.
"""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from eol_ros.core.table import Table

FIELD_SR = 0.006  # WCAG 2.2: a quarter of a 10 degree field
HALF_FIELD_DEG = 5.0
NEAREST_M = 0.2  # from eye to block, the least distance of a field that is looked at
LOWEST_DEG = 30.0  # elevation of the eye over the table, seen from a block
NEARER = 0.06  # share of the pitch by which a square of blocks may have contracted
PIXELS = 41  # across a field


class View(NamedTuple):
    """Where a field looks: distance in m, angles in degrees, its centre in the lattice in m."""

    distance_m: float
    elevation_deg: float
    azimuth_deg: float
    centre_m: tuple[float, float]


def covered(
    view: View, table: Table = Table(), nearer: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the blocks in a field as lattice places, (n, 2), and the solid angle of each in sr.

    nearer: share of its pitch by which the lattice has contracted.
    """
    pitch_m, side_m = (1 - nearer) * np.array(table.pitch_m), table.block_side_m
    radius_m = view.distance_m * math.tan(math.radians(HALF_FIELD_DEG))
    step_m = 2 * radius_m / PIXELS
    across = (np.arange(PIXELS) + 0.5) * step_m - radius_m
    x, y = (axis.ravel() for axis in np.meshgrid(across, across))
    inside = x**2 + y**2 <= radius_m**2
    table = x[inside] + 1j * y[inside] / math.sin(math.radians(view.elevation_deg))
    table = table * np.exp(1j * math.radians(view.azimuth_deg)) + complex(*view.centre_m)
    uv = np.stack([table.real, table.imag], axis=1)
    place = np.rint(uv / pitch_m)
    on = (np.abs(uv - place * pitch_m) <= side_m / 2).all(axis=1)
    blocks, pixels = np.unique(place[on].astype(int), axis=0, return_counts=True)
    return blocks, pixels * step_m**2 / view.distance_m**2


def most_flashes(blocks: np.ndarray, sr: np.ndarray, each: int, square: int) -> float:
    """Return a bound of the flashes a second of a field that shows `blocks`, (n, 2), as `sr`.

    Each block flashes at most `each`, a square of four at most `square` times a second. The bound
    is no whole number: a field makes at most its whole part.
    """
    if sr.sum() <= FIELD_SR:
        return 0.0
    if each * sr.sum() < (each + 1) * FIELD_SR or sr.sum() - sr.max() <= FIELD_SR:
        return each  # the areas of one flash more do not fit, or all flashes share one block
    from scipy.optimize import linprog

    order = np.argsort(-sr, kind='stable')[:11]
    enough_sr = FIELD_SR - (sr.sum() - sr[order].sum())  # the small ones always take part
    blocks, sr = blocks[order], sr[order]
    choices = np.array(list(itertools.product((False, True), repeat=len(sr))))
    total_sr, least_sr = choices @ sr, np.where(choices, sr, np.inf).min(axis=1)
    sets = choices[(total_sr > enough_sr) & (total_sr - least_sr <= enough_sr)]
    corners = {tuple(c) for b in blocks for c in b - np.array([[0, 0], [0, 1], [1, 0], [1, 1]])}
    members = [((blocks >= c) & (blocks <= np.add(c, 1))).all(axis=1) for c in corners]
    rows = np.concatenate([sets.T, [(sets & m).sum(axis=1) for m in members]])
    most = [each] * len(sr) + [square] * len(members)
    return -float(linprog(-np.ones(len(sets)), rows, most, method='highs').fun)


def views(
    nearest_m: float = NEAREST_M, furthest_m: float = 2.0, n: int = 7, table: Table = Table()
) -> Iterator[View]:
    """Yield fields all over the table from all distances and elevations, n by n to a pitch."""
    across, along = (np.linspace(-pitch_m / 2, pitch_m / 2, n) for pitch_m in table.pitch_m)
    for distance_m in np.arange(nearest_m, furthest_m, 0.1):
        for elevation_deg in (90.0, 60.0, 45.0, 37.0, LOWEST_DEG):
            for azimuth_deg in (0.0, 22.5, 45.0):
                for centre_m in itertools.product(across, along):
                    yield View(float(distance_m), elevation_deg, azimuth_deg, centre_m)
