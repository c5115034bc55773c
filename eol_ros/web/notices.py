# SPDX-License-Identifier: Apache-2.0
"""Messages of the graph as the plain dicts that pages read. Takes anything with the same fields."""

import datetime
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from eol_ros.core.science import powerlaw
from eol_ros.core.table import Table
from eol_ros.said import Said, from_message
from eol_ros.settings import GrainsSettings
from eol_ros.streams import cascades
from eol_ros.streams.record import seconds
from eol_ros.streams.requests import values_of
from eol_ros.streams.work_state import States

RECENT = 40
LEVELS = ('ok', 'warn', 'error', 'silent')


def wall(
    message: Any, fade_s: float, look: Callable[[str, list[str]], dict[str, Any]]
) -> dict[str, Any]:
    """Return a Wall message; an empty left and right means black.

    `look` gives what a page must know of the images beside their names: `caption_zh`, and in
    `looks` their fit and focus.
    """
    shown = [name for name in (message.left, message.right, *message.ahead) if name]
    return {
        't': 'wall', 'change': message.change, 'moving': message.moving,
        'flip': seconds(message.flip), 'left': message.left, 'right': message.right,
        'caption': message.caption, 'credit': message.credit, 'ahead': list(message.ahead),
        'fade': fade_s, **look(message.left, shown),
    }  # fmt: skip


def lattice(table: Table) -> dict[str, Any]:
    """Return the table for pages, all in metres; pairs are along x and along y."""
    return {
        'rows': table.rows, 'columns': table.columns, 'absent': list(table.absent),
        'side': table.block_side_m, 'gaps': list(table.gaps_m), 'bar': table.rim_width_m,
        'platform': list(table.platform_m),
    }  # fmt: skip


def limits(network: str) -> dict[str, Any]:
    """Return the range of each control that is a slider, and how far the graph can be reached."""
    radius = GrainsSettings.__dataclass_fields__['radius'].metadata
    return {'t': 'limits', 'radius': [radius['min'], radius['max']], 'network': network}


def meter(message: Any) -> dict[str, Any]:
    """Return the figures of a SoundMeter message, without its curves."""
    names = ('device', 'sample_rate', 'block_size', 'latency', 'triggers', 'underruns', 'late',
             'dropped', 'stolen', 'voices', 'load', 'peak_dbfs', 'rms_dbfs', 'limiter_db',
             'governor_db')  # fmt: skip
    return {name: getattr(message, name) for name in names}


def health(state: Any) -> dict[str, Any]:
    """Return a NodeState; who starts is shown as a warning."""
    level = LEVELS[state.level] if state.level < 3 else 'warn'
    said = from_message(state.text, state.code, values_of(state.args))
    return {
        't': 'health', 'node': state.node, 'level': level, 'text': state.text, 'said': said.parts,
        'rate': round(state.rate, 2), 'pid': state.pid, 'values': values_of(state.values),
    }  # fmt: skip


def work(state: Said) -> dict[str, Any]:
    """Return the state of the whole work; pages show `said`, and act by `code`."""
    return {'t': 'work', 'code': state.parts[0][0], 'text': state, 'said': state.parts}


class Roster:
    """The states of the nodes that have reported; may be read from any thread."""

    def __init__(self, scene: Iterable[str] = (), began_s: float = 0.0) -> None:
        self._all = States(scene, began_s)
        self._told: dict[str, tuple[float, dict[str, Any]]] = {}  # when, and what

    def take(self, state: Any, now_s: float, wall_s: float) -> dict[str, Any]:
        """Note a NodeState heard at `now_s` (`wall_s` on the wall clock); return it.

        `at` tells a page that is opened later how old it is.
        """
        self._all.take(state, now_s)
        notice = health(state) | {'at': wall_s}
        self._told[state.node] = now_s, notice
        return notice

    def states(self, now_s: float) -> dict[str, dict[str, Any]]:
        """Return the newest state of each node and its age; one of over 5 s is `silent`."""
        found = {}
        for node, (heard_s, notice) in list(self._told.items()):
            silent = {} if self.runs(node, now_s) else {'level': 'silent'}
            found[node] = notice | {'age_s': round(now_s - heard_s, 1)} | silent
        return found

    def runs(self, node: str, now_s: float) -> bool:
        """Return whether a node has been heard within 5 s."""
        return node in self._told and now_s - self._told[node][0] < States.SILENT_S

    def work(self, now_s: float) -> Said:
        """Return the state of the whole work."""
        return self._all.work(now_s)


class Day:
    """The cascades of today: how many of each area, and the newest ones.

    Today is the day on which they arrive, by the local clock: a replay of an old bag counts too.
    """

    def __init__(self, kept: Any = None, table: Table = Table()):
        self._places = {name: lattice(table)[name] for name in ('rows', 'columns', 'absent')}
        self._blocks, known = table.count, Table()
        alike = (table.rows, table.columns, table.absent) == (known.rows, known.columns, ())
        self._beside = {'automaton': powerlaw.AUTOMATON_B} if alike else {}
        self._date = ''
        self._areas: list[int] = []  # of each cascade, in order of time
        self._recent: deque[list[Any]] = deque(maxlen=RECENT)
        self._greatest: list[Any] = []
        self._law: dict[str, Any] = {}
        self._law_of = -1  # so many cascades were fitted
        self.other = isinstance(kept, dict) and kept.get('table', self._places) != self._places
        if not self.other and _is_day(kept, table):
            self._date, self._areas = kept['date'], list(kept['order'])
            self._recent.extend(kept['recent'])
            self._greatest = kept.get('greatest', [])
        self.fit()

    def turn(self, now_s: float) -> bool:
        """Begin from zero when midnight has passed; return whether it has."""
        date = str(datetime.date.fromtimestamp(now_s))
        if date == self._date:
            return False
        self._date = date
        self._areas.clear()
        self._recent.clear()
        self._greatest = []
        self.fit()
        return True

    def add(self, message: Any, now_s: float) -> None:
        """Count one Cascade message."""
        self.turn(now_s)
        self._areas.append(min(message.area, self._blocks))
        row = cascades.to_json(message)
        self._recent.append(row)
        if row[2:4] > self._greatest[2:4]:  # area and size
            self._greatest = row

    def kept(self) -> dict[str, Any]:
        """Return the day so far, as plain data."""
        return {
            'date': self._date, 'order': list(self._areas), 'recent': list(self._recent),
            'greatest': self._greatest, 'table': self._places,
        }  # fmt: skip

    def fit(self) -> bool:
        """Fit the power law of the areas, if cascades have come; return whether any had."""
        if self._law_of == len(self._areas):
            return False
        self._law_of = len(self._areas)
        try:
            law = powerlaw.cascade_law(np.array(self._areas, np.int64), self._blocks)
        except powerlaw.FitError:
            self._law = {'fitted': self._law_of, 'fewest': powerlaw.FEWEST_CASCADES}
            return True
        if law.rejected:
            self._law = {
                'fitted': self._law_of, 'fewest': powerlaw.FEWEST_CASCADES, 'rejected': True,
                'ks': law.fit.ks, 'p': law.tested.p_value, 'count': law.fit.count,
                **self._beside,
            }  # fmt: skip
            return True
        logs = np.log(np.arange(law.fit.x_min, self._blocks + 1))
        shares = np.exp(-law.fit.tau * logs)
        self._law = {
            'fitted': self._law_of, 'b': law.fit.b_value, 'error': law.tested.error,
            'from': law.fit.x_min, 'count': law.fit.count,
            'exceedance': (shares[::-1].cumsum()[::-1] / shares.sum()).tolist(),
            **self._beside,
        }  # fmt: skip
        return True

    def notice(self) -> dict[str, Any]:
        """Return the day so far, for pages: N of each area, newest and greatest cascade, their law.

        `law` has `b`, `error` and `exceedance`, the fitted share of N(>= from) for each area from
        `from` on; `rejected`, `ks`, `p` and `count` where they follow no power law; or, where there
        is no fit, only how many cascades there are and how many it takes. `automaton` is the b of
        the automaton of 5x5 blocks, which only a table of these is compared with.
        """
        counts = np.bincount(np.array(self._areas, np.int64), minlength=self._blocks + 1).tolist()
        return {
            't': 'cascades',
            'date': self._date,
            'areas': counts,
            'recent': list(self._recent),
            'greatest': self._greatest,
            'law': self._law,
        }


def _is_day(kept: Any, table: Table) -> bool:
    """Return whether a file holds a day as `Day.kept` gives it."""
    return (
        isinstance(kept, dict)
        and isinstance(kept.get('date'), str)
        and isinstance(kept.get('order'), list)
        and all(isinstance(area, int) and 0 <= area <= table.count for area in kept['order'])
        and isinstance(kept.get('recent'), list)
        and all(
            isinstance(row, list) and len(row) == 6
            for row in [*kept['recent'], *([kept['greatest']] if kept.get('greatest') else [])]
        )
    )
