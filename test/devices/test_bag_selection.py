# SPDX-License-Identifier: Apache-2.0
"""Which images are kept, and how losses are counted."""

from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros.devices.bag.mcap_file import BagMessage
from eol_ros.devices.bag.selection import (
    LATEST_NS,
    NS,
    SLIP_LIMIT_NS,
    AroundSlips,
    Gaps,
    LogTimes,
    RateLimiter,
    Slipping,
    StampGaps,
)

STEP = NS // 60


def picture(i: int) -> BagMessage:
    return BagMessage('image', b'', i * STEP, i * STEP, i)


def kept(slips: dict[int, Slipping], count: int, before_s=0.1, after_s=0.05) -> list[int]:
    ring, numbers = AroundSlips(before_s, after_s), []
    for i in range(count):
        if i in slips:
            numbers += [p.sequence for p in ring.slip(slips[i])]
        numbers += [p.sequence for p in ring.image(picture(i))]
    return numbers


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.integers(0, 300), st.integers(0, 690), st.booleans()), max_size=6),
    st.floats(0, 1),
    st.floats(0, 1),
)
def test_kept_is_what_lies_around_a_slip_and_nothing_else(drawn, before_s, after_s):
    """Oracle: every image against every slip. Some slips are never told to have stopped."""
    at = {}  # of each image, what is told just before it
    slips = []
    for number, (begin, length, stops) in enumerate(drawn):
        if begin in at or begin + length in at or (stops and not length):
            continue
        at[begin] = Slipping(number, True, begin * STEP)
        if stops:
            at[begin + length] = Slipping(number, False, (begin + length) * STEP)
        slips.append((begin * STEP, (begin + length) * STEP if stops else None))
    before_ns, after_ns = round(before_s * NS), round(after_s * NS)

    def wanted(i):
        for start, stop in slips:
            during = start <= i * STEP <= start + SLIP_LIMIT_NS and (
                stop is None or i * STEP < stop
            )
            told = [start] if stop is None else [start, stop]
            if during or any(t - before_ns <= i * STEP <= t + after_ns for t in told):
                return True
        return False

    assert kept(at, 1000, before_s, after_s) == [i for i in range(1000) if wanted(i)]


def test_nothing_is_kept_while_nothing_slips_and_the_ring_stays_small():
    ring = AroundSlips(0.25, 0.25)
    for i in range(1000):
        assert list(ring.image(picture(i))) == []
    assert len(list(ring.slip(Slipping(1, True, 999 * STEP)))) == 16


def test_thinning_does_not_catch_up_after_a_pause():
    limiter = RateLimiter(1.0)
    times = [0.0, 0.5, 1.0, 10.0, 10.5, 11.0]
    passed = [t for t in times if limiter.keep(BagMessage('meter', b'', int(t * NS), 0, 0))]
    assert passed == [0.0, 1.0, 10.0, 11.0]
    assert limiter.keep(BagMessage('preview', b'', 0, 0, 0))  # each topic has its own


def test_a_restarted_publisher_has_lost_nothing():
    gaps = Gaps()
    for number in (5, 6, 7, 1, 2, 4):
        gaps.take('t', number)
    assert gaps.lost['t'] == 1
    gaps.take('u', 0)
    gaps.take('u', 0)
    assert gaps.lost['u'] == 0


@given(
    st.sets(st.integers(2, 60), max_size=20),
    st.sets(st.integers(2, 60), max_size=20),
    st.lists(st.booleans(), min_size=120, max_size=120),
)
def test_two_publishers_that_speak_in_turn_are_told_apart(lost_a, lost_b, turns):
    """One is far ahead of the other, as the triggers of the work are of those of a person."""
    gaps = Gaps()
    gaps.take('t', 1000)
    gaps.take('t', 1)
    a = iter([1000 + k for k in range(1, 62) if k not in lost_a])
    b = iter([k for k in range(2, 62) if k not in lost_b])
    for number in [n for turn in turns if (n := next(a if turn else b, 0))] + [*a, *b]:
        gaps.take('t', number)
    assert gaps.lost['t'] == len(lost_a) + len(lost_b)


@given(st.sets(st.integers(20, 99), max_size=20), st.integers(0, 3))
def test_holes_in_the_rhythm_of_stamps_are_counted(missing, seed):
    gaps = StampGaps()
    for i in range(101):
        if i not in missing:
            jitter = (i * 7919 + seed * 104729) % (STEP // 5)
            gaps.take(NS + i * STEP + jitter)
    assert gaps.missing == len(missing)


def test_holes_are_counted_where_most_of_the_rhythm_is_holes():
    gaps = StampGaps()
    kept = [0, 1, 4, 5, *range(6, 40), *range(40, 4000, 3), *range(4000, 9000, 5), 9001]
    for i in kept:
        gaps.take(NS + i * STEP)
    assert gaps.missing == kept[-1] + 1 - len(kept)


def test_a_rhythm_that_is_known_needs_no_start():
    gaps, kept = StampGaps(NS / STEP), [0, 3, 5, 8, 10, 13, *range(14, 60)]
    for i in kept:
        gaps.take(NS + i * STEP)
    assert gaps.missing == 60 - len(kept)


def test_what_was_dropped_here_is_not_lost_before():
    gaps = Gaps()
    for number, fits in ((1, True), (2, False), (3, False), (5, True), (6, False), (9, True)):
        (gaps.take if fits else gaps.skip)('t', number)
        gaps.take('t', 0)  # a message without a number says nothing
    assert gaps.lost['t'] == 1 + 2
    assert gaps.received['t'] == 3 + 6


def test_a_replay_that_loops_has_no_gap():
    gaps = StampGaps()
    for _ in range(3):
        for i in range(1, 30):
            gaps.take(i * STEP)
    assert gaps.missing == 0


def test_times_of_the_middleware_are_taken_where_they_can_be():
    times, now = LogTimes(), 100 * NS
    assert times.take('a', now - 3, now - 5, now) == (now - 3, now - 5)
    assert times.take('a', now + NS, now - 1, now) == (now, now - 1)  # received in times to come
    assert times.take('b', now - LATEST_NS - 1, now + 1, now) == (now, now)  # too long ago
    assert times.take('c', now - LATEST_NS, 0, now) == (now - LATEST_NS, now - LATEST_NS)


def test_a_topic_never_goes_back_and_a_bag_never_before_its_begin():
    times, now = LogTimes(begun_ns=50 * NS), 51 * NS
    assert times.take('a', 50 * NS - 1, 50 * NS, now) == (now, 50 * NS)
    assert times.take('a', now - 9, now - 9, now) == (now + 1, now - 9)
    assert times.take('b', now - 9, now - 9, now) == (now - 9, now - 9)
