# SPDX-License-Identifier: Apache-2.0
"""What keys and controllers of a MIDI instrument do: lines of text to changes of live settings.

A line is `SOURCE [CHANNEL:]NUMBER ACTION`. Sources are `cc` (a controller), `note` and `program`;
channels count from 1, and without one all are meant. Actions are

    NODE.SETTING LEAST MOST    as far as the controller is turned, or the key was struck
    NODE.SETTING VALUE         this value, when the controller is turned up or the key pressed
    NODE.SETTING               the whole range; on and off; of choices one after the other
    recall PRESET              when turned up, pressed or chosen
    morph PRESET PRESET        as far as the controller is turned
    cue CUE                    a cue of the scene, when turned up, pressed or chosen

Messages are those of MIDI 1.0 (MMA, 1996): three bytes of control change (0xB0), note on (0x90,
with velocity 0 it is off) and off (0x80), two of program change (0xC0).
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from eol_ros.core.sound.presets import between
from eol_ros.errors import ConfigError

NUMBERS = 128
SOURCES = {0x80: 'note', 0x90: 'note', 0xB0: 'cc', 0xC0: 'program'}
PRESSED = 64  # a controller from here on is up: MIDI 1.0, switches
_BOOLEANS = {'on': True, 'true': True, '1': True, 'off': False, 'false': False, '0': False}


@dataclass(frozen=True)
class Event:
    """What was turned, struck or chosen: cc, note or program; channel 1..16; value 0..127."""

    source: str
    channel: int
    number: int
    value: int

    @property
    def words(self) -> str:
        """The begin of a line that means it."""
        return f'{self.source} {self.channel}:{self.number}'


@dataclass(frozen=True)
class Change:
    """One setting of a node gets a value."""

    node: str
    name: str
    value: Any


@dataclass(frozen=True)
class Recall:
    """A preset is recalled."""

    preset: str


@dataclass(frozen=True)
class Morph:
    """The settings lie `share` (0..1) of the way from one preset to another."""

    start: str
    end: str
    share: float


@dataclass(frozen=True)
class Cue:
    """A cue of the scene is given."""

    name: str


Action = Change | Recall | Morph | Cue


def event_of(message: Sequence[int]) -> Event | None:
    """Return what the bytes of a MIDI message say, None for what no line can mean.

    Examples
    --------
    >>> event_of([0xB2, 74, 127])
    Event(source='cc', channel=3, number=74, value=127)
    """
    source = SOURCES.get(message[0] & 0xF0) if message else None
    if source is None or len(message) < (2 if source == 'program' else 3):
        return None
    value = 127 if source == 'program' else message[2]
    if message[0] & 0xF0 == 0x80:
        value = 0
    return Event(source, 1 + (message[0] & 0x0F), message[1], value)


class Mapping:
    """The lines of a mapping, as above; `kinds`: the settings of each node that may be named.

    Raises ConfigError for a line that cannot be understood, or that names no live setting.
    """

    def __init__(self, lines: Iterable[str], kinds: dict[str, type]):
        self._rows = [_row(line, kinds) for line in lines]

    @property
    def presets(self) -> set[str]:
        """Names of all presets that lines speak of."""
        return {name for row in self._rows for name in row.presets}

    @property
    def cues(self) -> list[tuple[str, str]]:
        """The cues that lines give, each with its line."""
        return [(row.line, row.name) for row in self._rows if row.verb == 'cue']

    @property
    def changes(self) -> list[tuple[str, Change]]:
        """The ends of what lines can set, each with its line, for who knows what may be."""
        ends = ((row, row.action(value)) for row in self._rows for value in (0, 127))
        return [(row.line, end) for row, end in ends if isinstance(end, Change)]

    def actions(self, event: Event) -> list[Action]:
        """Return what an event means, by the order of the lines."""
        means = [row.action(event.value) for row in self._rows if row.meets(event)]
        return [action for action in means if action is not None]


@dataclass(frozen=True)
class _Row:
    line: str
    source: str
    channel: int  # 0: any
    number: int
    verb: str  # recall, morph, cue or set
    presets: tuple[str, ...] = ()
    node: str = ''
    kind: type | None = None
    name: str = ''
    ends: tuple[Any, ...] = ()  # one value, or least and most

    def meets(self, event: Event) -> bool:
        alike = (self.source, self.number) == (event.source, event.number)
        return alike and self.channel in (0, event.channel)

    def action(self, value: int) -> Action | None:
        if self.verb == 'morph':
            return Morph(self.presets[0], self.presets[1], value / 127)
        pressed = value >= PRESSED if self.source == 'cc' else value > 0
        if self.verb == 'recall':
            return Recall(*self.presets) if pressed else None
        if self.verb == 'cue':
            return Cue(self.name) if pressed else None
        if len(self.ends) == 1:
            return Change(self.node, self.name, self.ends[0]) if pressed else None
        if len(self.ends) > 2 or self.ends == (False, True):  # one after the other
            last = len(self.ends) - 1
            number = last * pressed if last == 1 else min(value * (last + 1) // NUMBERS, last)
            return Change(self.node, self.name, self.ends[number])
        if self.source == 'note' and not value:
            return None  # it is let go: the value stays
        assert self.kind is not None
        least, most = ({self.name: end} for end in self.ends)
        found = between(self.kind, least, most, value / 127)
        return Change(self.node, self.name, found.get(self.name, self.ends[0]))


def _row(line: str, kinds: dict[str, type]) -> _Row:
    source, _, rest = line.partition(' ')
    place, _, action = rest.strip().partition(' ')
    channel, _, number = place.rpartition(':')
    words = action.split()
    good = source in SOURCES.values() and number.isdecimal() and int(number) < NUMBERS
    if not good or (channel and (not channel.isdecimal() or not 1 <= int(channel) <= 16)):
        raise ConfigError(f'midi_map {line!r}: begin with cc, note or program and its number')
    begin = (line, source, int(channel or 0), int(number))
    if words[:1] in (['recall'], ['cue'], ['morph']):
        count = 2 if words[0] == 'morph' else 1
        if len(words) != 1 + count or (source != 'cc' and count == 2):
            raise ConfigError(
                f'midi_map {line!r}: say recall PRESET, cue CUE, or of a cc: morph PRESET PRESET'
            )
        if words[0] == 'cue':
            return _Row(*begin, 'cue', name=words[1])
        return _Row(*begin, words[0], presets=tuple(words[1:]))
    node, _, name = words[0].partition('.') if words else ('', '', '')
    fields = {f.name: f for f in dataclasses.fields(kinds[node])} if node in kinds else {}
    if name not in fields or not fields[name].metadata.get('live'):
        raise ConfigError(
            f'midi_map {line!r}: there is no live setting {words[0] if words else ""}'
        )
    ends = _ends(line, fields[name], words[1:])
    if source == 'program' and len(ends) != 1:
        raise ConfigError(f'midi_map {line!r}: a program has no range: say which value')
    return _Row(*begin, 'set', node=node, kind=kinds[node], name=name, ends=ends)


def _ends(line: str, field: Any, words: list[str]) -> tuple[Any, ...]:
    meta = field.metadata
    if isinstance(field.default, tuple):
        return ((' '.join(words),) if words else (),)
    if meta.get('choices'):
        return tuple(words) or meta['choices']
    if field.type is bool:
        if len(words) > 1 or (words and words[0] not in _BOOLEANS):
            raise ConfigError(f'midi_map {line!r}: {field.name} is on or off')
        return (_BOOLEANS[words[0]],) if words else (False, True)
    if field.type is str:
        if not words:
            raise ConfigError(f'midi_map {line!r}: say what {field.name} becomes')
        return (' '.join(words),)
    try:
        ends = tuple(field.type(word) for word in words)
    except ValueError:
        raise ConfigError(f'midi_map {line!r}: {field.name} is a number') from None
    if not ends:
        ends = (meta.get('min'), meta.get('max'))
    if len(ends) > 2 or None in ends or not all(map(math.isfinite, ends)):
        raise ConfigError(f'midi_map {line!r}: say LEAST MOST of {field.name}')
    return tuple(map(field.type, ends))
