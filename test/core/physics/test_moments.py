# SPDX-License-Identifier: Apache-2.0
"""Friction's moments and the springs' orders in vectors, against SciPy and NumPy."""

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial
from scipy.integrate import quad

from eol_ros.core.physics.event.moments import (
    DEGREE,
    PANELS,
    ROWS,
    direction_moments,
    panel_moments,
    tables,
)
from eol_ros.core.physics.series import entry
from eol_ros.core.vectors import WIDTH, spring_order

ORDER, BLOCKS = 9, 2 * WIDTH
pytestmark = pytest.mark.slow


@entry
def _over_step(rate, scaled, end, fit, least, swing, mean, path, out):
    direction_moments(rate, scaled, end, fit, least, swing, mean, path, out)


@entry
def _over_part(order, column, node, begin, wide, more_x, more_y, out):
    panel_moments(order, column, node, begin, wide, more_x, more_y, out)


@entry
def _springs(orders, x, y, square, inverse, law, px, py):
    for k in range(1, orders):
        spring_order(k, x, y, square, inverse, law, px, py)


def _velocity(scaled: np.ndarray, c: int) -> tuple[Polynomial, Polynomial]:
    x, y = Polynomial(scaled[:, c]).deriv(), Polynomial(scaled[:, BLOCKS + c]).deriv()
    return x, y


def _moment(x: Polynomial, y: Polynomial, weigh, begin: float, end: float) -> list[float]:
    """Return the integrals of x / |v| and y / |v| times `weigh`."""
    return [
        quad(
            lambda s, part=part: weigh(s) * part(s) / np.hypot(x(s), y(s)), begin, end, epsabs=1e-13
        )[0]
        for part in (x, y)
    ]


def _way(x: Polynomial, y: Polynomial, begin: float, end: float) -> float:
    return quad(lambda s: np.hypot(x(s), y(s)), begin, end)[0]


def test_moments_of_plain_motion():
    random = np.random.default_rng(3)
    scaled = random.normal(size=(ORDER + 1, 2 * BLOCKS)) * 0.1 / np.arange(1, ORDER + 2)[:, None]
    scaled[1, :BLOCKS] += 2.0  # none comes near to rest
    least, swing = np.zeros((PANELS, BLOCKS)), np.zeros((PANELS, BLOCKS))
    mean, path = np.zeros((PANELS, 2 * BLOCKS)), np.zeros((1, BLOCKS))
    out, panels = np.zeros((ROWS, 2 * BLOCKS)), tables(ORDER + 1)
    _over_step(panels.rate, scaled, ORDER + 1, panels.fit, least, swing, mean, path, out)
    for c in range(0, BLOCKS, 5):
        x, y = _velocity(scaled, c)
        for r in range(ROWS):
            basis = Legendre.basis(r, domain=[0, 1])
            wanted = [(2 * r + 1) * part for part in _moment(x, y, basis, 0, 1)]
            assert out[r, [c, BLOCKS + c]] == pytest.approx(wanted, abs=1e-9)
        assert mean[2, [c, BLOCKS + c]] == pytest.approx(
            _moment(x, y, lambda s: 1, 2 / PANELS, 3 / PANELS), abs=1e-10
        )
        assert path[0, c] == pytest.approx(_way(x, y, 0, 1), abs=1e-9)
        speed = np.hypot(x(panels.rate[:, 2] / 2), y(panels.rate[:, 2] / 2)).reshape(PANELS, -1)
        assert least[:, c] == pytest.approx(speed.min(1))
    polynomial = panels.power @ out  # the same as powers
    tau = 0.3
    legendre = np.array([Legendre.basis(r, domain=[0, 1])(tau) for r in range(ROWS)])
    assert tau ** np.arange(ROWS) @ polynomial == pytest.approx(legendre @ out)


def test_a_panel_that_reverses_is_left_out():
    scaled = np.zeros((ORDER + 1, 2 * BLOCKS))
    scaled[1, :], scaled[1, 3], scaled[2, 3] = 1.0, -0.42, 0.5  # lane 3: x reverses at 0.42,
    scaled[1, BLOCKS + 3] = 1e-3  # with next to nothing across
    least, swing = np.zeros((PANELS, BLOCKS)), np.zeros((PANELS, BLOCKS))
    mean, path = np.zeros((PANELS, 2 * BLOCKS)), np.zeros((1, BLOCKS))
    out, panels = np.zeros((ROWS, 2 * BLOCKS)), tables(ORDER + 1)
    _over_step(panels.rate, scaled, ORDER + 1, panels.fit, least, swing, mean, path, out)
    reverses = 4 * least**2 < swing
    assert np.argwhere(reverses).tolist() == [[int(0.42 * PANELS), 3]]
    assert mean[int(0.42 * PANELS), 3] == 0 and mean[0, 3] < 0 < mean[-1, 3]
    x, y = _velocity(scaled, 3)
    panel = int(0.42 * PANELS)
    whole = [
        _moment(x, y, lambda s: 1, *ends)[0]
        for ends in ((0, panel / PANELS), ((panel + 1) / PANELS, 1))
    ]
    assert out[0, 3] == pytest.approx(sum(whole), abs=1e-9)


def test_moments_over_a_part_of_a_step():
    column, panels = np.zeros((2, ORDER + 1)), tables(ORDER + 1)
    column[:, 1:4] = [[-0.2, 1.0, 0.3], [0.1, -0.2, 0.4]]
    x, y = Polynomial(column[0, 1:]) + 0.01, Polynomial(column[1, 1:]) - 0.02
    out = np.zeros((2 * ROWS + 1, WIDTH))
    _over_part(ORDER, column, panels.node, 0.30, 0.05, 0.01, -0.02, out)
    _over_part(ORDER, column, panels.node, 0.35, 0.04, 0.01, -0.02, out)
    found = out.sum(1)
    for r in range(ROWS):
        wanted = _moment(x, y, lambda s, r=r: (2 * s - 1) ** r, 0.30, 0.39)
        assert found[2 * r : 2 * r + 2] == pytest.approx(wanted, abs=1e-10)
    assert found[-1] == pytest.approx(_way(x, y, 0.30, 0.39), abs=1e-12)
    raw = panels.raw @ found[:-1].reshape(ROWS, 2)
    last = Legendre.basis(DEGREE, domain=[0, 1])
    wanted = [(2 * DEGREE + 1) * part for part in _moment(x, y, last, 0.30, 0.39)]
    assert raw[DEGREE] == pytest.approx(wanted, abs=1e-10)


def test_orders_of_springs_are_those_of_their_force():
    random, springs = np.random.default_rng(8), WIDTH
    x, y = 0.1 * random.normal(size=(2, ORDER, springs))
    x[0] += 1.0
    law = random.uniform(0.5, 2.0, (2, springs))
    square, inverse, px, py = (np.zeros((ORDER, springs)) for _ in range(4))
    square[0], inverse[0] = x[0] ** 2 + y[0] ** 2, 1 / np.hypot(x[0], y[0])
    _springs(ORDER, x, y, square, inverse, law, px, py)
    px[0], py[0] = (
        law[0] * x[0] * (1 - law[1] * inverse[0]),
        law[0] * y[0] * (1 - law[1] * inverse[0]),
    )
    for t in (0.05, -0.08):  # the series ends at order 8: it misses 0.08^9 and less
        power = t ** np.arange(ORDER)
        a, b = power @ x, power @ y
        pull = law[0] * (1 - law[1] / np.hypot(a, b))
        assert power @ px == pytest.approx(pull * a, abs=1e-8)
        assert power @ py == pytest.approx(pull * b, abs=1e-8)
