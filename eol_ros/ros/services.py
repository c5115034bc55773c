# SPDX-License-Identifier: Apache-2.0
"""Services of std_srvs for what people ask of the graph; `streams.requests` says which.

One node of a scene serves them all. A call is published as the request that it stands for, so a bag
has it and a replay asks it again. The call returns when the nodes have answered. That node also
answers requests that no other node would.
"""

import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from eol_msgs.msg import Request
from rclpy.service import Service
from rclpy.timer import Timer
from std_srvs.srv import SetBool, Trigger

from eol_ros.errors import EolError
from eol_ros.ros.requests import Answers, RequestClient, RequestServer, expected_of
from eol_ros.scene import machine_node
from eol_ros.streams.graph import NODES
from eol_ros.streams.requests import KINDS, Asked, Kind, no_request

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

AGAIN_S, GIVE_UP_S = 0.2, 4.0  # until a response is sent again, and is given up


class RequestServices:
    """The services of the scene of `node`, for the kinds that a node of the scene handles."""

    def __init__(self, node: 'EolNode', requests: RequestServer):
        self._node, self._there = node, {*node.scene.nodes, *node.scene.elsewhere}
        # A node that was started alone speaks for itself: others of its kind may run beside it.
        self._to = node.NAME if len(self._there) == 1 else ''
        self._client = RequestClient(node, requests.publisher)
        requests.on_results(self._client.heard)
        for kind in KINDS.values():
            if (kind.off or kind.triggered) and self._handled(kind):
                self._serve(kind)

    def unanswered(self, message: Request) -> str:
        """Return why nobody else answers a request; '' where a node does."""
        kind = KINDS.get(message.kind)
        if message.node in self._there and 'requests' in NODES[message.node].subscribes:
            return ''
        if kind is None:
            return no_request(message.kind)
        if kind.internal or self._to:  # others that were started alone may answer
            return ''
        try:
            expected_of(message.kind, message.node, self._there.__contains__)
        except EolError as error:
            return str(error)
        return ''

    def _handled(self, kind: Kind) -> bool:
        needed = (kind.answered_by,) if kind.answered_by else ()
        return bool(self._there & set(kind.nodes)) and self._there.issuperset(needed)

    def _serve(self, kind: Kind) -> None:
        def reply(request: Any, response: Any) -> _Reply:
            on = request.data if kind.off else True
            return _Reply(self, kind.name if on else kind.off, response)

        type_ = SetBool if kind.off else Trigger
        _send_later(self._node, self._node.create_service(type_, kind.name, reply))

    def ask(self, kind: str, reply: Callable[[bool, str], None]) -> None:
        """Publish a request of `kind`; `reply` gets success and text when it is answered."""
        asked = Asked(kind, self._to, source='service')
        try:
            expected = expected_of(kind, self._to, self._there.__contains__)
        except EolError as error:
            reply(False, str(error))
            return
        if expected == {'machine'}:
            expected = {machine_node(name) for name in self._node.scene.machines}
        timers: list[Timer] = []

        def done(answers: Answers) -> None:
            for timer in timers:
                self._node.destroy_timer(timer)
            timers.clear()
            if not answers.whole:
                self._client.give_up(answers)
            text = answers.refusal or (answers.text if answers.whole else answers.silent)
            reply(answers.whole and not answers.refusal, text)

        answers = self._client.ask(asked, expected, done)
        timers.append(self._node.create_timer(KINDS[kind].within_s, lambda: done(answers)))


class _Reply:
    """The response to a call of a service, which is sent when it is known."""

    def __init__(self, services: RequestServices, kind: str, response: Any):
        self._services, self._kind, self._response = services, kind, response

    def send_by(self, send: Callable[[Any], None]) -> None:
        def reply(success: bool, text: str) -> None:
            self._response.success, self._response.message = success, text
            send(self._response)

        self._services.ask(self._kind, reply)


def _send_later(node: 'EolNode', service: Service) -> None:
    """Let callbacks of a service return a `_Reply`; send again what the client cannot read yet.

    rclpy's EventsExecutor sends what a callback returns, and awaits no coroutine (7.1.6). rmw gives
    up a response, with a warning, where the client's reader is not discovered within 0.1 s: over a
    cable that loses 8 % of the packets that was one of five first calls.
    """
    send = service.send_response

    def send_until_read(response: Any, header: Any) -> None:
        until_s = time.monotonic() + GIVE_UP_S
        timers: list[Timer] = []

        def attempt() -> None:
            with warnings.catch_warnings(record=True) as unread:
                warnings.simplefilter('always', RuntimeWarning)  # rclpy's: no reader yet
                send(response, header)
            if unread and time.monotonic() < until_s:
                if not timers:
                    timers.append(node.create_timer(AGAIN_S, attempt))
                return
            for timer in timers:
                node.destroy_timer(timer)
            for warning in unread:
                node.get_logger().warning(f'{service.service_name}: {warning.message}')

        attempt()

    def send_response(reply: _Reply, header: Any) -> None:
        reply.send_by(lambda response: send_until_read(response, header))

    # mypy knows a method by its class
    service.send_response = send_response  # type: ignore[method-assign,assignment]
