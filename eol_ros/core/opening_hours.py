# SPDX-License-Identifier: Apache-2.0
"""Opening hours: whether the work is open at an instant, when that changes, what to ask of it.

A line names days and their times, and of the lines that name a day the last one counts:

    Tue-Sun 10:00-18:00
    Thu 10:00-12:30, 13:30-21:00
    Sat 20:00-26:00                     until 2:00 of Sunday
    2026-12-24 closed
    2026-12-27-2026-12-31 10:00-14:00

Times are those of the clocks on the wall. A time that a clock shows twice, in autumn, opens the
first time and closes the second; one that it leaves out, in spring, is when it has gone past it.
"""

import bisect
import datetime
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from eol_ros.errors import ConfigError
from eol_ros.said import said

_DAYS = tuple(map(said, ('mon', 'tue', 'wed', 'thu', 'fri', 'sat', 'sun')))
NAMES = ('Monday', 'Tuesday', 'Wednesday', 'Thursday', 'Friday', 'Saturday', 'Sunday')
HORIZON = datetime.timedelta(days=400)  # what does not change within that does not change
YEARS = range(2000, 2200)  # years of dates; the days before and after each date are checked, too
CLOCK_SET_S = 1_767_225_600.0  # 2026: a clock that shows a time before has not been set
SLEEP, WAKE = 'sleep', 'wake'
DAY = datetime.timedelta(days=1)
_DATES = re.compile(r'(\d{4}-\d\d-\d\d)(?:-(\d{4}-\d\d-\d\d))?')
_TIMES = re.compile(r'(\d{1,2}):([0-5]\d)-(\d{1,2}):([0-5]\d)')
_LIKE = "such as 'Tue-Sun 10:00-18:00', '2026-12-24 closed'"

Span = tuple[int, int]  # minutes from midnight, the second past the first


@dataclass(frozen=True)
class Line:
    """A line of opening hours; `spans` is empty where it says closed."""

    text: str
    weekdays: frozenset[int]  # Monday is 0
    dates: tuple[tuple[datetime.date, datetime.date], ...]  # first and last
    spans: tuple[Span, ...]

    def covers(self, day: datetime.date) -> bool:
        """Tell whether it names a day."""
        return day.weekday() in self.weekdays or any(a <= day <= b for a, b in self.dates)


def line(text: str) -> Line:
    """Read a line; raise ConfigError that quotes it and says what is wrong."""
    try:
        named, _, times = close_up(text).partition(' ')
        if not times:
            raise ValueError(f'not days and their times, {_LIKE}')
        return Line(text, *named_days(named), _spans(times))
    except ValueError as error:
        raise ConfigError(f'{text!r}: {error}') from None


def close_up(text: str) -> str:
    """Return a line with `-` for dashes, without spaces around marks, with one between words."""
    words = re.sub(r'\s*([,\N{EN DASH}-])\s*', r'\1', text).replace('\N{EN DASH}', '-')
    return ' '.join(words.split())


def named_days(
    text: str,
) -> tuple[frozenset[int], tuple[tuple[datetime.date, datetime.date], ...]]:
    """Return the weekdays and the first and last dates that a text names; raise ValueError."""
    weekdays: set[int] = set()
    dates = []
    for item in text.split(','):
        if match := _DATES.fullmatch(item):
            first, last = (_date(part or match[1]) for part in match.groups())
            if last < first:
                raise ValueError(f'{last} is before {first}')
            dates.append((first, last))
        else:
            first_day, _, last_day = item.partition('-')
            begin, end = _weekday(first_day), _weekday(last_day or first_day)
            weekdays |= {(begin + i) % 7 for i in range((end - begin) % 7 + 1)}
    return frozenset(weekdays), tuple(dates)


def _date(text: str) -> datetime.date:
    try:
        date = datetime.date.fromisoformat(text)
    except ValueError:
        raise ValueError(f'{text} is no date of the calendar') from None
    if date.year not in YEARS:
        raise ValueError(f'{text} is not in the years {YEARS[0]} to {YEARS[-1]}')
    return date


def _weekday(text: str) -> int:
    for number, name in enumerate(NAMES):
        if len(text) >= 3 and name.lower().startswith(text.lower()):
            return number
    raise ValueError(f'{text!r} is neither a weekday nor a date, {_LIKE}')


def _spans(text: str) -> tuple[Span, ...]:
    if text.lower() == 'closed':
        return ()
    spans = sorted(_span(item) for item in text.split(','))
    for (_, end), (begin, later) in itertools.pairwise(spans):
        if begin < end:
            raise ValueError(f'{_clock(begin)}-{_clock(later)} overlaps the time before it')
    return tuple(spans)


def _span(text: str) -> Span:
    match = _TIMES.fullmatch(text)
    if not match:
        raise ValueError(f'{text!r} is neither times nor closed, {_LIKE}')
    hour, minute, end_hour, end_minute = map(int, match.groups())
    begin, end = 60 * hour + minute, 60 * end_hour + end_minute
    if begin >= 24 * 60:
        raise ValueError(f'{_clock(begin)} is no time to open at')
    if end <= begin:
        late = f'{_clock(begin)}-{_clock(end + 24 * 60)}'
        raise ValueError(f'{text} ends before it begins; past midnight is written {late}')
    if end - begin > 24 * 60:
        raise ValueError(f'{text} is longer than a day')
    return begin, end


def _clock(minutes: int) -> str:
    return f'{minutes // 60:02d}:{minutes % 60:02d}'


class State(NamedTuple):
    """Open or closed, since when and until when; None: nothing changes within HORIZON."""

    open: bool
    since: datetime.datetime | None
    until: datetime.datetime | None


class OpeningHours:
    """A calendar of opening hours: lines, later ones before earlier ones, of a time zone.

    Raises ConfigError with a line for each mistake.
    """

    def __init__(self, texts: Sequence[str], time_zone: datetime.tzinfo):
        if found := mistakes(texts):
            raise ConfigError('\n'.join(found))
        self.zone = time_zone
        self._lines = [line(text) for text in texts]

    def state(self, at: datetime.datetime) -> State:
        """Return how it is at an instant (with its zone), with the changes around it in UTC."""
        day = at.astimezone(self.zone).date()
        sure = HORIZON - 3 * DAY  # what is open at the ends may go on beyond
        times = self._times(day - HORIZON, day + HORIZON)
        edges = [edge for span in times for edge in span]
        after = bisect.bisect_right(edges, at)
        since, until = edges[:after][-1:], edges[after : after + 1]
        return State(
            after % 2 == 1,
            since[0] if since and at - since[0] < sure else None,
            until[0] if until and until[0] - at < sure else None,
        )

    def _times(
        self, first: datetime.date, last: datetime.date
    ) -> list[tuple[datetime.datetime, datetime.datetime]]:
        """Return the times of `first` to `last` at which it is open, those that touch as one."""
        found: list[tuple[datetime.datetime, datetime.datetime]] = []
        for number in range((last - first).days + 1):
            day = first + number * DAY
            told = _line_of(self._lines, day)
            for minutes in told.spans if told else ():
                begin, end = (instant(self.zone, day, m, fold) for fold, m in enumerate(minutes))
                if begin >= end:  # it lies in the hour that spring leaves out
                    continue
                if found and begin <= found[-1][1]:
                    begin, end = found[-1][0], max(found.pop()[1], end)
                found.append((begin, end))
        return found


def instant(
    zone: datetime.tzinfo, day: datetime.date, minutes: int, fold: int
) -> datetime.datetime:
    """Return when the clock on the wall shows so many minutes after the midnight of a day."""
    shown = datetime.datetime.combine(day, datetime.time()) + datetime.timedelta(minutes=minutes)
    utc = datetime.timezone.utc
    found = shown.replace(tzinfo=zone, fold=fold).astimezone(utc)
    if found.astimezone(zone).replace(tzinfo=None) == shown:
        return found
    # Left out: by the offsets before and after it lies on either side of the clock's jump.
    low, high = sorted(shown.replace(tzinfo=zone, fold=f).astimezone(utc) for f in (0, 1))
    while high - low > datetime.timedelta(seconds=1):
        middle = low + (high - low) // 2
        if middle.astimezone(zone).replace(tzinfo=None) < shown:
            low = middle
        else:
            high = middle
    return high.replace(microsecond=0)


def _line_of(lines: Sequence[Line], day: datetime.date) -> Line | None:
    return next((found for found in reversed(lines) if found.covers(day)), None)


def mistakes(texts: Sequence[str]) -> list[str]:
    """Return what is wrong with lines of opening hours, a text for each."""
    if not texts:
        return [f'says no hours, {_LIKE}']
    lines, found = [], []
    for text in texts:
        try:
            lines.append(line(text))
        except ConfigError as error:
            found.append(str(error))
    if found:
        return found
    days = _telling(lines)
    used = {id(_line_of(lines, day)) for day in days}
    for one in lines:
        if id(one) not in used:
            found.append(f'{one.text!r}: has no effect, later lines name all its days')
    overlaps: dict[tuple[str, str], str] = {}
    for day in days:
        after = day + DAY
        late, early = _line_of(lines, day), _line_of(lines, after)
        if not late or not early or not late.spans or not early.spans:
            continue
        if late.spans[-1][1] - 24 * 60 > early.spans[0][0]:
            what = f'overlaps {early.text!r} on {NAMES[after.weekday()]} {after}'
            overlaps.setdefault((late.text, early.text), f'{late.text!r}: {what}')
    return found + list(overlaps.values())


def _telling(lines: Sequence[Line]) -> list[datetime.date]:
    """Return days that show all that lines can say: each named date, those beside it, a week."""
    dates = {
        first + number * DAY
        for one in lines
        for first, last in one.dates
        for number in range(-1, (last - first).days + 2)
    }
    start = max(dates, default=datetime.date(2026, 1, 1)) + 7 * DAY
    week = {start + number * DAY for number in range(8)}
    return sorted(day for day in dates | week if any(one.covers(day) for one in lines))


class Door:
    """Says what to ask of the work so that it sleeps while it is closed.

    It asks once for each time of opening or closing: what people ask in between holds until the
    next. A clock that was never set is not trusted, and the work stays open. heeded_s: which time
    the work has been asked for, as before a restart.
    """

    def __init__(self, hours: OpeningHours, heeded_s: float | None = None):
        self.hours = hours
        self.heeded_s = heeded_s
        self.state = State(True, None, None)
        self.trusted = False
        self._period_s = 0.0
        self._looked_s: float | None = None

    def look(self, now_s: float) -> str:
        """Take the time of the system's clock; return SLEEP or WAKE where that is to be asked."""
        at = datetime.datetime.fromtimestamp(now_s, datetime.timezone.utc)
        self.trusted = now_s >= CLOCK_SET_S
        if not self.trusted:
            self.state = State(True, None, None)
            self._looked_s = None
        elif self._stale(now_s, at):
            self.state, self._looked_s = self.hours.state(at), now_s
        since = self.state.since
        self._period_s = since.timestamp() if since else 0.0
        if self.heeded_s == self._period_s:
            return ''
        return WAKE if self.state.open else SLEEP

    def _stale(self, now_s: float, at: datetime.datetime) -> bool:
        # A clock that is set back by some seconds at ten does not shut the doors again.
        if self._looked_s is None or not -60 <= now_s - self._looked_s < 3600:
            return True
        return self.state.until is not None and at >= self.state.until

    def heed(self) -> None:
        """Take note that the work does what was to be asked, or what people want instead."""
        self.heeded_s = self._period_s

    def words(self, asleep: bool) -> str:
        """Return it for people: `asleep until Tue 10:00`."""
        is_open, _, until = self.state
        end = self.shown(until) if until else {}
        if is_open and asleep:
            return said('open_hand', **end) if end else said('open_hand_ever')
        if is_open:
            return said('open_until', **end) if end else said('open_ever')
        if not asleep:
            return said('closed_hand', **end) if end else said('closed_hand_ever')
        return said('asleep_until', **end) if end else said('asleep_ever')

    def shown(self, at: datetime.datetime) -> dict[str, str]:
        """Return day and time of an instant, with its date where it is far."""
        local = at.astimezone(self.hours.zone)
        far = at.timestamp() - (self._looked_s or 0.0) > 6 * 86400
        date = f'{local:%Y-%m-%d} ' if far else ''
        return {'day': _DAYS[local.weekday()], 'time': f'{date}{local:%H:%M}'}
