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

import math
from typing import NamedTuple

import numpy as np

from eol_ros.core.physics.event.abreast import add_reply, forced_reach, forced_series
from eol_ros.core.physics.event.moments import (
    DEGREE,
    PANELS,
    ROWS,
    Panels,
    direction_moments,
    panel_moments,
)
from eol_ros.core.physics.series import inlined, uncounted
from eol_ros.core.vectors import WIDTH, lane_product

LOW = 9  # order of the series that the first guess is made from
GROWTH = 3.0  # of the panels that lead away from a reversal
EARLIEST = 1e-9  # of a step: the first of these panels, where v passes zero itself
SETTLED = 1e-12  # of a step: as near is its nearest approach to zero known
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


class Sweep(NamedTuple):
    """The friction along a guessed motion; two halves of a row are x and y."""

    panels: Panels
    scaled: np.ndarray  # (size, 2 b): a_k h^(k-1)
    least: np.ndarray  # (panels, b) speed
    swing: np.ndarray  # (panels, b) squares of the change of velocity
    mean: np.ndarray  # (panels, 2 b) integral of v/|v| over each plain panel
    coefficient: np.ndarray  # (degree + 1, 2 b) of v/|v|
    smooth: np.ndarray  # the same as a polynomial
    before: np.ndarray
    friction: np.ndarray  # (2 b,) mu_k g
    change: np.ndarray  # (2 b,)
    path: np.ndarray  # (1, b) m: way along the motion
    column: np.ndarray  # (2, size) series of one block's velocity
    raw: np.ndarray  # (2 (degree + 1) + 1, WIDTH) its moments


def make_sweep(panels: Panels, lanes: int, size: int) -> Sweep:
    """Return arrays for so many lanes (the padding is part of them)."""
    return Sweep(
        panels,
        np.zeros((size, 2 * lanes)),
        np.zeros((PANELS, lanes)),
        np.zeros((PANELS, lanes)),
        np.zeros((PANELS, 2 * lanes)),
        np.zeros((ROWS, 2 * lanes)),
        np.zeros((ROWS, 2 * lanes)),
        np.zeros((ROWS, 2 * lanes)),
        np.zeros(2 * lanes),
        np.zeros(2 * lanes),
        np.zeros((1, lanes)),
        np.zeros((2, size)),
        np.zeros((2 * ROWS + 1, WIDTH)),
    )


@inlined
def velocity_at(order, tau, sw):
    """Return (vx, vy, ax, ay): velocity of the block in sw.column at tau, its derivative by tau."""
    x, y, a, b = sw.column[0, order], sw.column[1, order], 0.0, 0.0
    for k in range(order - 1, 0, -1):
        a, b = a * tau + x, b * tau + y
        x, y = x * tau + sw.column[0, k], y * tau + sw.column[1, k]
    return x, y, a, b


@uncounted
def add_reversal(order, c, lanes, panel, h, ab, sw):
    """Add the moments of a panel in which lane c reverses; return False if it may stop there.

    When it reverses hangs on the friction until then, and within a step the polynomial has that
    only on the average: the velocity is put right by what the two differ.
    """
    begin, end = panel / PANELS, (panel + 1) / PANELS
    path_x, path_y = sw.coefficient[0, c], sw.coefficient[0, lanes + c]
    for p in range(panel + 1, PANELS):
        path_x -= sw.mean[p, c]
        path_y -= sw.mean[p, lanes + c]
    for k in range(1, order + 1):
        sw.column[0, k], sw.column[1, k] = k * sw.scaled[k, c], k * sw.scaled[k, lanes + c]
    x0, y0, _, _ = velocity_at(order, begin, sw)
    x, y, _, _ = velocity_at(order, end, sw)
    a, b = x - x0, y - y0
    tau = begin - (end - begin) * (x0 * a + y0 * b) / (a * a + b * b + 1e-200)
    tau = min(max(tau, begin), end)
    more_x = more_y = x = y = rise = 0.0
    for _ in range(8):  # the nearest approach of v to zero
        x, y, a, b = velocity_at(order, tau, sw)
        x, y = x + more_x, y + more_y
        rise = a * a + b * b
        if rise == 0.0:
            return False
        before = tau
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
        if abs(tau - before) < SETTLED:
            break
    rise = np.sqrt(rise)
    if rise < APART * sw.friction[c] * h:
        return False
    for r in range(2 * ROWS + 1):
        for g in range(WIDTH):
            sw.raw[r, g] = 0.0
    first = max(np.sqrt(x * x + y * y) / rise, EARLIEST)
    here, wide = tau, first
    while here < end:
        there = here + wide
        if there + 0.5 * wide > end:
            there = end
        panel_moments(order, sw.column, sw.panels.node, here, there - here, more_x, more_y, sw.raw)
        here, wide = there, (GROWTH - 1.0) * (there - tau)
    here, wide = tau, first
    while here > begin:
        there = here - wide
        if there - 0.5 * wide < begin:
            there = begin
        panel_moments(order, sw.column, sw.panels.node, there, here - there, more_x, more_y, sw.raw)
        here, wide = there, (GROWTH - 1.0) * (tau - there)
    for r in range(2 * ROWS + 1):
        for g in range(1, WIDTH):
            sw.raw[r, 0] += sw.raw[r, g]
    for r in range(ROWS):
        for s in range(r + 1):
            sw.coefficient[r, c] += sw.panels.raw[r, s] * sw.raw[2 * s, 0]
            sw.coefficient[r, lanes + c] += sw.panels.raw[r, s] * sw.raw[2 * s + 1, 0]
    sw.path[0, c] += sw.raw[2 * ROWS, 0]
    return True


@uncounted
def sample(order, m, h, ab, sw):
    """Write the Legendre coefficients of v/|v| along the series; False if a block may stop."""
    lanes = len(ab.inverse_mass)
    wide, scaled, panels = 2 * lanes, sw.scaled, sw.panels
    power = 1.0
    for k in range(1, order + 1):
        for c in range(wide):
            scaled[k, c] = ab.a[k, c] * power
        power *= h
    direction_moments(
        panels.rate,
        scaled,
        order + 1,
        panels.fit,
        sw.least,
        sw.swing,
        sw.mean,
        sw.path,
        sw.coefficient,
    )
    for p in range(PANELS):
        for c in range(m):
            if sw.friction[c] == 0.0:
                continue
            least = sw.least[p, c]
            if 4.0 * least * least >= sw.swing[p, c]:
                if least < sw.friction[c] * h:
                    return False
            elif not add_reversal(order, c, lanes, p, h, ab, sw):
                return False
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
            add_reply(min(order, REPLY), m, at, ab)
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
