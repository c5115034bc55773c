# SPDX-License-Identifier: Apache-2.0
"""Which cue is due and which comes next, against clocks walked minute by minute."""

import datetime
import zoneinfo

import pytest

from eol_ros.core.cue_times import CueTimes, line
from eol_ros.core.opening_hours import CLOCK_SET_S
from eol_ros.errors import ConfigError

VIENNA = zoneinfo.ZoneInfo('Europe/Vienna')
LINES = ('Mon-Sun 10:00, 14:30 day', 'Fri,Sat 18:30 evening', '2026-11-28 14:30 farewell')


def at_s(text, zone=VIENNA):
    return datetime.datetime.fromisoformat(text).replace(tzinfo=zone).timestamp()


def look(times, text, since='2026-11-27 10:00:00'):
    return times.look(at_s(text), at_s(since))


def shown(times):
    return times.next and (f'{times.next.at.astimezone(times.zone):%a %H:%M}', times.next.cue)


def test_each_cue_once_at_its_time_and_the_next_told():
    times = CueTimes(LINES, VIENNA)
    assert look(times, '2026-11-27 09:59:59.500') == [] and shown(times) == ('Fri 10:00', 'day')
    assert look(times, '2026-11-27 10:00:00') == ['day'] and shown(times) == ('Fri 14:30', 'day')
    assert look(times, '2026-11-27 10:00:01') == []
    assert look(times, '2026-11-27 14:30:00.900') == ['day']
    assert shown(times) == ('Fri 18:30', 'evening')
    # asleep for a day: all that came in between, in order; of one time by their lines
    assert look(times, '2026-11-28 15:00:00') == ['evening', 'day', 'day', 'farewell']
    assert shown(times) == ('Sat 18:30', 'evening')


def test_a_start_takes_up_what_the_opening_has_had_so_far():
    assert look(CueTimes(LINES, VIENNA), '2026-11-27 19:00') == ['day', 'day', 'evening']
    late = CueTimes(LINES, VIENNA, done_s=at_s('2026-11-27 15:00'))  # restarted
    assert look(late, '2026-11-27 19:00') == ['evening']


def test_a_clock_that_is_set():
    times = CueTimes(LINES, VIENNA)
    assert times.look(180.0, 0.0) == [] and times.next is None  # never set
    assert times.look(CLOCK_SET_S - 1, 0.0) == []
    assert look(times, '2026-11-27 10:00:05') == ['day']
    assert look(times, '2026-11-27 09:59:50') == []  # some seconds back
    assert look(times, '2026-11-27 10:00:00') == []
    assert look(times, '2026-11-27 08:00:00') == [] and shown(times) == ('Fri 10:00', 'day')
    assert look(times, '2026-11-27 10:00:00') == ['day']  # it was two hours ahead


@pytest.mark.parametrize(
    ('zone', 'day', 'clock', 'utc'),
    [
        ('Europe/Vienna', '2026-03-29', '02:30', '01:00'),  # left out: 3:00 CEST
        ('Europe/Vienna', '2026-10-25', '02:30', '00:30'),  # shown twice: CEST first
        ('Australia/Lord_Howe', '2026-10-04', '02:15', '15:30'),  # half an hour left out
    ],
)
def test_days_on_which_clocks_are_set(zone, day, clock, utc):
    times = CueTimes([f'{day} {clock} night'], zoneinfo.ZoneInfo(zone))
    start_s = at_s(f'{day} 00:00', times.zone)
    times.look(start_s, start_s)
    assert f'{times.next.at:%H:%M}' == utc
    due_s = times.next.at.timestamp()
    found = [s for s in range(0, 86400, 60) if times.look(start_s + s, start_s)]
    assert found == [due_s - start_s] and times.next is None


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('Fri 18:30', 'not DAYS TIME CUE, such as'),
        ('Fry 18:30 evening', "'Fry' is neither a weekday nor a date"),
        ('Fri 24:00 evening', "'24:00' is no time of day, such as"),
        ('Fri 18.30 evening', "'18.30' is no time of day"),
        ('2026-02-30 18:30 evening', '2026-02-30 is no date of the calendar'),
        ('Fri 18:30, evening', 'not DAYS TIME CUE'),
    ],
)
def test_a_line_that_cannot_be_read(text, why):
    with pytest.raises(ConfigError) as error:
        line(text)
    assert str(error.value).startswith(repr(text)) and why in str(error.value)
