# SPDX-License-Identifier: Apache-2.0
"""Times of cues: which cue is due at an instant, and which comes next.

A line names days, times and a cue; each line counts on each day that it names:

    Tue-Sun 10:00 day
    Fri,Sat 18:30, 20:30 evening
    2026-12-24 12:00 farewell

Days and clocks are those of `core.opening_hours`. A time that a clock shows twice, in autumn, means
the first. A time that it skips, in spring, means the end of the gap.
"""

import datetime
import re
import unicodedata
from collections.abc import Sequence
from typing import NamedTuple

from eol_ros.core import opening_hours
from eol_ros.core.opening_hours import CLOCK_SET_S, DAY, HORIZON
from eol_ros.errors import ConfigError

BACK_S = 60.0  # after the clock was set back by less, no cue is given twice
_TIME = re.compile(r'([01]?\d|2[0-3]):([0-5]\d)')
_LIKE = "such as 'Fri,Sat 18:30 evening', '2026-12-24 12:00 farewell'"


class Due(NamedTuple):
    """A cue and its time."""

    at: datetime.datetime
    cue: str


class _Line(NamedTuple):
    days: opening_hours.Line  # of no times
    minutes: tuple[int, ...]  # from midnight
    cue: str


def line(text: str) -> _Line:
    """Read a line; raise ConfigError that quotes it and says what is wrong."""
    words = opening_hours.close_up(unicodedata.normalize('NFC', text)).split(' ')
    if len(words) != 3:
        raise ConfigError(f'{text!r}: not DAYS TIME CUE, {_LIKE}')
    try:
        minutes = [_minutes(item) for item in words[1].split(',')]
        days = opening_hours.Line(text, *opening_hours.named_days(words[0]), ())
    except ValueError as error:
        raise ConfigError(f'{text!r}: {error}') from None
    return _Line(days, tuple(minutes), words[2])


def _minutes(text: str) -> int:
    match = _TIME.fullmatch(text)
    if not match:
        raise ValueError(f'{text!r} is no time of day, {_LIKE}')
    return 60 * int(match[1]) + int(match[2])


class CueTimes:
    """Says which cues are due, by lines `texts` with times of `time_zone`.

    done_s: time until which cues have been given, s since the epoch, as before a restart. Raises
    ConfigError for a line that cannot be read.
    """

    def __init__(
        self, texts: Sequence[str], time_zone: datetime.tzinfo, done_s: float | None = None
    ):
        self.zone, self.done_s = time_zone, done_s
        self.next: Due | None = None
        self._lines = [line(text) for text in texts]
        self._looked_s = -float('inf')

    def look(self, now_s: float, since_s: float) -> list[str]:
        """Take the time of the system's clock; return the cues that are due now, in order.

        Both times are s since the epoch. The first call returns the cues from `since_s` on, so that
        the work is as if it had run since then. A clock that was never set gives none.
        """
        if now_s < CLOCK_SET_S:
            self.next, self._looked_s = None, -float('inf')
            return []
        if self.done_s is None:
            self.done_s = since_s - 1  # a cue of that second counts
        if now_s < self.done_s - BACK_S:
            self.done_s = now_s
        stale = not 0 <= now_s - self._looked_s < 3600
        if not stale and (self.next is None or now_s < self.next.at.timestamp()):
            return []
        self._looked_s = now_s
        now = datetime.datetime.fromtimestamp(now_s, datetime.timezone.utc)
        done = datetime.datetime.fromtimestamp(self.done_s, datetime.timezone.utc)
        done = max(done, now - DAY)  # a clock that was set by years
        due = self._between(done, now) if done < now else []
        self.done_s = max(self.done_s, now_s)
        self.next = self._after(max(done, now))
        return [one.cue for one in due]

    def _on(self, day: datetime.date) -> list[Due]:
        """Return the cues of a day of the zone, in order; those of one time by their lines."""
        found = [
            Due(opening_hours.instant(self.zone, day, minutes, 0), one.cue)
            for one in self._lines
            if one.days.covers(day)
            for minutes in one.minutes
        ]
        return sorted(found, key=lambda due: due.at)

    def _between(self, after: datetime.datetime, until: datetime.datetime) -> list[Due]:
        first, last = (at.astimezone(self.zone).date() for at in (after, until))
        days = (first + number * DAY for number in range((last - first).days + 1))
        return [due for day in days for due in self._on(day) if after < due.at <= until]

    def _after(self, at: datetime.datetime) -> Due | None:
        today = at.astimezone(self.zone).date()
        days = (today + number * DAY for number in range(HORIZON.days))
        return next((due for day in days for due in self._on(day) if due.at > at), None)
