# SPDX-License-Identifier: Apache-2.0
import datetime
import zoneinfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eol_ros.core.opening_hours import CLOCK_SET_S, Door, OpeningHours, line, mistakes
from eol_ros.errors import ConfigError

UTC = datetime.timezone.utc
MINUTE, DAY = datetime.timedelta(minutes=1), datetime.timedelta(days=1)
VIENNA = zoneinfo.ZoneInfo('Europe/Vienna')
MUSEUM = ['Tue-Sun 10:00-18:00', 'Thu 10:00-21:00', '2026-12-24 closed', '2026-12-31 10:00-14:00']


def vienna(text):
    return datetime.datetime.fromisoformat(text).replace(tzinfo=VIENNA)


# Lines whose days and times are known without reading them: text, weekdays, begin and length


@st.composite
def written(draw):
    begin = draw(st.integers(0, 23 * 60 + 59))
    length = draw(st.integers(1, 24 * 60))
    first, count = draw(st.integers(0, 6)), draw(st.integers(1, 7))
    names = ('Mon', 'Tue', 'Wed', 'Thu', 'Fri', 'Sat', 'Sun')
    weekdays = {(first + i) % 7 for i in range(count)}
    days = f'{names[first]}-{names[(first + count - 1) % 7]}'
    if draw(st.integers(0, 3)) == 0:
        return f'{days} closed', weekdays, None
    return f'{days} {shown(begin, length)}', weekdays, (begin, length)


def shown(begin, length):
    end = begin + length
    return f'{begin // 60}:{begin % 60:02d}-{end // 60}:{end % 60:02d}'


# By zone: the days on which clocks are set, half an hour in Lord Howe, and an ordinary one.
DAYS = [
    ('Europe/Vienna', '2026-03-29'),
    ('Europe/Vienna', '2026-10-25'),
    ('Europe/Vienna', '2026-07-01'),
    ('America/New_York', '2026-03-08'),
    ('America/New_York', '2026-11-01'),
    ('Australia/Lord_Howe', '2026-04-05'),
    ('Australia/Lord_Howe', '2026-10-04'),
    ('Asia/Taipei', '2026-05-05'),
]


def walked(lines, zone, day):
    """Return the minutes around a day and whether it is open in each, found one by one."""
    midnight = datetime.datetime.combine(day, datetime.time(), UTC)
    walk = [midnight + i * MINUTE for i in range(-2 * 1440, 4 * 1440)]
    clocks = [at.astimezone(zone).replace(tzinfo=None) for at in walk]
    is_open = [False] * len(walk)
    for offset in range(-2, 3):
        today = day + offset * DAY
        spoken = [span for _, weekdays, span in lines if today.weekday() in weekdays]
        if spoken and spoken[-1]:
            begin, length = spoken[-1]
            opens = datetime.datetime.combine(today, datetime.time()) + begin * MINUTE
            closes = opens + length * MINUTE
            first = next((i for i, clock in enumerate(clocks) if clock >= opens), len(walk))
            twice = [i for i, clock in enumerate(clocks) if clock == closes]
            after = (i for i, clock in enumerate(clocks) if clock > closes)
            last = twice[-1] if twice else next(after, len(walk))
            is_open[first:last] = [True] * max(0, last - first)
    return walk, is_open


def compare(lines, name, date):
    zone, day = zoneinfo.ZoneInfo(name), datetime.date.fromisoformat(date)
    walk, is_open = walked(lines, zone, day)
    hours = OpeningHours([text for text, _, _ in lines], zone)
    start, end = 2 * 1440 - 720, 2 * 1440 + 720  # the day itself, wherever in the world
    changes = [i for i in range(start, end + 720) if is_open[i] != is_open[i - 1]]
    near = {i + step for i in changes for step in (-61, -31, -1, 0, 29, 59)}
    for i in [start, *sorted(i for i in near if start <= i < end)]:
        state = hours.state(walk[i] + datetime.timedelta(seconds=i % 60))
        assert state.open == is_open[i]
        until = next((walk[j] for j in changes if j > i), None)
        if until is not None:
            assert state.until == until
        else:
            assert state.until is None or state.until >= walk[end + 720]


@pytest.mark.slow
@settings(max_examples=40)
@given(st.lists(written(), min_size=1, max_size=3), st.sampled_from(DAYS))
def test_against_a_walk_minute_by_minute(lines, day):
    if not mistakes([text for text, _, _ in lines]):
        compare(lines, *day)


@pytest.mark.slow
@pytest.mark.parametrize(('name', 'date'), DAYS)
@settings(max_examples=16)
@given(begin=st.integers(45, 200), length=st.integers(1, 120))
def test_against_a_walk_in_the_night_in_which_clocks_are_set(name, date, begin, length):
    compare([(f'Mon-Sun {shown(begin, length)}', set(range(7)), (begin, length))], name, date)


def test_a_museum_with_a_long_thursday_and_holidays():
    hours = OpeningHours(MUSEUM, VIENNA)

    for when, until in {
        '2026-11-24 10:00': '2026-11-24 18:00',  # a Tuesday
        '2026-11-26 18:30': '2026-11-26 21:00',  # a Thursday
        '2026-12-31 13:59': '2026-12-31 14:00',  # a Thursday, and the last of the year
    }.items():
        assert hours.state(vienna(when))[::2] == (True, vienna(until))
    for when, until in {
        '2026-11-29 18:00': '2026-12-01 10:00',  # from Sunday to Tuesday
        '2026-12-24 12:00': '2026-12-25 10:00',
        '2026-12-31 14:00': '2027-01-01 10:00',
    }.items():
        assert hours.state(vienna(when))[::2] == (False, vienna(until))


def test_times_that_touch_are_one_and_what_never_changes_says_so():
    night = OpeningHours(['Fri 18:00-24:00', 'Sat 0:00-3:00'], VIENNA)
    assert night.state(vienna('2026-11-27 23:00'))[1:] == (
        vienna('2026-11-27 18:00'),
        vienna('2026-11-28 03:00'),
    )
    assert OpeningHours(['Mon-Sun 0:00-24:00'], VIENNA).state(vienna('2026-11-27 23:00')) == (
        True,
        None,
        None,
    )
    assert OpeningHours(['2026-11-01 10:00-11:00'], VIENNA).state(vienna('2026-11-27 23:00')) == (
        False,
        vienna('2026-11-01 11:00'),
        None,
    )


@pytest.mark.parametrize(
    ('text', 'what'),
    [
        ('Tue', "'Tue': not days and their times, such as 'Tue-Sun 10:00-18:00'"),
        ('Tus 10:00-18:00', "'Tus' is neither a weekday nor a date"),
        ('Tu 10:00-18:00', "'Tu' is neither"),
        ('Tue 10-18', "'10-18' is neither times nor closed"),
        ('Tue 10:60-18:00', "'10:60-18:00' is neither"),
        ('Tue 18:00-10:00', 'ends before it begins; past midnight is written 18:00-34:00'),
        ('Tue 10:00-10:00', 'ends before it begins'),
        ('Tue 24:00-25:00', '24:00 is no time to open at'),
        ('Tue 8:00-32:30', '8:00-32:30 is longer than a day'),
        ('Tue 10:00-14:00, 13:00-18:00', '13:00-18:00 overlaps the time before it'),
        ('2026-02-30 closed', '2026-02-30 is no date of the calendar'),
        ('2026-12-26-2026-12-24 closed', '2026-12-24 is before 2026-12-26'),
    ],
)
def test_a_line_that_cannot_be_meant(text, what):
    with pytest.raises(ConfigError, match='^[^\n]*$') as error:
        line(text)
    assert str(error.value).startswith(repr(text)) and what in str(error.value)


def test_ways_to_write_the_same():
    for text in ('tue-sun 10:00-18:00', 'Tuesday - Sunday 10:00 \N{EN DASH} 18:00'):
        assert line(text).weekdays == frozenset(range(1, 7)) and line(text).spans == ((600, 1080),)
    assert line('Sat, Mon 9:00-12:00, 13:00-17:00').weekdays == {0, 5}
    assert line('Sat-Tue closed').weekdays == {5, 6, 0, 1}


def test_lines_that_contradict_each_other():
    assert mistakes(MUSEUM) == []
    assert mistakes([]) == ["says no hours, such as 'Tue-Sun 10:00-18:00', '2026-12-24 closed'"]
    assert mistakes(['Thu 10:00-21:00', 'Tue-Sun 10:00-18:00']) == [
        "'Thu 10:00-21:00': has no effect, later lines name all its days"
    ]
    assert mistakes(['Fri 20:00-34:00', 'Sat 9:00-18:00', 'Mon 1:0-2:00', 'Mo closed']) == [
        "'Mon 1:0-2:00': '1:0-2:00' is neither times nor closed, such as 'Tue-Sun 10:00-18:00',"
        " '2026-12-24 closed'",
        "'Mo closed': 'Mo' is neither a weekday nor a date, such as 'Tue-Sun 10:00-18:00',"
        " '2026-12-24 closed'",
    ]
    assert mistakes(['Fri 20:00-34:00', 'Sat 9:00-18:00']) == [
        "'Fri 20:00-34:00': overlaps 'Sat 9:00-18:00' on Saturday 2026-01-10"
    ]
    assert mistakes(['Sat 9:00-18:00', '2026-12-24 20:00-34:00', '2026-12-25 9:00-10:00']) == [
        "'2026-12-24 20:00-34:00': overlaps '2026-12-25 9:00-10:00' on Friday 2026-12-25"
    ]
    assert mistakes(['Fri 20:00-33:00', 'Sat 9:00-18:00']) == []


class Clock:
    """Walks a door through time, and keeps what it asks of the work."""

    def __init__(self, door):
        self.door, self.asked, self.asleep = door, [], False

    def at(self, text):
        when = vienna(text) if isinstance(text, str) else text
        if kind := self.door.look(when.timestamp()):
            self.asked.append((str(text), kind))
            self.asleep = kind == 'sleep'
            self.door.heed()
        return self.door.words(self.asleep)


def test_the_work_is_asked_once_and_people_have_the_last_word():
    clock = Clock(Door(OpeningHours(MUSEUM, VIENNA)))
    assert clock.at('2026-11-27 17:59') == 'open until Fri 18:00'
    assert clock.at('2026-11-27 18:00') == 'asleep until Sat 10:00'
    clock.asleep = False  # somebody wakes it
    assert clock.at('2026-11-27 23:00') == 'closed until Sat 10:00, woken by hand'
    assert clock.at('2026-11-28 10:00') == 'open until Sat 18:00'
    clock.asleep = True
    assert clock.at('2026-11-28 12:00') == 'open until Sat 18:00, put to sleep by hand'
    assert clock.at('2026-11-28 18:00') == 'asleep until Sun 10:00'
    assert clock.asked == [
        ('2026-11-27 17:59', 'wake'),
        ('2026-11-27 18:00', 'sleep'),
        ('2026-11-28 10:00', 'wake'),
        ('2026-11-28 18:00', 'sleep'),
    ]


def test_a_restart_asks_nothing_that_was_asked_before():
    hours = OpeningHours(MUSEUM, VIENNA)
    clock = Clock(Door(hours))
    clock.at('2026-11-27 18:00')
    again = Clock(Door(hours, clock.door.heeded_s))
    again.at('2026-11-27 19:00')
    assert again.asked == []
    again.at('2026-11-28 10:00')  # after a night without power
    assert again.asked == [('2026-11-28 10:00', 'wake')]


def test_a_clock_that_was_never_set_keeps_it_open():
    clock = Clock(Door(OpeningHours(MUSEUM, VIENNA)))
    clock.at(datetime.datetime.fromtimestamp(30, UTC))
    assert not clock.door.trusted and clock.asked[-1][1] == 'wake'
    clock.at(datetime.datetime.fromtimestamp(CLOCK_SET_S - 1, UTC))
    assert len(clock.asked) == 1
    assert clock.at('2026-11-27 22:00') == 'asleep until Sat 10:00'
    assert clock.door.trusted


def test_a_clock_that_is_corrected_at_ten_opens_once():
    clock = Clock(Door(OpeningHours(MUSEUM, VIENNA)))
    clock.at('2026-11-27 09:00')
    clock.at('2026-11-27 10:00:01')
    clock.at('2026-11-27 09:59:40')
    clock.at('2026-11-27 10:00:02')
    assert [kind for _, kind in clock.asked] == ['sleep', 'wake']
    assert clock.at('2026-11-26 23:00') == 'asleep until Fri 10:00'  # a real step back


@pytest.mark.parametrize(
    'days', ['9999-12-31', '0001-01-01', '2026-01-01-9999-12-31', '1999-12-31']
)
def test_a_date_at_the_end_of_the_calendar_is_refused_in_a_line(days):
    with pytest.raises(ConfigError, match='is not in the years 2000 to 2199') as error:
        line(f'{days} closed')
    assert mistakes(['Mon 10:00-12:00', f'{days} closed']) == [str(error.value)]


@pytest.mark.parametrize('days', ['2000-01-01', '2199-12-31', '2000-01-01-2199-12-31'])
def test_the_first_and_the_last_date_that_are_taken_work(days):
    hours = OpeningHours([f'{days} 14:00-26:00'], VIENNA)
    for day in ('2000-01-01', '2199-12-31'):
        assert hours.state(vienna(f'{day} 15:00')).open == (day in days)
