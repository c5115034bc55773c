# SPDX-License-Identifier: Apache-2.0
"""What may be asked of the nodes: every kind of request once, and the requests of a recording.

A request goes out on `requests`; every node that heeds it answers on `request_results`, with the
stamp from which it counts. Both are in the bag, so that what was asked while recording is heeded
again by a replay and by `eol report --retrack`, from the same image on.
"""

import math
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from eol_ros.errors import UsageError, nearest
from eol_ros.said import said
from eol_ros.settings import fields_of, live_fields
from eol_ros.streams.graph import NODES

if TYPE_CHECKING:  # bringup loads this module and no numpy
    import numpy as np

SET, CUE = 'set', 'cue'


@dataclass(frozen=True)
class Number:
    """A number that a request takes, within its range."""

    name: str
    low: float
    high: float
    whole: bool = False

    def check(self, value: Any) -> float:
        """Return the value; raise UsageError where it is another."""
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, float))
            or not math.isfinite(value)
        ):
            raise UsageError(said('no_number', name=self.name, value=f'{value!r}'))
        if not self.low <= value <= self.high:
            raise UsageError(
                said(
                    'not_within',
                    name=self.name,
                    value=f'{value:g}',
                    low=f'{self.low:g}',
                    high=f'{self.high:g}',
                )
            )
        if self.whole and value != int(value):
            raise UsageError(said('not_whole', name=self.name, value=f'{value:g}'))
        return int(value) if self.whole else float(value)


def is_name(text: str) -> bool:
    """Return whether a text in Unicode's form NFC is letters and digits of any script, - and _.

    1 to 64 characters and at most 200 bytes: it names a file. A letter or digit comes first.
    """
    kinds = [unicodedata.category(c)[0] for c in text]  # L letter, M mark on a letter, N number
    good = all(kind in 'LMN' or c in '-_' for kind, c in zip(kinds, text, strict=True))
    return good and 1 <= len(text) <= 64 and kinds[0] in 'LN' and len(text.encode()) <= 200


@dataclass(frozen=True)
class Word:
    """A name that a request takes."""

    name: str

    def check(self, value: Any) -> str:
        """Return the value; raise UsageError where it is another."""
        found = unicodedata.normalize('NFC', value) if isinstance(value, str) else ''
        if not is_name(found):
            raise UsageError(said('no_name', name=self.name, value=f'{str(value)[:40]!r}'))
        return found


@dataclass(frozen=True)
class Bits:
    """One bit for each place of a table, in hex: more of them than a number of a message has."""

    name: str

    def check(self, value: Any) -> str:
        """Return the value; raise UsageError where it is another."""
        if not (isinstance(value, str) and re.fullmatch('[0-9a-f]{1,64}', value)):
            raise UsageError(said('no_bits', name=self.name, value=f'{str(value)[:40]!r}'))
        return value


@dataclass(frozen=True)
class Value:
    """The value of a setting, whose type and range its node checks."""

    name: str

    def check(self, value: Any) -> Any:
        """Return the value; raise UsageError where it is none that a message can carry."""
        if isinstance(value, (list, tuple)) and all(isinstance(line, str) for line in value):
            return tuple(value)
        whole = isinstance(value, int) and abs(value) < 2**63
        if not (whole or isinstance(value, (float, str))):
            raise UsageError(said('no_value', name=self.name, value=f'{str(value)[:40]!r}'))
        return value


def as_setting(settings: type, name: str, given: Sequence[Any]) -> Any:
    """Return what OSC sent as the setting has it: not all can send a boolean."""
    field = fields_of(settings)[name]
    if isinstance(field.default, tuple):
        return list(given)
    if len(given) != 1:
        raise UsageError(f'{name} takes one value, not {len(given)}')
    value = given[0]
    if isinstance(value, bool):  # `T` is no level of 1
        return value
    if field.type is float and isinstance(value, int):
        return float(value)
    if field.type is int and isinstance(value, float) and value.is_integer():
        return int(value)
    return bool(value) if field.type is bool and value in (0, 1) else value


Taken = Number | Word | Bits | Value


@dataclass(frozen=True)
class Kind:
    """One kind of request.

    nodes: who heeds it. also: who follows it where a scene has them. takes: its values.
    answered_by: whose result is the last word, where that is another node. within_s: how long that
    may take. internal: nodes ask it of each other, or it is a service alone. off: the kind that
    undoes it; both are a service std_srvs/SetBool. triggered: it is a service std_srvs/Trigger.
    """

    name: str
    doc: str
    nodes: tuple[str, ...]
    also: tuple[str, ...] = field(default=(), kw_only=True)
    takes: tuple[Taken, ...] = ()
    answered_by: str = ''
    within_s: float = 3.0
    internal: bool = False
    off: str = ''
    triggered: bool = False

    def whom(self, node: str) -> tuple[str, ...]:
        """Return whom a request to `node` is for, empty for all; raise UsageError if nobody."""
        heeding = self.nodes + self.also
        if node and node not in heeding:
            raise UsageError(f'{self.name}: {node} does not heed it, but {", ".join(heeding)}')
        return (node,) if node else heeding

    def check(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the checked values; raise UsageError that names what is wrong."""
        if self.name == SET:
            return {name: Value(name).check(value) for name, value in values.items()}
        return checked(self.name, self.takes, values)


def checked(name: str, takes: tuple[Taken, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `values` where they are what `takes` names; raise UsageError that says what not."""
    known = {item.name for item in takes}
    for given in values:
        if given not in known:
            raise UsageError(
                said('takes', given=str(given)[:40], name=name, known=sorted(known) or 'nothing')
            )
    for missing in sorted(known - set(values)):
        raise UsageError(said('missing', name=missing))
    return {item.name: item.check(values[item.name]) for item in takes}


_GRAIN = Number('grain', 0, 2**32 - 1, whole=True)
_PRESET = Word('preset')
_TIME = Number('until_ns', 0, 2**63 - 1, whole=True)

_SLEEPERS = ('leds', 'sound', 'montage')
_FOLLOW = ('hours', 'projectors')
# a replay gives the requests of its bag and heeds none: its rate is a ROS parameter alone
_LIVE = tuple(
    name
    for name, node in NODES.items()
    if live_fields(node.settings) and 'requests' in node.subscribes
)

KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(SET, 'change live settings, from the next image on', _LIVE, within_s=20.0),
        Kind('sleep', 'walls black, sound silent, LEDs dark', _SLEEPERS, also=_FOLLOW,
             off='wake'),
        Kind('wake', 'the work runs again', _SLEEPERS, also=_FOLLOW),
        Kind('mute', 'no sound', ('sound',), off='unmute'),
        Kind('unmute', 'sound again', ('sound',)),
        Kind('test', 'test card on the walls, all lights, noise from each loudspeaker in turn',
             ('leds', 'panel', 'sound'), within_s=45.0, triggered=True),
        Kind('calibrate', 'calibrate the camera on the blocks, which must be at rest',
             ('tracker',), within_s=60.0, triggered=True),
        Kind('learn_background', 'learn the background: static lights, with all infrared LEDs off',
             ('leds',), answered_by='tracker', within_s=15.0, triggered=True),
        Kind(CUE, 'send the requests of a cue of the scene', ('hours',),
             (Word('name'),), within_s=65.0),  # longer than any request of a cue
        Kind('play_grain', 'play one grain', ('sound',), (_GRAIN,)),
        Kind('save_preset', 'store the live settings of grains and sound under a name', ('sound',),
             (_PRESET,), within_s=10.0),
        Kind('recall_preset', 'restore the settings of a preset, or glide to them',
             ('sound',), (_PRESET, Number('over_s', 0, 3600))),
        Kind('morph_presets', 'set the settings between two presets, at a share of the way',
             ('sound',), (Word('from'), Word('to'), Number('share', 0, 1))),
        Kind('move_grain', 'put a grain elsewhere in the descriptor space, 0..1; kept beside the'
             ' sound', ('grains',), (_GRAIN, Number('x', 0, 1), Number('y', 0, 1))),
        Kind('restore_grain', 'put a moved grain back to its place in the layout', ('grains',),
             (_GRAIN,)),
        Kind('restart', 'restart all nodes of all machines; only with `network: secure`',
             ('machine',), within_s=1.0, internal=True, triggered=True),
        Kind('stop', 'end the run on all machines; only with `network: secure`',
             ('machine',), within_s=1.0, internal=True, triggered=True),
        Kind('darkness', 'stamp until which the infrared light is off', ('tracker',), (_TIME,),
             within_s=15.0, internal=True),
        Kind('background', 'background model as PNG; empty: none',
             ('tracker',), internal=True),
        Kind('covers', 'learned brightness of each cover, by place, which identifies blocks',
             ('tracker',), internal=True),
        Kind('infrared', 'blocks whose infrared light is on, one bit each', ('twin',),
             (Bits('mask'),), internal=True),
    )
}  # fmt: skip


def server_of(nodes: Collection[str]) -> str:
    """Return which of the nodes of a scene serves `eol_ros.ros.services`; '' where none can.

    It is the last of those that give way most (`nice`), so that no image waits for a call. Of
    `machine` there are several.
    """
    found = [
        node
        for node in NODES.values()
        if node.name in nodes and 'requests' in node.subscribes and node.name != 'machine'
    ]
    return max(reversed(found), key=lambda n: n.nice).name if found else ''


def no_request(kind: str) -> str:
    """Return that there is no request of `kind`, with the one that is nearest."""
    known = [name for name, row in KINDS.items() if not row.internal]
    return f'{kind[:40]}: no such request. {nearest(kind[:40], known)}'


PROVED = ('tracker', 'motion', 'grains')  # their results are recomputed from a bag
PEOPLE = ('sleep', 'wake', 'test')  # asked of the work, not of a machine or a room
_OF_CUES = (SET, 'mute', 'unmute')  # and by a cue, which is part of the work
Columns: TypeAlias = 'Mapping[str, np.ndarray] | np.ndarray'  # of a table, by name
_WRITING = ('move_grain', 'restore_grain')  # to files that are there when it is replayed
_KEPT = (SET, 'background', 'covers')  # hold until the next such request


@dataclass(frozen=True)
class Asked:
    """One request, as a node takes it; `from_ns` is the first stamp it counts for, 0: at once."""

    kind: str
    node: str = ''
    values: dict[str, Any] = field(default_factory=dict)
    data: bytes = b''
    from_ns: int = 0
    id: str = ''
    source: str = ''

    def words(self) -> str:
        """Return it as one line for people."""
        values = ' '.join(f'{name}={value}' for name, value in self.values.items())
        return ' '.join(filter(None, (self.kind, self.node, values)))


@dataclass(frozen=True)
class Heeded:
    """A line of a recording, and when it was recorded.

    accepted: it is what a node accepted, with the stamp from which it counted; else what was asked.
    """

    asked: Asked
    log_ns: int
    accepted: bool


def ahead(heeded: list[Heeded], start_ns: int) -> list[Asked]:
    """Return what a replay must ask before the first image, each with the stamp it counts from.

    Of what was asked before `start_ns` of the recording only what still held then is asked.
    """
    mine = [h for h in heeded if h.accepted and h.asked.node in PROVED]
    before: dict[tuple[Any, ...], Asked] = {}
    for one in mine:
        if one.log_ns < start_ns and one.asked.kind in _KEPT:
            key = (one.asked.node, one.asked.kind, tuple(sorted(one.asked.values)))
            before[key] = one.asked
    after = [h.asked for h in mine if h.log_ns >= start_ns and h.asked.kind not in _WRITING]
    return [*before.values(), *after]


def meanwhile(heeded: list[Heeded]) -> dict[int, Asked]:
    """Return what a replay must ask when its time has come, by the time of its record."""
    asked = [h for h in heeded if not h.accepted]
    by_people = [h for h in asked if h.asked.kind in PEOPLE]
    by_cues = [h for h in asked if h.asked.source == 'hours' and h.asked.kind in _OF_CUES]
    return {h.log_ns: h.asked for h in by_people + by_cues if h.asked.node not in PROVED}


def for_tracker(asked: Asked) -> Iterator[tuple[str, Any]]:
    """Yield kind and value of a request as `core.vision.requests` has them."""
    if asked.kind in ('background', 'covers'):
        yield asked.kind, asked.data
    elif asked.kind in ('darkness', 'calibrate'):
        yield asked.kind, asked.values.get('until_ns')


def value_of(value: Any) -> Any:
    """Return the value in a rcl_interfaces/ParameterValue, a message or a row of a table."""
    names = ('', 'bool_value', 'integer_value', 'double_value', 'string_value', 'byte_array_value',
             'bool_array_value', 'integer_array_value', 'double_array_value',
             'string_array_value')  # fmt: skip
    take = value.__getitem__ if hasattr(value, 'dtype') else lambda name: getattr(value, name)
    number = int(take('type'))
    if not 0 < number < len(names):
        return None
    found = take(names[number])
    if number < 5:
        return found.item() if hasattr(found, 'item') else found
    return tuple(v.item() if hasattr(v, 'item') else v for v in found)


def values_of(parameters: Iterable[Any]) -> dict[str, Any]:
    """Return rcl_interfaces/Parameter messages as plain data, by name."""
    return {parameter.name: value_of(parameter.value) for parameter in parameters}


def recorded(requests: Columns, results: Columns) -> list[Heeded]:
    """Return what was asked in a bag, and what of it each node has accepted.

    requests, results: the columns of both topics and `log_time`, in order of recording.
    """
    asked = [_asked(requests, i) for i in range(len(requests['id']))]
    pictures = {heeded.asked.id: heeded.asked.data for heeded in asked if heeded.asked.data}
    found = []
    for i in results['accepted'].nonzero()[0].tolist():
        one = _asked(results, i, accepted=True)
        data = pictures.get(one.asked.id, b'')
        found.append(replace(one, asked=replace(one.asked, data=data)) if data else one)
    return sorted(asked + found, key=lambda heeded: heeded.log_ns)


def _asked(columns: Columns, i: int, accepted: bool = False) -> Heeded:
    asked = Asked(
        str(columns['kind'][i]),
        str(columns['node'][i]),
        {str(v['name']): value_of(v['value']) for v in columns['values'][i]},
        b'' if accepted else bytes(columns['data'][i]),
        int(columns['from_stamp'][i].astype('i8')),
        str(columns['id'][i]),
        '' if accepted else str(columns['source'][i]),
    )
    return Heeded(asked, int(columns['log_time'][i].astype('i8')), accepted)
