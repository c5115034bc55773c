# SPDX-License-Identifier: Apache-2.0
"""The landscape on the covers: the same for a seed, at any resolution."""

import numpy as np
import pytest

from eol_ros.core import terrain

CELLS = 12


def test_the_landscape_is_seeded_and_has_sea_and_summit():
    land = terrain.landscape(1, cells=CELLS)
    assert land.shape == (5 * CELLS + 1, 5 * CELLS + 1)
    assert np.array_equal(land, terrain.landscape(1, cells=CELLS))
    assert not np.array_equal(land, terrain.landscape(2, cells=CELLS))
    assert land.min() == 0 and land.max() == 1
    assert 0.08 < np.mean(land == 0) < 0.16
    assert np.abs(np.diff(land, axis=0)).max() < 0.5  # continuous: no cliff from sample to sample


@pytest.mark.parametrize('seed', range(1, 6))
def test_finer_sampling_is_the_same_land(seed):
    coarse = terrain.landscape(seed, cells=16)
    fine = terrain.landscape(seed, cells=32)[::2, ::2]
    assert np.corrcoef(coarse.ravel(), fine.ravel())[0, 1] > 0.99
