# SPDX-License-Identifier: Apache-2.0
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eol_ros.core.stamp_watch import StampWatch

T0, S = 1_700_000_000_000_000_000, 1_000_000_000
PERIOD = S // 60
JUMPS = st.one_of(
    st.floats(-1e9, -0.3), st.floats(2.2, 1e9), st.sampled_from([-3600.0, 3600.0, -0.3])
)


@pytest.mark.slow
@given(
    st.lists(st.integers(0, 1_500_000_000), min_size=2, max_size=40),
    st.lists(st.integers(-150_000_000, 150_000_000), min_size=40, max_size=40),
    st.lists(st.sampled_from([0, 0, 0, 5 * S, 7200 * S]), min_size=40, max_size=40),
)
def test_late_messages_overtaking_and_silence_are_no_jump(delays, jitter, pauses):
    watch, at, heard = StampWatch(), T0, 0
    for delay, off, pause in zip(delays, jitter, pauses, strict=False):
        at += PERIOD + pause
        heard = max(heard, at - T0 + delay)
        swapped = at + off // 2  # two neighbours lie no more than 0.15 s out of order
        assert watch.take(swapped, heard) == 0


@pytest.mark.parametrize('waiting', [1, 5, 40, 600])
def test_messages_that_wait_while_all_stands_still_are_no_jump(waiting):
    """The last before the stall come after it, and the next one at once."""
    watch = StampWatch()
    for k in range(660):
        stalled_s = 30 if k >= 660 - waiting else 0
        assert watch.take(T0 + k * PERIOD, k * PERIOD + stalled_s * S) == 0
    assert watch.take(T0 + 41 * S, 41 * S) == 0
    assert watch.take(T0 + 51 * S, 42 * S) == 9 * S


@given(st.lists(JUMPS, min_size=1, max_size=4), st.integers(1, 100))
def test_each_jump_is_told_once_and_by_how_much(jumps, images):
    watch, offset, steady, told = StampWatch(), T0, 5 * S, []
    for jump in [0.0, *jumps]:
        offset += round(jump * S)
        for _ in range(images):
            steady += PERIOD
            found = watch.take(offset + steady, steady)
            told += [found] if found else []
    assert told == [round(jump * S) for jump in jumps]
