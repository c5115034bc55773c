# SPDX-License-Identifier: Apache-2.0
"""Moments of the direction v/|v| of a motion over a step, by quadrature in vectors of lanes.

Plain parts of a step have all blocks abreast; where a block reverses, the nodes of one panel are.
"""

import functools
from typing import Any, NamedTuple

import llvmlite.ir as ir
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.polynomial import Legendre

from eol_ros.core import algebra
from eol_ros.core.vectors import VECTOR, WIDTH, Code

DEGREE = (
    5  # of the polynomial: of a step w h < 2 the higher moments move nothing by 1e-7 of mu_k g h^2
)
PANELS, NODES = 6, 5
ROWS = DEGREE + 1
TOGETHER = 5  # nodes at which a velocity is worked out at once
TINY = 1e-200  # m/s: a block at rest has some direction


class Panels(NamedTuple):
    """Quadrature over a step, as tables."""

    rate: np.ndarray  # (q, size): k tau^(k-1)
    fit: np.ndarray  # (degree + 1, q): Legendre coefficients from values; the first are the weights
    power: np.ndarray  # (degree + 1, degree + 1): coefficient of tau^k in P_r, as [k, r]
    raw: np.ndarray  # (degree + 1, degree + 1): Legendre coefficients from moments of (2 tau - 1)^k
    node: np.ndarray  # (2, WIDTH) of a part beside a reversal: nodes and weights on 0..1


@functools.cache
def tables(size: int) -> Panels:
    """Return the quadrature for series of rows 0..size - 1."""
    (x, w), (fine, share) = _gauss(NODES), _gauss(WIDTH)
    node = ((np.arange(PANELS)[:, None] + x) / PANELS).ravel()
    weight = np.tile(w / PANELS, PANELS)
    k = np.arange(size)
    rate = k * node[:, None] ** np.maximum(k - 1, 0)
    basis = [Legendre.basis(r, domain=[0, 1]) for r in range(ROWS)]
    fit = np.array([(2 * r + 1) * weight * p(node) for r, p in enumerate(basis)])
    power, raw = np.zeros((ROWS, ROWS)), np.zeros((ROWS, ROWS))
    for r, p in enumerate(basis):
        power[: r + 1, r] = p.convert(domain=[-1, 1], kind=np.polynomial.Polynomial).coef
        raw[r, : r + 1] = (2 * r + 1) * np.polynomial.legendre.leg2poly(np.eye(ROWS)[r, : r + 1])
    return Panels(rate, fit, power, raw, np.stack((fine, share)))


def _gauss(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights on 0..1."""
    x, w = algebra.gauss_legendre(nodes)
    return 0.5 * (x + 1), 0.5 * w


def _vector(number: float) -> Any:
    return ir.Constant(VECTOR, [number] * WIDTH)


def _direction_moments(
    typing: Any,
    rate: Any,
    scaled: Any,
    end: Any,
    fit: Any,
    least: Any,
    swing: Any,
    mean: Any,
    path: Any,
    out: Any,
) -> Any:
    """Write the Legendre coefficients of v/|v| over all panels in which a block does not reverse.

    v at a node is the sum over 1 <= k < `end` of `rate` times `scaled`, (size, 2 b); a block
    reverses where twice its least speed is below its change of velocity. `least` and `swing`
    (panels, b) are these, the latter squared, `mean` (panels, 2 b) a panel's share of the first
    coefficient, `path` (1, b) the integral of the speed, `out` (degree + 1, 2 b) the coefficients.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        code = Code(context, builder, signature, values)
        end, blocks, zero = values[2], code.columns(4), _vector(0.0)
        totals, part = code.sums(2 * ROWS + 1), code.sums(2 * ROWS + 1)
        speeds = code.sums(2 * TOGETHER)
        slowest = code.sums(1)[0]
        first, one = code.constant(0), code.constant(1)
        with code.loop(first, blocks, WIDTH) as (q, _):
            beside = builder.add(q, blocks)
            for total in totals:
                builder.store(zero, total)
            with code.loop(first, code.constant(PANELS)) as (panel, _):
                for total in part:
                    builder.store(zero, total)
                builder.store(_vector(float('inf')), slowest)
                row = builder.mul(panel, code.constant(NODES))
                start: list[Any] = []
                for _group in range(NODES // TOGETHER):
                    nodes = [builder.add(row, code.constant(i)) for i in range(TOGETHER)]
                    for total in speeds:
                        builder.store(zero, total)
                    with code.loop(one, end) as (k, _):
                        x, y = code.load(1, k, q), code.load(1, k, beside)
                        for i, node in enumerate(nodes):
                            share = code.splat(code.number(0, node, k))
                            for term, total in ((x, speeds[2 * i]), (y, speeds[2 * i + 1])):
                                builder.store(code.fma(share, term, builder.load(total)), total)
                    for i, node in enumerate(nodes):
                        vx, vy = builder.load(speeds[2 * i]), builder.load(speeds[2 * i + 1])
                        start = start or [vx, vy]
                        speed = code.sqrt(code.fma(vx, vx, builder.fmul(vy, vy)))
                        lower = builder.fcmp_ordered('<', speed, builder.load(slowest))
                        builder.store(builder.select(lower, speed, builder.load(slowest)), slowest)
                        inverse = builder.fdiv(_vector(1.0), builder.fadd(speed, _vector(TINY)))
                        terms = (builder.fmul(vx, inverse), builder.fmul(vy, inverse))
                        for r in range(ROWS):
                            share = code.splat(code.number(3, code.constant(r), node))
                            for term, total in zip(terms, part[2 * r : 2 * r + 2], strict=True):
                                builder.store(code.fma(share, term, builder.load(total)), total)
                            if r == 0:
                                way = code.fma(share, speed, builder.load(part[-1]))
                                builder.store(way, part[-1])
                    row = builder.add(row, code.constant(TOGETHER))
                dx, dy = builder.fsub(vx, start[0]), builder.fsub(vy, start[1])
                change = code.fma(dx, dx, builder.fmul(dy, dy))
                low = builder.load(slowest)
                code.store(low, 4, panel, q)
                code.store(change, 5, panel, q)
                low = builder.fmul(_vector(4.0), builder.fmul(low, low))
                plain = builder.fcmp_ordered('>=', low, change)
                for i, (share, total) in enumerate(zip(part, totals, strict=True)):
                    value = builder.select(plain, builder.load(share), zero)
                    builder.store(builder.fadd(builder.load(total), value), total)
                    if i < 2:
                        code.store(value, 6, panel, (q, beside)[i])
            for i, total in enumerate(totals[:-1]):
                code.store(builder.load(total), 8, code.constant(i // 2), (q, beside)[i % 2])
            code.store(builder.load(totals[-1]), 7, first, q)
        return context.get_dummy_value()

    arrays = (fit, least, swing, mean, path, out)
    return types.void(rate, scaled, end, *arrays), generate


def _panel_moments(
    typing: Any,
    order: Any,
    column: Any,
    node: Any,
    begin: Any,
    wide: Any,
    more_x: Any,
    more_y: Any,
    out: Any,
) -> Any:
    """Add one block's moments over `wide` of a step from `begin` to `out` (2 (degree + 1) + 1, w).

    v is the series `column` (2, size) and (more_x, more_y); rows of `out` are the moments of
    (2 tau - 1)^k times v/|v|, x before y, and last the way; its columns are to be added up.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        code = Code(context, builder, signature, values)
        first, one = code.constant(0), code.constant(1)
        order, wide = values[0], code.splat(values[4])
        tau = code.fma(wide, code.load(2, first, first), code.splat(values[3]))
        speeds = code.sums(2)
        for total in speeds:
            builder.store(_vector(0.0), total)
        with code.loop(first, order) as (down, _):
            k = builder.sub(order, down)
            for i, total in enumerate(speeds):
                term = code.splat(code.number(1, code.constant(i), k))
                builder.store(code.fma(builder.load(total), tau, term), total)
        vx, vy = (
            builder.fadd(builder.load(total), code.splat(more))
            for total, more in zip(speeds, values[5:7], strict=True)
        )
        speed = code.sqrt(code.fma(vx, vx, builder.fmul(vy, vy)))
        speed = builder.fadd(speed, _vector(TINY))
        weight = builder.fmul(wide, code.load(2, one, first))
        inverse = builder.fdiv(weight, speed)
        terms = [builder.fmul(vx, inverse), builder.fmul(vy, inverse)]
        place = code.fma(_vector(2.0), tau, _vector(-1.0))
        for r in range(ROWS):
            for i in range(2):
                at = code.constant(2 * r + i)
                code.store(builder.fadd(code.load(7, at, first), terms[i]), 7, at, first)
                terms[i] = builder.fmul(terms[i], place)
        at = code.constant(2 * ROWS)
        code.store(code.fma(weight, speed, code.load(7, at, first)), 7, at, first)
        return context.get_dummy_value()

    return types.void(order, column, node, begin, wide, more_x, more_y, out), generate


direction_moments: Any = intrinsic(_direction_moments)
panel_moments: Any = intrinsic(_panel_moments)
