# SPDX-License-Identifier: Apache-2.0
"""The way from the panel's web server into the graph; called from the server's own thread."""

from collections.abc import Callable
from typing import Any

from eol_msgs.msg import Control, GrainTrigger, RimCommand
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from eol_ros.ros.stamps import to_msg
from eol_ros.web.controls import CONTROLS

NO_BLOCK = 255


class PanelBridge:
    """Implements `eol_ros.web.server.Bridge` with the publishers and clients of one node."""

    def __init__(self, node: Any):
        self._node = node
        self._controls = node.publisher('control')
        self._rims = node.publisher('rim_command')
        self._triggers = node.publisher('grain_triggers')
        self._clients = {
            target: node.create_client(SetParameters, f'{target}/set_parameters')
            for target in {c.target for c in CONTROLS.values() if c.settings}
        }

    def runs(self, node: str) -> bool:
        """Return whether a node gives signs of life."""
        return self._node.states.runs(node)

    def control(self, command: str, target: str, key: str, value: str, source: str) -> None:
        """Publish a request of a person."""
        message = Control(source=source, command=command, target=target, key=key, value=value)
        message.header.stamp = to_msg(self._node.now_ns())
        self._controls.publish(message)

    def change(self, node: str, values: dict[str, Any], done: Callable[[str], None]) -> None:
        """Set live settings of a node; `done` gets an empty text, or why not."""
        client = self._clients[node]
        if not client.service_is_ready():
            return done(f'{node} does not run')
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        future = client.call_async(SetParameters.Request(parameters=parameters))
        future.add_done_callback(
            lambda f: done(
                '; '.join(r.reason or 'refused' for r in f.result().results if not r.successful)
            )
        )

    def rim(self, source: str, velocity: tuple[float, float, float], hold_s: float) -> None:
        """Publish a hand on the rim."""
        vx, vy, yaw_rate = velocity
        message = RimCommand(source=source, vx=vx, vy=vy, yaw_rate=yaw_rate, hold=hold_s)
        message.header.stamp = to_msg(self._node.now_ns())
        self._rims.publish(message)

    def play(self, grain: int) -> None:
        """Publish one trigger that no block caused."""
        message = GrainTrigger(
            sequence=0,  # not known: it is outside the count of the node grains
            grain=grain,
            block=NO_BLOCK,
            gain=1.0,
            rate=1.0,
            attack=0.005,
            release=0.02,
        )
        message.header.stamp = to_msg(self._node.now_ns())
        self._triggers.publish(message)
