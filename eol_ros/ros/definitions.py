# SPDX-License-Identifier: Apache-2.0
"""What a bag needs to know of a message type: its definition with all it refers to, and its hash.

Both are read from the `share` folders that ROS packages install, so they are those of the very
types that are on the wire.
"""

import functools
import json
import os
import sys
from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import QoSProfile

from eol_ros.errors import ConfigError
from eol_ros.ros.topics import PUBLISHER_QOS
from eol_ros.streams.definition import parse, references, short
from eol_ros.streams.graph import TOPICS

_SEPARATOR = '=' * 80
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


def share_file(type_name: str, suffix: str) -> Path:
    """Return the installed file of `package/msg/Name`; raise ConfigError when there is none."""
    package, kind, name = type_name.split('/')
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        path = Path(prefix) / 'share' / package / kind / f'{name}{suffix}'
        if path.is_file():
            return path
    raise ConfigError(
        f'{type_name}: no definition in share/{package} of {", ".join(filter(None, prefixes))}; '
        f'install the package {package}'
    )


@functools.cache
def definition(type_name: str) -> str:
    """Return the `ros2msg` schema of `package/msg/Name`: itself, then all it refers to.

    Format of https://mcap.dev/spec/registry#ros2msg: each further type behind a line of 80 `=` and
    a line `MSG: package/Name`.
    """
    waiting, done = [type_name], {type_name}
    parts: list[str] = []
    while waiting:
        current = waiting.pop(0)
        text = share_file(current, '.msg').read_text(encoding='utf-8')
        package, _, name = current.split('/')
        parts.append(text if not parts else f'{_SEPARATOR}\nMSG: {package}/{name}\n{text}')
        for other in references(parse(text, current)[short(current)]):
            if other not in done:
                done.add(other)
                waiting.append(other)
    return '\n'.join(part.rstrip('\n') for part in parts) + '\n'


@functools.cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of `package/msg/Name` (REP 2011, REP 2016)."""
    data = json.loads(share_file(type_name, '.json').read_text(encoding='utf-8'))
    hashes: dict[str, str] = {h['type_name']: h['hash_string'] for h in data['type_hashes']}
    return hashes[type_name]


def is_installed(type_name: str, recorded: str, recorded_hash: str) -> bool:
    """Return whether a recorded definition of a type is the installed one.

    Where no hash was recorded, they are compared field by field.
    """
    if recorded_hash:
        return recorded_hash == type_hash(type_name)
    theirs, ours = (
        {kind: [field[:3] for field in message.fields] for kind, message in found.items()}
        for found in (parse(recorded, type_name), parse(definition(type_name), type_name))
    )
    return all(fields == ours.get(kind) for kind, fields in theirs.items())


def qos_text(profile: QoSProfile) -> str:
    """Return a one-item YAML list, as rosbag2's metadata version 9 says a publisher's QoS."""
    data = {
        'history': profile.history.name.lower(),
        'depth': profile.depth,
        'reliability': profile.reliability.name.lower(),
        'durability': profile.durability.name.lower(),
        'deadline': dict(_FOREVER),
        'lifespan': dict(_FOREVER),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(_FOREVER),
        'avoid_ros_namespace_conventions': False,
    }
    text: str = yaml.safe_dump([data], sort_keys=False)
    return text


def describe(topic: str) -> dict[str, Any]:
    """Return type, definition, hash and offered QoS of a topic of the table, as a bag has them."""
    row = TOPICS[topic]
    return {
        'type': row.type_name,
        'definition': definition(row.type_name),
        'type_hash': type_hash(row.type_name),
        'qos': qos_text(PUBLISHER_QOS[row.qos]),
    }
