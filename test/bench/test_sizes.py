# SPDX-License-Identifier: Apache-2.0
"""The moments of `eol bench sizes` find the exponents that areas were drawn with."""

import numpy as np
import pytest

from benchmarks import sizes
from benchmarks.sizes import MOMENTS, _scaling
from eol_ros.core.science.powerlaw import sample


def drawn(tau, x_min, x_max, count, rng):
    """How many there are of each area of a law."""
    return np.bincount(sample(tau, x_min, x_max, count, rng), minlength=x_max + 1)


def test_scaling_finds_tau_and_dimension_of_a_law_that_scales():
    """P(A) ~ A^-1.4 up to L^2: D = 2, and sigma(q) = 2 (q - 0.4) as L grows."""
    sides = (16, 32, 64, 128)
    areas = {
        (n, s): drawn(1.4, 1, n * n, 200_000, np.random.default_rng([n, s]))
        for n in sides for s in range(3)
    }  # fmt: skip
    found = _scaling('x', sides, range(3), lambda n, s: areas[n, s])

    assert found['D'] == pytest.approx(2.0, abs=0.05)
    assert found['tau'] == pytest.approx(1.4, abs=0.05)
    assert found['bend'] < 0.05
    np.testing.assert_allclose(found['sigma'], 2 * (np.array(MOMENTS) - 0.4), atol=0.12)


def test_a_law_that_does_not_grow_has_no_dimension():
    areas = {
        (n, s): drawn(2.5, 1, 40, 50_000, np.random.default_rng([n, s]))
        for n in (16, 32, 64) for s in range(2)
    }  # fmt: skip
    found = _scaling('x', (16, 32, 64), range(2), lambda n, s: areas[n, s])

    np.testing.assert_allclose(found['sigma'], 0, atol=0.05)


@pytest.mark.slow
def test_curves_of_a_law_that_scales_fall_on_one_another(tmp_path):
    sides, seeds = (16, 32, 64), range(2)
    areas = {
        (n, s): drawn(1.5, 1, n * n, 20_000, np.random.default_rng([n, s]))
        for n in sides for s in seeds
    }  # fmt: skip
    found = _scaling('x', sides, seeds, lambda n, s: areas[n, s])
    off = sizes.apart(sides, found['curves'], 1.0, 1.5)  # areas that grow with L, not L^2

    assert sizes.apart(sides, found['curves'], 2.0, 1.5) < 0.1 < 0.4 < off
    side = {'mean_area': 2.0, 'mean_area_deviation': 0.1}
    rows = [
        {'side': n, 'table': side, 'plate': side, 'ks': 0.1, 'ks_deviation': 0.0,
         'ks_of_two_starts': 0.0} for n in sides
    ]  # fmt: skip
    result = {
        'seeds': 2, 'starts': 2, 'travel_m': 1.0, 'speed_mps': 1e-3, 'sides': rows,
        'scaling': [found],
    }  # fmt: skip
    sizes.draw(result, tmp_path)
    assert {f.name for f in tmp_path.iterdir()} == {'sizes.png', 'collapse.png'}
