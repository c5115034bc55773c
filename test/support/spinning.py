# SPDX-License-Identifier: Apache-2.0
"""Nodes that a test turns itself, or in a thread of their own context, while it waits."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node

from eol_ros.ros.node import EolNode
from support.waiting import GENEROUS_S, wait_until

Made = TypeVar('Made', bound=EolNode)


def matched(*nodes: EolNode) -> bool:
    """Whether all publishers and subscriptions among `nodes` know each other, both ways.

    What is published before the reader has found the writer is lost, even in one process.
    """
    publishers = [p for node in nodes for p in node.publishers]
    subscriptions = [s for node in nodes for s in node.subscriptions]
    return all(
        p.get_subscription_count() >= sum(s.topic_name == p.topic_name for s in subscriptions)
        for p in publishers
    ) and all(
        s.get_publisher_count() >= sum(p.topic_name == s.topic_name for p in publishers)
        for s in subscriptions
    )


def states_of(node: EolNode, name: str) -> list[tuple[int, str]]:
    """Return a list to which `node` adds level and text of each report of the node `name`."""
    found: list[tuple[int, str]] = []

    def hear(array: Any) -> None:
        found.extend((s.level[0], s.message) for s in array.status if s.name == f'eol: {name}')

    node.subscribe('/diagnostics', hear)
    return found


class Nodes:
    """Nodes in one executor, which the test turns while it waits; a context that ends them.

    Whoever is not destroyed tells its latched messages to the next test.
    """

    def __init__(self, *nodes: Node, executor: type[Executor] = SingleThreadedExecutor):
        self._executor, self._nodes = executor(), []
        for node in nodes:
            self.add(node)

    def add(self, node: Any) -> Any:
        """Turn one more node; return it."""
        self._executor.add_node(node)
        self._nodes.append(node)
        return node

    def end(self, node: Node) -> None:
        """Close one of the nodes, and turn it no more."""
        self._nodes.remove(node)
        if isinstance(node, EolNode):
            node.close()
        self._executor.remove_node(node)
        node.destroy_node()

    def turn(self) -> None:
        """Let the executor do what is next, within 0.02 s."""
        self._executor.spin_once(timeout_sec=0.02)

    def run(self, seconds: float) -> None:
        """Turn for a time."""
        end_s = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end_s)

    def until(self, condition: Callable[[], Any], seconds: float = GENEROUS_S) -> Any:
        """Turn until `condition` returns something true; return that, or fail the test."""
        return wait_until(condition, seconds, turn=self.turn)

    def meet(self) -> None:
        """Turn until all know each other."""
        self.until(lambda: matched(*self._nodes))

    def close(self) -> None:
        """End all nodes, in the order in which they came."""
        for node in list(self._nodes):
            self.end(node)
        self._executor.shutdown(timeout_sec=1.0)

    def __enter__(self):
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()


@contextmanager
def spinning_in(make: Callable[[rclpy.Context], Made]) -> Iterator[Made]:
    """Run the node that `make` makes in a context, until the end of the block.

    The default context is shut down meanwhile: a visit to the graph brings one of its own.
    """
    context = rclpy.Context()
    context.init()
    node = make(context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    stopping = threading.Event()

    def spin():
        while not stopping.is_set():
            executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    rclpy.try_shutdown()
    try:
        yield node
    finally:
        stopping.set()
        thread.join()
        executor.remove_node(node)
        node.close()
        node.destroy_node()
        context.try_shutdown()
