# SPDX-License-Identifier: Apache-2.0
"""Every button of the panel: one row, one route `POST /control/NAME`, one request to the graph."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from eol_ros.errors import UsageError
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import KINDS, SET, Asked, Taken, Value, Word, checked


@dataclass(frozen=True)
class Control:
    """One button: a request of `kind`, to `node` or to all that heed it.

    settings: of a request that sets, which field of the body each setting takes. fixed: what it
    sets by itself.
    """

    name: str
    doc: str
    kind: str
    node: str = ''
    takes: tuple[Taken, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)

    def read(self, body: Any, source: str) -> Asked:
        """Return what a body asks for; raises UsageError that names what is wrong."""
        if not isinstance(body, dict):
            raise UsageError('the request is a JSON object')
        values = checked(self.name, self.takes, body)
        if self.settings:
            values = {name: values[given] for name, given in self.settings.items()}
        return Asked(self.kind, self.node, {**values, **self.fixed}, source=source)


def _setting(name: str, node: str, setting: str) -> Control:
    """A live setting."""
    meta = next(f for f in fields(NODES[node].settings) if f.name == setting).metadata
    doc = f'{meta["doc"]}' + (f', in {meta["unit"]}' if meta['unit'] else '')
    return Control(name, doc, SET, node, (Value('value'),), {setting: 'value'})


def _plain(name: str, kind: str = '') -> Control:
    row = KINDS[kind or name]
    return Control(name, row.doc, row.name, takes=row.takes)


CONTROLS: dict[str, Control] = {
    row.name: row
    for row in (
        *map(
            _plain,
            ('sleep', 'wake', 'mute', 'unmute', 'test', 'calibrate', 'learn_background', 'cue'),
        ),
        Control(
            'plays_itself',
            'simulated visitors play with the virtual table while nobody does',
            SET,
            'twin',
            fixed={'hands': 'visitors'},
        ),
        Control(
            'people_only',
            'only people move the virtual table',
            SET,
            'twin',
            fixed={'hands': 'nobody'},
        ),
        _setting('radius', 'grains', 'radius'),
        _setting('blend', 'grains', 'blend'),
        Control(
            'axes',
            'descriptors of the two axes',
            SET,
            'grains',
            (Word('x'), Word('y')),
            {'x_axis': 'x', 'y_axis': 'y'},
        ),
        *(_setting(name, 'grains', name) for name in ('mode', 'weights', 'regions', 'paths')),
        *(
            _setting(name, 'sound', name)
            for name in (
                'gain_db',
                'filter',
                'filter_hz',
                'filter_q',
                'filter_by',
                'filter_octaves',
            )
        ),
        *map(_plain, ('save_preset', 'recall_preset', 'morph_presets')),
        _plain('play', 'play_grain'),
        _plain('move', 'move_grain'),
        _plain('restore', 'restore_grain'),
    )
}
