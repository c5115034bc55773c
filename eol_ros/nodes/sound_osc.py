# SPDX-License-Identifier: Apache-2.0
"""The sound node's door to other instruments: triggers and slips out, live settings in.

Out: /eol/grain block grain gain rate pan x y VALUE ..., the place of the grain on the table in m
and its descriptors; /eol/descriptors NAME ..., what these are, whenever a corpus is told, and again
before a grain every 5 s, for a listener that comes later; /eol/slip block kind x y (kind as in
Slip, metres).
/eol/state CODE TEXT, the state of the whole work: at each change and every 5 s. The panel publishes
it; in a scene without a panel it is computed here, from the states of the nodes.
In: /eol/set/NAME VALUE for any live setting of the node, such as /eol/set/gain_db -12, and
/eol/set/NODE/NAME VALUE for one of grains or sound. Lines of a list are values one by one.
In place of `eol` stands the namespace of the graph.
"""

import math
import time
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from eol_ros.devices.audio.osc import OscIn, OscOut
from eol_ros.errors import ConfigError
from eol_ros.nodes.sound_control import Instrument
from eol_ros.said import code_and_args
from eol_ros.streams import corpus as corpora
from eol_ros.streams.graph import full_name
from eol_ros.streams.work_state import States

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

PERIOD_S = 0.02
WARN_S, WARNED = 60.0, 20  # one warning an address, of so many addresses
AGAIN_S = 5.0  # until the descriptors and the state of the work are sent again


class Osc:
    """Speaks OSC for `node` as its settings `osc_out` and `osc_in` say."""

    def __init__(self, node: 'EolNode', instrument: Instrument):
        s = node.settings
        self._node, self._instrument = node, instrument
        self._grain, self._slipped, self._set, self._names = (
            full_name(name, node.namespace) for name in ('grain', 'slip', 'set/', 'descriptors')
        )
        self._of_work = full_name('state', node.namespace)
        # From which stamp on a corpus counts, and what is told of its grains: this one, the next.
        self._corpora: deque[tuple[int, np.ndarray]] = deque(maxlen=2)
        self._described: tuple[str, ...] = ()
        self._described_s = -math.inf  # when last, monotonic
        self._out = OscOut(s.osc_out) if s.osc_out else None
        self._state: tuple[str, str] | None = None  # code and text, of the whole work
        self._warned: dict[str, float] = {}  # addresses, and when
        self._refused = 0
        self.input = OscIn(s.osc_in) if s.osc_in else None
        if self._out:
            node.subscribe('slips', self._slip)
            if 'panel' in node.scene.nodes:
                node.subscribe('work_state', self._work)
            else:
                self._states = States(node.scene.nodes, time.monotonic())
                node.subscribe('node_states', self._node_state)
            node.create_timer(AGAIN_S, self._tell_work)
        if self.input:
            node.create_timer(PERIOD_S, self._settings)

    def corpus(self, message, from_ns: int) -> None:
        """Take the grains that triggers from a stamp on name."""
        if self._out is None:
            return
        told = corpora.values(message)
        if len(told) == len(message.descriptors):
            self._corpora.append(
                (from_ns, np.stack([*corpora.places(message).T, *told.values()], axis=1))
            )
            self._described = tuple(told)
            self._describe()

    def _describe(self) -> None:
        assert self._out is not None
        self._out.send(self._names, *self._described)
        self._described_s = time.monotonic()

    def trigger(self, message, stamp_ns: int) -> None:
        """Send one grain trigger."""
        if self._out is None:
            return
        known: list[float] = []
        for from_ns, rows in self._corpora:
            if stamp_ns >= from_ns and message.grain < len(rows):
                known = rows[message.grain].tolist()
        if self._described and time.monotonic() > self._described_s + AGAIN_S:
            self._describe()
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

    def _work(self, message) -> None:
        self._state = message.code, message.text
        self._tell_work()

    def _node_state(self, message) -> None:
        self._states.take(message, time.monotonic())
        state = self._states.work(time.monotonic())
        told = code_and_args(state)[0], str(state)
        if told != self._state:
            self._state = told
            self._tell_work()

    def _tell_work(self) -> None:
        assert self._out is not None  # it subscribes only then
        if self._state:
            self._out.send(self._of_work, *self._state)

    def _settings(self) -> None:
        assert self.input is not None  # there is a timer only then
        for address, *values in self.input.take():
            node, _, name = address.removeprefix(self._set).rpartition('/')
            try:
                if not address.startswith(self._set):
                    raise ConfigError('there is no such live setting')
                self._instrument.change(node or self._node.NAME, name, values)
            except ConfigError as error:
                why = str(error).removeprefix(f'{name}: ')  # which the address ends with
                self._warn(address[:200], why)
        self._node.health.values['osc_refused'] = self._refused + self.input.bad

    def _warn(self, address: str, why: str) -> None:
        """Warn of what is refused, once an address and a minute; count it in the status."""
        self._refused += 1
        now_s = time.monotonic()
        self._warned = {a: s for a, s in self._warned.items() if now_s - s < WARN_S}
        if address not in self._warned and len(self._warned) < WARNED:
            self._warned[address] = now_s
            self._node.get_logger().warning(f'OSC {address}: {why}')
