# SPDX-License-Identifier: Apache-2.0
"""The sound node's door to other instruments: triggers and slips out, live settings in.

Out: /eol/grain block grain gain rate pan x y VALUE ..., the place of the grain on the table in m
and its descriptors; /eol/descriptors NAME ..., what these are, whenever a corpus is told; /eol/slip
block kind x y (kind as in Slip, metres).
In: /eol/set/NAME VALUE for any live setting of the node, such as /eol/set/gain_db -12, and
/eol/set/NODE/NAME VALUE for one of grains or sound. Lines of a list are values one by one.
In place of `eol` stands the namespace of the graph.
"""

import dataclasses
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.parameter import Parameter

from eol_ros.devices.audio.osc import OscIn, OscOut
from eol_ros.settings import live_fields
from eol_ros.streams.corpus import places
from eol_ros.streams.graph import NODES, full_name
from eol_ros.streams.requests import SET, Asked

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

PERIOD_S = 0.02
SET_BY_OSC = ('grains', 'sound')


class Osc:
    """Speaks OSC for `node` as its settings `osc_out` and `osc_in` say."""

    def __init__(self, node: 'EolNode'):
        s = node.settings
        self._node = node
        self._grain, self._slipped, self._set, self._names = (
            full_name(name, node.namespace) for name in ('grain', 'slip', 'set/', 'descriptors')
        )
        # From which stamp on a corpus counts, and what is told of its grains: this one, the next.
        self._corpora: deque[tuple[int, np.ndarray]] = deque(maxlen=2)
        self._out = OscOut(s.osc_out) if s.osc_out else None
        self.input = OscIn(s.osc_in) if s.osc_in else None
        if self._out:
            node.subscribe('slips', self._slip)
        if self.input:
            node.create_timer(PERIOD_S, self._settings)

    def corpus(self, message, from_ns: int) -> None:
        """Take the grains that triggers from a stamp on name."""
        if self._out is None:
            return
        names = list(message.descriptors)
        values = np.array(message.values, float).reshape(-1, len(names) or 1)
        at = places(message)
        if len(values) == len(at):
            self._corpora.append((from_ns, np.hstack([at, values])))
            self._out.send(self._names, *names)

    def trigger(self, message, stamp_ns: int) -> None:
        """Send one grain trigger."""
        if self._out is None:
            return
        known: list[float] = []
        for from_ns, rows in self._corpora:
            if stamp_ns >= from_ns and message.grain < len(rows):
                known = rows[message.grain].tolist()
        values = (message.gain, message.rate, message.pan, *known)
        self._out.send(self._grain, message.block, message.grain, *values)

    def close(self) -> None:
        """Give the sockets back."""
        for end in (self.input, self._out):
            if end:
                end.close()

    def _slip(self, message) -> None:
        assert self._out is not None  # it subscribes only then
        x, y = float(message.x), float(message.y)
        self._out.send(self._slipped, message.block, message.kind, x, y)

    def _settings(self) -> None:
        assert self.input is not None  # there is a timer only then
        for address, *values in self.input.take():
            log = self._node.get_logger()
            name = address.removeprefix(self._set)
            node, _, name = name.rpartition('/')
            node = node or self._node.NAME
            if not address.startswith(self._set) or node not in SET_BY_OSC:
                log.warning(f'OSC {address}: there is no such live setting')
                continue
            kind = NODES[node].settings
            if name not in live_fields(kind):
                log.warning(f'OSC {address}: there is no such live setting')
                continue
            value = _value(kind, name, values)
            if node != self._node.NAME:  # refused in its own log
                self._node.requests.ask(Asked(SET, node, {name: value}))
                continue
            result = self._node.set_parameters([Parameter(name, value=value)])[0]
            if not result.successful:
                log.warning(f'OSC {address}: {result.reason}')


def _value(kind: type, name: str, values: list[Any]) -> Any:
    """Return what was sent as the setting has it: OSC has no booleans that all can send."""
    field = next(f for f in dataclasses.fields(kind) if f.name == name)
    if isinstance(field.default, tuple):
        return values
    value = values[0] if values else None
    if field.type is float and isinstance(value, int):
        return float(value)
    if field.type is int and isinstance(value, float) and value.is_integer():
        return int(value)
    return bool(value) if field.type is bool and value in (0, 1) else value
