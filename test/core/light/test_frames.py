# SPDX-License-Identifier: Apache-2.0
"""Frames of light are a function of the slips' stamps, however late each slip is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.light.flash import FlashField
from eol_ros.core.light.frames import Frames

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
LAG = 40 * MS


def shown(slips, delays, ticks, lag=LAG, decay_s=0.05):
    """Levels in order: slips (stamp, block) known `delays` later, frames asked for at `ticks`."""
    frames = Frames(FlashField(decay_s), 100.0)
    events = [
        (stamp + delay, 0, n)
        for n, ((stamp, _), delay) in enumerate(zip(slips, delays, strict=False))
    ]
    events += [(tick, 1, 0) for tick in ticks]
    levels = []
    for now, tick, n in sorted(events):
        levels += frames.until(now - lag) if tick else frames.slip(*slips[n])
    return levels, frames


SLIPS = st.lists(st.tuples(st.integers(0, 240), st.integers(0, 24)), min_size=1, max_size=20)


@pytest.mark.slow
@given(SLIPS, st.lists(st.integers(0, LAG), min_size=40, max_size=40), st.integers(1, 30))
def test_the_same_slips_give_the_same_levels_whenever_they_are_known(slips, delays, tick_ms):
    slips = sorted({(T0 + image * 16_666_667, block) for image, block in slips})
    half = [LAG // 2 + delay // 2 for delay in delays]  # in the order of their stamps
    for n in range(1, len(slips)):
        half[n] = max(half[n], half[n - 1] + slips[n - 1][0] - slips[n][0])
    end = slips[-1][0] + 10**10
    quick, _ = shown(slips, [0] * len(slips), range(T0, end, 5 * MS))
    slow, frames = shown(slips, half, range(T0 + 3, end, tick_ms * MS))

    assert quick == slow
    assert not frames.late and not frames.glows
    assert quick[-1] == bytes(25)


def test_frames_lie_on_the_grid_of_the_slip_that_lit_the_dark():
    field = FlashField(0.2)
    frames = Frames(field, 100.0)
    assert frames.until(T0) == []
    (lit,) = frames.slip(T0 + 5 * MS, 3)
    assert lit[3] == 255 and sum(lit) == 255
    assert frames.until(T0 + 14 * MS) == []
    (first,) = frames.until(T0 + 15 * MS)
    assert first[3] == round(255 * np.exp(-0.01 / 0.2))
    before, after = frames.slip(T0 + 26 * MS, 4)
    assert before[4] == 0 and before[3] < first[3]
    assert after[4] == 255 and len(frames.until(T0 + 36 * MS)) == 1


def test_a_slip_known_too_late_is_lit_and_counted():
    frames = Frames(FlashField(0.2), 100.0)
    frames.slip(T0, 1)
    frames.until(T0 + 100 * MS)
    (levels,) = frames.slip(T0 + 50 * MS, 2)
    assert levels[2] == 255 and frames.late == 1


@pytest.mark.parametrize('jump_s', [-3600, -2, 3600])
def test_a_clock_that_is_set_neither_stops_nor_restarts_the_light(jump_s):
    frames = Frames(FlashField(0.1), 100.0)
    frames.slip(T0, 1)
    frames.until(T0 + 50 * MS)
    frames.shift(jump_s * 10**9)
    now = T0 + jump_s * 10**9
    (same, fainter) = frames.slip(now + 50 * MS, 1)[-1], frames.until(now + 450 * MS)[-1]
    assert same[1] == 255
    assert fainter[1] < 255  # the hold of a third of a second counts on
    assert frames.until(now + 10**10)[-1] == bytes(25)
