# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from eol_ros.core.geometry import N_BLOCKS, rest_lattice
from eol_ros.core.motion.felt import Knock
from eol_ros.core.motion.motion import Motion, _Begun
from eol_ros.settings import MotionSettings


def run(taps, arrival_lag_s):
    """Block 7 slips at 2.0 s; taps (stamp, block, sigma) arrive a fixed time later."""
    random = np.random.default_rng(0)
    motion = Motion(MotionSettings())
    slips, cascades = [], []
    waiting = sorted(taps)
    for k in range(240):
        t = k / 60
        while waiting and waiting[0][0] + arrival_lag_s <= t:
            stamp_s, block, sigma_s = waiting.pop(0)
            motion.tap(Knock(round(stamp_s * 1e9), block, sigma_s))
        place = rest_lattice() + random.normal(0, 1e-5, (N_BLOCKS, 2))
        place[7, 0] += 1.25 * min(max(t - 2.0, 0), 0.1) ** 2
        new, closed = motion.update(t, place[:, 0], place[:, 1], np.ones(N_BLOCKS, bool))
        slips += new
        cascades += closed
    return slips, cascades


def test_tap_says_when():
    slips, cascades = run([(2.0004, 7, 2e-4)], 0.01)
    start, stop = slips
    assert not start.tapped
    assert stop.tapped
    assert stop.event.onset_s == pytest.approx(2.0004, abs=3e-4)
    assert stop.event.onset_sigma_s < 2.1e-4
    assert cascades[0].onset_s == stop.event.onset_s
    end = start.event.onset_s, run([], 0)[0][1].event
    assert stop.event.onset_s + stop.event.duration_s == pytest.approx(
        end[1].onset_s + end[1].duration_s
    )


@pytest.mark.parametrize('tap', [(2.0004, 8, 2e-4), (2.3, 7, 2e-4), (1.7, 7, 2e-4)])
def test_tap_of_another_block_or_time_says_nothing(tap):
    assert not run([tap], 0.01)[0][1].tapped


def test_arrival_time_of_a_tap_does_not_matter():
    taps = [(2.0004, 7, 2e-4), (2.0007, 7, 3e-4), (2.001, 6, 1e-3)]
    assert run(taps, 0.0) == run(taps, 0.09)


@pytest.mark.parametrize(('late_s', 'is_it'), [(0.045, True), (-0.045, True), (0.06, False)])
def test_an_onset_that_the_images_see_late_is_still_that_of_its_knock(late_s, is_it):
    """As of a slip that follows another within 0.1 s, whose rest is told after it has begun."""
    motion = Motion(MotionSettings())
    motion._begun = [_Begun(slip=9, block=3, onset_s=2.0 + late_s, onset_sigma_s=1e-3)]
    knock = Knock(2_000_000_000, 3, 2e-4, 1.0)
    assert motion._fuse(knock) == (9 if is_it else 0)
    assert motion._fuse(knock) == 0  # it has been given away
