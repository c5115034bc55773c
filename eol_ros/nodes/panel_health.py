# SPDX-License-Identifier: Apache-2.0
"""What the nodes say of themselves: taken as bytes, and read only when somebody asks."""

import threading
import time
from collections import deque
from typing import Any

from eol_ros.said import Said
from eol_ros.scene import machine_node
from eol_ros.streams.graph import NODES
from eol_ros.streams.work_state import States
from eol_ros.web import notices

UNREAD = 64  # kept between looks, once a second while nobody looks: five seconds of twelve nodes


class Health:
    """The newest state of each node, which the panel tells as soon as it is read."""

    def __init__(self, panel: Any):
        self._known = {*NODES, *map(machine_node, panel.scene.machines)}
        self._panel, self._intake = panel, panel.intake('node_states', self._notice)
        self._unread: deque[tuple[float, float, bytes]] = deque(maxlen=UNREAD)
        self._roster = notices.Roster()
        self._states = States(panel.scene.nodes, time.monotonic())
        self._reading = threading.Lock()

    def take(self, raw: bytes) -> None:
        """Keep a NodeState in CDR."""
        self._unread.append((time.monotonic(), time.time(), raw))
        if self._panel.server.hub.viewers:
            self._read_up()
            self._panel.tell_work()

    def _read_up(self) -> notices.Roster:
        with self._reading:
            while self._unread:
                heard_s, wall_s, raw = self._unread.popleft()
                self._heard_s = heard_s, wall_s
                if notice := self._intake(raw):
                    self._panel.tell(f'health {notice["node"]}', notice)
        return self._roster

    def _notice(self, state: Any) -> dict[str, Any] | None:
        if state.node not in self._known:
            return None
        self._states.take(state, self._heard_s[0])
        return self._roster.take(state, *self._heard_s)

    def work(self) -> Said:
        """Return the state of the whole work."""
        self._read_up()
        return self._states.work(time.monotonic())

    def runs(self, node: str) -> bool:
        """Return whether a node gives signs of life; any thread."""
        return self._read_up().runs(node, time.monotonic())

    def nodes(self) -> dict[str, dict[str, Any]]:
        """Return the newest state of each node by name, with its age; any thread."""
        return self._read_up().states(time.monotonic())
