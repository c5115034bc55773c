# SPDX-License-Identifier: Apache-2.0
import numpy as np

from eol_ros.core.sound.arrivals import RECENT_S, WINDOW, Arrivals


def arrivals(needed_s):
    found = Arrivals()
    for k, needed in enumerate(needed_s):
        found.add(0.01 * k, needed)
    return found


def test_the_remedy_is_one():
    rng = np.random.default_rng(4)
    needed = 0.02 + rng.exponential(0.01, WINDOW)
    found = arrivals(needed)
    remedy_s = found.remedy_s(2.0, 0.025)
    assert np.mean(needed > remedy_s) <= 0.01
    assert np.mean(needed > remedy_s - 0.006) > 0.01  # and not much more than one
    assert found.remedy_s(2.0, remedy_s) is None


def test_few_triggers_and_old_ones_say_nothing():
    assert arrivals([0.5] * (WINDOW - 1)).remedy_s(2.0, 0.025) is None
    assert arrivals([0.5] * WINDOW).remedy_s(3.0, 0.025) == 0.502
    assert arrivals([0.5] * WINDOW).remedy_s(RECENT_S + 1.0, 0.025) is None
    assert Arrivals().remedy_s(3.0, 0.025) is None
