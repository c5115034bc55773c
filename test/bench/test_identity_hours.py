# SPDX-License-Identifier: Apache-2.0
"""Hours of names by several seeds, and what is counted of each."""

import numpy as np

from benchmarks import identity


def test_names_are_counted_as_they_are():
    score, true = identity.Score(), np.array([2, -1, 0, 1])
    index = np.full(25, -1)
    index[[0, 1, 2]] = [2, 3, 0]
    assert not score.add(0.0, true, index, False)
    assert (score.shown, score.hidden, score.missed, score.wrong) == (3, 22, 0, 0)
    index[[0, 1, 5]] = [3, 2, 1]  # two are exchanged, and a false light has a name
    assert not score.add(1.0, true, index, True)
    assert (score.wrong, score.switches, score.ghosts, score.sure_wrong) == (2, 2, 1, 0)
    index[:] = -1
    assert not score.add(3.0, true, index, False)
    assert score.missed == 3 and score.switches == 2
    assert score.add(3.01, true, index, False)  # 2.01 s without the right name
    assert score.lasting == score.undeclared == 1
