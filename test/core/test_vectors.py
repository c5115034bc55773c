# SPDX-License-Identifier: Apache-2.0
"""Sums that stay in vector registers, against NumPy."""

import numpy as np
import pytest

from eol_ros.core.physics.series import entry
from eol_ros.core.vectors import WIDTH, lane_response, lane_responses


@entry
def _respond(once, twice, table, terms, count):
    lane_response(once, table, terms, count)
    lane_responses(twice, table, terms, count)


@pytest.mark.slow
def test_responses_of_lanes():
    random, count, lanes = np.random.default_rng(5), 6, 2 * WIDTH
    table = random.normal(size=(count * count, lanes))
    terms = random.normal(size=(2 * count, lanes))
    once, twice = np.zeros((count, lanes)), np.zeros((2 * count, lanes))
    _respond(once, twice, table, terms, count)
    wide = table.reshape(count, count, lanes)
    first, second = (np.einsum('req,eq->rq', wide, part) for part in np.split(terms, 2))
    assert np.allclose(once, first, atol=1e-14)
    assert np.allclose(twice, np.vstack((first, second)), atol=1e-14)
