# SPDX-License-Identifier: Apache-2.0
"""Small bags of standard messages, packed by hand, for the tests."""

import struct
from pathlib import Path

from eol_ros.devices.bag.mcap_file import BagTopic
from eol_ros.devices.bag.writer import BagWriter

HASH = 'RIHS01_6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881'
TEXT_HASH = 'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18'
QOS = """\
- history: keep_last
  depth: 60
  reliability: reliable
  durability: volatile
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
POINT = BagTopic(
    '/eol/point', 'geometry_msgs/msg/Point', 'float64 x\nfloat64 y\nfloat64 z\n', HASH, QOS
)
TEXT = BagTopic('/eol/text', 'std_msgs/msg/String', 'string data\n', TEXT_HASH, QOS)
T0 = 1_700_000_000_000_000_000


def point(x: float, y: float = 0.0, z: float = 0.0) -> bytes:
    return b'\0\1\0\0' + struct.pack('<3d', x, y, z)


def text(words: str) -> bytes:
    data = words.encode() + b'\0'
    return b'\0\1\0\0' + struct.pack('<I', len(data)) + data


def write_bag(folder: Path, count: int = 100, about=None, **options) -> BagWriter:
    """Return an open bag of `count` points, 10 ms apart, and a text with each tenth."""
    about = {'scene': 'scene: test', 'seeds': '{twin: 7}', **(about or {})}
    bag = BagWriter(folder, [POINT, TEXT], about, **options)
    for i in range(count):
        now = T0 + i * 10_000_000
        bag.write('/eol/point', point(i, -i), now, now - 500, i + 1)
        if i % 10 == 0:
            bag.write('/eol/text', text(f'word {i}'), now + 1, T0, i // 10 + 1)
    return bag


def rows_of(batch) -> list[tuple[int, int, bytes]]:
    """Return reception, sending and data of each message of a batch."""
    return list(zip(batch.log_ns.tolist(), batch.publish_ns.tolist(), batch.data, strict=True))


def bag_of(folder: Path, messages: list, **about: str):
    """Return a bag of messages of the graph: topic, message, seconds since T0."""
    from rclpy.serialization import serialize_message

    from eol_ros.analysis.bag import open_bag
    from eol_ros.ros.definitions import describe

    names = dict.fromkeys(topic for topic, _, _ in messages)
    bag = BagWriter(folder, [BagTopic(f'/eol/{t}', **describe(t)) for t in names], about)
    for topic, message, at_s in sorted(messages, key=lambda m: m[2]):
        at_ns = T0 + round(at_s * 1e9)
        bag.write(f'/eol/{topic}', bytes(serialize_message(message)), at_ns, at_ns)
    bag.close()
    return open_bag(folder)
