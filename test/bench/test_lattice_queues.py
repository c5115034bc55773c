# SPDX-License-Identifier: Apache-2.0
"""The other queues of the bench follow the same rule: the same events as the automaton's own."""

import numpy as np
import pytest

from benchmarks import lattice_queues
from eol_ros.core.physics.automaton.ofc import ONE, Automaton


@pytest.mark.slow
@pytest.mark.parametrize('queue', ['tree', 'boxes'])
@pytest.mark.parametrize(('side', 'alpha'), [(7, 0.25), (16, 0.2), (70, 0.15), (35, 0.24)])
def test_other_queues_find_the_same_events(queue, side, alpha):
    ours, other = Automaton.random(side, alpha, 5), Automaton.random(side, alpha, 5)
    for count in (2000, 1000):
        sizes = np.zeros(count, np.int64)
        done = getattr(lattice_queues, queue)(other._stress, side, ONE, other._share, sizes)
        assert done == count
        np.testing.assert_array_equal(sizes, ours.run(count).size)
    np.testing.assert_array_equal(other.stress, ours.stress)
