# SPDX-License-Identifier: Apache-2.0
"""Replay against a clock that does not wait."""

import pytest
from bag_samples import write_bag

from eol_ros.devices.bag_player import BagPlayer, choose
from eol_ros.devices.bag_reader import BagReader
from eol_ros.errors import ConfigError

POINTS, TEXTS = '/eol/point', '/eol/text'


class Clock:
    """A clock that only moves when somebody sleeps."""

    def __init__(self):
        self.now = 100.0
        self.given = []
        self.at_sleep = None

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        if self.at_sleep:
            self.at_sleep()

    def give(self, message):
        self.given.append((self.now - 100.0, message))


@pytest.fixture
def bag(tmp_path):
    write_bag(tmp_path / 'run').close()
    return BagReader(tmp_path / 'run')


def play(bag, topics=(POINTS,), **options):
    clock = Clock()
    player = BagPlayer(bag, topics, clock.give, clock=clock, sleep=clock.sleep, **options)
    return clock, player


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_messages_come_at_their_time(bag, rate):
    clock, player = play(bag, rate=rate)
    player.run()
    assert [m.sequence for _, m in clock.given] == list(range(1, 101))
    assert [t for t, _ in clock.given] == pytest.approx([i * 0.01 / rate for i in range(100)])
    assert player.position_s == pytest.approx(0.99)


def test_bytes_are_untouched(bag):
    clock, player = play(bag, (POINTS, TEXTS), fast=True)
    player.run()
    assert [m for _, m in clock.given] == list(bag.messages())
    assert clock.now == 100.0


def test_start_skips(bag):
    clock, player = play(bag, start_s=0.5)
    player.run()
    assert [m.sequence for _, m in clock.given] == list(range(51, 101))
    assert clock.given[0][0] == 0.0


def test_loop_begins_again_until_stopped(bag):
    clock, player = play(bag, loop=True)
    clock.at_sleep = lambda: player.stop() if len(clock.given) >= 250 else None
    player.run()
    assert [m.sequence for _, m in clock.given[95:105]] == [*range(96, 101), *range(1, 6)]
    assert len(clock.given) == 250


def test_loop_over_nothing_ends(bag):
    clock, player = play(bag, ('/absent',), loop=True)
    player.run()
    assert clock.given == []


def test_a_pause_shifts_what_follows(bag):
    clock, player = play(bag)
    naps = []

    def at_sleep():
        if len(clock.given) == 50:
            naps.append(clock.now)
            if len(naps) in (1, 21):
                player.pause()

    clock.at_sleep = at_sleep
    player.run()
    assert len(clock.given) == 100
    assert clock.given[49][0] == pytest.approx(0.49)
    assert clock.given[-1][0] == pytest.approx(0.99 + 2.0, abs=0.11)


def test_far_behind_the_clock_is_set_anew(bag):
    clock, player = play(bag)
    give = clock.give

    def slow_once(message):
        give(message)
        clock.now += 5.0 if message.sequence == 50 else 0.0

    player._give = slow_once
    player.run()
    steps = [b[0] - a[0] for a, b in zip(clock.given, clock.given[1:], strict=False)]
    assert steps[49] == pytest.approx(5.0)
    assert steps[51:] == pytest.approx([0.01] * 48)


def test_which_topics_are_played(bag):
    assert choose(bag, ['point', '/eol/text'], []) == [POINTS, TEXTS]
    assert choose(bag, [], ['/eol/pictures', TEXTS, POINTS]) == [TEXTS]
    with pytest.raises(ConfigError, match='neither /a nor /b in it.*there are /eol/point'):
        choose(bag, [], ['/a', '/b'])
