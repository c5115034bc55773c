# SPDX-License-Identifier: Apache-2.0
"""State of the whole work as one text, from the states of its nodes.

Pages, walls, OSC, `eol status`, notifications and the log of bringup show this text and no other.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from eol_ros.said import Said, first_clause, from_message, said
from eol_ros.streams.graph import IMAGE_SOURCES
from eol_ros.streams.requests import values_of

OK, WARN, ERROR, STARTING, DOWN = range(5)  # levels of a node; DOWN: it does not run or answer
# Nodes without which people see or hear less. Recorder, panel and opening hours are none.
SHOWN = (*IMAGE_SOURCES, 'tracker', 'motion', 'leds', 'grains', 'sound', 'montage')
LEVELS = {'starting': STARTING, 'work_fault': ERROR, 'no_camera': WARN, 'no_sound_card': WARN}
Rows = Mapping[str, Mapping[str, Any]]


def is_asleep(rows: Rows) -> bool:
    """Return whether a node that people see or hear sleeps."""
    return any(rows[node]['values'].get('asleep') for node in SHOWN if node in rows)


def gives_no_images(row: Mapping[str, Any]) -> bool:
    """Return whether a node that handles images has none and reports that."""
    return row['level'] in (WARN, ERROR) and row['rate'] == 0


def work_state(rows: Rows) -> Said:
    """Return the first state that applies: starting, test, asleep, work_fault, no_camera,
    no_sound_card, muted, awake.

    Parameters
    ----------
    rows : mapping
        Of each node by name: `level`, `text` with its `code` and `args`, `rate` in 1/s, `values`.
    """
    shown = {node: rows[node] for node in SHOWN if node in rows}
    if not rows or any(row['level'] == STARTING for row in shown.values()):
        return said('starting')
    if any(row['values'].get('testing') for row in rows.values()):
        return said('test')
    if is_asleep(rows):
        until = 'hours' in rows and rows['hours']['code'] in ('asleep_until', 'asleep_ever')
        return first_clause(_text(rows['hours'])) if until else said('asleep')
    for node, row in shown.items():
        if row['level'] == DOWN:
            return said('work_fault', why=said('does_not_run', names=node))
        if row['level'] == ERROR and node not in IMAGE_SOURCES:
            return said('work_fault', why=said('of_node', node=node, why=_text(row)))
    if any(gives_no_images(shown[node]) for node in (*IMAGE_SOURCES, 'tracker') if node in shown):
        return said('no_camera')
    sound = shown['sound']['values'] if 'sound' in shown else {}
    if sound.get('card_missing'):
        return said('no_sound_card')
    return said('muted') if sound.get('muted') else said('awake')


class States:
    """Newest state of each node, from NodeState messages.

    Nodes of the scene that have not been heard of are starting for START_S after `began_s`.
    """

    SILENT_S, START_S = 5.0, 60.0

    def __init__(self, scene: Iterable[str] = (), began_s: float = 0.0) -> None:
        until_s = began_s + self.START_S - self.SILENT_S
        unheard = {'level': STARTING, 'values': {}, 'heard_s': until_s}
        self._rows: dict[str, dict[str, Any]] = {node: unheard for node in scene}

    def take(self, state: Any, now_s: float) -> None:
        """Note a NodeState heard at `now_s`."""
        self._rows[state.node] = {
            'level': state.level, 'text': state.text, 'code': state.code,
            'args': values_of(state.args), 'rate': state.rate, 'values': values_of(state.values),
            'heard_s': now_s,
        }  # fmt: skip

    def work(self, now_s: float) -> Said:
        """Return the state of the whole work; a node that is silent counts as DOWN."""
        return work_state(
            {
                node: row if now_s - row['heard_s'] < self.SILENT_S else row | {'level': DOWN}
                for node, row in list(self._rows.items())
            }
        )


def _text(row: Mapping[str, Any]) -> Said:
    return from_message(row['text'], row['code'], row['args'])
