# SPDX-License-Identifier: Apache-2.0
"""Sums that stay in vector registers: the orders of springs, against NumPy."""

import numpy as np
import pytest

from eol_ros.core.physics.series import entry
from eol_ros.core.vectors import WIDTH, spring_order

ORDER = 9


@entry
def _springs(orders, x, y, square, inverse, law, px, py):
    for k in range(1, orders):
        spring_order(k, x, y, square, inverse, law, px, py)


@pytest.mark.slow
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
