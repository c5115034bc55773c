# SPDX-License-Identifier: Apache-2.0
"""Messages as text, as `ros2 topic echo` and `ros2 topic hz` print them; what is on the graph."""

import contextlib
import itertools
import json
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Collection
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


class Rate:
    """Rate of arrival over the last `window` messages, in the words of `ros2 topic hz`."""

    def __init__(self, window: int = 10_000):
        self._at: deque[float] = deque(maxlen=window)

    def tick(self, now_s: float) -> None:
        """Count a message."""
        self._at.append(now_s)

    def numbers(self) -> dict[str, float] | None:
        """Return rate_hz, min_s, max_s, std_s and window, or None for fewer than two messages."""
        if len(self._at) < 2:
            return None
        times = list(self._at)
        gaps = [b - a for a, b in itertools.pairwise(times)]
        mean = statistics.fmean(gaps)
        return {
            'rate_hz': 1.0 / mean if mean else math.inf,
            'min_s': min(gaps),
            'max_s': max(gaps),
            'std_s': statistics.pstdev(gaps),
            'window': len(times),
        }

    def text(self) -> str:
        """Return the numbers as `ros2 topic hz` prints them."""
        n = self.numbers()
        if n is None:
            return 'no new messages'
        return (
            f'average rate: {n["rate_hz"]:.3f}\n\tmin: {n["min_s"]:.3f}s max: {n["max_s"]:.3f}s '
            f'std dev: {n["std_s"]:.5f}s window: {n["window"]}'
        )


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
    """Says that nothing publishes any of `topics`, full names: once, each time that this lasts."""

    def __init__(
        self, node: Node, topics: Collection[str], clock: Callable[[], float] = time.monotonic
    ):
        self._node, self._topics, self._clock = node, topics, clock
        self._since_s = self._looked_s = clock()
        self._told = False

    def look(self) -> str:
        """Return a line to tell people, mostly empty; call it about once a second or more often."""
        now_s = self._clock()
        if now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            if any(self._node.count_publishers(topic) for topic in self._topics):
                self._since_s, self._told = now_s, False
        if self._told or now_s - self._since_s <= DISCOVERY_S:
            return ''
        self._told = True
        what = next(iter(self._topics)) if len(self._topics) == 1 else 'its topics'
        domain = self._node.context.get_domain_id()
        return f'nothing publishes {what} in domain {domain} now; waiting (Ctrl-C ends it)'


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
