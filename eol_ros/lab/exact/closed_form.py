# SPDX-License-Identifier: Apache-2.0
"""Segments along x without series: one sliding block, and the modes of a stiff set."""

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.numerics import ON_LIMIT
from eol_ros.lab.exact.taylor import force_now

MARCH_ROUNDS = 400
SOFT = 1e-8  # of the highest w^2: below it eigenvalues have lost eight digits


class Lone(NamedTuple):
    """One block on its springs: x = side (e (1 - cos w t) + b t + q sin(w t) / w)."""

    side: float
    e: float
    b: float
    q: float
    w: float


@njit(cache=True, inner=True)
def lone_slip(i, sign, u, v, t, speed, at):
    """Return (motion, time until it stops or inf) of block i that alone slides."""
    force = force_now(i, u, at, speed * t)
    stiff = at.k_sum[i]
    w = math.sqrt(stiff * at.inverse[i])
    e = sign * (force - sign * at.friction[i]) / stiff
    b = sign * at.drive[i, 0] * speed / stiff
    q = sign * v[i] - b
    motion = Lone(sign, e, b, q, w)
    size = math.hypot(e * w, q)
    if size <= abs(b):
        return motion, np.inf
    phase = math.atan2(e * w, q)
    if v[i] == 0.0:
        phase *= 2.0
    else:
        phase += math.acos(-b / size)
    if phase <= 0.0:
        phase += 2.0 * math.pi
    return motion, phase / w


@njit(cache=True, inner=True)
def lone_state(motion, s):
    """Return displacement and speed at s."""
    angle = motion.w * s
    sine = math.sin(angle)
    half = math.sin(0.5 * angle)
    x = 2.0 * motion.e * half * half + motion.b * s + motion.q * sine / motion.w
    d = motion.e * motion.w * sine + motion.b + motion.q * (1.0 - 2.0 * half * half)
    return motion.side * x, motion.side * d


@njit(cache=True, inner=True)
def lone_path(motion, s):
    """Return the integral of the motion up to s."""
    angle = motion.w * s
    half = math.sin(0.5 * angle)
    path = motion.e * (s - math.sin(angle) / motion.w) + 0.5 * motion.b * s * s
    return motion.side * (path + motion.q * 2.0 * half * half / motion.w**2)


class Modes(NamedTuple):
    """Sliding blocks as oscillators: u = root * shape @ y, y'' = -w^2 y + p + r t."""

    w: np.ndarray
    shape: np.ndarray
    root: np.ndarray
    y: np.ndarray  # at the start
    d: np.ndarray
    p: np.ndarray
    r: np.ndarray
    a_most: np.ndarray  # bounds of each block's acceleration and of its rate
    j_most: np.ndarray


@njit(cache=True, inner=True)
def ties_of(m, at, la):
    """Return (rows, free): the springs of the m sliding blocks, and how many modes have none.

    rows (r, m), N/m under the root: with M^(-1/2) behind, their square is S. A set of blocks that
    springs tie to each other, and to nothing else, has one free mode.
    """
    label = np.arange(m)
    held, free, edges = np.zeros(m, np.bool_), 0, m
    for c in range(m):
        for j in range(c):
            if la.dense[c, j] > 0.0:
                edges += 1
                one, other = min(label[c], label[j]), max(label[c], label[j])
                for q in range(m):
                    if label[q] == other:
                        label[q] = one
    rows = np.zeros((edges, m))
    edges = m
    for c in range(m):
        i = la.slots[c]
        out = at.drive[i, 0]
        for e in range(at.lo[i], at.lo[i + 1]):
            if la.slot[at.near[e]] < 0:
                out += at.k_near[e]
        rows[c, c] = math.sqrt(out)
        held[label[c]] = held[label[c]] or out > 0.0
        for j in range(c):
            if la.dense[c, j] > 0.0:
                rows[edges, c] = math.sqrt(la.dense[c, j])
                rows[edges, j] = -rows[edges, c]
                edges += 1
    for c in range(m):
        free += label[c] == c and not held[c]
    return rows, free


@njit(cache=True, inner=True)
def modes_of(m, u, v, t, speed, h, at, la):
    """Return the modes of the m sliding blocks from the state at t, bounds valid for h."""
    root = np.sqrt(la.inverse[:m])
    s = np.empty((m, m))
    p, r = np.empty(m), np.empty(m)
    y, d = np.empty(m), np.empty(m)
    for c in range(m):
        i = la.slots[c]
        for j in range(m):
            s[c, j] = -la.dense[c, j] * root[c] * root[j]
        force = force_now(i, u, at, speed * t) - la.sign[c] * la.friction[c]
        p[c] = force * root[c]
        r[c] = at.drive[i, 0] * speed * root[c]
        y[c] = 0.0
        d[c] = v[i] / root[c]
    square, shape = np.linalg.eigh(s)
    w = np.sqrt(np.maximum(square, 0.0))
    if square[0] < SOFT * square[-1]:  # singular values of its root are more accurate
        rows, free = ties_of(m, at, la)
        if free < m and square[free] < SOFT * square[-1]:
            for c in range(m):
                rows[:, c] *= root[c]
            _, w, back = np.linalg.svd(rows, full_matrices=False)
            w, shape = w[::-1].copy(), back[::-1].T.copy()
        w[:free] = 0.0
    back = np.ascontiguousarray(shape.T)
    p, r, d = back @ p, back @ r, back @ d
    a_most, j_most = np.zeros(m), np.zeros(m)
    for k in range(m):
        if w[k] > 0.0:
            even, odd = p[k], w[k] * d[k] - r[k] / w[k]
            a, j = math.hypot(even, odd), math.hypot(even, odd) * w[k]
        else:
            a, j = abs(p[k]) + abs(r[k]) * h, abs(r[k])
        for c in range(m):
            a_most[c] += root[c] * abs(shape[c, k]) * a
            j_most[c] += root[c] * abs(shape[c, k]) * j
    return Modes(w, np.ascontiguousarray(shape), root, y, d, p, r, a_most, j_most)


@njit(cache=True, inner=True)
def modes_state(mo, s, m, x, d, a):
    """Write how far the lanes have moved since the start, their speed and acceleration at s."""
    y, yd, ya = np.empty(m), np.empty(m), np.empty(m)
    for k in range(m):
        w = mo.w[k]
        if w > 0.0:
            sine, half = math.sin(w * s), math.sin(0.5 * w * s)
            rise = 2.0 * half * half
            p, r, v = mo.p[k] / w, mo.r[k] / w, mo.d[k]
            # y = p (1 - cos)/w^2 + r (t - sin/w)/w^2 + v sin/w, differences kept small
            y[k] = (p * rise + r * (s - sine / w) + v * sine) / w
            yd[k] = p * sine + r * rise / w + v * (1.0 - rise)
            ya[k] = w * (p * (1.0 - rise) + r * sine / w - v * sine)
        else:
            y[k] = s * (mo.d[k] + s * (0.5 * mo.p[k] + s * mo.r[k] / 6.0))
            yd[k] = mo.d[k] + s * (mo.p[k] + 0.5 * s * mo.r[k])
            ya[k] = mo.p[k] + s * mo.r[k]
    shape = mo.shape
    for c in range(m):
        px = pd = pa = 0.0
        for k in range(m):
            px += shape[c, k] * y[k]
            pd += shape[c, k] * yd[k]
            pa += shape[c, k] * ya[k]
        x[c], d[c], a[c] = mo.root[c] * px, mo.root[c] * pd, mo.root[c] * pa


@njit(cache=True, inner=True)
def modes_path(mo, k, h):
    """Return the integral of mode k over the time h since the start."""
    w, p, r, d = mo.w[k], mo.p[k], mo.r[k], mo.d[k]
    if w == 0.0:
        return h * h * (0.5 * d + h * (p / 6.0 + h * r / 24.0))
    half = math.sin(0.5 * w * h)
    rise = 2.0 * half * half
    lag = h - math.sin(w * h) / w
    return (p * lag / w + r * (0.5 * h * h - rise / w**2) / w + d * rise / w) / w


@njit(cache=True, inner=True)
def safe_step(g, d, bound):
    """Return how far g > 0 with rate d cannot reach zero, |g''| <= bound."""
    reach = math.sqrt(d * d + 2.0 * bound * max(g, 0.0))
    if d < 0.0:
        return 2.0 * max(g, 0.0) / (reach - d)
    return (d + reach) / bound if bound > 0.0 else np.inf


@njit(cache=True, inner=True)
def march(mo, m, h, forces, speed, watched, count, at, la, x, d, a):
    """Return (time, kind, block): 2 a block stops, 3 one breaks, 0 nothing until then.

    All conditions are followed at once, each step the shortest that is safe for all.
    """
    s = 0.0
    for _ in range(MARCH_ROUNDS):
        modes_state(mo, s, m, x, d, a)
        step, who, kind = np.inf, -1, 0
        for c in range(m):
            if la.sign[c] == 0.0:
                continue
            if s == 0.0 and d[c] == 0.0 and la.sign[c] * a[c] <= 0.0:
                return 0.0, 0, -1
            near = safe_step(la.sign[c] * d[c], la.sign[c] * a[c], mo.j_most[c])
            if near < step:
                step, who, kind = near, la.slots[c], 2
        for p in range(count):
            j = watched[p]
            force = forces[p] + at.drive[j, 0] * speed * s
            rate, bound = at.drive[j, 0] * speed, 0.0
            for e in range(at.lo[j], at.lo[j + 1]):
                c = la.slot[at.near[e]]
                if c >= 0:
                    force += at.k_near[e] * x[c]
                    rate += at.k_near[e] * d[c]
                    bound += at.k_near[e] * mo.a_most[c]
            near = min(
                safe_step(at.static[j] - force, -rate, bound),
                safe_step(at.static[j] + force, rate, bound),
            )
            if near < step:
                step, who, kind = near, j, 3
        if step <= 4e-16 * s or (s > 0.0 and step < 1e-17):
            return s, kind, who
        s += step
        if s >= h:
            return h, 0, -1
    return s, 0, -1


@njit(cache=True, inner=True)
def clear_of_limits(watched, count, forces, h, far, lone, speed, at):
    """Return True if no watched block can break while block `lone` moves by `far` within h."""
    for p in range(count):
        j = watched[p]
        push = abs(at.drive[j, 0] * speed) * h
        for e in range(at.lo[j], at.lo[j + 1]):
            if at.near[e] == lone:
                push += at.k_near[e] * far
        if abs(forces[p]) + push >= at.static[j] * (1.0 - ON_LIMIT):
            return False
    return True
