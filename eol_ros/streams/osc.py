# SPDX-License-Identifier: Apache-2.0
"""OSC messages of the graph: one table of what is sent, and the requests that messages make.

Addresses begin with the namespace of the graph, here `eol`. The table in
`docs/reference/osc.md` is made from this one.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eol_ros.core.sound.stress import stress
from eol_ros.core.table import Table
from eol_ros.errors import UsageError, nearest
from eol_ros.settings import OSC_MESSAGES, live_fields
from eol_ros.streams import corpus
from eol_ros.streams.graph import NODES, full_name
from eol_ros.streams.requests import KINDS, SET, Asked, as_setting, no_request

AGAIN_S = 5.0  # period at which all that holds is sent again, for a listener that comes later
MOVED_M, TURNED_RAD = 0.0005, 0.005  # least change of a pose that is sent (chosen: above its noise)
STRESSED = 0.01  # least change of stress that is sent (chosen)

IDLE = 'has nothing to do: set send_to, port, tuio or tuio2'
Values = tuple[Any, ...]


@dataclass(frozen=True)
class Row:
    """One kind of message; `of` makes its values of a message of the graph, or the node does."""

    name: str
    takes: str
    doc: str
    of: Callable[[Any], Values] = lambda message: ()


def _since_s(message: Any) -> float:
    """Return when it began, in s from its stamp on: the time tag has what a float32 has not."""
    began, stamp = message.onset, message.header.stamp
    return float(began.sec - stamp.sec + (began.nanosec - stamp.nanosec) * 1e-9)


def _slip(m: Any) -> Values:
    return (m.block, m.kind, m.x, m.y, m.slip, _since_s(m), m.speed, m.distance, m.duration,
            m.cascade, int(m.tapped))  # fmt: skip


def _provisional(m: Any) -> Values:
    return m.block, m.kind, m.x, m.y, m.slip, _since_s(m), m.strength, m.probability


def _cascade(m: Any) -> Values:
    return m.cascade, m.nucleus, m.area, m.size, _since_s(m), m.duration, m.distance, *m.blocks


def _wall(m: Any) -> Values:
    return m.change, int(m.moving), m.left, m.right, m.caption


def _meter(m: Any) -> Values:
    return m.peak_dbfs, m.rms_dbfs, m.limiter_db, m.governor_db, m.voices, m.load


ROWS = {
    row.name: row
    for row in (
        Row('block', 'block, x m, y m, yaw rad, sigma m, seen 0 or 1',
            'pose of a block that has moved by 0.5 mm or turned by 0.005 rad; at most `rate_hz` '
            'times a second'),
        Row('tracking', 'state, count', 'state of the tracker (1: all identities are known) and '
            'the number of blocks whose pose is known; at each change'),
        Row('slip', 'block, kind, x m, y m, slip, onset s, speed m/s, distance m, duration s, '
            'cascade, tapped 0 or 1', 'a block starts to move (kind 1) or stops (kind 2)', _slip),
        Row('provisional', 'block, kind, x m, y m, slip, onset s, strength m/s², probability',
            'a slip that an accelerometer felt: provisional (kind 1), then confirmed by the camera '
            '(kind 2, with its number) or retracted (kind 3)', _provisional),
        Row('cascade', 'cascade, nucleus, area, size, onset s, duration s, distance m, block ...',
            'slips joined in time and neighbourhood; the blocks are in order of onset', _cascade),
        Row('stress', 'stress ...', 'stress of each place, 1: friction at its limit, NaN: not '
            'known; on a change by 0.01, at most `rate_hz` times a second'),
        Row('lights', 'level ...', 'level of the light of each place, 0 to 255; at each change '
            'and every 5 s'),
        Row('wall', 'change, moving 0 or 1, left, right, caption',
            'the pair of pictures that the walls show from the time tag on', _wall),
        Row('grain', 'block, grain, gain, rate, pan, x m, y m, descriptor ...',
            'a grain is triggered (block 255: by a person); from x on only with a corpus'),
        Row('descriptors', 'name ...', 'names of the descriptors of `grain`; at each corpus, and '
            'every 5 s while grains sound'),
        Row('meter', 'peak dBFS, rms dBFS, limiter dB, governor dB, voices, load', 'level of the '
            'sound; at most `rate_hz` times a second', _meter),
        Row('state', 'code, text', 'state of the whole work: awake, asleep, muted ...; at each '
            'change and every 5 s'),
        Row('health', 'node, level, text', 'level of a node: 0 works, 1 warns, 2 does not work, '
            '3 starts; at each change'),
    )
}  # fmt: skip
assert tuple(ROWS) == OSC_MESSAGES


def addresses(send: Iterable[str], namespace: str) -> dict[str, str]:
    """Return the address of each message that is sent."""
    return {name: full_name(name, namespace) for name in send or ROWS}


class Changes:
    """Tells which rows of an array have changed since they were told, `rate_hz` times a second.

    All rows are returned again every AGAIN_S. NaN equals NaN.
    """

    def __init__(self, rate_hz: float, least: Any = 0.0):
        self._period_s, self._least = 1 / rate_hz, least
        self._told: np.ndarray | None = None
        self._next_s = self._all_s = -math.inf

    def rows(self, values: np.ndarray, now_s: float) -> np.ndarray:
        """Return the numbers of the rows of `values` (rows, columns) to be told now."""
        if now_s < self._next_s:
            return np.empty(0, int)
        if self._told is None or now_s >= self._all_s:
            self._told, self._all_s = np.full(values.shape, np.inf), now_s + AGAIN_S
        with np.errstate(invalid='ignore'):  # silence is -inf dB
            same = np.abs(values - self._told) <= self._least
        same |= np.isnan(values) & np.isnan(self._told)
        changed = np.flatnonzero(~same.all(axis=1))
        if len(changed):
            self._told[changed] = values[changed]
            self._next_s = now_s + self._period_s
        return changed


def poses(rows: np.ndarray, known: bool) -> np.ndarray:
    """Return x, y and yaw of each place, (cells, 3), from the rows of a Blocks message."""
    found = np.stack([rows['x'], rows['y'], rows['yaw']], axis=1)
    found[~np.isfinite(found).all(axis=1) | (not known)] = np.nan
    return found


def strains(at: np.ndarray, break_m: float, table: Table) -> np.ndarray:
    """Return the stress of each place (cells,) by `poses`; NaN where it is not known."""
    with np.errstate(invalid='ignore'):
        found = stress(at[:, :2], break_m, table)
    found[~table.present] = np.nan
    return found


class GrainValues:
    """What is sent of a grain besides its trigger: place and descriptors, by the corpus."""

    def __init__(self) -> None:
        # From which stamp on a corpus counts, and the values of its grains: this one, the next.
        self._corpora: deque[tuple[int, np.ndarray]] = deque(maxlen=2)
        self.names: tuple[str, ...] = ()

    def take(self, message: Any, from_ns: int) -> bool:
        """Take a Corpus message; return whether it has values for its descriptors."""
        told = corpus.values(message)
        if len(told) != len(message.descriptors):
            return False
        rows = np.stack([*corpus.places(message).T, *told.values()], axis=1)
        self._corpora.append((from_ns, rows))
        self.names = tuple(told)
        return True

    def of(self, grain: int, stamp_ns: int) -> list[float]:
        """Return x, y and descriptors of a grain; nothing where no corpus has it."""
        known: list[float] = []
        for from_ns, rows in self._corpora:
            if stamp_ns >= from_ns and grain < len(rows):
                known = rows[grain].tolist()
        return known


def asked_of(address: str, values: Sequence[Any], namespace: str) -> Asked | None:
    """Return the request of a message; None for a button that is let go; raise UsageError.

    `/eol/call/KIND VALUE ...` or `/eol/call/KIND/NODE VALUE ...`, with the values in the order of
    `eol call --list`; `/eol/set/NODE/NAME VALUE`, with the lines of a list as values.
    """
    values = [float(f'{v:.7g}') if isinstance(v, float) else v for v in values]  # a float32: 0.1
    call, to_set = full_name('call/', namespace), full_name('set/', namespace)
    words = address.removeprefix(call).split('/')
    if address.startswith(call) and len(words) <= 2:
        return _call(words[0], ''.join(words[1:]), values)
    words = address.removeprefix(to_set).split('/')
    if not address.startswith(to_set) or len(words) > 2:
        raise UsageError(f'no such address; there are {call}KIND and {to_set}NODE/NAME')
    node, name = words if len(words) == 2 else ('', words[0])
    if len(words) == 1 or node not in KINDS[SET].nodes:
        having = [n for n in KINDS[SET].nodes if name in live_fields(NODES[n].settings)]
        hint = f'write {to_set}{having[0]}/{name}' if having else 'no node has this live setting'
        raise UsageError(f'it names no node that has settings; {hint}')
    kind = NODES[node].settings
    if name not in live_fields(kind):
        raise UsageError(f'{node} has no such live setting. {nearest(name, live_fields(kind))}')
    return Asked(SET, node, {name: as_setting(kind, name, values)})


def _call(name: str, node: str, values: Sequence[Any]) -> Asked | None:
    kind = KINDS.get(name)
    if kind is None or kind.internal or name == SET:
        raise UsageError(no_request(name))
    kind.whom(node)
    if not kind.takes and len(values) == 1:  # a button: 1 when pressed, 0 when let go
        if values[0] not in (0, 1):
            raise UsageError(f'{name} takes no value but 1, the press of a button')
        return Asked(name, node) if values[0] else None
    names = [item.name for item in kind.takes]
    if len(values) != len(names):
        raise UsageError(f'{name} takes {" ".join(names) or "no values"}, not {len(values)} values')
    return Asked(name, node, kind.check(dict(zip(names, values, strict=True))))
