# SPDX-License-Identifier: Apache-2.0
"""The sound node's door to other instruments: triggers and slips out, its live settings in.

Out: /eol/grain block grain gain rate pan; /eol/slip block kind x y (kind as in Slip, metres).
In: /eol/set/NAME VALUE for any live setting of the node, such as /eol/set/gain_db -12.
In place of `eol` stands the namespace of the graph.
"""

from typing import TYPE_CHECKING

from rclpy.parameter import Parameter

from eol_ros.devices.audio.osc import OscIn, OscOut
from eol_ros.settings import live_fields
from eol_ros.streams.graph import full_name

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

PERIOD_S = 0.02


class Osc:
    """Speaks OSC for `node` as its settings `osc_out` and `osc_in` say."""

    def __init__(self, node: 'EolNode'):
        s = node.settings
        self._node = node
        self._grain, self._slipped, self._set = (
            full_name(name, node.namespace) for name in ('grain', 'slip', 'set/')
        )
        self._out = OscOut(s.osc_out) if s.osc_out else None
        self.input = OscIn(s.osc_in) if s.osc_in else None
        if self._out:
            node.subscribe('slips', self._slip)
        if self.input:
            node.create_timer(PERIOD_S, self._settings)

    def trigger(self, message) -> None:
        """Send one grain trigger."""
        if self._out:
            values = (message.gain, message.rate, message.pan)
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
            name = address.removeprefix(self._set)
            log, live = self._node.get_logger(), live_fields(type(self._node.settings))
            if not address.startswith(self._set) or name not in live:
                log.warning(f'OSC {address}: there is no such live setting')
                continue
            value = values[0] if values else None
            if isinstance(getattr(self._node.settings, name), float) and isinstance(value, int):
                value = float(value)
            result = self._node.set_parameters([Parameter(name, value=value)])[0]
            if not result.successful:
                log.warning(f'OSC {address}: {result.reason}')
