# SPDX-License-Identifier: Apache-2.0
"""Hours of names by several seeds, and what is counted of each."""

import numpy as np
import pytest

from benchmarks import identity


def half_an_hour(lasting, seed=0):
    """What a seed shows in half an hour with so many lasting failures."""
    return {
        'eol_ros': {'lasting_failures_per_hour': lasting / 0.5, 'switches_per_hour': 2.0 * seed}
    }


def test_hours_of_several_seeds_add_up():
    lasting = {3: 0, 4: 2, 5: 1}
    found = identity.measure_seeds(lambda s: half_an_hour(lasting[s], s), range(3, 6), 0.5)
    found = found['eol_ros']
    assert found['hours'] == 1.5 and found['lasting_failures'] == 3
    assert found['lasting_failures_per_hour'] == pytest.approx(2.0)
    assert found['switches_per_hour'] == pytest.approx(8.0)
    assert found['switches_per_hour_most'] == 10.0


def test_without_a_failure_the_rule_of_three_holds():
    found = identity.together([half_an_hour(0)] * 200, 0.5)['eol_ros']
    assert found['hours'] == 100.0
    assert found['lasting_per_hour_below_95'] == pytest.approx(0.03, rel=2e-3)


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
