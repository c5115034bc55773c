# SPDX-License-Identifier: Apache-2.0
"""Where the lattice of blocks lies in an image, from nothing.

The response at each place of a grid on the table is by how much a square of a block's size differs
from the ring around it. Blocks stray from the nodes of their lattice by centimetres, so a node
takes the greatest response within that distance. The lattice lies where the sum over its nodes
is greatest.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from eol_ros.core.compiled import njit
from eol_ros.core.elementary_kernels import cos, sin
from eol_ros.core.table import Table
from eol_ros.core.vision.appearance.model import (
    ANGLES,
    CLIP,
    GAP,
    INNER,
    RING,
    TURNS,
    Lengths,
)  # fmt: skip
from eol_ros.core.vision.calibration.mapping import to_pixel

QUARTER = math.pi / 2


@njit(cache=True)
def noise_by_level(image, out):
    """Fill out (2,): variance of a dark pixel and its growth by grey level; return that of most.

    It grows with light along a line, as shot noise does. From second differences along rows, whose
    median hardly sees edges; levels that only edges have say too much: the least slope counts.
    """
    counts, found = np.zeros((32, 128), np.int64), np.zeros(32)
    for r in range(2, image.shape[0] - 2, 7):
        for q in range(2, image.shape[1] - 2, 3):
            d = 2.0 * image[r, q] - image[r, q - 1] - image[r, q + 1]
            # by the level of others: its own would hide how far noise takes it
            level = int((image[r, q - 2] * 1.0 + image[r, q + 2]) / 16)
            counts[level, int(min(abs(d), 127.0))] += 1
    most, at = 0, 0
    for k in range(32):
        total = counts[k].sum()
        if total > most:
            most, at = total, k
        if total < 400:
            continue
        need, level = total // 2, 0
        while need >= counts[k, level]:
            need, level = need - counts[k, level], level + 1
        part = (need + 0.5) / max(counts[k, level], 1)
        # a second difference has six variances, the median of its size is 0.6745 sigma
        found[k] = (max(level - 0.5 + part, 0.0) / 0.6745) ** 2 / 6
    dark, slope = max(found[at], 1.0 / 12), np.inf
    for k in range(at + 3, 32):
        if found[k] > 0.0:
            slope = min(slope, max(found[k] - dark, 0.0) / (k - at))
    if slope == np.inf:
        slope = 0.0
    out[0], out[1] = dark - slope * (at + 0.5), slope / 8  # levels come by eights
    return dark


def _samples() -> np.ndarray:
    """Return samples (2, SAMPLES) in half sides: of a square, then of the sides of its ring."""
    inner = 0.8 * (2 * np.arange(INNER) / (INNER - 1) - 1)
    along, far = 0.9 * (2 * np.arange(RING) / (RING - 1) - 1), np.full(RING, 1.0 + 2 * GAP)
    a = np.concatenate([np.repeat(inner, INNER), far, along, -far, along])
    return np.stack([a, np.concatenate([np.tile(inner, INNER), along, far, along, -far])])


A, B = _samples()
SAMPLES = len(A)


@njit(cache=True)
def _stands_out(image, u, v, ua, va, ub, vb, noise, at):
    """Return 0 to 1: how a parallelogram of half axes (ua, va), (ub, vb) differs from its ring.

    at (SAMPLES,): scratch.
    """
    rows, cols = image.shape
    reach_u, reach_v = 1.3 * (abs(ua) + abs(ub)), 1.3 * (abs(va) + abs(vb))
    if u < reach_u or v < reach_v or u + reach_u > cols - 1 or v + reach_v > rows - 1:
        return 0.0
    width = np.int32(cols)
    for n in range(SAMPLES):  # by itself, so that it vectorises
        row = np.int32(v + A[n] * va + B[n] * vb + 0.5)
        at[n] = row * width + np.int32(u + A[n] * ua + B[n] * ub + 0.5)
    flat, total = image.reshape(-1), 0
    for n in range(INNER * INNER):
        total += flat[at[n]]
    inner = total / (INNER * INNER)
    least, mean = CLIP, 0.0
    for side in range(4):
        ring = square = 0
        for n in range(RING):
            p = int(flat[at[INNER * INNER + side * RING + n]])
            ring += p
            square += p * p
        level = ring / RING
        scatter = max(square / RING - level * level, 0.0)
        z = min(max((inner - level) / math.sqrt((noise + scatter) / RING + 1.0), 0.0), CLIP)
        mean += z / 4
        least = min(least, z)
    return (mean + least) / (2 * CLIP)


@njit(cache=True)
def respond(image, c, lengths, x0, y0, noise, first, turns, step, out, angle):
    """Fill out, angle (ny, nx): the greatest response of `turns` angles at each place of a grid."""
    half_m, angles = lengths.half_side, first + step * np.arange(turns)
    at = np.empty(SAMPLES, np.int32)
    cosines = np.array([cos(theta) for theta in angles])
    sines = np.array([sin(theta) for theta in angles])
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = x0 + j * lengths.cell, y0 + i * lengths.cell
            out[i, j] = angle[i, j] = 0.0
            u, v = to_pixel(c, x, y)
            if not (0 <= u < image.shape[1] and 0 <= v < image.shape[0]):
                continue
            ur, vr = to_pixel(c, x + half_m, y)
            ut, vt = to_pixel(c, x, y + half_m)
            du, dv, eu, ev = ur - u, vr - v, ut - u, vt - v
            for k in range(turns):
                cs, sn = cosines[k], sines[k]
                ua, va, ub, vb = (
                    cs * du + sn * eu,
                    cs * dv + sn * ev,
                    cs * eu - sn * du,
                    cs * ev - sn * dv,
                )
                r = _stands_out(image, u, v, ua, va, ub, vb, noise, at)
                if r > out[i, j]:
                    out[i, j], angle[i, j] = r, angles[k]


@njit(cache=True)
def _best(pool, x0, rest, lengths, span, best):
    """Fill best (4,): mean response, x, y, angle of the lattice `rest` (n, 2) that gathers most.

    Tries angles below `span`, the period of the lattice.
    """
    ny, nx = pool.shape
    cell = lengths.cell
    n, origin, reach = rest.shape[0], int(round(-x0 / cell)), int(lengths.centre / cell)
    angles = int(round(ANGLES * span / QUARTER))
    dx, dy = np.empty(n, np.int64), np.empty(n, np.int64)
    best[0] = -1.0
    for k in range(angles):
        theta = span * k / angles
        c, s = cos(theta), sin(theta)
        for i in range(n):
            dx[i] = int(round((c * rest[i, 0] - s * rest[i, 1]) / cell))
            dy[i] = int(round((s * rest[i, 0] + c * rest[i, 1]) / cell))
        for p in range(-reach, reach + 1, 2):
            for q in range(-reach, reach + 1, 2):
                total = np.float32(0.0)
                for i in range(n):
                    r, t = origin + p + dy[i], origin + q + dx[i]
                    if 0 <= r < ny and 0 <= t < nx:
                        total += pool[r, t]
                if total > best[0] * n:
                    best[0], best[1], best[2], best[3] = total / n, q * cell, p * cell, theta


@njit(cache=True)
def _nodes(response, angle, x0, rest, best, lengths, out):
    """Fill out (n, 3): x, y, angle of the place near each node that stands out most."""
    ny, nx = response.shape
    c, s = cos(best[3]), sin(best[3])
    cell = lengths.cell
    reach = int(math.ceil(1.6 * lengths.node_stray / cell))
    for i in range(rest.shape[0]):
        x = best[1] + c * rest[i, 0] - s * rest[i, 1]
        y = best[2] + s * rest[i, 0] + c * rest[i, 1]
        jc, ic = int(round((x - x0) / cell)), int(round((y - x0) / cell))
        out[i, 0], out[i, 1], out[i, 2] = x, y, best[3]
        top = -1.0
        for p in range(max(ic - reach, 0), min(ic + reach + 1, ny)):
            for q in range(max(jc - reach, 0), min(jc + reach + 1, nx)):
                # of two that stand out alike the one closer to the node
                r = response[p, q] - 0.05 * ((p - ic) ** 2 + (q - jc) ** 2) / reach**2
                if r > top:
                    top = r
                    out[i, 0], out[i, 1], out[i, 2] = x0 + q * cell, x0 + p * cell, angle[p, q]


class Lattice(NamedTuple):
    """A lattice found: nodes (n, 3) x, y in m and angle in rad; mean response; its own angle."""

    nodes: np.ndarray
    response: float
    angle: float


def find_lattice(image: np.ndarray, packed: np.ndarray, table: Table, noise: float) -> Lattice:
    """Return where the squares of a table lie, in order of its ids, up to its turns.

    image (h, w) uint8; packed: Calibration.packed(); noise: variance of a grey level.
    """
    lengths, rest = Lengths.of(table), table.rest[table.ids]
    n = 2 * int(math.ceil(lengths.reach / lengths.cell)) + 1
    x0 = -(n // 2) * lengths.cell
    response, angle = np.zeros((2, n, n), np.float32)
    step = QUARTER / TURNS
    respond(image, packed, lengths, x0, x0, noise, 0.0, TURNS, step, response, angle)
    reach = int(lengths.node_stray / lengths.cell)
    pool = np.pad(response, reach)
    for axis in (0, 1):
        pool = sliding_window_view(pool, 2 * reach + 1, axis).max(axis=-1)
    best, nodes = np.empty(4), np.empty((len(rest), 3))
    _best(pool, x0, rest, lengths, math.tau / len(table.turns), best)
    _nodes(response, angle, x0, rest, best, lengths, nodes)
    return Lattice(nodes, float(best[0]), float(best[3]))
