# SPDX-License-Identifier: Apache-2.0
"""Lasting faults and the daily summary, of which people are notified. Pure.

Times and states are arguments.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from eol_ros.said import Said, from_message, said
from eol_ros.streams.work_state import STARTING, is_asleep

SETTLED_S = 30.0  # well for so long: what flaps is not well in between
START_S = 180.0  # who starts may be not OK for so long more: it may compile
STORM, STORM_S = 5, 600.0  # so many starts within this time, though each lasts but seconds
GB = 1e9
_LEVELS = ('is_ok', 'is_warn', 'is_error', 'is_starting', 'is_down')  # codes, by level
_COUNTS = 'restarts', 'slips', 'lost'


@dataclass(frozen=True)
class Fault:
    """A fault: its subject, its text, and how long it may last before it is reported."""

    what: str
    text: str
    patience_s: float


@dataclass(frozen=True)
class News:
    """Changes since the last notification: texts of lasting faults, names of ended ones."""

    lasting: tuple[str, ...]
    over: tuple[str, ...]


class Lasting:
    """Tells what lasts, and that it is over; never more often than every `pause_s`.

    What changes within the pause is told at its end, if it is still so.
    """

    def __init__(self, pause_s: float):
        self.pause_s = pause_s
        self._since: dict[str, float] = {}
        self._well: dict[str, float] = {}  # since when what was not well is
        self._faults: dict[str, Fault] = {}
        self._told: set[str] = set()
        self._last_s: float | None = None

    def look(self, now_s: float, faults: Iterable[Fault]) -> News | None:
        """Take the current faults; return the changes to notify of, or None."""
        now = {fault.what: fault for fault in faults}
        for what in now:
            self._since.setdefault(what, now_s)
            self._well.pop(what, None)
        self._faults |= now
        for what in [what for what in self._since if what not in now]:
            if now_s - self._well.setdefault(what, now_s) >= SETTLED_S:
                for kept in (self._since, self._well, self._faults):
                    del kept[what]
        lasting = {what for what in self._since if self._lasts(what, now_s)}
        early = self._last_s is not None and now_s - self._last_s < self.pause_s
        if lasting == self._told or early:
            return None
        over, self._told, self._last_s = self._told - lasting, lasting, now_s
        return News(self.words(now_s), tuple(sorted(over)))

    def _lasts(self, what: str, now_s: float) -> bool:
        if what in self._told:  # it is over when it is settled, not before
            return True
        long = now_s - self._since[what] >= self._faults[what].patience_s
        return long and what not in self._well

    def words(self, now_s: float) -> tuple[str, ...]:
        """Return what has been told and is not over, a line each."""
        return tuple(
            said(
                'lasting',
                what=what,
                text=self._faults[what].text,
                time=duration(now_s - self._since[what]),
            )
            for what in sorted(self._told)
        )


def duration(seconds: float) -> Said:
    """Return a time in words: `40 s`, `12 min`, `3.5 h`."""
    if seconds < 120:
        return said('time_s', count=f'{seconds:.0f}')
    if seconds < 7200:
        return said('time_min', count=f'{seconds / 60:.0f}')
    return said('time_h', count=f'{seconds / 3600:.1f}')


class RestartStorms:
    """Finds processes that are started again and again."""

    def __init__(self) -> None:
        self._before: dict[str, int] = {}
        self._at_s: dict[str, deque[float]] = {}

    def look(self, now_s: float, restarts: Mapping[str, int]) -> list[Fault]:
        """Take how often each process was started again; return those that storm."""
        found = []
        for name, count in restarts.items():
            times = self._at_s.setdefault(name, deque(maxlen=STORM))
            times.extend([now_s] * (count - self._before.get(name, 0)))
            self._before[name] = count
            while times and now_s - times[0] > STORM_S:
                times.popleft()
            if len(times) == STORM:
                text = said('restarted', count=STORM, minutes=round(STORM_S / 60))
                found.append(Fault(said('restarts_of', name=name), text, 0.0))
        return found


def of_nodes(rows: Iterable[Mapping[str, Any]], after_s: float) -> list[Fault]:
    """Return a fault for each node of a status that is not OK."""
    return [
        Fault(
            row['node'],
            said(_LEVELS[row['level']], text=from_message(row['text'], row['code'], row['args'])),
            after_s + (START_S if row['level'] == STARTING else 0.0),
        )
        for row in rows
        if row['level']
    ]


def of_disk(free_bytes: float | None, least_gb: float, after_s: float) -> list[Fault]:
    """Return whether the disk is nearly full: less free than twice what recording stops at."""
    if free_bytes is None or free_bytes >= 2 * least_gb * GB:
        return []
    text = said('disk_free', free=f'{free_bytes / GB:.1f}', least=f'{least_gb:g}')
    return [Fault(said('disk'), text, after_s)]


@dataclass
class Sums:
    """What adds up over a day; counters of a node that is started again begin from zero."""

    since_s: float = 0.0  # system time at which it began; 0: not yet
    open_s: float = 0.0
    restarts: int = 0
    slips: int = 0
    lost: int = 0
    _before: dict[str, int] = field(default_factory=dict)
    _last_s: float | None = None

    def take(self, now_s: float, rows: Iterable[Mapping[str, Any]], restarts: int) -> None:
        """Add what has come since the last call; `now_s` is steady."""
        nodes = {str(row['node']): row for row in rows}
        runs = any(row['level'] < STARTING for row in nodes.values())
        if self._last_s is not None and runs and not is_asleep(nodes):
            self.open_s += min(now_s - self._last_s, 60.0)  # not what the machine has slept
        self._last_s = now_s
        self.restarts += self._grown('restarts', restarts)
        self.slips += self._grown('slips', _count(nodes, 'motion', 'slips'))
        self.lost += self._grown('lost', _count(nodes, 'recorder', 'lost'))

    def _grown(self, name: str, count: int | None) -> int:
        if count is None:
            return 0
        before = self._before.get(name, 0)
        self._before[name] = count
        return count - before if count >= before else count

    def words(self) -> Said:
        """Return the day in a line: `open 10.0 h, restarts 1, slips 14 213, messages lost 0`."""
        counts = {name: f'{getattr(self, name):,}'.replace(',', ' ') for name in _COUNTS}
        return said('day', hours=f'{self.open_s / 3600:.1f}', **counts)

    def begin(self, since_s: float) -> None:
        """Begin another day; what counters had counted stays counted."""
        self.since_s, self.open_s = since_s, 0.0
        self.restarts = self.slips = self.lost = 0

    def kept(self) -> dict[str, Any]:
        """Return the sums as plain data for a file."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name[0] != '_'}

    def resume(self, kept: Any) -> None:
        """Restore the sums that an earlier run saved; ignore damaged data."""
        names = self.kept()
        if isinstance(kept, dict) and all(
            type(kept.get(name)) in (int, float) and kept[name] >= 0 for name in names
        ):
            for name, now in names.items():
                setattr(self, name, type(now)(kept[name]))


def _count(rows: Mapping[str, Mapping[str, Any]], node: str, name: str) -> int | None:
    value = rows[node]['values'].get(name) if node in rows else None
    return int(value) if isinstance(value, (int, float)) else None
