# SPDX-License-Identifier: Apache-2.0
"""Steps as long as stiff springs allow, whatever friction does within them.

Where springs are stiff a block reverses often, and the direction v/|v| of its friction with
it: a series of v/|v| ends at the complex zeros of v.v, far nearer than the springs' own reach. But
there friction is a small perturbation. Its effect over a step goes through the springs' response,
which is smooth, so that only its lowest moments count, and a polynomial with the same moments does
as well. So: from a first guess of the motion v(t) the moments of v/|v| are found by quadrature,
panels graded towards each reversal; the series is worked out again under that polynomial; and the
moments once more along the better motion (Picard's iteration; it gains a factor mu_k g / |a| each
time, a the acceleration by springs).
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Legendre

from eol_ros.core.physics.event.abreast import add_reply, forced_reach, forced_series
from eol_ros.core.physics.series import inlined, uncounted
from eol_ros.core.vectors import lane_product

DEGREE = (
    5  # of the polynomial: of a step w h < 2 the higher moments move nothing by 1e-7 of mu_k g h^2
)
PANELS, NODES = 6, 8
LOW = 11  # order of the series that the first guess is made from
GROWTH = 3.0  # of the panels that lead away from a reversal
EARLIEST = 1e-9  # of a step: the first of these panels, where v passes zero itself
CLEAR = 6.0  # how many plain steps one by the springs' own reach must be worth to compile sweeps
APART = 4.0  # how many times friction the springs must pull where a block reverses
ROUNDS = 4
REPLY = DEGREE + 6  # rows in which the springs answer the last change, to second order
LATE = 30.0  # how much more than a step's truncation the last change of friction may leave,
LEFT = 0.01  # which is so much of it: by the springs' own change, and higher orders
SHORT = 0.93
# |P_(DEGREE + 1)| of sin(w t) / w over a step, of (w h / 2)^(DEGREE + 1), by a reversal's
REST = 1.7e-7
FAST = 300.0  # how many times friction springs pull where what friction misses outweighs the series


class Panels(NamedTuple):
    """Quadrature over a step, as tables."""

    rate: np.ndarray  # (q, size): k tau^(k-1)
    weight: np.ndarray  # (q,)
    fit: np.ndarray  # (degree + 1, q): Legendre coefficients from values
    power: np.ndarray  # (degree + 1, degree + 1): coefficient of tau^k in P_r, as [k, r]
    x: np.ndarray  # (nodes,) on 0..1
    w: np.ndarray


class Sweep(NamedTuple):
    """The friction along a guessed motion; two halves of a row are x and y."""

    panels: Panels
    scaled: np.ndarray  # (size, 2 b): a_k h^(k-1)
    v: np.ndarray  # (q, 2 b)
    speed: np.ndarray  # (q, b)
    n: np.ndarray  # (q, 2 b)
    least: np.ndarray  # (panels, b) squares of speed
    swing: np.ndarray  # (panels, b) squares of the change of velocity
    coefficient: np.ndarray  # (degree + 1, 2 b) of v/|v|
    smooth: np.ndarray  # of it what the plain panels give
    before: np.ndarray
    friction: np.ndarray  # (2 b,) mu_k g
    change: np.ndarray  # (2 b,)
    path: np.ndarray  # (b,) m: way along the motion
    nodes: tuple[np.ndarray, ...]  # of one panel: six arrays (NODES,)


@functools.cache
def tables(size: int) -> Panels:
    """Return the quadrature for series of rows 0..size - 1."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1), 0.5 * w
    node = ((np.arange(PANELS)[:, None] + x) / PANELS).ravel()
    weight = np.tile(w / PANELS, PANELS)
    k = np.arange(size)
    rate = k * node[:, None] ** np.maximum(k - 1, 0)
    basis = [Legendre.basis(r, domain=[0, 1]) for r in range(DEGREE + 1)]
    fit = np.array([(2 * r + 1) * weight * p(node) for r, p in enumerate(basis)])
    power = np.zeros((DEGREE + 1, DEGREE + 1))
    for r, p in enumerate(basis):
        power[: r + 1, r] = p.convert(domain=[-1, 1], kind=np.polynomial.Polynomial).coef
    return Panels(rate, weight, fit, power, x, w)


def make_sweep(panels: Panels, lanes: int, size: int) -> Sweep:
    """Return arrays for so many lanes (the padding is part of them)."""
    q = PANELS * NODES
    return Sweep(
        panels,
        np.zeros((size, 2 * lanes)),
        np.zeros((q, 2 * lanes)),
        np.zeros((q, lanes)),
        np.zeros((q, 2 * lanes)),
        np.zeros((PANELS, lanes)),
        np.zeros((PANELS, lanes)),
        np.zeros((DEGREE + 1, 2 * lanes)),
        np.zeros((DEGREE + 1, 2 * lanes)),
        np.zeros((DEGREE + 1, 2 * lanes)),
        np.zeros(2 * lanes),
        np.zeros(2 * lanes),
        np.zeros(lanes),
        tuple(np.zeros(NODES) for _ in range(6)),
    )


@inlined
def velocity_at(order, c, lanes, scaled, tau):
    """Return (vx, vy, ax, ay): velocity of lane c at tau and its derivative after tau."""
    x, y, a, b = order * scaled[order, c], order * scaled[order, lanes + c], 0.0, 0.0
    for k in range(order - 1, 0, -1):
        a, b = a * tau + x, b * tau + y
        x, y = x * tau + k * scaled[k, c], y * tau + k * scaled[k, lanes + c]
    return x, y, a, b


@inlined
def add_panel(order, c, lanes, begin, end, more_x, more_y, sw):
    """Add the moments of lane c's direction over part of the step, all its nodes abreast.

    (more_x, more_y) is added to the velocity.
    """
    tau, vx, vy, weight, p0, p1 = sw.nodes
    x, w = sw.panels.x, sw.panels.w
    wide = end - begin
    for g in range(NODES):
        tau[g] = begin + wide * x[g]
        vx[g] = vy[g] = 0.0
    for k in range(order, 0, -1):
        a, b = k * sw.scaled[k, c], k * sw.scaled[k, lanes + c]
        for g in range(NODES):
            vx[g] = vx[g] * tau[g] + a
            vy[g] = vy[g] * tau[g] + b
    for g in range(NODES):
        vx[g] += more_x
        vy[g] += more_y
        speed = np.sqrt(vx[g] * vx[g] + vy[g] * vy[g]) + 1e-200
        sw.path[c] += wide * w[g] * speed
        weight[g] = wide * w[g] / speed
        tau[g] = 2.0 * tau[g] - 1.0
        p0[g], p1[g] = 1.0, tau[g]
    for r in range(DEGREE + 1):
        a = b = 0.0
        for g in range(NODES):
            a += weight[g] * p0[g] * vx[g]
            b += weight[g] * p0[g] * vy[g]
            p0[g], p1[g] = p1[g], ((2 * r + 3) * tau[g] * p1[g] - (r + 1) * p0[g]) / (r + 2)
        sw.coefficient[r, c] += (2 * r + 1) * a
        sw.coefficient[r, lanes + c] += (2 * r + 1) * b


@uncounted
def add_reversal(order, c, lanes, panel, h, ab, sw):
    """Add the moments of a panel in which lane c reverses; return False if it may stop there.

    When it reverses hangs on the friction until then, and within a step the polynomial has that
    only on the average: the velocity is put right by what the two differ.
    """
    begin, end = panel / PANELS, (panel + 1) / PANELS
    tau, least = begin, np.inf
    for g in range(NODES):
        q = panel * NODES + g
        if sw.v[q, c] ** 2 + sw.v[q, lanes + c] ** 2 < least:
            least = sw.v[q, c] ** 2 + sw.v[q, lanes + c] ** 2
            tau = begin + (end - begin) * sw.panels.x[g]
    path_x, path_y = sw.coefficient[0, c], sw.coefficient[0, lanes + c]
    for q in range(panel * NODES):
        path_x += sw.panels.weight[q] * sw.n[q, c]
        path_y += sw.panels.weight[q] * sw.n[q, lanes + c]
    x0, y0, _, _ = velocity_at(order, c, lanes, sw.scaled, begin)
    more_x = more_y = x = y = rise = 0.0
    for _ in range(8):  # the nearest approach of v to zero
        x, y, a, b = velocity_at(order, c, lanes, sw.scaled, tau)
        x, y = x + more_x, y + more_y
        rise = a * a + b * b
        if rise == 0.0:
            return False
        tau = min(max(tau - (x * a + y * b) / rise, begin), end)
        size = np.sqrt((x0 + more_x) ** 2 + (y0 + more_y) ** 2) + 1e-200
        wide = tau - begin
        push = -sw.friction[c] * h
        px, py = push * (path_x + wide * x0 / size), push * (path_y + wide * y0 / size)
        power = tau * h
        for k in range(DEGREE + 1):
            px -= ab.push[k, c] * power / (k + 1)
            py -= ab.push[k, lanes + c] * power / (k + 1)
            power *= tau * h
        more_x, more_y = px, py
    rise = np.sqrt(rise)
    if rise < APART * sw.friction[c] * h:
        return False
    first = max(np.sqrt(x * x + y * y) / rise, EARLIEST)
    here, wide = tau, first
    while here < end:
        there = here + wide
        if there + 0.5 * wide > end:
            there = end
        add_panel(order, c, lanes, here, there, more_x, more_y, sw)
        here, wide = there, (GROWTH - 1.0) * (there - tau)
    here, wide = tau, first
    while here > begin:
        there = here - wide
        if there - 0.5 * wide < begin:
            there = begin
        add_panel(order, c, lanes, there, here, more_x, more_y, sw)
        here, wide = there, (GROWTH - 1.0) * (tau - there)
    return True


@uncounted
def sample(order, m, h, ab, sw):
    """Write the Legendre coefficients of v/|v| along the series; False if a block may stop."""
    lanes, panels = len(ab.inverse_mass), sw.panels
    wide, q_end = 2 * lanes, PANELS * NODES
    scaled, v, n, speed = sw.scaled, sw.v, sw.n, sw.speed
    power = 1.0
    for k in range(1, order + 1):
        for c in range(wide):
            scaled[k, c] = ab.a[k, c] * power
        power *= h
    lane_product(v, panels.rate, q_end, scaled, 1, order + 1)
    for q in range(q_end):
        for c in range(lanes):
            speed[q, c] = np.sqrt(v[q, c] * v[q, c] + v[q, lanes + c] * v[q, lanes + c])
        for c in range(lanes):
            n[q, c] = 1.0 / (speed[q, c] + 1e-200)
        for c in range(lanes):
            n[q, lanes + c] = v[q, lanes + c] * n[q, c]
        for c in range(lanes):
            n[q, c] *= v[q, c]
    for c in range(lanes):
        sw.path[c] = 0.0
    for r in range(DEGREE + 1):
        for c in range(wide):
            sw.coefficient[r, c] = 0.0
    for p in range(PANELS):
        a, b = p * NODES, (p + 1) * NODES - 1
        for c in range(lanes):
            sw.least[p, c] = speed[a, c]
        for q in range(a + 1, b + 1):
            for c in range(lanes):
                now = speed[q, c]
                sw.least[p, c] = now if now < sw.least[p, c] else sw.least[p, c]
        for c in range(lanes):
            x, y = v[b, c] - v[a, c], v[b, lanes + c] - v[a, lanes + c]
            sw.swing[p, c] = x * x + y * y
        for c in range(m):
            if sw.friction[c] == 0.0:
                continue
            least = sw.least[p, c]
            if 4.0 * least * least >= sw.swing[p, c]:
                if least < sw.friction[c] * h:
                    return False
                continue
            for q in range(a, b + 1):
                n[q, c] = n[q, lanes + c] = speed[q, c] = 0.0
            if not add_reversal(order, c, lanes, p, h, ab, sw):
                return False
    for q in range(q_end):
        weight = panels.weight[q]
        for c in range(lanes):
            sw.path[c] += weight * speed[q, c]
    lane_product(sw.smooth, panels.fit, DEGREE + 1, n, 0, q_end)
    for r in range(DEGREE + 1):
        for c in range(wide):
            sw.coefficient[r, c] += sw.smooth[r, c]
    return True


@uncounted
def take_push(h, first, ab, sw):
    """Make the coefficients the friction in ab.push, what changes in ab.extra.

    Returns how much the place at h changes (m).
    """
    wide, friction, change = 2 * len(ab.inverse_mass), sw.friction, sw.change
    for c in range(wide):
        change[c] = 0.0
    for r in range(DEGREE + 1):
        for c in range(wide):
            change[c] += abs(sw.coefficient[r, c] - sw.before[r, c])
        for c in range(wide):
            sw.before[r, c] = sw.coefficient[r, c]
    most = 0.0
    for c in range(wide):
        most = max(most, change[c] * friction[c])
    lane_product(sw.smooth, sw.panels.power, DEGREE + 1, sw.coefficient, 0, DEGREE + 1)
    scale = -1.0
    for k in range(DEGREE + 1):
        for c in range(wide):
            change[c] = friction[c] * sw.smooth[k, c] * scale
        for c in range(wide):
            ab.extra[k, c] = change[c] - ab.push[k, c]
        for c in range(wide):
            ab.push[k, c] = change[c]
        scale /= h
    return np.inf if first else 0.5 * most * h * h


@uncounted
def fastest(m, at, pl):
    """Return a bound (1/s^2) of the squares of the sliding blocks' frequencies, by Gershgorin."""
    square = 0.0
    for c in range(m):
        i = pl.slots[c]
        stiff = at.k_sum[i]
        for e in range(at.lo[i], at.lo[i + 1]):
            if pl.slot[at.near[e]] >= 0:
                stiff += at.k_near[e]
        square = max(square, stiff * at.inverse[i])
    return square


@uncounted
def would_pay(order, m, plain, small, at, pl):
    """Return whether springs allow steps so much longer than `plain` (s) that sweeps would pay.

    Not where a block may stop: one that is slow has to be reversed by its springs.
    """
    most, square = 0.0, fastest(m, at, pl)
    for c in range(m):
        i = pl.slots[c]
        friction = at.friction[i] * at.inverse[i]
        rise = 2.0 * np.sqrt(pl.ax[c, 2] ** 2 + pl.ay[c, 2] ** 2)
        speed = np.sqrt(pl.ax[c, 1] ** 2 + pl.ay[c, 1] ** 2)
        if speed < CLEAR * plain * friction and rise < APART * friction:
            return False
        most = max(most, rise)
    if square == 0.0 or most == 0.0:
        return False
    # terms of a motion of that acceleration and frequency are most w^(k - 2) / k!
    power = math.log(small / most) + math.lgamma(order + 1.0) - 0.5 * (order - 2) * math.log(square)
    return math.exp(power / order) > CLEAR * plain


@uncounted
def all_fast(m, v, at, pl):
    """Return whether the springs of each sliding block pull, or soon will, by far the most."""
    for c in range(m):
        i = pl.slots[c]
        limit = FAST * at.friction[i] * at.inverse[i]
        square = 4.0 * (pl.ax[c, 2] ** 2 + pl.ay[c, 2] ** 2)
        square += (v[i, 0] ** 2 + v[i, 1] ** 2) * at.k_sum[i] * at.inverse[i]
        if square < limit * limit:
            return False
    return True


@uncounted
def sweep_top(m, small, at, pl):
    """Return the step up to which the higher moments of friction move no block by 10 `small`.

    A reversal leaves the polynomial REST mu_k g h^2 (w h / 2)^(DEGREE + 1) short;
    """
    square, most = fastest(m, at, pl), 0.0
    for c in range(m):
        i = pl.slots[c]
        most = max(most, at.friction[i] * at.inverse[i])
    if square == 0.0 or most == 0.0:
        return np.inf
    half = 0.5 * np.sqrt(square)
    return (10.0 * small / (REST * most * half ** (DEGREE + 1))) ** (1.0 / (DEGREE + 3))


@uncounted
def sweep_step(order, m, count, u, v, used, at, pl, ab, sw, cx, cy, cc, cs, small, h, top):
    """Write the series of a step into `ab`; return (h, reach), h = 0 where this way does not hold.

    `h`: the step to try, at most `top`, or 0 if not known; `reach`: what the springs allow.
    """
    lanes = len(ab.inverse_mass)
    low = min(LOW, order)
    for c in range(2 * lanes):
        sw.friction[c] = 0.0
    for k in range(DEGREE + 1):
        for c in range(2 * lanes):
            ab.push[k, c] = 0.0
    for c in range(m):
        i = pl.slots[c]
        sw.friction[c] = sw.friction[lanes + c] = at.friction[i] * at.inverse[i]
        speed = np.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
        if speed > 0.0:
            ab.push[0, c] = -sw.friction[c] * v[i, 0] / speed
            ab.push[0, lanes + c] = -sw.friction[c] * v[i, 1] / speed
    guess = low if h > 0.0 else order
    forced_series(guess, 0, m, count, u, v, used, at, pl, ab, cx, cy, cc, cs)
    if h <= 0.0:
        h = forced_reach(order, ab, small, top)
    h = min(h, top)
    reach, first, last = h, True, np.inf
    for _ in range(ROUNDS):
        if not sample(guess, m, h, ab, sw):
            return 0.0, reach
        change = take_push(h, first, ab, sw)
        if not first and LEFT * change <= LATE * small:
            add_reply(min(order, REPLY), m, at, pl, ab)
            return h, reach
        if not first and change > 0.1 * last:
            return 0.0, reach
        if not first:
            last = change
        first, guess = False, order
        forced_series(order, DEGREE, m, count, u, v, used, at, pl, ab, cx, cy, cc, cs)
        reach = forced_reach(order, ab, small, top)
        if reach < SHORT * h:
            h, first = 0.95 * reach, True
    return 0.0, reach
