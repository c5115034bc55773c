# SPDX-License-Identifier: Apache-2.0
"""How late a camera sees a light: blinks with a delay that nobody tells."""

import numpy as np
import pytest
from support import measured_twins
from support.measured_twins import Blinks

from eol_ros.errors import EolError


def test_the_delay_is_found_far_finer_than_an_image():
    for seed in range(3):
        blinks = Blinks(seed)
        found = measured_twins.measured_light(blinks)
        low, high = found.delay.interval(0.99)
        assert low < blinks.delay_s < high and found.delay.sigma < 0.002
        assert found.block == blinks.block
        # on average half an image until the next is exposed, and then what it takes
        assert found.heard_s.mean() == pytest.approx(
            blinks.delay_s + 0.5 / 60 + blinks.heard_s, abs=0.004
        )


@pytest.mark.soak
def test_intervals_hold_as_often_as_they_say():
    twins = [Blinks(seed) for seed in range(2000, 2100)]
    held = measured_twins.held([(t.delay_s, measured_twins.measured_light(t).delay) for t in twins])
    assert 59 <= held[0] <= 77 and held[1] >= 90


def test_what_cannot_be_known_is_refused():
    blinks = Blinks(1, blinks=40, period_s=2.0)
    with pytest.raises(EolError, match='in step with the camera'):
        measured_twins.measured_light(blinks)
    few = Blinks(1, blinks=4)
    with pytest.raises(EolError, match='blinks seen, 10 are needed'):
        measured_twins.measured_light(few)
    few.sent_s = np.zeros(0)
    with pytest.raises(EolError, match='Let one block blink'):
        measured_twins.measured_light(few)
    few.stamp_s = few.stamp_s[:1]
    with pytest.raises(EolError, match='no images of the blocks'):
        measured_twins.measured_light(few)


def test_a_lost_image_is_no_evidence():
    blinks = Blinks(2)
    first_dark = np.flatnonzero(np.diff(blinks.seen[:, blinks.block].astype(int)) == -1) + 1
    kept = np.ones(len(blinks.stamp_s), bool)
    kept[first_dark[:10]] = False
    before = len(measured_twins.measured_light(blinks).middles_s)
    blinks.stamp_s, blinks.seen = blinks.stamp_s[kept], blinks.seen[kept]
    found = measured_twins.measured_light(blinks)
    assert len(found.middles_s) == before - 10
    low, high = found.delay.interval(0.99)
    assert low < blinks.delay_s < high
