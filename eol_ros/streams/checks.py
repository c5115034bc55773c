# SPDX-License-Identifier: Apache-2.0
"""What a message must be before a node uses it: one table of limits, for topics and for the board.

Of every type: numbers are finite and not beyond LARGEST, times are times. `rules` adds to that.
`blocks.Codec` and `images.Codec` check what they read themselves.
"""

from collections.abc import Callable, Container, Mapping
from typing import Any, NamedTuple

import numpy as np

from eol_ros.core.table import Table
from eol_ros.streams import triggers
from eol_ros.streams.cdr import NS, TIMES
from eol_ros.streams.definition import parse, short

LARGEST = 1e6  # of any quantity here, in SI units, pixels or decibels
SPAN_NS = 60 * NS  # from now to the stamp of an image or a tap, at most
PLAYED_SPAN_NS = 3600 * NS  # the same from what a replay has played: /clock comes late
ANY_TIME = 0, 2**63 - 1


class Rule(NamedTuple):
    """Limits of one type.

    values: those that a whole number, or each item of an array, may have. nan: numbers that may be
    missing. by_place: arrays with an item for each place of the table. holds: whether arrays that
    belong together have sizes that do.
    """

    values: Mapping[str, Container[int]] = {}
    nan: tuple[str, ...] = ()
    by_place: tuple[str, ...] = ()
    holds: Callable[[Any], bool] = lambda message: True


def _corpus(m: Any) -> bool:
    """Return whether all is there of each grain; places and descriptors may be left out."""
    grains = len(m.file)
    return (
        grains == len(m.start) == len(m.duration)
        and len(m.x) == len(m.y)
        and len(m.x) in (0, grains)
        and len(m.bounds) in (0, 4)
        and len(m.values) in (0, grains * len(m.descriptors))
        and max(m.file, default=-1) < len(m.files)
    )


def rules(table: Table) -> dict[str, Rule]:
    """Return the limits of each type at a table; no message tells of a place without a block."""
    blocks = frozenset(table.ids.tolist())
    return {
        'eol_msgs/msg/BlockTap': Rule({'block': blocks}),
        'eol_msgs/msg/Slip': Rule({'kind': (1, 2), 'block': blocks}),
        'eol_msgs/msg/FeltSlip': Rule({'kind': (1, 2, 3), 'block': blocks}),
        'eol_msgs/msg/Cascade': Rule(
            {'nucleus': blocks, 'area': range(1, table.count + 1), 'blocks': blocks},
            holds=lambda m: len(m.blocks) == m.area,
        ),
        'eol_msgs/msg/GrainTrigger': Rule({'block': {*blocks, triggers.NO_BLOCK}}),
        'eol_msgs/msg/LedCommand': Rule(by_place=('white',)),
        'eol_msgs/msg/Truth': Rule(by_place=('x', 'y', 'yaw', 'moving')),
        'eol_msgs/msg/Corpus': Rule(nan=('x', 'y', 'values'), holds=_corpus),
        'eol_msgs/msg/NodeState': Rule({'level': range(4)}),
        'eol_msgs/msg/SoundMeter': Rule(holds=lambda m: len(m.wave_min) == len(m.wave_max)),
        'eol_msgs/msg/SoundSamples': Rule(
            holds=lambda m: m.channels and not len(m.samples) % m.channels
        ),
    }


def strange(message: Any, values: Mapping[str, Container[int]]) -> str:
    """Return what is not among the `values` that it may have, in words; '' where all is."""
    for name, allowed in values.items():
        value = getattr(message, name)
        for number in (value,) if isinstance(value, int) else value:
            if number not in allowed:
                return f'{name} is {number}'
    return ''


def beyond(name: str, numbers: Any, nan: bool = False) -> str:
    """Return which of `numbers` is not finite or too large, in words; '' where none is."""
    found = np.asarray(numbers)
    good = np.abs(found) <= LARGEST
    if nan:
        good |= np.isnan(found)
    return '' if good.all() else f'{name} is {found[~good][0]}'


class Check:
    """Checks messages of one type, by its definition and `rules`."""

    def __init__(self, type_name: str, definition: str, table: Table):
        self._cells = table.cells
        self._rule = rule = rules(table).get(type_name, Rule())
        fields = parse(definition, type_name)[short(type_name)].fields
        floats = [f for f in fields if f.type in ('float32', 'float64')]
        self._numbers = [f.name for f in floats if f.length is None]
        self._arrays = [(f.name, f.name in rule.nan) for f in floats if f.length is not None]
        self._times = [f.name for f in fields if f.type in TIMES and f.length is None]
        self._headed = any(f.type == 'std_msgs/Header' for f in fields)

    def __call__(self, message: Any, span: tuple[int, int] = ANY_TIME) -> str:
        """Return what is wrong with a message, in words; '' where nothing is.

        span: of its stamp, in ns; its onset may be earlier.
        """
        for name in self._numbers:
            value = getattr(message, name)
            if not -LARGEST <= value <= LARGEST:
                return f'{name} is {value}'
        if wrong := strange(message, self._rule.values):
            return wrong
        if self._headed and (wrong := off('stamp', ns(message.header.stamp), span)):
            return wrong
        for name in self._times:
            late_ns = span[1] if name == 'onset' else ANY_TIME[1]
            if wrong := off(name, ns(getattr(message, name)), (0, late_ns)):
                return wrong
        for name in self._rule.by_place:
            if (found := len(getattr(message, name))) != self._cells:
                return f'{name} has {found} items, the table {self._cells} places'
        for name, nan in self._arrays:
            if wrong := beyond(name, getattr(message, name), nan):
                return wrong
        return '' if self._rule.holds(message) else 'its arrays do not belong together'


def ns(stamp: Any) -> int:
    """Return a stamp message in nanoseconds; -1 where it is none."""
    return stamp.sec * NS + stamp.nanosec if stamp.nanosec < NS else -1


def off(name: str, time_ns: int, span: tuple[int, int]) -> str:
    """Return how far a time lies beyond its span, in words; '' where it lies within."""
    early_ns, late_ns = span
    if early_ns <= time_ns <= late_ns and time_ns >= 0:
        return ''
    if span == ANY_TIME or time_ns < 0:
        return f'{name} is no time'
    away_s = (time_ns - late_ns if time_ns > late_ns else early_ns - time_ns) / NS
    side = 'after' if time_ns > late_ns else 'before'
    return f'{name} is {away_s:.0f} s {side} what is accepted'
