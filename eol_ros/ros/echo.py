# SPDX-License-Identifier: Apache-2.0
"""Messages as text, as `ros2 topic echo` prints them; what is on the graph."""

import contextlib
import json
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from eol_ros.errors import DeviceMissing, nearest
from eol_ros.ros.topics import QOS, message_class
from eol_ros.streams.graph import OF_ROS, topic_of

DISCOVERY_S = 5.0  # a busy machine needs so long until a publisher is found
LOOK_S = 1.0
TRUNCATE = 128  # items of an array and letters of a text, as ros2 topic echo does


# mypy takes no base class that is looked up
class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """YAML of plain data, in C where PyYAML has it."""


def plain(value: Any, truncate: int | None = None) -> Any:
    """Return a message, or a value of one, as dictionaries, lists, numbers and texts.

    With `truncate`, longer arrays and texts end in '...' after so many items.
    """
    if hasattr(value, 'get_fields_and_field_types'):
        names = value.get_fields_and_field_types()
        return {name: plain(getattr(value, name), truncate) for name in names}
    if isinstance(value, bytes):
        value = ''.join(chr(byte) for byte in value)
    if isinstance(value, str):
        return value if truncate is None or len(value) <= truncate else value[:truncate] + '...'
    if isinstance(value, (np.generic,)):
        return value.item()
    if isinstance(value, (list, tuple, np.ndarray)) or hasattr(value, 'typecode'):
        count = len(value)
        items = [plain(item, truncate) for item in value[:truncate]]
        return items if truncate is None or count <= truncate else [*items, '...']
    return value


def to_yaml(message: Any, full: bool = False) -> str:
    """Return the YAML of a message as `ros2 topic echo` prints it, without the `---` behind it."""
    text: str = yaml.dump(
        plain(message, None if full else TRUNCATE),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=2**31 - 1,
        default_flow_style=False,
    )
    return text


def to_json(message: Any) -> str:
    """Return the whole message as one line of JSON; what is not a number becomes null."""
    return json.dumps(_finite(plain(message)), ensure_ascii=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def type_of(node: Node, topic: str) -> str:
    """Return the type of the full name `topic`, from the graph, else from the table of topics.

    Raises DeviceMissing when neither knows it.
    """
    ours = topic_of(topic, node.get_namespace()[1:])
    end = time.monotonic() + (0.0 if ours else DISCOVERY_S)
    while True:
        types = dict(node.get_topic_names_and_types()).get(topic)
        if types:
            return types[0]
        if time.monotonic() >= end:
            break
        time.sleep(0.05)
    if ours:
        return ours.type_name
    known = sorted({name for name, _ in node.get_topic_names_and_types()} - OF_ROS)
    there = nearest(topic, known) if known else 'No graph runs here.'
    raise DeviceMissing(f'{topic}: nothing publishes it. {there}')


def qos_for(node: Node, topic: str) -> QoSProfile:
    """Return a QoS that hears every publisher of `topic`: no stricter than any of them."""
    offers = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    ours = topic_of(topic, node.get_namespace()[1:])
    if ours:
        return QOS[ours.qos]
    reliable = offers and all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
    latched = offers and all(o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
    return QoSProfile(
        depth=60,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def listen(node: Node, topic: str, hear: Any, raw: bool = False) -> str:
    """Call `hear(message)` for each message on the full name `topic`; return its type.

    `raw` hands over the CDR bytes instead. Bytes that are no such message are left out.
    """
    name = type_of(node, topic)
    kind = message_class(name)

    def take(data: bytes) -> None:
        with contextlib.suppress(RuntimeError):  # RMWError
            hear(deserialize_message(data, kind))

    node.create_subscription(kind, topic, hear if raw else take, qos_for(node, topic), raw=True)
    return name


class Absence:
    """Says that nothing publishes `topic`, a full name: once, each time that this lasts."""

    def __init__(self, node: Node, topic: str, clock: Callable[[], float] = time.monotonic):
        self._node, self._topic, self._clock = node, topic, clock
        self._since_s = self._looked_s = clock()
        self._told = False

    def look(self) -> str:
        """Return a line to tell people, mostly empty; call it about once a second or more often."""
        now_s = self._clock()
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            if self._node.count_publishers(self._topic):
                self._since_s, self._told = now_s, False
        if self._told or now_s - self._since_s <= DISCOVERY_S:
            return ''
        self._told = True
        domain = self._node.context.get_domain_id()
        return f'nothing publishes {self._topic} in domain {domain} now; waiting (Ctrl-C ends it)'


def on_the_graph(node: Node) -> list[dict[str, Any]]:
    """Return a row per topic that somebody publishes or reads: name, type, counts, doc."""
    rows = []
    for name, types in sorted(node.get_topic_names_and_types()):
        ours = topic_of(name, node.get_namespace()[1:])
        rows.append(
            {
                'topic': name,
                'type': ', '.join(types),
                'publishers': node.count_publishers(name),
                'readers': node.count_subscribers(name),
                'doc': ours.doc if ours else '',
            }
        )
    return rows
