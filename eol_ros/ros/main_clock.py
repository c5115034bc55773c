# SPDX-License-Identifier: Apache-2.0
"""The clock of the machine of the image source, as the node `machine` measures it from here."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from eol_msgs.msg import NodeState

from eol_ros.core.clock_offset import LIMIT_S
from eol_ros.said import said
from eol_ros.scene import machine_node
from eol_ros.streams.requests import values_of

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

KEEP_S = 30.0  # an offset outlives restarts of `machine`; two clocks drift by up to 3 ms meanwhile


class MainClock:
    """How far the clock here is ahead of that of the stamps.

    It is 0 on the main machine, behind a replay, where the offset is within its error, and when
    none has been heard for KEEP_S.
    """

    def __init__(self, node: 'EolNode', clock: Callable[[], float] = time.monotonic):
        self._clock, self._health, here = clock, node.health, node.scene.machine_of(node.NAME)
        self._ahead_ns, self._until_s = 0, clock()
        self._machine = machine_node(here)
        self.followed = here != node.scene.main and not node.sim_time
        if self.followed:
            node.on_states(self.take)

    def take(self, state: NodeState) -> None:
        """Learn the offset from the node `machine` of this machine."""
        if state.node != self._machine:
            return
        values = values_of(state.values)
        if 'offset_ms' not in values:  # it has just started, or does not hear the main machine
            return
        ahead_ms, error_ms = values['offset_ms'], values['offset_error_ms']
        self._ahead_ns = round(1e6 * ahead_ms) if abs(ahead_ms) > error_ms else 0
        self._until_s = self._clock() + KEEP_S

    @property
    def ahead_ns(self) -> int:
        """How far this machine's clock is ahead, ns."""
        return self._ahead_ns if self._clock() < self._until_s else 0

    def report(self) -> str:
        """Put the offset into the health values; return a clause if it is above LIMIT_S."""
        if not self.followed:
            return ''
        ahead_ms = self.ahead_ns * 1e-6
        self._health.values['clock_ahead_ms'] = ahead_ms
        if abs(ahead_ms) <= LIMIT_S * 1e3:
            return ''
        return said('clock_subtracted', offset=f'{ahead_ms:.1f}')
