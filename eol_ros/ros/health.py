# SPDX-License-Identifier: Apache-2.0
"""State of a node: `node_states`, `/diagnostics` for ROS tools, and a heartbeat for bringup.

The same status goes all ways once a second: as a `NodeState`, as a `DiagnosticStatus` (REP 107),
and as one JSON line to the pipe inherited from bringup. The executor writes it, so a node whose
executor hangs falls silent, and bringup notices. The status reports a worker thread that completes
no round within seconds. Later the line says `hung`, and bringup treats it as silence.
"""

import math
import os
import platform
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from eol_msgs.msg import NodeState
from std_msgs.msg import Header

from eol_ros.core.latency import Latency
from eol_ros.core.round_watch import HUNG_S, STALLED_S, RoundWatch
from eol_ros.ros.health_pipe import HealthPipe
from eol_ros.ros.requests import parameter_messages
from eol_ros.ros.stamps import to_msg
from eol_ros.ros.startup_barrier import PATIENCE_S
from eol_ros.said import Said, clauses, code_and_args, said
from eol_ros.streams.graph import status_name
from eol_ros.streams.work_state import ERROR, OK, STARTING, WARN

if TYPE_CHECKING:
    from eol_ros.ros.node import EolNode

PERIOD_S = 1.0
STARTS = said('starting')
REJECTED_TOLD_S = 60.0  # between two lines on messages that were rejected


class Health:
    """Status of one node: a level, a sentence for people, a rate of work, and values."""

    def __init__(self, node: 'EolNode'):
        self.values: dict[str, Any] = {'rejected': 0}
        self.kept: dict[str, Any] = {}  # what the node must take up if it is started again
        self.level = STARTING
        self.text: str = STARTS
        self._name = node.get_name()
        self._node = node
        self._states = node.publisher('node_states')
        self._diagnostics = node.publisher('/diagnostics')
        self.ticks = self._reported_ticks = 0
        self._rate = 0.0
        self.rejected = 0  # messages that the node did not use, see `Intake`
        self._rejected_why, self._rejected_s, self._rejected_told_s = '', -math.inf, -math.inf
        self._expected: tuple[str, float] | None = None
        self._latencies: dict[str, Latency] = {}
        self._workers: dict[str, tuple[Callable[[], int | None], RoundWatch]] = {}
        self._last_tick_s, self._reported_s = self._now_s(), time.monotonic()
        self._pipe = HealthPipe.inherited()
        node.create_timer(PERIOD_S, self._beat)

    def tick(self, count: int = 1) -> None:
        """Count one unit of work; the rate in the status is of these."""
        self.ticks += count
        self._last_tick_s = self._now_s()

    def took(self, name: str, latency_s: float) -> None:
        """Count a latency: `values` get p50 and p99 of the last minute, NAME_p50_ms and so on.

        Behind a replay none is counted: its stamps are not of now.
        """
        if not self._node.sim_time:
            self._latencies.setdefault(name, Latency()).add(time.monotonic(), latency_s)

    def _tell_latencies(self) -> None:
        for name, latency in self._latencies.items():
            keys = f'{name}_p50_ms', f'{name}_p99_ms'
            found = latency.values(time.monotonic())
            for key, value in zip(keys, found or (None, None), strict=True):
                if value is None:
                    self.values.pop(key, None)
                else:
                    self.values[key] = value

    def expects(self, what: str, within_s: float = 2.0) -> None:
        """Warn automatically when no tick has come for `within_s`: "no images for 3 s".

        An empty `what` ends the check.
        """
        self._expected = (what, within_s) if what else None
        self._last_tick_s = self._now_s()  # the silence counts from here

    def watches(
        self,
        worker: str,
        rounds: Callable[[], int | None],
        stalled_s: float = STALLED_S,
        hung_s: float = HUNG_S,
    ) -> None:
        """Report a stalled `worker` automatically, by its count of `rounds`.

        `rounds` returns None while no work is due. After `stalled_s` the status is an error. After
        `hung_s` the heartbeat stops, and bringup restarts the process.
        """
        self._workers[worker] = rounds, RoundWatch(stalled_s, hung_s)

    def look_at_workers(self, now_s: float) -> None:
        """Record the counts of all workers at `now_s` of the steady clock."""
        for rounds, watch in self._workers.values():
            watch.look(now_s, rounds())

    @property
    def hung(self) -> bool:
        """Whether a worker has stalled so long that the process must be restarted."""
        return any(watch.hung for _, watch in self._workers.values())

    def _stalled(self) -> tuple[str, float]:
        """Return the worker that has stalled longest, and how long; ('', 0) if none."""
        found = [
            (watch.still_s, name) for name, (_, watch) in self._workers.items() if watch.stalled
        ]
        still_s, name = max(found, default=(0.0, ''))
        return name, still_s

    def _now_s(self) -> float:
        """Behind a replay silence counts in its time: one that stands still owes nothing."""
        return self._node.now_ns() * 1e-9 if self._node.sim_time else time.monotonic()

    def overdue_s(self) -> float:
        """Return for how long what the node `expects` has not come; 0 while that is not long."""
        if self._expected is None:
            return 0.0
        now_s = self._now_s()
        if not 0 < self._last_tick_s <= now_s:  # /clock has begun, or begun again
            self._last_tick_s = now_s
        silent_s = now_s - self._last_tick_s
        return silent_s if silent_s > self._expected[1] else 0.0

    def ok(self, text: str) -> None:
        """All is well: say what is being done."""
        self._set(OK, text)

    def warn(self, text: str) -> None:
        """Something is missing, and the node goes on without it."""
        self._set(WARN, text)

    def error(self, text: str) -> None:
        """The node cannot do its work; a person must act."""
        self._set(ERROR, text)

    def reject(self, topic: str, why: str) -> None:
        """Count a message that the node does not use, and log that once a minute."""
        self.rejected += 1
        self.values['rejected'] = self.rejected
        self._rejected_why, self._rejected_s = (
            f'{topic}: {" ".join(why.split())}'[:200],
            time.monotonic(),
        )
        if self._rejected_s - self._rejected_told_s >= REJECTED_TOLD_S:
            self._rejected_told_s = self._rejected_s
            self._node.get_logger().warning(self._rejections())

    def _rejections(self) -> Said:
        return said('rejected', count=self.rejected, why=self._rejected_why)

    def _set(self, level: int, text: str) -> None:
        changed = level != self.level
        self.level, self.text = level, text
        if changed:  # tell at once, do not wait for the next second
            log = self._node.get_logger()
            if level == OK:  # a call each: rclpy ties the severity to the place of the call
                log.info(text)
            elif level == WARN:
                log.warning(text)
            else:
                log.error(text)
            self.report()

    def status(self) -> dict[str, Any]:
        """Return the status as plain data."""
        now = time.monotonic()
        span = now - self._reported_s
        if span > 0.5 * PERIOD_S:  # a change of state reports in between: too short to count in
            self._rate = (self.ticks - self._reported_ticks) / span
            self._reported_ticks, self._reported_s = self.ticks, now
        level, text = self.level, self.text
        # the source may wait so long for its nodes
        patience_s = {OK: 0.0, STARTING: 2 * PATIENCE_S}.get(level, math.inf)
        if self._expected and (silent_s := self.overdue_s()) > patience_s:
            level = WARN
            text = said('nothing_of', what=self._expected[0], seconds=f'{silent_s:.0f}')
        if time.monotonic() - self._rejected_s < REJECTED_TOLD_S:
            text = clauses([text, self._rejections()])
        if differs := self._node.qos.text:
            level = OK if level == STARTING else level
            level = max(level, ERROR if self._node.qos.starved else WARN)
            text = clauses([differs, text])
        worker, still_s = self._stalled()
        if worker:
            level = ERROR
            text = said('stands_still', what=worker, seconds=f'{still_s:.0f}')
        code, args = code_and_args(text)
        return {
            'node': self._name,
            'level': level,
            'text': text,
            'code': code,
            'args': args,
            'rate': round(self._rate, 2),
            'pid': os.getpid(),
            'values': self.values.copy(),  # other threads add to them while it is sent
        }

    def _beat(self) -> None:
        self.look_at_workers(time.monotonic())
        self._node.qos.look()
        self._tell_latencies()
        self.report()

    def relay(self, status: dict[str, Any]) -> None:
        """Send bringup the status of a node of another machine."""
        if self._pipe is not None:
            self._pipe.send(status)

    @property
    def supervised(self) -> bool:
        """Whether bringup runs this node and reads its reports."""
        return self._pipe is not None

    def order(self, what: str) -> None:
        """Ask bringup to `restart` all nodes, or to `stop` the run."""
        if self._pipe is not None:
            self._pipe.send({'order': what})

    def report(self) -> None:
        """Send the status all ways."""
        status = self.status()
        if self._pipe is not None:
            own = {'node': self._node.NAME, 'kept': self.kept}  # not as it was renamed
            self._pipe.send(status | own | ({'hung': True} if self.hung else {}))
        header = Header(stamp=to_msg(self._node.now_ns()))
        typed = {name: parameter_messages(status[name]) for name in ('args', 'values')}
        self._states.publish(NodeState(header=header, **(status | typed)))
        values = {'rate_hz': status['rate'], 'pid': status['pid'], **status['values']}
        row = DiagnosticStatus(
            # Who starts is not stale (REP 107): that is what others find of one who is silent.
            level=bytes([WARN if status['level'] == STARTING else status['level']]),
            name=status_name(self._name, self._node.namespace),
            message=status['text'],
            hardware_id=platform.node(),
            values=[KeyValue(key=k, value=str(v)) for k, v in values.items()],
        )
        self._diagnostics.publish(DiagnosticArray(header=header, status=[row]))
