# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.lab.science.quiescent import NotAtRest, cascades, joined


def test_cascades_end_where_nothing_moves():
    #        one slip | 3 sets off 4, 3 slips again  | 0, not over
    block = [7, 7, 3, 4, 3, 3, 4, 3, 0]
    start = [1, 0, 1, 1, 0, 1, 0, 0, 1]
    size, area = cascades(np.array(block), np.array(start))

    assert size.tolist() == [1, 3]
    assert area.tolist() == [1, 2]


def test_nothing_happened():
    size, area = cascades(np.array([]), np.array([]))

    assert len(size) == len(area) == 0


def test_one_that_is_never_over_is_left_out():
    size, area = cascades(np.array([1, 2]), np.array([1, 1]))

    assert len(size) == len(area) == 0


@pytest.mark.parametrize(('block', 'start'), [([1, 1, 2], [1, 0, 0]), ([1, 1, 1], [1, 1, 1])])
def test_events_that_cannot_be_are_refused(block, start):
    with pytest.raises(NotAtRest, match='at rest'):
        cascades(np.array(block), np.array(start))


def test_slips_are_joined_as_their_events_are():
    rng = np.random.default_rng(1)
    begin, end, block = [], [], []
    for one in range(6):  # a block rests between its slips
        gaps = rng.exponential(1.0, 120)
        edges = np.cumsum(gaps * np.tile([12.0, 1.0], 60))
        begin += edges[::2].tolist()
        end += edges[1::2].tolist()
        block += [one] * 60
    times = np.r_[begin, end]
    order = np.argsort(times)
    start = np.r_[np.ones(360, bool), np.zeros(360, bool)][order]
    areas = cascades(np.r_[block, block][order], start)[1]
    mixed = rng.permutation(360)
    found = joined(np.array(begin)[mixed], np.array(end)[mixed], np.array(block)[mixed])

    assert len(areas) > 50 and areas.max() > 2
    np.testing.assert_array_equal(found, areas)
    assert len(joined(np.zeros(0), np.zeros(0), np.zeros(0, int))) == 0
