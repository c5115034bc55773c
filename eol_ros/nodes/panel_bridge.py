# SPDX-License-Identifier: Apache-2.0
"""The way from the panel's web server into the graph; called from the server's own thread."""

from collections.abc import Callable
from typing import Any

from eol_msgs.msg import RimCommand

from eol_ros.ros.requests import Answers, RequestClient, expected_of
from eol_ros.ros.stamps import to_msg
from eol_ros.streams.requests import Asked


class PanelBridge:
    """Implements `eol_ros.web.server.Bridge` with the publishers of one node."""

    def __init__(self, node: Any):
        self._node = node
        self._client = RequestClient(node, node.requests.publisher)
        self._rims = node.publisher('rim_command')
        node.requests.on_results(self._client.heard)

    def ask(self, asked: Asked, done: Callable[[Answers], None]) -> Answers:
        """Publish a request; `done` is called when all who must have answered it.

        Raises EolError where nobody is there to answer.
        """
        return self._client.ask(asked, expected_of(asked.kind, asked.node, self._runs), done)

    def give_up(self, answers: Answers) -> None:
        """Wait no longer for answers."""
        self._client.give_up(answers)

    def rim(self, source: str, velocity: tuple[float, float, float], hold_s: float) -> None:
        """Publish a hand on the rim."""
        vx, vy, yaw_rate = velocity
        message = RimCommand(source=source, vx=vx, vy=vy, yaw_rate=yaw_rate, hold=hold_s)
        message.header.stamp = to_msg(self._node.now_ns())
        self._rims.publish(message)

    def _runs(self, node: str) -> bool:
        """Return whether a node gives signs of life."""
        return node == self._node.NAME or self._node.states.runs(node)
