# SPDX-License-Identifier: Apache-2.0
"""Between DDS and a node: decodes each message, checks it by the table, counts what it rejects."""

import statistics
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message

from eol_ros.errors import EolError
from eol_ros.ros.definitions import definition
from eol_ros.ros.topics import message_class
from eol_ros.streams import blocks, images
from eol_ros.streams.cdr import Flat
from eol_ros.streams.checks import ANY_TIME, Check, off
from eol_ros.streams.graph import topic_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

COSTS = 20  # images whose conversion is timed
FAULTS = EolError, ValueError, TypeError, LookupError, RuntimeError, MemoryError  # RMWError, too


class ConversionCost:
    """Logs the median time to convert an image to grey, once."""

    def __init__(self, node: 'EolNode'):
        self._node = node
        self._took_s: list[float] = []

    def add(self, encoding: str, took_s: float) -> None:
        """Add the time of one conversion; log the median after COSTS of them."""
        if len(self._took_s) < COSTS:
            self._took_s.append(took_s)
            if len(self._took_s) == COSTS:
                cost_ms = 1e3 * statistics.median(self._took_s)
                self._node.get_logger().info(
                    f'images are {encoding}: converted to mono8, {cost_ms:.1f} ms each'
                )


class InTurn:
    """Calls `callback` with one message at a time, after everything else that has arrived by then.

    EventsExecutor takes one message for each arrival, in the order of arrival on all topics. A
    history that drops messages leaves their arrivals in that queue. So behind a slow callback the
    other topics of the process wait ever longer: motion, beside an overloaded tracker, by seconds
    more each minute. Here each message is taken at once. `depth` of them wait, and newer ones
    replace the oldest.
    """

    def __init__(self, node: 'EolNode', depth: int, callback: Callable[[bytes], None]):
        self._node, self._callback = node, callback
        self._waiting: deque[bytes] = deque(maxlen=depth)

    def take(self, raw: bytes) -> None:
        """Let a message wait for its turn."""
        if not self._waiting:
            self._come_back()
        self._waiting.append(raw)

    def finish(self) -> None:
        """Handle everything that waits, now."""
        while self._waiting:
            self._callback(self._waiting.popleft())

    def _come_back(self) -> None:
        assert self._node.executor is not None  # it calls `take`
        self._node.executor.create_task(self._handle)

    def _handle(self) -> None:
        if not self._waiting:  # finished meanwhile
            return
        raw = self._waiting.popleft()
        if self._waiting:
            self._come_back()
        self._callback(raw)


class Intake:
    """Call it with the CDR bytes of a message; it returns the message, or None for a bad one.

    Blocks and images come as their codec reads them. read: what a node makes of a message besides;
    where that raises one of FAULTS, the message is bad, too.
    """

    def __init__(
        self,
        node: 'EolNode',
        topic: str,
        type_name: str,
        read: Callable[[Any], Any] | None = None,
    ):
        self._node, self._topic, self._read = node, topic, read
        row = topic_of(topic)
        self._stamped = bool(row and row.stamped)
        self._codec: Any = None
        if type_name == blocks.TYPE:
            self._codec = blocks.Codec(definition(type_name), cells=node.table.cells)
        elif type_name == images.TYPE:
            self._codec = images.Codec(definition(type_name))
        else:
            self._kind = message_class(type_name)
            self._check = Check(type_name, definition(type_name), node.table)
            self._flat = Flat.of(type_name, definition(type_name)) if node.READS_ONLY else None
        self._cost = ConversionCost(node) if isinstance(self._codec, images.Codec) else None

    def __call__(self, raw: bytes) -> Any:
        """Return the message in `raw`; None where it is bad, which the node's health counts."""
        if not raw:  # as DDS hands it over where the writer was killed while it gave the message
            return None
        try:
            message = self._decoded(raw)
        except FAULTS as error:
            self._node.health.reject(self._topic, str(error))
            return None
        return message

    def _decoded(self, raw: bytes) -> Any:
        span = self._node.stamps_span() if self._stamped else ANY_TIME
        if self._codec is None:
            message = self._flat and self._flat.read(raw)
            if message is None:
                message = deserialize_message(raw, self._kind)
            wrong = self._check(message, span)
        else:
            began_s = time.perf_counter()
            message = self._codec.read(raw)
            if self._cost and self._codec.encoding:
                self._cost.add(self._codec.encoding, time.perf_counter() - began_s)
            wrong = off('stamp', message.stamp_ns, span)
        if wrong:
            raise ValueError(wrong)
        return self._read(message) if self._read else message
