# SPDX-License-Identifier: Apache-2.0
"""Requests on the graph: how a node takes and answers them, and how one asks and is answered."""

import itertools
import math
import os
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from eol_msgs.msg import Request, RequestResult
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.duration import Duration
from rclpy.parameter import Parameter

from eol_ros.core.stamp_watch import SOON_NS
from eol_ros.errors import DeviceMissing, EolError, UsageError
from eol_ros.ros.stamps import now_ns, to_msg, to_ns
from eol_ros.said import Said, clauses, code_and_args, from_message, said
from eol_ros.streams.graph import NAMESPACE
from eol_ros.streams.requests import KINDS, Asked, no_request, values_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode
    from eol_ros.ros.services import RequestServices

REQUESTS, RESULTS = 'requests', 'request_results'
LATER = object()  # what a handler returns that answers by itself when it knows what came of it
_MOST_WAITING = 1000  # requests of a person; a replay asks ahead what its whole bag has
_OWN = 256  # ids of one's own that are remembered
_QUIET_S = 1.5  # without another node found: all have been
_DISCOVERY_S = 10.0
_ACKED_S = 2.0
_numbers = itertools.count(1)

Handler = Callable[[Asked], Any]


def new_id(source: str) -> str:
    """Return an id that no other process gives."""
    return f'{source}-{os.getpid()}-{time.time_ns():x}-{next(_numbers)}'


def request_to_msg(asked: Asked, stamp_ns: int) -> Request:
    """Return the message of a request that is made at `stamp_ns`."""
    message = Request(
        id=asked.id,
        source=asked.source,
        node=asked.node,
        kind=asked.kind,
        values=parameter_messages(asked.values),
        data=array('B', asked.data),
        from_stamp=to_msg(asked.from_ns),
    )
    message.header.stamp = to_msg(stamp_ns)
    return message


def plain(value: Any) -> Any:
    """Return the value of a setting as a parameter has it."""
    if isinstance(value, tuple):
        return list(value)
    return value.item() if hasattr(value, 'item') else value  # of NumPy


def parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return settings, or values of a request, as parameters; an empty list is one of strings."""
    texts = Parameter.Type.STRING_ARRAY  # rclpy makes an empty list an array of bytes
    found = {name: plain(value) for name, value in values.items()}
    return [Parameter(name, texts if v == [] else None, v) for name, v in found.items()]


def parameter_messages(values: Mapping[str, Any]) -> list[ParameterMessage]:
    """Return settings, or values of a request, as a message has them."""
    return [parameter.to_parameter_msg() for parameter in parameters(values)]


def request_from_msg(message: Request) -> Asked:
    """Return what a message asks."""
    return Asked(
        message.kind,
        message.node,
        values_of(message.values),
        bytes(message.data),
        to_ns(message.from_stamp),
        message.id,
        message.source,
    )


class RequestServer:
    """Takes the requests that are meant for `node` and calls the handler of their kind.

    A handler gets the request with the stamp from which it is to count, and returns a text for
    people or None; it raises EolError to refuse, or returns LATER and calls `answer` itself. What
    counts from a stamp that has not come yet waits, where the node says `holds`, until `reached`
    tells of it.
    """

    def __init__(self, node: 'EolNode', holds: bool = True):
        self._node, self._holds = node, holds
        self._handlers: dict[str, Handler] = {}
        self._listeners: list[Callable[[RequestResult], None]] = []
        self._own: deque[str] = deque(maxlen=_OWN)
        self._waiting: list[tuple[int, Asked]] = []
        self.newest_ns = 0  # stamp of the stream that the node lives by
        self.services: RequestServices | None = None  # where this node serves the scene's
        self.publisher = node.publisher(REQUESTS)
        self._results = node.publisher(RESULTS)
        node.subscribe(REQUESTS, self.take)

    def on_results(self, callback: Callable[[RequestResult], None]) -> None:
        """Call `callback` for each message of `request_results`."""
        if not self._listeners:
            self._node.subscribe(RESULTS, self._heard)
        self._listeners.append(callback)

    def _heard(self, result: RequestResult) -> None:
        for listener in self._listeners:
            listener(result)

    def serve(self, **handlers: Handler) -> None:
        """Call `handlers` by kind of request."""
        self._handlers.update(handlers)

    def from_ns(self, asked_ns: int = 0) -> int:
        """Return the stamp from which a request of now counts; 0: from the first."""
        return max(asked_ns, self.newest_ns + SOON_NS) if self.newest_ns else asked_ns

    def reached(self, stamp_ns: int) -> None:
        """Do what counts from `stamp_ns` on, before what has this stamp is used."""
        self.newest_ns = stamp_ns
        while self._waiting and self._waiting[0][0] <= stamp_ns:
            self._do(self._waiting.pop(0)[1])

    def forget(self) -> None:
        """Drop what waits: time has jumped back."""
        self._waiting.clear()
        self.newest_ns = 0

    def take(self, message: Request) -> None:
        """Heed a message, if it is meant for this node and is not its own."""
        name = self._node.NAME
        if message.id in self._own:
            return
        if self.services is not None and (reason := self.services.unanswered(message)):
            return self.refuse(request_from_msg(message), reason)
        if message.node not in ('', name):
            return
        if message.kind not in self._handlers:
            if message.node == name:
                known = ', '.join(sorted(self._handlers))
                reason = f'{name} is asked for {known}'
                if message.kind not in KINDS:
                    reason = f'{no_request(message.kind)}; {reason}'
                self.refuse(request_from_msg(message), reason)
            return
        asked = request_from_msg(message)
        try:
            values = KINDS[asked.kind].check(asked.values)
        except UsageError as error:
            return self.refuse(asked, str(error))
        asked = replace(asked, values=values, from_ns=self.from_ns(asked.from_ns))
        if self._holds and asked.from_ns > self.newest_ns + SOON_NS:
            if len(self._waiting) >= _MOST_WAITING and not self._node.sim_time:
                return self.refuse(asked, f'{_MOST_WAITING} requests wait already')
            self._waiting.append((asked.from_ns, asked))
            self._waiting.sort(key=lambda item: item[0])
        else:
            self._do(asked)

    def _do(self, asked: Asked) -> None:
        try:
            reason = self._handlers[asked.kind](asked)
        except EolError as error:
            return self.refuse(asked, str(error))
        if reason is not LATER:
            self.answer(asked, True, reason or '')

    def refuse(self, asked: Asked, reason: str) -> None:
        """Say that a request is not done, and why."""
        self._node.get_logger().warning(f'refused {asked.words()}: {reason}')
        self.answer(asked, False, reason)

    def answer(self, asked: Asked, accepted: bool, reason: str) -> None:
        """Say what came of a request."""
        code, args = code_and_args(reason)
        result = RequestResult(
            id=asked.id,
            node=self._node.answers_as,
            kind=asked.kind,
            values=parameter_messages(asked.values),
            accepted=accepted,
            reason=reason,
            code=code,
            args=parameter_messages(args),
            from_stamp=to_msg(asked.from_ns),
        )
        result.header.stamp = to_msg(now_ns())
        self._results.publish(result)

    def ask(self, asked: Asked) -> None:
        """Ask another node."""
        id_ = asked.id or new_id(self._node.NAME)
        message = request_to_msg(replace(asked, id=id_, source=self._node.NAME), now_ns())
        self._own.append(id_)
        self.publisher.publish(message)

    def declare(
        self, kind: str, values: Mapping[str, Any], from_ns: int, data: bytes = b''
    ) -> None:
        """Say, for the bag, what this node does without having been asked on the topic."""
        asked = Asked(kind, self._node.NAME, dict(values), data, from_ns, new_id(self._node.NAME))
        self.ask(asked)
        self.answer(asked, True, '')


@dataclass
class Answers:
    """What nodes have said to one request; `whole` when all that were expected have."""

    asked: Asked
    expected: set[str]
    done: Callable[['Answers'], None] | None = None
    until_s: float = math.inf  # of the monotonic clock: how long `RequestClient.look` waits
    found: dict[str, tuple[bool, str]] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """Whether nothing more is to be waited for: all have answered, or one has refused."""
        refused = not all(accepted for accepted, _ in self.found.values())
        return refused or self.expected <= set(self.found)

    @property
    def refusal(self) -> Said:
        """Return why it was refused, with the node's name; '' where it was not."""
        refused = [(node, why) for node, (good, why) in self.found.items() if not good]
        return clauses(said('of_node', node=node, why=why) for node, why in refused)

    @property
    def text(self) -> Said:
        """Return what nodes that accepted it say came of it."""
        return clauses(why for good, why in self.found.values() if good)

    @property
    def silent(self) -> Said:
        """Return who has not answered, in words."""
        return _of('does_not_answer', 'do_not_answer', sorted(self.expected - set(self.found)))


class RequestClient:
    """Asks nodes and gathers their answers; may be used from any thread."""

    def __init__(self, node: Any, publisher: Any):
        self._node, self._publisher = node, publisher
        self._lock = threading.Lock()
        self._open: dict[str, Answers] = {}

    def ask(
        self, asked: Asked, expected: set[str], done: Callable[[Answers], None] | None = None
    ) -> Answers:
        """Publish a request; `done` is called, in the executor's thread, when all have answered."""
        asked = replace(asked, id=asked.id or new_id(asked.source or 'eol'))
        until_s = time.monotonic() + KINDS[asked.kind].within_s
        answers = Answers(asked, expected, done, until_s)
        with self._lock:
            self._open[asked.id] = answers
        self._publisher.publish(request_to_msg(asked, self._node.get_clock().now().nanoseconds))
        return answers

    @property
    def waiting(self) -> int:
        """How many requests wait for answers."""
        return len(self._open)

    def look(self) -> None:
        """Give up what nodes have not answered in time, and call `done` for it."""
        now_s = time.monotonic()
        with self._lock:
            over = [answers for answers in self._open.values() if now_s > answers.until_s]
            for answers in over:
                del self._open[answers.asked.id]
        for answers in over:
            if answers.done:
                answers.done(answers)

    def give_up(self, answers: Answers) -> None:
        """Wait no longer."""
        with self._lock:
            self._open.pop(answers.asked.id, None)

    def heard(self, result: RequestResult) -> None:
        """Take a message of `request_results`; to be called by the owner for each."""
        with self._lock:
            answers = self._open.get(result.id)
            if answers is None:
                return
            answers.found[result.node] = (
                result.accepted,
                from_message(result.reason, result.code, values_of(result.args)),
            )
            if not answers.whole:
                return
            del self._open[result.id]
        if answers.done:
            answers.done(answers)


def expected_of(kind: str, node: str, runs: Callable[[str], bool]) -> set[str]:
    """Return who must answer a request; raise DeviceMissing when whom it needs does not run."""
    row = KINDS.get(kind)
    if row is None:
        raise UsageError(no_request(kind))
    asked = row.whom(node)
    heeding = {name for name in asked if runs(name)}
    if row.answered_by and not runs(row.answered_by):
        raise DeviceMissing(said('does_not_run', names=row.answered_by))
    if not heeding:
        names = asked if node else row.nodes
        raise DeviceMissing(_of('does_not_run', 'do_not_run', names))
    return {row.answered_by} if row.answered_by else heeding


def _of(one: str, many: str, names: Sequence[str]) -> Said:
    return said(one if len(names) == 1 else many, names=', '.join(names))


class Visit:
    """On the graph from the command line: asks nodes."""

    def __init__(self, session: Any, node: str):
        from eol_ros.ros.topics import PUBLISHER_QOS, QOS

        self._session, graph = session, session.node
        self._publisher = graph.create_publisher(Request, REQUESTS, PUBLISHER_QOS['stream'])
        self._client = RequestClient(graph, self._publisher)
        graph.create_subscription(RequestResult, RESULTS, self._client.heard, QOS['stream'])
        self._found = _Heeding(graph)
        known = self._publisher.get_subscription_count
        session.run(lambda: self._found.whole(node, known()), _DISCOVERY_S)

    def ask(self, asked: Asked) -> Answers:
        """Return what nodes have answered in time; raise DeviceMissing when nobody is there to."""
        try:
            expected = expected_of(asked.kind, asked.node, self._found.runs)
        except DeviceMissing as error:
            raise DeviceMissing(f'{error} here (--secure and --lan look further)') from None
        answers = self._client.ask(asked, expected)
        self._session.run(lambda: answers.whole, KINDS[asked.kind].within_s)
        self._publisher.wait_for_all_acked(Duration(seconds=_ACKED_S))  # by a busy recorder, too
        return answers


@contextmanager
def visiting(reach: str, namespace: str = NAMESPACE, node: str = '') -> Iterator[Visit]:
    """Visit the running graph once its nodes have been discovered, `node` among them if named."""
    from eol_ros.ros.session import session

    with session(reach=reach, namespace=namespace) as visit:
        yield Visit(visit, node)


class _Heeding:
    """Which nodes take requests and answer them, as far as they have been discovered."""

    def __init__(self, node: Any):
        self._node = node
        self._asked: set[str] = set()
        self._answering: set[str] = set()
        self._met_s = 0.0

    def runs(self, name: str) -> bool:
        return name in self._asked and name in self._answering

    def whole(self, node: str, matched: int) -> bool:
        """Whether all that were found are matched, `node` and the recorder among them.

        Without a recorder, or a `node`, no other was found for a while.
        """
        full = self._node.resolve_topic_name
        asked = {e.node_name for e in self._node.get_subscriptions_info_by_topic(full(REQUESTS))}
        answering = {e.node_name for e in self._node.get_publishers_info_by_topic(full(RESULTS))}
        if (asked, answering) != (self._asked, self._answering):
            self._asked, self._answering, self._met_s = asked, answering, time.monotonic()
        quiet = time.monotonic() - self._met_s > _QUIET_S
        found = self.runs(node) if node else bool(asked)
        known = quiet or (bool(node) and 'recorder' in asked)
        return found and known and matched >= len(asked)
