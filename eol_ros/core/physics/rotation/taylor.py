# SPDX-License-Identifier: Apache-2.0
"""Power series of blocks that rotate as they slide, springs fixed to them at lever arms.

A square of side w under even pressure can bear a force F and a torque T as long as
(F / F_s)^2 + (T / (c F_s))^2 <= 1, c = 0.3826 w its points' mean distance from the centre: the
ellipsoidal limit surface (Goyal, Ruina and Papadopoulos, Wear 143, 1991; Howe and Cutkosky, Int. J.
Robotics Research 15, 1996), to which the sliding velocity is normal. With s = c theta as a third
coordinate that is Coulomb friction in three dimensions, F_k against V = (vx, vy, c omega), of a
block whose mass along s is I / c^2 = 1.1386 m.
"""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.elementary_kernels import sin
from eol_ros.core.lanes import doubles, fma, less, put, splat_double, take
from eol_ros.core.physics.event.taylor import TINY
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import inlined, uncounted

WIDTH = doubles.width
LEVER = (math.sqrt(2.0) + math.asinh(1.0)) / 6.0  # mean distance in a unit square from its centre


class RotationArgs(NamedTuple):
    """What rotation adds to a lattice."""

    lever: float  # c, m
    mass: np.ndarray  # (n, 3): m, m, I / c^2
    arm: np.ndarray  # (s, 2): where a spring is fixed to its first block, in the block's frame
    arm_j: np.ndarray  # (s, 2): to its second; not used at the rim


class Springs(NamedTuple):
    """Springs abreast: row k of an array of series is order k of all, row n of blocks is the rim.

    Springs beyond the lattice's fill the last vector; they stay zero.
    """

    ends: np.ndarray  # (n + 1, 4) x, y, cos(theta) - 1, sin(theta), of one order
    force: np.ndarray  # (n + 1, 4) x, y, sums of arm x force and arm . force, as in its frame
    dx: np.ndarray  # (size, s) along the springs
    dy: np.ndarray
    square: np.ndarray
    inverse: np.ndarray
    px: np.ndarray  # (size, s) their force
    py: np.ndarray
    second: np.ndarray  # (s,) row of its second end
    arms: np.ndarray  # (s, 4) to the first end, x and y, and to the second
    law: np.ndarray  # (2, s) stiffness and natural length
    co: np.ndarray  # (size, b) cos(theta) - 1
    si: np.ndarray
    across: np.ndarray  # (size, b) of `force`
    along: np.ndarray
    torque: np.ndarray  # (b,) of one order


class Series(NamedTuple):
    """Series along the last axis, for every block; those at rest have order 0 only."""

    a: np.ndarray  # (n, 3, size) x, y, s
    w: np.ndarray  # (n, 3, size) velocity, or for fresh blocks velocity / t
    square: np.ndarray  # (n, size)
    inverse: np.ndarray
    g: np.ndarray  # (n, 3, size) force, torque / c
    rim: np.ndarray  # (4, size) that of the springs on the rim; arm x and arm . force, too
    springs: Springs


def _whole(count: int) -> int:
    return -(-count // WIDTH) * WIDTH


def make_springs(at: Lattice, ra: RotationArgs, size: int) -> Springs:
    """Return the lanes of a lattice's springs, their rows 0..size - 1."""
    count, rim = len(at.k), at.second >= at.n
    b, s = _whole(at.n + 1), _whole(count)
    arms, law = np.zeros((count, 4)), np.zeros((2, s))
    arms[:, :2] = ra.arm
    arms[:, 2:] = ra.arm_j
    arms[rim, 2:] = at.anchors[at.second[rim] - at.n]
    law[0, :count], law[1, :count] = at.k, at.natural
    return Springs._make([
        *np.zeros((2, at.n + 1, 4)), *np.zeros((6, size, s)), np.minimum(at.second, at.n), arms,
        law, *np.zeros((4, size, b)), np.zeros(b),
    ])  # fmt: skip


def make_series(at: Lattice, ra: RotationArgs, order: int) -> Series:
    """Return the arrays for a lattice and the order of the series."""
    n, size = at.n, order + 2
    return Series._make([
        *np.zeros((2, n, 3, size)), *np.zeros((2, n, size)), np.zeros((n, 3, size)),
        np.zeros((4, size)), make_springs(at, ra, size),
    ])  # fmt: skip


@inlined
def spring_order(k, q, sp):
    """Do what `forces_order` does for k > 0 and WIDTH springs from q on.

    As `event.taylor.direction_order`; the sums stay in vector registers, which they do only if the
    loop over the terms is the inner one: what LLVM makes of a loop over springs passes each term
    through memory.
    """
    s = p = nx = ny = splat_double(0.0)
    half, one = splat_double(0.5 / k), splat_double(1.0)
    for j in range(1, k):
        x, y, r = take(sp.dx, j, q), take(sp.dy, j, q), take(sp.inverse, k - j, q)
        share = half * splat_double(j) - one
        s = fma(y, take(sp.dy, k - j, q), fma(x, take(sp.dx, k - j, q), s))
        p = fma(share * take(sp.square, j, q), r, p)
        nx, ny = fma(r, x, nx), fma(r, y, ny)
    x0, y0, r = take(sp.dx, 0, q), take(sp.dy, 0, q), take(sp.inverse, 0, q)
    x, y = take(sp.dx, k, q), take(sp.dy, k, q)
    s = fma(splat_double(2.0), fma(x0, x, y0 * y), s)
    p = fma(splat_double(-0.5), s * r, p) * (r * r)
    put(sp.square, k, q, s)
    put(sp.inverse, k, q, p)
    stiff, natural = take(sp.law, 0, q), take(sp.law, 1, q)
    nx, ny = fma(r, x, fma(p, x0, nx)), fma(r, y, fma(p, y0, ny))
    put(sp.px, k, q, stiff * less(x, natural, nx))
    put(sp.py, k, q, stiff * less(y, natural, ny))


@inlined
def forces_order(k, sp):
    """Write order k of geometric springs' force into sp.px and sp.py, from dx and dy."""
    if k > 0:
        for q in range(0, sp.law.shape[1], WIDTH):
            spring_order(k, q, sp)
        return
    for q in range(sp.law.shape[1]):
        length = sp.dx[0, q] * sp.dx[0, q] + sp.dy[0, q] * sp.dy[0, q]
        sp.square[0, q] = length
        sp.inverse[0, q] = 1.0 / np.sqrt(length) if length > TINY else 0.0
    for q in range(sp.law.shape[1]):
        pull = sp.law[0, q] * (1.0 - sp.law[1, q] * sp.inverse[0, q])
        sp.px[0, q], sp.py[0, q] = pull * sp.dx[0, q], pull * sp.dy[0, q]


@uncounted
def springs_order(k, sliding, at, ra, b, x, y, co, si):
    """Write order k of all forces on all blocks; x, y, co, si: that of the rim.

    With arms that rotate by theta the torque on a block is cos(theta) across - sin(theta) along:
    one product of series for a block, not one for each of its springs.
    """
    sp, n, ends, force = b.springs, at.n, b.springs.ends, b.springs.force
    for i in range(n):
        moves = k == 0 or sliding[i]
        ends[i, 0], ends[i, 1] = b.a[i, 0, k] if moves else 0.0, b.a[i, 1, k] if moves else 0.0
        ends[i, 2], ends[i, 3] = sp.co[k, i], sp.si[k, i]
    ends[n, 0], ends[n, 1], ends[n, 2], ends[n, 3] = x, y, co, si
    for i in range(n + 1):
        for p in range(4):
            force[i, p] = 0.0
    dx, dy, px, py, arms = sp.dx, sp.dy, sp.px, sp.py, sp.arms
    for e in range(len(at.k)):
        i, j = at.first[e], sp.second[e]
        ax, ay, bx, by = arms[e, 0], arms[e, 1], arms[e, 2], arms[e, 3]
        c, s = ends[j, 2], ends[j, 3]
        far_x, far_y = ends[j, 0] + c * bx - s * by, ends[j, 1] + s * bx + c * by
        c, s = ends[i, 2], ends[i, 3]
        dx[k, e] = far_x - (ends[i, 0] + c * ax - s * ay)
        dy[k, e] = far_y - (ends[i, 1] + s * ax + c * ay)
        if at.geometric and k == 0:
            dx[0, e] += at.rest[e, 0]
            dy[0, e] += at.rest[e, 1]
    if at.geometric:
        forces_order(k, sp)
    else:
        for e in range(sp.law.shape[1]):
            px[k, e] = sp.law[0, e] * dx[k, e]
        for e in range(sp.law.shape[1]):
            py[k, e] = sp.law[0, e] * dy[k, e]
    for e in range(len(at.k)):
        i, j, fx, fy = at.first[e], sp.second[e], px[k, e], py[k, e]
        ax, ay, bx, by = arms[e, 0], arms[e, 1], arms[e, 2], arms[e, 3]
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += ax * fy - ay * fx
        force[i, 3] += ax * fx + ay * fy
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= bx * fy - by * fx
        force[j, 3] -= bx * fx + by * fy
    for i in range(n):
        sp.torque[i] = sp.across[k, i] = force[i, 2]
        sp.along[k, i] = force[i, 3]
    for q in range(k + 1):
        for i in range(n):
            more = sp.co[q, i] * sp.across[k - q, i] - sp.si[q, i] * sp.along[k - q, i]
            sp.torque[i] += more
    for i in range(n):
        b.g[i, 0, k], b.g[i, 1, k] = force[i, 0], force[i, 1]
        b.g[i, 2, k] = sp.torque[i] / ra.lever
    for p in range(4):
        b.rim[p, k] = -force[n, p]


@inlined
def direction3(k, i, b, n):
    """Write order k of the square and inverse length of w, and of its direction into n."""
    w, square, inverse = b.w, b.square, b.inverse
    if k == 0:
        s = w[i, 0, 0] ** 2 + w[i, 1, 0] ** 2 + w[i, 2, 0] ** 2
        square[i, 0] = s
        inverse[i, 0] = 1.0 / math.sqrt(s) if s > 0.0 else 0.0
        for p in range(3):
            n[p] = inverse[i, 0] * w[i, p, 0]
        return
    x0, y0, z0, r0 = w[i, 0, 0], w[i, 1, 0], w[i, 2, 0], inverse[i, 0]
    xk, yk, zk = w[i, 0, k], w[i, 1, k], w[i, 2, k]
    s, sx, sy, sz = 2.0 * (x0 * xk + y0 * yk + z0 * zk), 0.0, 0.0, 0.0
    r = nx = ny = nz = 0.0
    half = 0.5 / k
    for j in range(1, k):  # sums side by side, so that none waits for another
        xj, yj, zj, rj = w[i, 0, j], w[i, 1, j], w[i, 2, j], inverse[i, k - j]
        sx += xj * w[i, 0, k - j]
        sy += yj * w[i, 1, k - j]
        sz += zj * w[i, 2, k - j]
        r += (half * j - 1.0) * square[i, j] * rj
        nx += rj * xj
        ny += rj * yj
        nz += rj * zj
    s += sx + sy + sz
    r = (r - 0.5 * s * r0) * r0 * r0
    square[i, k], inverse[i, k] = s, r
    n[0] = nx + r0 * xk + r * x0
    n[1] = ny + r0 * yk + r * y0
    n[2] = nz + r0 * zk + r * z0


@uncounted
def start_rate(force, friction, mass, out):
    """Write how a block at rest begins to move: m_p w_p = force_p - friction w_p / |w|.

    With l = friction / |w|, w_p = force_p / (m_p + l); l is the root of a rising function.
    """
    low, high = 0.0, 1e30
    rate = mass[0]
    for _ in range(200):
        total = slope = 0.0
        for p in range(3):
            part = rate * force[p] / (mass[p] + rate)
            total += part * part
            slope += 2.0 * part * force[p] * mass[p] / (mass[p] + rate) ** 2
        gap = total - friction * friction
        if gap > 0.0:
            high = rate
        else:
            low = rate
        step = rate - gap / slope if slope > 0.0 else high
        if not low < step < high:
            step = 0.5 * (low + high) if high < 1e30 else 2.0 * rate
        if abs(step - rate) <= 4e-16 * rate:
            break
        rate = step
    for p in range(3):
        out[p] = force[p] / (mass[p] + rate) if friction > 0.0 else force[p] / mass[p]


@inlined
def slide_order(k, i, is_fresh, friction, mass, b, n):
    """Write order k + 2 of the motion of block i from order k of its forces."""
    if not is_fresh:
        for p in range(3):
            b.w[i, p, k] = (k + 1) * b.a[i, p, k + 1]
        direction3(k, i, b, n)
        for p in range(3):
            pull = b.g[i, p, k] - friction * n[p]
            b.a[i, p, k + 2] = pull / (mass[i, p] * (k + 1) * (k + 2))
        return
    if k == 0:
        for p in range(3):
            n[p] = b.g[i, p, 0]
        start_rate(n, friction, mass[i], n[3:])
        for p in range(3):
            b.w[i, p, 0] = n[3 + p]
        direction3(0, i, b, n)
    else:  # (k + 1) m w_k + friction dn/dw w_k = the rest: diagonal less a dyad
        for p in range(3):
            b.w[i, p, k] = 0.0
        direction3(k, i, b, n)
        r0 = b.inverse[i, 0]
        beta = friction * r0
        over = under = 0.0
        for p in range(3):
            o = b.w[i, p, 0] * r0
            n[3 + p] = 1.0 / ((k + 1) * mass[i, p] + beta)
            n[p] = (b.g[i, p, k] - friction * n[p]) * n[3 + p]
            over += o * n[p]
            under += o * o * n[3 + p]
        over *= beta / (1.0 - beta * under)
        more = 0.0
        for p in range(3):
            b.w[i, p, k] = n[p] + over * n[3 + p] * b.w[i, p, 0] * r0
            more += 2.0 * b.w[i, p, 0] * b.w[i, p, k]
        b.square[i, k] += more
        b.inverse[i, k] -= 0.5 * more * r0**3
    for p in range(3):
        b.a[i, p, k + 2] = b.w[i, p, k] / (k + 2)


@uncounted
def start_series(q, v, sliding, moved, ra, b):
    """Write places and velocities of what slides or has moved since they were written."""
    for i in range(len(q)):
        if sliding[i] or moved[i]:
            theta = q[i, 2] / ra.lever
            half = sin(0.5 * theta)
            b.springs.co[0, i], b.springs.si[0, i] = -2.0 * half * half, sin(theta)
            for p in range(3):
                b.a[i, p, 0], b.a[i, p, 1] = q[i, p], v[i, p]


@uncounted
def rotating_series(order, sliding, fresh, at, ra, b, cx, cy, cc, cs, n):
    """Write the series of all that moves, and of the forces on all blocks to order - 2.

    Places, velocities and the forces of now are there already.
    """
    co, si = b.springs.co, b.springs.si
    for k in range(order - 1):
        if k > 0:
            for i in range(at.n):
                s = c = 0.0
                for j in range(1, k + 1 if sliding[i] else 0):
                    rate = j * b.a[i, 2, j] / ra.lever
                    c -= rate * si[k - j, i]
                    s += rate * (co[k - j, i] + (1.0 if j == k else 0.0))
                co[k, i], si[k, i] = c / k, s / k
            springs_order(k, sliding, at, ra, b, cx[k], cy[k], cc[k], cs[k])
        for i in range(at.n):
            if sliding[i]:
                slide_order(k, i, fresh[i], at.friction[i], ra.mass, b, n)
