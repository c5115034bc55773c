# SPDX-License-Identifier: Apache-2.0
"""Power series in time: of the rim's motion, of products; and the first root of a polynomial.

The solvers write each segment between two events as a power series whose coefficients follow from
the equation of motion by recurrence (Taylor's method; Jorba and Zou, Experimental Mathematics 14,
2005). The series is at once the step, its error estimate, and the dense output in which events are
located.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from eol_ros.core.compiled import njit
from eol_ros.core.physics.drive import CIRCLE, POSES, VELOCITY

FAST = {'contract', 'reassoc', 'nsz'}
FUSED = {'contract', 'nsz'}  # sums keep their order: loops over lanes, not over terms, run abreast
# division by zero gives inf or nan, which `not finite` tells; a check of each would stop vectors
UNCOUNTED: dict[str, Any] = {'_nrt': False, 'error_model': 'numpy'}
ROOT_ROUNDS = 80


def uncounted(loop: Callable[..., Any]) -> Any:
    """Return the compiled `loop`, which takes arrays and makes none, without reference counting.

    Counting references to dozens of arrays in a tuple, an atomic operation each, would cost as much
    as the work of a small step. Only compiled functions call it.
    """
    return njit(cache=True, inner=True, fastmath=FUSED, **UNCOUNTED)(loop)


def entry(loop: Callable[..., Any]) -> Any:
    """Return `loop` as `uncounted` does, to be called from Python."""
    return njit(cache=True, fastmath=FUSED, **UNCOUNTED)(loop)


def inlined(loop: Callable[..., Any]) -> Any:
    """Return `loop` as `uncounted` does, to be made part of its caller.

    A call hands over each array in seven words, so that one of a few flops would be all calling.
    """
    return njit(cache=True, inner=True, fastmath=FUSED, forceinline=True, **UNCOUNTED)(loop)


@inlined
def sine_order(k, s, c):
    """Return the k-th derivative of the sine where it is s and the cosine is c."""
    k &= 3
    return s if k == 0 else (c if k == 1 else (-s if k == 2 else -c))


@uncounted
def drive_series(kind, par, knots, cubics, t, order, cx, cy, cc, cs, phi):
    """Write the series at `t` of the rim's x, y, cos(phi) - 1 and sin(phi), k = 0..order.

    Returns (reach, used): up to which step the series holds (the next knot), and the highest k that
    is not zero (for a drive with an infinite series: `order`). `phi` takes the angle's own.
    """
    for k in range(order + 1):
        cx[k] = cy[k] = cc[k] = cs[k] = phi[k] = 0.0
    if kind == VELOCITY:
        cx[0], cx[1] = par[0] * t, par[0]
        cy[0], cy[1] = par[1] * t, par[1]
        return np.inf, 1
    if kind == CIRCLE:
        radius, w, phi0, w2 = par[0], par[1], par[2], par[3]
        s, c = math.sin(w * t), math.cos(w * t)
        half = math.sin(0.5 * w * t)
        f = 1.0
        for k in range(order + 1):
            cx[k] = radius * f * sine_order(k, s, c)
            cy[k] = -radius * f * sine_order(k + 1, s, c)
            f *= w / (k + 1)
        cy[0] = 2.0 * radius * half * half
        if phi0 != 0.0:
            s, c = math.sin(w2 * t), math.cos(w2 * t)
            f = 1.0
            for k in range(order + 1):
                phi[k] = phi0 * f * sine_order(k, s, c)
                f *= w2 / (k + 1)
            rotation_series(phi, order, order, cc, cs)
        return np.inf, order
    if kind == POSES:
        last = len(cubics) - 1
        if t < knots[0]:
            cx[0], cy[0], phi0 = cubics[0, 0, 0], cubics[0, 1, 0], cubics[0, 2, 0]
            cc[0] = -2.0 * math.sin(0.5 * phi0) ** 2
            cs[0] = math.sin(phi0)
            return knots[0] - t, 0
        held = t >= knots[last + 1]
        low, p = 0, last  # bisection: an hour of poses has 200,000 knots
        while low < p:
            middle = (low + p + 1) // 2
            if knots[middle] > t:
                p = middle - 1
            else:
                low = middle
        s = (knots[last + 1] if held else t) - knots[p]
        for axis in range(3):
            c0, c1 = cubics[p, axis, 0], cubics[p, axis, 1]
            c2, c3 = cubics[p, axis, 2], cubics[p, axis, 3]
            out = cx if axis == 0 else (cy if axis == 1 else phi)
            out[0] = c0 + s * (c1 + s * (c2 + s * c3))
            if not held:
                out[1] = c1 + s * (2.0 * c2 + 3.0 * s * c3)
                out[2] = c2 + 3.0 * s * c3
                out[3] = c3
        rotates = phi[0] != 0.0 or phi[1] != 0.0 or phi[2] != 0.0 or phi[3] != 0.0
        if rotates:
            rotation_series(phi, 0 if held else 3, 0 if held else order, cc, cs)
        if held:
            return np.inf, 0
        rest = phi[1] != 0.0 or phi[2] != 0.0 or phi[3] != 0.0
        return knots[p + 1] - t, order if rest else 3
    return np.inf, 0


@uncounted
def rotation_series(phi, degree, order, cc, cs):
    """Write the series of cos(phi) - 1 and sin(phi) for the series `phi` of that degree."""
    s0, c0 = math.sin(phi[0]), math.cos(phi[0])
    cs[0] = s0
    cc[0] = -2.0 * math.sin(0.5 * phi[0]) ** 2
    for k in range(1, order + 1):
        s = c = 0.0
        for j in range(1, min(k, degree) + 1):
            cosine = c0 if j == k else cc[k - j]
            s += j * phi[j] * cosine
            c -= j * phi[j] * cs[k - j]
        cs[k] = s / k
        cc[k] = c / k


@uncounted
def first_root(c, degree, h):
    """Return (x, found): the first root in (0, h] of a polynomial that is positive at 0.

    Steps from the left by the root of a parabola that lies below the polynomial, its curvature a
    bound of the second derivative over the whole of [0, h]: no root can be jumped over, and near a
    simple root the steps converge as Newton's. Where the rounds run out (a multiple root or a near
    miss) found is False and x < h is how far the interval is known to be free of roots.
    """
    if h <= 0.0:
        return h, False
    bound = 0.0
    power = 1.0
    scale = abs(c[0])
    for k in range(1, degree + 1):
        scale += abs(c[k]) * power * h
        if k >= 2:
            bound += k * (k - 1) * abs(c[k]) * (power / h if k > 1 else 0.0)
        power *= h
    tiny = 2e-16 * scale
    x = 0.0
    for _ in range(ROOT_ROUNDS):
        g = c[degree]
        d = 0.0
        for k in range(degree - 1, -1, -1):
            d = d * x + g
            g = g * x + c[k]
        if g <= tiny and x > 0.0:
            if d < 0.0:
                x += g / -d
            return min(max(x, 0.0), h), True
        g = max(g, tiny)
        reach = math.sqrt(d * d + 2.0 * bound * g)
        if d < 0.0:
            step = 2.0 * g / (reach - d)
        elif bound > 0.0:
            step = (d + reach) / bound
        else:
            return h, False
        x += step
        if x >= h:
            return h, False
        if step <= 2e-16 * x:
            return x, True
    return x, False


@uncounted
def add_exactly(total, rest, step):
    """Return total + step and the new rest of a compensated sum (Kahan)."""
    y = step - rest
    new = total + y
    return new, (new - total) - y
