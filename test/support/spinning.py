# SPDX-License-Identifier: Apache-2.0
"""A node in a thread of its own context, for what visits the graph from this one."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

Made = TypeVar('Made', bound=Node)


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
