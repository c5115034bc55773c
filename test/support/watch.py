# SPDX-License-Identifier: Apache-2.0
"""Look at a running graph from outside: which stamps came when, on which topic."""

import os
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from eol_ros.core.played_clock import PlayedClock
from eol_ros.ros import network
from eol_ros.ros.session import NO_LOG_FILES
from eol_ros.ros.stamps import to_ns
from eol_ros.streams.cdr import stamp_ns
from eol_ros.streams.graph import NAMESPACE, TOPICS

DEPTH = 600  # small messages of ten seconds: it has a low priority


class Watch:
    """Keeps (stamp, arrival) in nanoseconds of every message of `topics` on `domain`.

    It arrives when DDS has received it, however late this process comes to look at it; `sent` keeps
    when its publisher sent it, ns of the system clock.

    Behind a `replay` a stamp is given as the system time at which its moment was played. It runs in
    a thread with a DDS context of its own, so that one program can watch several graphs one after
    the other.
    """

    def __init__(
        self,
        topics: Iterable[str],
        domain: int,
        keep: Iterable[str] = (),
        replay: bool = False,
    ):
        network.configure('local')
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.node import Node
        from rosgraph_msgs.msg import Clock

        from eol_ros.ros.topics import CLOCK, CLOCK_QOS, QOS, informed, message_class, with_depth

        self.seen: dict[str, list[tuple[int, int]]] = defaultdict(list)
        self.sent: dict[str, list[int]] = defaultdict(list)
        self.raw: dict[str, list[bytes]] = defaultdict(list)
        self._context = rclpy.Context()
        rclpy.init(args=list(NO_LOG_FILES), context=self._context, domain_id=domain)
        self._node = Node(f'watch_{os.getpid()}', namespace=NAMESPACE, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        kept = set(keep)
        for topic in topics:
            row = TOPICS[topic]
            self._node.create_subscription(
                message_class(row.type_name),
                topic,
                informed(self._callback(topic, topic in kept)),
                with_depth(QOS[row.qos], DEPTH if row.qos == 'stream' else None),
                raw=True,
            )
        self.played = PlayedClock() if replay else None
        self._moments: dict[int, int] = {}  # system time at which a stamp was played, kept as heard
        if replay:
            self._node.create_subscription(Clock, CLOCK, self._hear, CLOCK_QOS)
        self._going = True
        self._thread = threading.Thread(target=self._spin, name='watch', daemon=True)
        self._thread.start()

    def _callback(self, topic: str, keep: bool) -> Callable[[bytes, int, int, int], None]:
        seen, sent, raws = self.seen[topic], self.sent[topic], self.raw[topic]

        def take(raw: bytes, received_ns: int, sent_ns: int, _sequence: int) -> None:
            stamp = stamp_ns(raw)
            if self.played is not None and stamp:
                stamp = self._moments.setdefault(stamp, self.played.wall_ns(stamp) or received_ns)
            seen.append((stamp, received_ns))
            sent.append(sent_ns)
            if keep:
                raws.append(raw)

        return take

    def _hear(self, message: Any) -> None:
        went_back = self.played and self.played.take(to_ns(message.clock), time.time_ns())
        if went_back:
            self._moments.clear()

    def _spin(self) -> None:
        # A viewer has a low priority: it must not take a core from what it shows.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 5)
        while self._going:
            self._executor.spin_once(timeout_sec=0.1)

    def messages(self, topic: str) -> list[Any]:
        """Return the messages of a topic named in `keep`."""
        from rclpy.serialization import deserialize_message

        from eol_ros.ros.topics import topic_class

        kind = topic_class(topic)
        return [deserialize_message(raw, kind) for raw in self.raw[topic]]

    def entities(self) -> dict[str, int]:
        """Return how many DDS writers and readers each node has; a service or a client is two.

        Without this one, and without those whose name DDS has not learned.
        """
        from eol_ros.ros.topics import UNKNOWN_NODE

        me, found = self._node, {}
        for name, namespace in me.get_node_names_and_namespaces():
            if name in (me.get_name(), UNKNOWN_NODE):
                continue
            asked = (
                (1, me.get_publisher_names_and_types_by_node),
                (1, me.get_subscriber_names_and_types_by_node),
                (2, me.get_service_names_and_types_by_node),
                (2, me.get_client_names_and_types_by_node),
            )
            found[name] = sum(
                each * len(types) for each, ask in asked for _, types in ask(name, namespace)
            )
        return found

    def close(self) -> None:
        """Leave the graph."""
        self._going = False
        self._thread.join()
        self._executor.shutdown(timeout_sec=1.0)
        self._node.destroy_node()
        self._context.try_shutdown()
