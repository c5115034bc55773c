# SPDX-License-Identifier: Apache-2.0
"""The sound node's door to other instruments: triggers and slips out, its live settings in.

Out: /eol/grain block grain gain rate pan; /eol/slip block kind x y (kind as in Slip, metres).
In: /eol/set/NAME VALUE for any live setting of the node, such as /eol/set/gain_db -12.
"""

from typing import TYPE_CHECKING

from rclpy.parameter import Parameter

from eol_ros.devices.audio.osc import OscIn, OscOut
from eol_ros.settings import live_fields

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

SET = '/eol/set/'
PERIOD_S = 0.02


class Osc:
    """Speaks OSC for `node` as its settings `osc_out` and `osc_in` say."""

    def __init__(self, node: 'EolNode'):
        s = node.settings
        self._node = node
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
            self._out.send('/eol/grain', message.block, message.grain, *values)

    def close(self) -> None:
        """Give the sockets back."""
        for end in (self.input, self._out):
            if end:
                end.close()

    def _slip(self, message) -> None:
        assert self._out is not None  # it subscribes only then
        self._out.send('/eol/slip', message.block, message.kind, float(message.x), float(message.y))

    def _settings(self) -> None:
        assert self.input is not None  # there is a timer only then
        for address, *values in self.input.take():
            name = address.removeprefix(SET)
            log = self._node.get_logger()
            if not address.startswith(SET) or name not in live_fields(type(self._node.settings)):
                log.warning(f'OSC {address}: there is no such live setting')
                continue
            value = values[0] if values else None
            if isinstance(getattr(self._node.settings, name), float) and isinstance(value, int):
                value = float(value)
            result = self._node.set_parameters([Parameter(name, value=value)])[0]
            if not result.successful:
                log.warning(f'OSC {address}: {result.reason}')
