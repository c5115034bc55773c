# SPDX-License-Identifier: Apache-2.0
"""Recorded time against wall time, through messages that come late, pauses and loops."""

import numpy as np
import pytest

from eol_ros.core.played_clock import PlayedClock

R0, W0 = 1_700_000_000_000_000_000, 1_800_000_000_000_000_000
MS = 1_000_000


class Replay:
    """A replay with a truth of its own: tells its time every 10 ms, heard up to 4 ms late."""

    def __init__(self, rate, seed=0, late_ms=4.0):
        self.rate, self.rng, self.late_ms = rate, np.random.default_rng(seed), late_ms
        self.clock, self.wall, self.recorded = PlayedClock(), W0, R0

    def run(self, seconds, rate=None):
        rate = self.rate if rate is None else rate
        for _ in range(round(seconds * 100)):
            self.wall += 10 * MS
            self.recorded += round(10 * MS * rate)
            heard = self.wall + round(self.rng.uniform(0, self.late_ms) * MS)
            self.clock.take(self.recorded, heard)


@pytest.mark.parametrize('rate', [0.01, 0.25, 1.0, 4.0, 100.0])
def test_a_stamp_of_now_is_mapped_to_when_it_was_played(rate):
    replay = Replay(rate)
    replay.run(2.0)
    errors = []
    for _ in range(200):
        replay.run(0.01)
        for ago_ms in (0, 5, 30):  # as a trigger comes some milliseconds after its image
            stamp = replay.recorded - round(ago_ms * MS * rate)
            errors.append(replay.clock.wall_ns(stamp) - (replay.wall - ago_ms * MS))
    assert np.abs(errors).max() < 5 * MS
    assert np.std(errors) < 1.2 * MS  # less than that of the messages themselves
    back = replay.clock.recorded_ns(replay.wall)
    assert abs(back - replay.recorded) < 5 * MS * rate + 1


@pytest.mark.parametrize(('rate', 'times'), [(0.01, 100), (0.25, 4), (1.0, 1), (4.0, 1)])
def test_what_waits_waits_longer_behind_a_slower_replay(rate, times):
    replay = Replay(rate)
    replay.run(0.05)
    assert replay.clock.stretch == 1  # the pace is not known
    replay.run(2.0)
    assert replay.clock.stretch == pytest.approx(times, rel=0.01)


def test_what_waits_waits_as_long_while_messages_are_late():
    replay = Replay(0.25)
    replay.run(2.0)
    replay.wall += 60 * MS  # a busy machine: the pace is fitted from here on again
    for _ in range(12):
        replay.run(0.01)
        assert replay.clock.stretch == pytest.approx(4, rel=0.05)
    replay.run(2.0, rate=1.0)
    assert replay.clock.stretch == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize('rate', [0.25, 1.0, 4.0])
def test_from_the_first_message_on_nothing_is_far_off(rate):
    replay = Replay(rate)
    replay.run(1.0, rate=0.0)  # it stands until all are there
    for _ in range(30):
        replay.run(0.01)
        stamp = replay.recorded - round(4 * MS * rate)
        assert abs(replay.clock.wall_ns(stamp) - (replay.wall - 4 * MS)) < 12 * MS


def test_through_a_pause():
    replay = Replay(1.0)
    replay.run(1.0)
    last, played = replay.recorded - 5 * MS, replay.wall - 5 * MS
    replay.run(5.0, rate=0.0)
    assert abs(replay.clock.wall_ns(last) - played) < 5 * MS  # it was played before the pause
    assert replay.clock.recorded_ns(replay.wall + 3 * MS) == replay.recorded
    for _ in range(20):
        replay.run(0.01)
        stamp = replay.recorded - 2 * MS
        assert abs(replay.clock.wall_ns(stamp) - (replay.wall - 2 * MS)) < 12 * MS


def test_after_a_jump_back_nothing_before_it_holds():
    replay = Replay(1.0)
    replay.run(2.0)
    replay.recorded = R0
    assert not replay.clock.take(replay.recorded + 2000 * MS + 1, replay.wall)
    assert replay.clock.take(replay.recorded, replay.wall)
    replay.run(0.5)
    stamp = replay.recorded - 3 * MS
    assert abs(replay.clock.wall_ns(stamp) - (replay.wall - 3 * MS)) < 6 * MS
