# SPDX-License-Identifier: Apache-2.0
"""Power series of sliding blocks with their lanes abreast, friction given as a polynomial in time.

Row k of every array is order k of all lanes, x before y, so that a processor takes eight lanes at a
time (core/vectors.py); `event.taylor` has the orders of a lane side by side and is quicker where
few blocks slide.
"""

from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.event.taylor import TINY, force_on, spring_vector
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import inlined, uncounted
from eol_ros.core.vectors import WIDTH, spring_order

TIES = 4  # of a block's ties are taken together


class Abreast(NamedTuple):
    """The series; the last block lane stands for all that is at rest and stays zero."""

    a: np.ndarray  # (size, 2 b) displacement
    push: np.ndarray  # (size, 2 b) acceleration by friction
    extra: np.ndarray  # (size, 2 b) acceleration that came to be known late, and what it moves
    reply: np.ndarray
    force: np.ndarray  # (2 b,) of one order
    dx: np.ndarray  # (size, s) along the springs
    dy: np.ndarray
    square: np.ndarray  # (size, s)
    inverse: np.ndarray  # (size, s)
    px: np.ndarray  # (size, s) force of the springs on their first ends
    py: np.ndarray
    first: np.ndarray  # (s,) lanes of their ends, unsigned: no index counts from the end
    second: np.ndarray
    ties: np.ndarray  # (groups, b, TIES) what pulls at each block: geometric springs, else blocks;
    share: np.ndarray  # (groups, b, TIES) its sign or stiffness, 0 where there is none
    own: np.ndarray  # (b,) stiffness of all linear springs of a block
    law: np.ndarray  # (2, s) stiffness and natural length of the springs
    work: np.ndarray  # (4, s)
    inverse_mass: np.ndarray  # (b,)


def _wide(count: int) -> int:
    return -(-count // WIDTH) * WIDTH


def make_abreast(at: Lattice, size: int) -> Abreast:
    """Return lanes for a lattice and rows 0..size - 1."""
    b, s = _wide(at.n + 1), 0
    most = int(np.max(np.diff(at.lo) + np.diff(at.rim_lo), initial=0))
    groups = -(-most // TIES)
    if at.geometric:
        s = _wide(len(at.k) + 1)
    return Abreast(
        np.zeros((size, 2 * b)),
        np.zeros((size, 2 * b)),
        np.zeros((size, 2 * b)),
        np.zeros((size, 2 * b)),
        np.zeros(2 * b),
        np.zeros((size, s)),
        np.zeros((size, s)),
        np.zeros((size, s)),
        np.zeros((size, s)),
        np.zeros((size, s)),
        np.zeros((size, s)),
        np.zeros(s, np.uint64),
        np.zeros(s, np.uint64),
        np.zeros((groups, b, TIES), np.uint64),
        np.zeros((groups, b, TIES)),
        np.zeros(b),
        np.zeros((2, s)),
        np.zeros((4, s)),
        np.zeros(b),
    )


@uncounted
def fill_abreast(m, count, at, pl, ab):
    """Take constants of the sliding blocks and their springs into their lanes."""
    lanes, springs = len(ab.inverse_mass), ab.law.shape[1]
    for c in range(lanes):
        ab.inverse_mass[c] = at.inverse[pl.slots[c]] if c < m else 0.0
        ab.own[c] = at.k_sum[pl.slots[c]] if c < m else 0.0
        for p in range(TIES * len(ab.ties)):
            ab.ties[p // TIES, c, p % TIES], ab.share[p // TIES, c, p % TIES] = 0, 0.0
    if at.geometric:
        for q in range(springs):
            used = q < count
            ab.first[q] = pl.act_first[q] if used and pl.act_first[q] >= 0 else lanes - 1
            ab.second[q] = pl.act_second[q] if used and pl.act_second[q] >= 0 else lanes - 1
            ab.law[0, q] = at.k[pl.act[q]] if used else 0.0
            ab.law[1, q] = at.natural[pl.act[q]] if used else 0.0
        for q in range(count):
            for end in range(2):
                c = pl.act_first[q] if end == 0 else pl.act_second[q]
                if c >= 0:
                    p = 0
                    while ab.share[p // TIES, c, p % TIES] != 0.0:
                        p += 1
                    ab.ties[p // TIES, c, p % TIES] = q
                    ab.share[p // TIES, c, p % TIES] = 1.0 - 2.0 * end
    else:
        for c in range(m):
            for e in range(pl.tie_lo[c], pl.tie_lo[c + 1]):
                p = e - pl.tie_lo[c]
                ab.ties[p // TIES, c, p % TIES] = pl.tie[e]
                ab.share[p // TIES, c, p % TIES] = pl.tie_k[e]
    for k in range(len(ab.a)):
        for c in range(2 * lanes):
            ab.a[k, c] = ab.push[k, c] = 0.0
        for q in range(springs):
            ab.dx[k, q] = ab.dy[k, q] = 0.0
    for q in range(springs):
        ab.dx[0, q] = 1.0  # where there is no spring, a length that can be divided by


@inlined
def add_ties(m, half, x, y, ab):
    """Add to the force on the blocks what their ties pull; halves of ab.force, from 0 and `half`.

    `x` and `y` are of springs, or of blocks.
    """
    force, ties, share = ab.force, ab.ties, ab.share
    for c in range(m):
        fx, fy = force[c], force[half + c]
        for p in range(len(ties)):
            i, j, k, l = ties[p, c, 0], ties[p, c, 1], ties[p, c, 2], ties[p, c, 3]  # noqa: E741
            a, b, d, e = share[p, c, 0], share[p, c, 1], share[p, c, 2], share[p, c, 3]
            fx += (a * x[i] + b * x[j]) + (d * x[k] + e * x[l])
            fy += (a * y[i] + b * y[j]) + (d * y[k] + e * y[l])
        force[c], force[half + c] = fx, fy


@inlined
def forces_order(k, ab):
    """Write order k of geometric springs' force into ab.px and ab.py, from dx and dy."""
    if k > 0:
        spring_order(k, ab.dx, ab.dy, ab.square, ab.inverse, ab.law, ab.px, ab.py)
        return
    for q in range(ab.law.shape[1]):
        length = ab.dx[0, q] * ab.dx[0, q] + ab.dy[0, q] * ab.dy[0, q]
        ab.square[0, q] = length
        ab.inverse[0, q] = 1.0 / np.sqrt(length) if length > TINY else 0.0
    for q in range(ab.law.shape[1]):
        pull = ab.law[0, q] * (1.0 - ab.law[1, q] * ab.inverse[0, q])
        ab.px[0, q], ab.py[0, q] = pull * ab.dx[0, q], pull * ab.dy[0, q]


@inlined
def springs_abreast(k, m, count, used, u, at, pl, ab, x0, y0, co, si):
    """Write order k of the springs and of the force on the blocks."""
    s, lanes = ab.law.shape[1], len(ab.inverse_mass)
    if k == 0:
        for q in range(count):
            ab.dx[0, q], ab.dy[0, q] = spring_vector(pl.act[q], u, at, x0, y0, co, si)
    else:
        ends = ab.a[k]
        for q in range(s):
            ab.dx[k, q] = ends[ab.second[q]] - ends[ab.first[q]]
        ends = ends[lanes:]
        for q in range(s):
            ab.dy[k, q] = ends[ab.second[q]] - ends[ab.first[q]]
        if k <= used:
            for q in range(count):
                anchor = pl.act_anchor[q]
                if anchor >= 0:
                    ax, ay = at.anchors[anchor, 0], at.anchors[anchor, 1]
                    ab.dx[k, q] += x0 + co * ax - si * ay
                    ab.dy[k, q] += y0 + si * ax + co * ay
    forces_order(k, ab)
    for c in range(2 * lanes):
        ab.force[c] = 0.0
    add_ties(m, lanes, ab.px[k], ab.py[k], ab)


@inlined
def linear_abreast(k, m, used, u, at, pl, ab, x, y, co, si):
    """Write order k of the linear springs' force on the blocks."""
    lanes, force = len(ab.inverse_mass), ab.force
    if k == 0:
        for c in range(m):
            force[c], force[lanes + c] = force_on(pl.slots[c], u, at, x, y, co, si)
        return
    linear_reply(m, ab.a[k], ab)
    if k <= used:
        for c in range(m):
            i = pl.slots[c]
            force[c] += at.drive[i, 0] * x + at.drive[i, 1] * co - at.drive[i, 2] * si
            force[lanes + c] += at.drive[i, 0] * y + at.drive[i, 1] * si + at.drive[i, 2] * co


@inlined
def linear_reply(m, row, ab):
    """Write the linear springs' force on blocks that are displaced by `row`."""
    lanes, force = len(ab.inverse_mass), ab.force
    for c in range(lanes):
        force[c] = -ab.own[c] * row[c]
    for c in range(lanes):
        force[lanes + c] = -ab.own[c] * row[lanes + c]
    add_ties(m, lanes, row, row[lanes:], ab)


@uncounted
def forced_series(order, degree, m, count, u, v, used, at, pl, ab, cx, cy, cc, cs):
    """Write the displacement series under springs and the friction ab.push of that degree."""
    lanes, a, force = len(ab.inverse_mass), ab.a, ab.force
    for c in range(m):
        i = pl.slots[c]
        a[0, c], a[0, lanes + c] = u[i, 0], u[i, 1]
        a[1, c], a[1, lanes + c] = v[i, 0], v[i, 1]
    for k in range(order - 1):
        if at.geometric:
            springs_abreast(k, m, count, used, u, at, pl, ab, cx[k], cy[k], cc[k], cs[k])
        else:
            linear_abreast(k, m, used, u, at, pl, ab, cx[k], cy[k], cc[k], cs[k])
        if at.rail:
            for c in range(lanes):
                force[lanes + c] = 0.0
        scale = 1.0 / ((k + 1) * (k + 2))
        if k <= degree:
            for c in range(lanes):
                a[k + 2, c] = (force[c] * ab.inverse_mass[c] + ab.push[k, c]) * scale
            for c in range(lanes, 2 * lanes):
                a[k + 2, c] = (force[c] * ab.inverse_mass[c - lanes] + ab.push[k, c]) * scale
        else:
            for c in range(lanes):
                a[k + 2, c] = force[c] * ab.inverse_mass[c] * scale
            for c in range(lanes, 2 * lanes):
                a[k + 2, c] = force[c] * ab.inverse_mass[c - lanes] * scale


@uncounted
def add_reply(last, m, at, ab):
    """Add to rows 2..`last` of the series what ab.extra moves; springs as at the start."""
    lanes, s = len(ab.inverse_mass), ab.law.shape[1]
    reply, force, w = ab.reply, ab.force, ab.work
    for k in range(last - 1):
        if k < 2 or at.geometric:
            for c in range(2 * lanes):
                force[c] = 0.0
        if k >= 2 and at.geometric:
            ends = reply[k]
            for q in range(s):
                w[0, q] = ends[ab.second[q]] - ends[ab.first[q]]
            ends = ends[lanes:]
            for q in range(s):
                w[1, q] = ends[ab.second[q]] - ends[ab.first[q]]
            for q in range(s):
                r = ab.inverse[0, q]
                along = r * r * (ab.dx[0, q] * w[0, q] + ab.dy[0, q] * w[1, q])
                bend = ab.law[1, q] * r
                w[2, q] = ab.law[0, q] * (w[0, q] - bend * (w[0, q] - along * ab.dx[0, q]))
            for q in range(s):
                r = ab.inverse[0, q]
                along = r * r * (ab.dx[0, q] * w[0, q] + ab.dy[0, q] * w[1, q])
                bend = ab.law[1, q] * r
                w[3, q] = ab.law[0, q] * (w[1, q] - bend * (w[1, q] - along * ab.dy[0, q]))
            add_ties(m, lanes, w[2], w[3], ab)
        elif k >= 2:
            linear_reply(m, reply[k], ab)
        scale = 1.0 / ((k + 1) * (k + 2))
        for c in range(lanes):
            reply[k + 2, c] = (force[c] * ab.inverse_mass[c] + ab.extra[k, c]) * scale
        for c in range(lanes, 2 * lanes):
            rail = 0.0 if at.rail else force[c]
            reply[k + 2, c] = (rail * ab.inverse_mass[c - lanes] + ab.extra[k, c]) * scale
        for c in range(2 * lanes):
            ab.a[k + 2, c] += reply[k + 2, c]


@uncounted
def forced_reach(order, ab, small, top):
    """Return the step at which the last two terms fall to `small` (m)."""
    h = top
    for k in range(order - 1, order + 1):
        most = 0.0
        for c in range(2 * len(ab.inverse_mass)):
            most = max(most, abs(ab.a[k, c]))
        if most > 0.0:
            h = min(h, (small / most) ** (1.0 / k))
    return h


@uncounted
def into_lanes(order, m, count, springs, ab, pl):
    """Copy the series to where the event path looks for them; the springs' where asked for."""
    lanes = len(ab.inverse_mass)
    if springs:
        for q in range(count):
            for k in range(order - 1):
                pl.px[q, k], pl.py[q, k] = ab.px[k, q], ab.py[k, q]
        return
    for c in range(m):
        for k in range(order + 1):
            pl.ax[c, k], pl.ay[c, k] = ab.a[k, c], ab.a[k, lanes + c]
