# SPDX-License-Identifier: Apache-2.0
"""What the nodes say of themselves: taken as bytes, and read only when somebody asks."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from eol_ros.streams.graph import node_of
from eol_ros.web import notices
from eol_ros.web.hub import Hub

UNREAD = 64  # kept while nobody looks: five seconds of twelve nodes


class Health:
    """The newest state of each node, told to `tell` by name as soon as it is read."""

    def __init__(self, hub: Hub, tell: Callable[[str, dict[str, Any]], None], namespace: str):
        self._hub, self._tell, self._namespace = hub, tell, namespace
        self._unread: deque[tuple[float, float, bytes]] = deque(maxlen=UNREAD)
        self._roster, self._reading = notices.Roster(), threading.Lock()

    def take(self, raw: bytes) -> None:
        """Keep a DiagnosticArray in CDR."""
        self._unread.append((time.monotonic(), time.time(), raw))
        if self._hub.viewers:
            self._read_up()

    def _read_up(self) -> notices.Roster:
        with self._reading:
            while self._unread:
                heard_s, wall_s, raw = self._unread.popleft()
                for status in deserialize_message(raw, DiagnosticArray).status:
                    node, namespace = node_of(status.name)
                    if node and namespace == self._namespace:
                        notice = self._roster.take(status, heard_s, wall_s)
                        self._tell(f'health {notice["node"]}', notice)
        return self._roster

    def runs(self, node: str) -> bool:
        """Return whether a node gives signs of life; any thread."""
        return self._read_up().runs(node, time.monotonic())

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the newest state of each node by name, with its age; any thread."""
        return self._read_up().states(time.monotonic())
