# SPDX-License-Identifier: Apache-2.0
"""The topics of `streams.graph` as ROS wants them: message classes and QoS profiles."""

import copy
import importlib
import inspect
from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from eol_ros.streams import graph


def message_class(type_name: str) -> Any:
    """Return the class of `package/msg/Name`, imported on demand."""
    package, _, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def type_name(kind: Any) -> str:
    """Return `package/msg/Name` of a message class."""
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


def topic_class(topic: str) -> Any:
    """Return the message class of one of our topics, imported on demand."""
    return message_class(graph.TOPICS[topic].type_name)


def _profile(qos: graph.QoS, depth: int) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=(ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT),
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE),
    )


QOS: dict[str, QoSProfile] = {name: _profile(qos, qos.depth) for name, qos in graph.QOS.items()}
PUBLISHER_QOS: dict[str, QoSProfile] = {
    name: _profile(qos, qos.sent or qos.depth) for name, qos in graph.QOS.items()
}


def with_depth(qos: QoSProfile, depth: int | None) -> QoSProfile:
    """Return `qos`, but with a history of `depth` messages; None: as it is."""
    if depth is None:
        return qos
    qos = copy.copy(qos)
    qos.depth = depth
    return qos


# The name that DDS gives to the node of an end that it has not learned yet, or that is none of ROS.
UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
CLOCK, CLOCK_QOS = '/clock', QOS['clock']

_TWO = inspect.signature(lambda message, info: None)


def informed(callback: Callable[[bytes, int, int, int], None]) -> Callable[..., None]:
    """Return a callback for a raw subscription that tells `callback` the bytes, when DDS received
    and when the publisher sent them (ns of the system clock), and the publisher's number of them.

    A publisher counts from 1, one for each message. The times are as exact when the reader itself
    is late. rclpy looks at the signature; the default executor then calls with message and
    information, Jazzy's EventsExecutor with one tuple of both.
    """

    def take(*taken: Any) -> None:
        data, info = taken if len(taken) == 2 else taken[0]
        if data:  # DDS hands over nothing where the writer was killed while it gave the message
            sequence = info['publication_sequence_number']
            callback(data, info['received_timestamp'], info['source_timestamp'], sequence or 0)

    # mypy knows no such attribute of a function; inspect.signature heeds it.
    take.__signature__ = _TWO  # type: ignore[attr-defined]
    return take
