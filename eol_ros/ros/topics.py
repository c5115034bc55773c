# SPDX-License-Identifier: Apache-2.0
"""Every topic of the graph: type, quality of service, publishers, subscribers, what it carries.

This table is the only place where QoS is chosen. Names are relative to the namespace
(`eol`), but for those that begin with a slash.
"""

import importlib
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


@dataclass(frozen=True)
class Topic:
    """One row of the table."""

    name: str
    type_name: str
    qos: str
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    doc: str

    def message_class(self) -> Any:
        """Return the message class, imported on demand."""
        return message_class(self.type_name)


def message_class(type_name: str) -> Any:
    """Return the class of `package/msg/Name`, imported on demand."""
    package, _, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def _qos(depth: int, reliable: bool = True, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


QOS: dict[str, QoSProfile] = {
    'images': _qos(20),  # 1 MB each: 20 bridge a third of a second of a busy reader
    'stream': _qos(60),  # small, one per image or per event
    'preview': _qos(10, reliable=False),
    'meter': _qos(10, reliable=False),
    'latched': _qos(10, latched=True),
    'health': _qos(10),
    'clock': _qos(1, reliable=False),  # as rclcpp and rclpy ask for it
}
# What a publisher keeps to send again. DDS threads answer in time even where the Python of the
# subscriber is busy, so the twelve last images are enough, and save 8 MB in each publisher.
PUBLISHER_QOS = QOS | {'images': _qos(12)}
CLOCK, CLOCK_QOS = '/clock', QOS['clock']

_ROWS = (
    Topic(
        'rim_command',
        'eol_msgs/msg/RimCommand',
        'stream',
        ('panel',),
        ('twin',),
        'hands on the rim of the twin',
    ),
    Topic(
        'camera/image_raw',
        'sensor_msgs/msg/Image',
        'images',
        ('camera', 'twin', 'replay'),
        ('tracker', 'recorder'),
        'the infrared picture, mono8',
    ),
    Topic(
        'camera/camera_info',
        'sensor_msgs/msg/CameraInfo',
        'latched',
        ('camera', 'twin', 'replay'),
        ('panel',),
        'the calibration of the camera',
    ),
    Topic(
        'camera/image/compressed',
        'sensor_msgs/msg/CompressedImage',
        'preview',
        ('tracker',),
        ('panel', 'recorder'),
        'JPEG for people, only while somebody subscribes',
    ),
    Topic(
        'truth',
        'eol_msgs/msg/Truth',
        'stream',
        ('twin', 'replay'),
        ('leds', 'panel'),
        'what the twin really did',
    ),
    Topic(
        'blocks',
        'eol_msgs/msg/Blocks',
        'stream',
        ('tracker', 'replay'),
        ('motion', 'grains', 'panel'),
        'the 25 blocks, once per image',
    ),
    Topic(
        'block_taps',
        'eol_msgs/msg/BlockTap',
        'stream',
        ('leds', 'replay'),
        ('motion', 'tracker'),
        "knocks felt by the blocks' own accelerometers",
    ),
    Topic(
        'slips',
        'eol_msgs/msg/Slip',
        'stream',
        ('motion', 'replay'),
        ('leds', 'montage', 'panel'),
        'a block starts to move, or stops',
    ),
    Topic(
        'cascades',
        'eol_msgs/msg/Cascade',
        'stream',
        ('motion', 'replay'),
        ('panel',),
        'slips joined in time and neighbourhood',
    ),
    Topic(
        'led_commands',
        'eol_msgs/msg/LedCommand',
        'stream',
        ('leds',),
        ('panel',),
        "what was sent to the blocks' LEDs",
    ),
    Topic(
        'corpus',
        'eol_msgs/msg/Corpus',
        'latched',
        ('grains',),
        ('sound', 'panel'),
        'all grains and their places',
    ),
    Topic(
        'grain_triggers',
        'eol_msgs/msg/GrainTrigger',
        'stream',
        ('grains', 'replay', 'panel'),
        ('sound', 'panel'),
        'play this grain',
    ),
    Topic(
        'sound_meter',
        'eol_msgs/msg/SoundMeter',
        'meter',
        ('sound',),
        ('panel',),
        'waveform, spectrum and counters of the sound',
    ),
    Topic(
        'sound_samples',
        'eol_msgs/msg/SoundSamples',
        'meter',
        ('sound',),
        ('panel',),
        "the engine's output, only while somebody subscribes",
    ),
    Topic(
        'wall',
        'eol_msgs/msg/Wall',
        'latched',
        ('montage',),
        ('panel',),
        'the pair on the two walls',
    ),
    Topic(
        'control',
        'eol_msgs/msg/Control',
        'stream',
        ('panel', 'leds', 'tracker', 'replay'),
        ('tracker', 'twin', 'leds', 'grains', 'sound', 'montage', 'panel'),
        'requests of people; from which image on the tracker heeds them',
    ),
    Topic(
        'ready',
        'std_msgs/msg/Empty',
        'latched',
        (),
        ('every node',),
        'startup barrier, without data: a node subscribes once it has discovered its peers',
    ),
    Topic(
        '/diagnostics',
        'diagnostic_msgs/msg/DiagnosticArray',
        'health',
        ('every node',),
        ('panel', 'recorder'),
        'state of every node, once a second',
    ),
    Topic(
        CLOCK,
        'rosgraph_msgs/msg/Clock',
        'clock',
        ('replay',),
        ('every node',),
        'recorded time, for nodes that use_sim_time',
    ),
)

TOPICS: dict[str, Topic] = {row.name: row for row in _ROWS}
