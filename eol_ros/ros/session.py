# SPDX-License-Identifier: Apache-2.0
"""A visit to the running graph from the command line: one node, until Ctrl-C, SIGTERM or done."""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from eol_ros.errors import UsageError
from eol_ros.ros import network
from eol_ros.streams.graph import NAMESPACE

# ROS would keep a file of each start of each node in ~/.ros/log for ever, and ends a process where
# it cannot. What nodes say goes to stderr and /rosout all the same, and bringup keeps it, bounded.
NO_LOG_FILES = ('--ros-args', '--disable-external-lib-logs')


# Fast DDS 2.14 can hang in `DomainParticipant::set_listener` when a participant is removed while
# another one leaves. The main thread then spins inside C++, and no
# Python signal handler runs; the kernel still ends the process (SIGALRM).
LEAVE_S = 4


class Session:
    """`node` is on the graph; `run` lets it work."""

    def __init__(self, node: Any, executor: Any):
        self.node = node
        self.stopped = False
        self._executor = executor
        executor.add_node(node)

    def run(self, until: Callable[[], bool], seconds: float | None = None) -> bool:
        """Spin until `until()` holds, the time is over, or a signal comes; return whether it held.

        `until` is called between two callbacks, so it may print and raise, which they may not.
        """
        end = None if seconds is None else time.monotonic() + seconds
        while not until():
            if self.stopped or (end is not None and time.monotonic() >= end):
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def stop(self, *_signal: Any) -> None:
        """End `run`."""
        self.stopped = True


@contextmanager
def ros(args: Sequence[str] = ()) -> Iterator[tuple[Any, list[Any]]]:
    """Start rclpy; yield an executor, and a list of nodes to close at the end.

    Raises UsageError for `args` that ROS does not know.
    """
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=[*args, *NO_LOG_FILES], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        said = str(error).removeprefix('failed to initialize rcl: ').split(', at /')[0]
        if type(error).__name__ == 'UnknownROSArgsError':  # rclpy does not export it
            said = f'ROS knows no {said}'
        elif not said.startswith("Couldn't parse"):
            raise
        raise UsageError(f'--ros-args: {said}') from None
    executor = EventsExecutor()  # half the cost of the default one
    nodes: list[Any] = []
    try:
        yield executor, nodes
    finally:
        for node in reversed(nodes):
            if hasattr(node, 'close'):
                node.close()
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(LEAVE_S)
        executor.shutdown(timeout_sec=1.0)
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        signal.alarm(0)


@contextmanager
def session(
    make: Callable[[], Any] | None = None,
    reach: str = 'local',
    namespace: str = NAMESPACE,
    images: bool = False,
) -> Iterator[Session]:
    """Start rclpy with transport `reach` (local, lan), and the node that `make` makes.

    Without `make` that is a plain one in `namespace`.
    """
    network.configure(reach, images)
    with ros() as (executor, nodes):
        from rclpy.node import Node

        nodes.append(make() if make else Node(f'eol_cli_{os.getpid()}', namespace=namespace))
        visit = Session(nodes[0], executor)
        before = {n: signal.signal(n, visit.stop) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield visit
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
