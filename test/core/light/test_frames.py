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


def until(frames, stamp_ns):
    """Return the levels up to a stamp that were not returned before."""
    return [levels for _, levels, _ in frames.due(stamp_ns)]


def slip(frames, stamp_ns, *blocks):
    """Light blocks; return the frames that lie before, and last the levels with the light."""
    frames.lit(stamp_ns, 'slip', *blocks)
    return until(frames, stamp_ns)


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
        levels += until(frames, now - lag) if tick else slip(frames, *slips[n])
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


KNOCKS = st.lists(
    st.tuples(st.integers(0, 4000), st.integers(0, 24), st.booleans()), min_size=1, max_size=20
)


@pytest.mark.slow
@given(KNOCKS, st.lists(st.integers(0, LAG), min_size=40, max_size=40), st.integers(1, 30))
def test_knocks_and_slips_give_the_same_levels_in_whatever_order_they_are_told(
    lit, delays, tick_ms
):
    """A slip is seen 12 ms after its onset; if its block was felt, that was 1 ms after it."""
    events = []
    for n, (ms, block, felt) in enumerate(sorted({(ms, block, felt) for ms, block, felt in lit})):
        onset = T0 + ms * MS + n  # no two at one moment
        events.append((onset + 12 * MS, block, onset))
        if felt:
            events.append((onset + MS, block, None))

    def told(delays, tick_ms):
        frames, found = Frames(FlashField(0.2), 100.0), []
        known = sorted((e[0] + d, 0, e) for e, d in zip(events, delays, strict=False))
        ticks = [(t, 1, None) for t in range(T0, T0 + 10**10, tick_ms * MS)]
        for now, tick, event in sorted(known + ticks, key=lambda one: one[:2]):
            if tick:
                found += frames.due(now - LAG)
            else:
                stamp, block, onset = event
                frames.lit(stamp, 'cause', block, onset_ns=onset)
        return found, frames

    quick, _ = told([0] * 40, 5)
    slow, frames = told(delays, tick_ms)
    assert quick == slow
    assert not frames.late and not frames.glows
    flashes = [t for t, _, cause in quick if cause]
    assert len(flashes) <= len(lit)


def test_a_slip_that_its_block_has_lit_is_not_lit_again():
    frames = Frames(FlashField(0.2), 100.0)
    frames.lit(T0 + 15 * MS, 'seen', 3, onset_ns=T0 - 2 * MS)  # told before the knock
    frames.lit(T0 + 15 * MS, 'seen', 4, onset_ns=T0)
    frames.lit(T0, 'felt', 3)
    lit = [(t - T0, cause) for t, _, cause in frames.due(T0 + LAG) if cause]
    assert lit == [(0, 'felt'), (15 * MS, 'seen')]
    frames.lit(T0 + 515 * MS, 'seen', 3, onset_ns=T0 + 500 * MS)  # another slip, not felt
    assert [cause for _, _, cause in frames.due(T0 + 600 * MS) if cause] == ['seen']


def test_light_runs_on_to_blocks_that_were_dark_for_a_second_alone():
    frames = Frames(FlashField(0.05), 100.0)
    frames.lit(T0, 'slip', 3)
    frames.lit(T0 + 500 * MS, 'runs', 3, 4, spread=0.5)
    frames.lit(T0 + 1600 * MS, 'runs', 3, spread=1.0)
    frames.lit(T0 + 1700 * MS, 'runs', 3, spread=1.0)
    lit = [(t, w[3], w[4]) for t, w, c in frames.due(T0 + 2 * 10**9) if c]
    assert lit == [(T0, 255, 0), (T0 + 500 * MS, 0, 128), (T0 + 1600 * MS, 255, 0)]


def test_dim_light_runs_on_to_no_block_that_shines_brighter():
    frames = Frames(FlashField(2.0), 100.0)
    frames.lit(T0, 'slip', 3)  # 0.55 after 1.2 s
    frames.lit(T0 + 1200 * MS, 'runs', 3, 4, spread=0.5)
    frames.lit(T0 + 1600 * MS, 'runs', 3, spread=0.6)
    found = frames.due(T0 + 2 * 10**9)
    lit = [(t, w[3]) for t, w, c in found if c]
    assert lit == [(T0, 255), (T0 + 1200 * MS, 140), (T0 + 1600 * MS, 153)]
    grid = [t for t, _, c in found if not c]
    assert grid == sorted(grid) and len(grid) == 200
    before = [w[3] for t, w, _ in found if T0 < t < T0 + 1600 * MS]
    assert all(np.diff(before) <= 0) and before[-1] < 128


def test_a_slip_known_too_late_is_lit_and_counted():
    frames = Frames(FlashField(0.2), 100.0)
    slip(frames, T0, 1)
    until(frames, T0 + 100 * MS)
    (levels,) = slip(frames, T0 + 50 * MS, 2)
    assert levels[2] == 255 and frames.late == 1


@pytest.mark.parametrize('jump_s', [-3600, -2, 3600])
def test_a_clock_that_is_set_neither_stops_nor_restarts_the_light(jump_s):
    frames = Frames(FlashField(0.1), 100.0)
    slip(frames, T0, 1)
    until(frames, T0 + 50 * MS)
    frames.shift(jump_s * 10**9)
    now = T0 + jump_s * 10**9
    (same, fainter) = slip(frames, now + 50 * MS, 1)[-1], until(frames, now + 450 * MS)[-1]
    assert same[1] == 255
    assert fainter[1] < 255  # the hold of a third of a second counts on
    assert until(frames, now + 10**10)[-1] == bytes(25)
