# SPDX-License-Identifier: Apache-2.0
"""Messages of the graph as the plain dicts that pages read. Takes anything with the same fields."""

import datetime
from collections import deque
from typing import Any

from eol_ros.core.geometry import N_BLOCKS

RECENT = 40
LEVELS = ('ok', 'warn', 'error', 'silent')


def seconds(stamp: Any) -> float:
    """Return a stamp message in seconds."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def wall(message: Any, fade_s: float) -> dict[str, Any]:
    """Return a Wall message; an empty left and right means black."""
    return {
        't': 'wall', 'change': message.change, 'moving': message.moving,
        'flip': seconds(message.flip), 'left': message.left, 'right': message.right,
        'caption': message.caption, 'credit': message.credit, 'ahead': list(message.ahead),
        'fade': fade_s,
    }  # fmt: skip


def slip(message: Any) -> dict[str, Any]:
    """Return a Slip message."""
    return {
        't': 'slip', 'start': message.kind == message.START, 'block': message.block,
        'slip': message.slip, 'cascade': message.cascade, 'stamp': seconds(message.header.stamp),
        'onset': seconds(message.onset), 'x': message.x, 'y': message.y,
        'speed': message.speed, 'distance': message.distance, 'duration': message.duration,
    }  # fmt: skip


def trigger(message: Any) -> dict[str, Any]:
    """Return a GrainTrigger message."""
    return {
        't': 'trigger', 'grain': message.grain, 'block': message.block, 'gain': message.gain,
        'stamp': seconds(message.header.stamp),
    }  # fmt: skip


def corpus(message: Any) -> dict[str, Any]:
    """Return a Corpus message, its values as one list per descriptor."""
    count = len(message.descriptors)
    return {
        'name': message.name, 'digest': message.digest, 'radius': message.radius,
        'x': list(message.x), 'y': list(message.y), 'x_name': message.x_name,
        'y_name': message.y_name, 'start': list(message.start), 'duration': list(message.duration),
        'bounds': list(message.bounds), 'descriptors': list(message.descriptors),
        'values': [list(message.values[i::count]) for i in range(count)],
    }  # fmt: skip


def meter(message: Any) -> dict[str, Any]:
    """Return the figures of a SoundMeter message, without its curves."""
    names = ('device', 'sample_rate', 'block_size', 'latency', 'triggers', 'underruns', 'late',
             'dropped', 'stolen', 'voices', 'load', 'peak_dbfs', 'rms_dbfs', 'limiter_db',
             'governor_db')  # fmt: skip
    return {name: getattr(message, name) for name in names}


def health(status: Any) -> dict[str, Any]:
    """Return a DiagnosticStatus (REP 107) of one of our nodes."""
    level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
    values = {pair.key: pair.value for pair in status.values}
    return {
        't': 'health', 'node': status.name.removeprefix('eol: '),
        'level': LEVELS[min(level, 3)], 'text': status.message,
        'rate': float(values.pop('rate_hz', 0.0)), 'values': values,
        'pid': status.hardware_id,
    }  # fmt: skip


class Roster:
    """The nodes that have been heard of, and how they are."""

    SILENT_S = 5.0

    def __init__(self) -> None:
        self.nodes: dict[str, dict[str, Any]] = {}
        self._heard_s: dict[str, float] = {}

    def take(self, status: Any, now_s: float) -> dict[str, Any]:
        """Note a DiagnosticStatus; return it for pages."""
        notice = health(status)
        self.nodes[notice['node']] = notice
        self._heard_s[notice['node']] = now_s
        return notice

    def runs(self, node: str, now_s: float) -> bool:
        """Return whether a node has been heard within 5 s."""
        return now_s - self._heard_s.get(node, -1e9) < self.SILENT_S


class Day:
    """The cascades of today: how many of each area, and the newest ones.

    Today is the day on which they arrive, by the local clock: a replay of an old bag counts too.
    """

    def __init__(self, kept: Any = None):
        self._date = ''
        self._areas = [0] * (N_BLOCKS + 1)
        self._recent: deque[list[Any]] = deque(maxlen=RECENT)
        if _is_day(kept):
            self._date, self._areas = kept['date'], list(kept['areas'])
            self._recent.extend(kept['recent'])

    def turn(self, now_s: float) -> bool:
        """Begin from zero when midnight has passed; return whether it has."""
        date = str(datetime.date.fromtimestamp(now_s))
        if date == self._date:
            return False
        self._date, self._areas = date, [0] * (N_BLOCKS + 1)
        self._recent.clear()
        return True

    def add(self, message: Any, now_s: float) -> None:
        """Count one Cascade message."""
        self.turn(now_s)
        self._areas[min(message.area, N_BLOCKS)] += 1
        self._recent.append([
            seconds(message.onset), message.nucleus, message.area, message.size, message.duration,
            list(message.blocks),
        ])  # fmt: skip

    def kept(self) -> dict[str, Any]:
        """Return the day so far, as plain data."""
        return {'date': self._date, 'areas': list(self._areas), 'recent': list(self._recent)}

    def notice(self) -> dict[str, Any]:
        """Return the day so far, for pages."""
        return {'t': 'cascades', **self.kept()}


def _is_day(kept: Any) -> bool:
    """Return whether a file holds a day as `Day.kept` gives it."""
    return (
        isinstance(kept, dict)
        and isinstance(kept.get('date'), str)
        and isinstance(kept.get('areas'), list)
        and len(kept['areas']) == N_BLOCKS + 1
        and all(isinstance(count, int) and count >= 0 for count in kept['areas'])
        and isinstance(kept.get('recent'), list)
        and all(isinstance(row, list) and len(row) == 6 for row in kept['recent'])
    )
