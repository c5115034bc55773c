# SPDX-License-Identifier: Apache-2.0
"""Replay against a clock that does not wait."""

import struct

import pytest
from support.bag_samples import POINT, T0, write_bag

from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.player import (
    LATE_S,
    LEAD_NS,
    STAND_S,
    TAIL_NS,
    BagPlayer,
    Played,
    choose,
    complete,
)
from eol_ros.devices.bag.reader import BagReader
from eol_ros.devices.bag.writer import BagWriter
from eol_ros.errors import ConfigError
from eol_ros.settings import ReplaySettings
from eol_ros.streams.cdr import stamp_ns

POINTS, TEXTS, IMAGES = '/eol/point', '/eol/text', '/eol/image'
NS = 1_000_000_000
LEAD_S = LEAD_NS * 1e-9


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


def play(bag, topics=(POINTS,), stamped=(), taps=(), begin=lambda: None, **settings):
    clock = Clock()
    player = BagPlayer(
        bag, Played(topics, stamped, taps), clock.give, ReplaySettings(**settings), begin, clock,
        clock.sleep,
    )  # fmt: skip
    return clock, player


def test_a_message_too_short_for_a_stamp_is_played_like_any_other(tmp_path):
    writer = write_bag(tmp_path / 'run', 10)
    writer.write(POINTS, b'\0\1\0\0', T0 + 200_000_000, T0 + 200_000_000, 11)
    writer.close()
    clock, player = play(BagReader(tmp_path / 'run'), stamped=[POINTS])
    player.run()
    assert [m.sequence for _, m in clock.given] == list(range(1, 12))


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_messages_come_at_their_time(bag, rate):
    clock, player = play(bag, rate=rate)
    player.run()
    assert [m.sequence for _, m in clock.given] == list(range(1, 101))
    times = [(LEAD_S + i * 0.01) / rate for i in range(100)]
    assert [t for t, _ in clock.given] == pytest.approx(times)
    assert player.position_s == pytest.approx(0.99)


def test_another_rate_counts_from_where_it_is(bag):
    clock, player = play(bag)

    def at_sleep():
        if clock.now >= 100.5 + LEAD_S:
            player.rate = 4.0

    clock.at_sleep = at_sleep
    player.run()
    assert [m.sequence for _, m in clock.given] == list(range(1, 101))
    steps = [b[0] - a[0] for a, b in zip(clock.given, clock.given[1:], strict=False)]
    assert steps[:49] == pytest.approx([0.01] * 49)
    assert steps[51:] == pytest.approx([0.0025] * 48)


def test_bytes_are_untouched(bag):
    clock, player = play(bag, (POINTS, TEXTS), fast=True)
    player.run()
    assert [m for _, m in clock.given] == list(bag.messages())
    assert clock.now == 100.0


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
    assert clock.given[49][0] == pytest.approx(0.49 + LEAD_S)
    assert clock.given[-1][0] == pytest.approx(0.99 + 2.0, abs=0.11)


@pytest.mark.parametrize('to_s', [0.2, 0.8, -5.0])
def test_seek_goes_on_elsewhere(bag, to_s):
    """Back, ahead, and before the bag: from its beginning."""
    begun = []
    clock, player = play(bag, begin=lambda: begun.append(player.first_ns))
    answers = []

    def at_sleep():
        if len(clock.given) == 50 and not answers:
            answers.append(player.seek(T0 + 10 * NS))
            answers.append(player.seek(T0 + round(to_s * NS)))

    clock.at_sleep = at_sleep
    player.run()
    assert answers == [False, True]
    start = max(round(to_s * 100), 0)
    sequences = [m.sequence for _, m in clock.given]
    assert sequences == [*range(1, 51), *range(start + 1, 101)]
    assert begun == [T0, T0 + start * 10_000_000]
    assert clock.given[50][0] - clock.given[49][0] == pytest.approx(STAND_S, abs=0.12)
    assert player.rounds == 1 and not player.seek(T0)


def test_seek_of_a_replay_that_stands(bag):
    clock, player = play(bag)
    naps = []

    def at_sleep():
        if len(clock.given) == 50:
            naps.append(clock.now)
            if len(naps) == 1:
                player.pause(True)
                player.pause(True)
            elif len(naps) == 5:
                assert player.seek(T0 + NS // 2)
            elif len(naps) == 30:
                assert player.paused
                assert abs(player.now_ns() - (T0 + NS // 2)) < 2 * LEAD_NS
                player.pause(False)

    clock.at_sleep = at_sleep
    player.run()
    assert [m.sequence for _, m in clock.given] == [*range(1, 51), *range(51, 101)]


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
    assert choose(bag, [], ['/eol/pictures', TEXTS, POINTS]) == [TEXTS, POINTS]
    with pytest.raises(ConfigError, match='neither /a nor /b in it.*there are /eol/point'):
        choose(bag, [], ['/a', '/b'])


PERIOD_NS = 16_666_667


@pytest.fixture
def stamped(tmp_path):
    """A bag of 60 stamped messages, each recorded 5 to 20 ms late, and a point after each tenth."""
    writer = BagWriter(tmp_path / 'stamped', [BagTopic(IMAGES, 'a/msg/B', '', ''), POINT], {})
    for i in range(60):
        stamp = T0 + i * PERIOD_NS
        log = stamp + 5_000_000 + i * 250_000
        data = struct.pack('<IiI', 256, stamp // NS, stamp % NS)
        writer.write(IMAGES, data, log, log)
        if i % 10 == 0:
            writer.write(POINTS, bytes(28), log + 3_000_000, log + 3_000_000)
    writer.close()
    return BagReader(tmp_path / 'stamped')


@pytest.mark.parametrize('rate', [0.25, 1.0, 4.0])
def test_stamped_messages_come_at_their_stamps_and_the_rest_between(stamped, rate):
    clock, player = play(stamped, (IMAGES, POINTS), rate=rate, stamped=[IMAGES])
    player.run()
    images = [t for t, m in clock.given if m.topic == IMAGES]
    points = [t for t, m in clock.given if m.topic == POINTS]
    grid = [(LEAD_S + i * PERIOD_NS * 1e-9) / rate for i in range(60)]
    assert images == pytest.approx(grid, abs=1e-6)
    assert points == pytest.approx([t + 0.003 / rate for t in grid[::10]], abs=1e-6)
    assert [m.log_ns for _, m in clock.given] == [
        m.log_ns for m in stamped.messages((IMAGES, POINTS))
    ]


@pytest.mark.parametrize('rate', [0.25, 1.0, 4.0])
def test_a_tap_is_played_at_its_knock_however_late_the_run_had_it(tmp_path, rate):
    taps = BagTopic('/eol/taps', 'a/msg/B', '', '')
    writer = BagWriter(tmp_path / 'taps', [BagTopic(IMAGES, 'a/msg/B', '', ''), taps], {})

    def write(topic, after_ms, late_ms):
        stamp = T0 + after_ms * 1_000_000
        log = stamp + late_ms * 1_000_000
        writer.write(topic, struct.pack('<IiI', 256, stamp // NS, stamp % NS), log, log)

    write(IMAGES, 0, 2)
    write('/eol/taps', 5, 4)  # received before the next image
    write(IMAGES, 20, 2)
    write('/eol/taps', 10, 27)  # received after it
    write(IMAGES, 40, 2)
    writer.close()
    options = {'stamped': [IMAGES], 'taps': ['/eol/taps']}
    clock, player = play(BagReader(tmp_path / 'taps'), (IMAGES, '/eol/taps'), rate=rate, **options)
    player.run()
    times = [(LEAD_S + t) / rate for t in (0, 0.005, 0.02, 0.02, 0.04)]
    assert [t for t, _ in clock.given] == pytest.approx(times, abs=1e-6)


def test_what_came_late_to_the_recorder_is_played_as_it_was_sent(tmp_path):
    writer = BagWriter(tmp_path / 'late', [POINT], {})
    for i, late_ms in enumerate((0, 40, 900, 900, 0)):
        sent_ns = T0 + i * 20_000_000
        came_ns = max(sent_ns + late_ms * 1_000_000, T0 + i)
        writer.write(POINTS, bytes(28), came_ns, sent_ns, i)
    writer.write(POINTS, bytes(28), T0 + 2 * NS, 0, 9)  # not known when sent
    writer.close()
    clock, player = play(BagReader(tmp_path / 'late'))
    player.run()
    assert [m.sequence for _, m in clock.given] == [0, 1, 4, 2, 3, 9]  # as they were received
    times = [LEAD_S + t for t in (0, 0.02, 0.08, 0.08, 0.08, 2)]
    assert [t for t, _ in clock.given] == pytest.approx(times)


def test_recorded_time_is_that_of_the_stamps_and_stands_in_a_pause(stamped):
    clock, player = play(stamped, (IMAGES,), rate=0.5, stamped=[IMAGES])
    assert player.now_ns() == T0 - LEAD_NS
    shown, pauses = [], []

    def at_sleep():
        shown.append(player.now_ns())
        if len(clock.given) == 30:
            pauses.append(shown[-1])
            if len(pauses) in (1, 11):
                player.pause()

    clock.at_sleep = at_sleep
    player.run()
    last = T0 + 59 * PERIOD_NS
    assert shown == sorted(shown) and shown[0] > T0 - LEAD_NS
    assert len(set(pauses[1:11])) == 1  # it stood
    assert player.now_ns() == last + TAIL_NS
    assert clock.given[-1][0] == pytest.approx((LEAD_S + 59 / 60) / 0.5 + 1.0, abs=0.11)


def test_it_waits_for_a_slow_disk_and_never_goes_back(stamped):
    clock, player = play(stamped, (IMAGES,), stamped=[IMAGES])
    give, shown, late = clock.give, [], []

    def slow(message):
        give(message)
        late.append(player.now_ns() - stamp_ns(message.data))
        for _ in range(40 if len(late) % 7 == 0 else 1):
            clock.now += 0.005
            shown.append(player.now_ns())

    player._give = slow
    player.run()
    assert shown == sorted(shown)
    assert min(late) >= 0 and max(late) <= LATE_S * 1e9 + 1
    assert clock.given[-1][0] > 59 / 60 + 8 * 0.15


def test_a_new_round_stands_at_its_start_until_all_have_noticed(stamped):
    began = []
    clock, player = play(
        stamped, (IMAGES,), stamped=[IMAGES], loop=True, begin=lambda: began.append(clock.now)
    )
    clock.at_sleep = lambda: player.stop() if len(clock.given) >= 90 else None
    player.run()
    assert len(began) == 2
    assert clock.given[60][0] - (began[1] - 100.0) == pytest.approx(STAND_S / 2 + LEAD_S)
    times = [t for t, _ in clock.given]
    assert times[61] - times[60] == pytest.approx(1 / 60, abs=1e-6)


def test_pictures_of_some_moments_are_not_all(stamped, bag):
    assert complete(stamped, IMAGES, POINTS)
    assert not complete(stamped, POINTS, IMAGES)
    assert not complete(bag, '/absent', POINTS)
