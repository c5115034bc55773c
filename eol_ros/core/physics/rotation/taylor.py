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

from eol_ros.core.physics.event.taylor import direction_order
from eol_ros.core.physics.kernel_args import Lattice
from eol_ros.core.physics.series import inlined, uncounted

LEVER = (math.sqrt(2.0) + math.asinh(1.0)) / 6.0  # mean distance in a unit square from its centre


class RotationArgs(NamedTuple):
    """What rotation adds to a lattice."""

    lever: float  # c, m
    mass: np.ndarray  # (n, 3): m, m, I / c^2
    arm: np.ndarray  # (s, 2): where a spring is fixed to its first block, in the block's frame
    arm_j: np.ndarray  # (s, 2): to its second; not used at the rim


class Series(NamedTuple):
    """Series along the last axis, for every block and spring; those at rest have order 0 only."""

    a: np.ndarray  # (n, 3, size) x, y, s
    co: np.ndarray  # (n, size) cos(theta) - 1
    si: np.ndarray
    w: np.ndarray  # (n, 3, size) velocity, or for fresh blocks velocity / t
    square: np.ndarray
    inverse: np.ndarray
    g: np.ndarray  # (n, 3, size) force, torque / c
    across: np.ndarray  # (n, size) sum of arm x force of its springs, the arms as in its frame
    along: np.ndarray  # (n, size) sum of arm . force
    dx: np.ndarray  # (s, size) along the springs
    dy: np.ndarray
    d_square: np.ndarray
    d_inverse: np.ndarray
    fx: np.ndarray  # their force
    fy: np.ndarray


def make_series(at: Lattice, order: int) -> Series:
    """Return the arrays for a lattice and the order of the series."""
    n, s, size = at.n, len(at.k), order + 2
    return Series(
        np.zeros((n, 3, size)),
        np.zeros((n, size)),
        np.zeros((n, size)),
        np.zeros((n, 3, size)),
        np.zeros((n, size)),
        np.zeros((n, size)),
        np.zeros((n, 3, size)),
        np.zeros((n, size)),
        np.zeros((n, size)),
        np.zeros((s, size)),
        np.zeros((s, size)),
        np.zeros((s, size)),
        np.zeros((s, size)),
        np.zeros((s, size)),
        np.zeros((s, size)),
    )


@inlined
def end_of(i, k, ax, ay, b):
    """Return order k of the displacement of a point of block i, given in its frame."""
    x = b.a[i, 0, k] + b.co[i, k] * ax - b.si[i, k] * ay
    return x, b.a[i, 1, k] + b.si[i, k] * ax + b.co[i, k] * ay


@inlined
def add_pull(i, k, side, e, ax, ay, b):
    """Add order k of the force of spring e to block i."""
    fx, fy = side * b.fx[e, k], side * b.fy[e, k]
    b.g[i, 0, k] += fx
    b.g[i, 1, k] += fy
    b.across[i, k] += ax * fy - ay * fx
    b.along[i, k] += ax * fx + ay * fy


@inlined
def add_torque(i, k, moves, lever, b):
    """Write order k of the torque on block i.

    With arms that rotate by theta the torque is cos(theta) across - sin(theta) along: one product
    of series for a block, not one for each of its springs.
    """
    torque = b.across[i, k]
    for q in range(k + 1 if moves else 1):
        torque += b.co[i, q] * b.across[i, k - q] - b.si[i, q] * b.along[i, k - q]
    b.g[i, 2, k] = torque / lever


@uncounted
def springs_order(k, sliding, driven, at, ra, b, x, y, co, si):
    """Write order k of all forces on all blocks; x, y, co, si: that of the rim."""
    for i in range(at.n):
        b.g[i, 0, k] = b.g[i, 1, k] = b.across[i, k] = b.along[i, k] = 0.0
    for e in range(len(at.k)):
        i, j = at.first[e], at.second[e]
        rim = j >= at.n
        if k > 0 and not (sliding[i] or (driven if rim else sliding[j])):
            continue
        ax, ay, bx, by = ra.arm[e, 0], ra.arm[e, 1], ra.arm_j[e, 0], ra.arm_j[e, 1]
        dx = dy = 0.0
        if rim:
            px, py = at.anchors[j - at.n, 0], at.anchors[j - at.n, 1]
            dx, dy = x + co * px - si * py, y + si * px + co * py
        elif k == 0 or sliding[j]:
            dx, dy = end_of(j, k, bx, by, b)
        if k == 0 or sliding[i]:
            px, py = end_of(i, k, ax, ay, b)
            dx, dy = dx - px, dy - py
        if k == 0 and at.geometric:
            dx, dy = dx + at.rest[e, 0], dy + at.rest[e, 1]
        b.dx[e, k], b.dy[e, k] = dx, dy
        if at.geometric and at.natural[e] > 0.0:
            nx, ny = direction_order(k, e, b.dx, b.dy, b.d_square, b.d_inverse)
            dx, dy = dx - at.natural[e] * nx, dy - at.natural[e] * ny
        b.fx[e, k], b.fy[e, k] = at.k[e] * dx, at.k[e] * dy
        add_pull(i, k, 1.0, e, ax, ay, b)
        if not rim:
            add_pull(j, k, -1.0, e, bx, by, b)
    for i in range(at.n):
        add_torque(i, k, sliding[i], ra.lever, b)


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
def rotating_series(order, q, v, sliding, fresh, driven, at, ra, b, cx, cy, cc, cs, n):
    """Write the series of all that moves, and of the forces on all blocks to order - 2."""
    for i in range(at.n):
        theta = q[i, 2] / ra.lever
        half = math.sin(0.5 * theta)
        b.co[i, 0], b.si[i, 0] = -2.0 * half * half, math.sin(theta)
        for p in range(3):
            b.a[i, p, 0], b.a[i, p, 1] = q[i, p], v[i, p]
    for k in range(order - 1):
        for i in range(at.n):
            if sliding[i] and k > 0:
                s = c = 0.0
                for j in range(1, k + 1):
                    rate = j * b.a[i, 2, j] / ra.lever
                    c -= rate * b.si[i, k - j]
                    s += rate * (b.co[i, k - j] + (1.0 if j == k else 0.0))
                b.co[i, k], b.si[i, k] = c / k, s / k
        springs_order(k, sliding, driven, at, ra, b, cx[k], cy[k], cc[k], cs[k])
        for i in range(at.n):
            if sliding[i]:
                slide_order(k, i, fresh[i], at.friction[i], ra.mass, b, n)
