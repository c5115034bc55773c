# SPDX-License-Identifier: Apache-2.0
"""Every button of the panel: one row, one route `POST /control/NAME`."""

import json
import math
from dataclasses import dataclass, field
from typing import Any

from eol_ros.errors import UsageError


@dataclass(frozen=True)
class Number:
    """A number that a control takes, within its range."""

    name: str
    low: float
    high: float
    whole: bool = False

    def check(self, value: Any) -> float:
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, float))
            or not math.isfinite(value)
        ):
            raise UsageError(f'{self.name}: {value!r} is not a number')
        if not self.low <= value <= self.high:
            raise UsageError(f'{self.name}: {value:g} is not within {self.low:g} to {self.high:g}')
        if self.whole and value != int(value):
            raise UsageError(f'{self.name}: {value:g} is not a whole number')
        return int(value) if self.whole else float(value)


@dataclass(frozen=True)
class Word:
    """A name that a control takes."""

    name: str

    def check(self, value: Any) -> str:
        plain = isinstance(value, str) and value.replace('_', '').isalnum() and value.isascii()
        if not plain or len(value) > 64:
            raise UsageError(f'{self.name}: {str(value)[:40]!r} is not a name')
        return value


@dataclass(frozen=True)
class Control:
    """One button.

    Either a `command` for the topic `control`, or live `settings` of a node with the field of the
    request that each takes: {setting: field}.
    """

    name: str
    doc: str
    takes: tuple[Number | Word, ...] = ()
    command: str = ''
    target: str = ''
    key: str = ''
    settings: dict[str, str] = field(default_factory=dict)
    answered: bool = False  # the target says in its status what came of it

    def read(self, body: Any) -> dict[str, Any]:
        """Return the checked fields of a request; raises UsageError that names what is wrong."""
        if not isinstance(body, dict):
            raise UsageError('the request is a JSON object')
        known = {item.name for item in self.takes}
        for name in body:
            if name not in known:
                raise UsageError(
                    f'{str(name)[:40]}: {self.name} takes {sorted(known) or "nothing"}'
                )
        for name in known - set(body):
            raise UsageError(f'{name}: missing')
        return {item.name: item.check(body[item.name]) for item in self.takes}

    def value(self, fields: dict[str, Any]) -> str:
        """Return the value for the topic `control`: YAML (JSON is YAML)."""
        return json.dumps(list(fields.values())) if fields else ''


_GRAIN = Number('grain', 0, 2**32 - 1, whole=True)

CONTROLS: dict[str, Control] = {
    row.name: row
    for row in (
        Control('sleep', 'walls black, sound silent, LEDs dark', command='sleep'),
        Control('wake', 'the work runs again', command='wake'),
        Control('mute', 'no sound', command='mute'),
        Control('unmute', 'sound again', command='unmute'),
        Control('test', 'test card on the walls, test of sound and light', command='test'),
        Control(
            'calibrate',
            'measure camera and table by the blocks, which must be still',
            command='calibrate',
            target='tracker',
            answered=True,
        ),
        Control(
            'learn_clutter',
            'take what shines now, without blocks, for background',
            command='learn_clutter',
            target='tracker',
            answered=True,
        ),
        Control(
            'radius',
            'reach of a block in metres',
            (Number('value', 0.001, 1.0),),
            target='grains',
            settings={'radius': 'value'},
        ),
        Control(
            'threshold',
            'brightness from which a spot may be a block, 0..255',
            (Number('value', 0, 255),),
            target='tracker',
            settings={'threshold': 'value'},
        ),
        Control(
            'axes',
            'descriptors of the two axes',
            (Word('x'), Word('y')),
            target='grains',
            settings={'x_axis': 'x', 'y_axis': 'y'},
        ),
        Control('play', 'hear one grain', (_GRAIN,), command='play', target='sound'),
        Control(
            'move',
            'put a grain elsewhere in the descriptor space, 0..1; kept beside the sound',
            (_GRAIN, Number('x', 0, 1), Number('y', 0, 1)),
            command='set',
            target='grains',
            key='place',
        ),
    )
}
