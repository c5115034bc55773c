# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.science.quiescent import NotAtRest, cascades


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
