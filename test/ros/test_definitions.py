# SPDX-License-Identifier: Apache-2.0
"""Definitions and hashes of installed types, against what rosbags works out by itself."""

import numpy as np
import pytest
import yaml
from eol_msgs.msg import BlockTap, Cascade, FeltSlip, GrainTrigger, Slip
from rclpy.serialization import serialize_message
from std_msgs.msg import Empty

from eol_ros.errors import ConfigError
from eol_ros.ros.definitions import definition, describe, qos_text, type_hash
from eol_ros.ros.stamps import to_msg, to_ns
from eol_ros.ros.topics import PUBLISHER_QOS, QOS, type_name
from eol_ros.streams.cdr import Flat
from eol_ros.streams.graph import TOPICS

OTHERS = {'sensor_msgs/msg/PointCloud2', 'std_msgs/msg/Empty', 'rosgraph_msgs/msg/Clock'}
TYPES = sorted({row.type_name for row in TOPICS.values()} | OTHERS)


@pytest.mark.parametrize('name', TYPES)
def test_rosbags_and_mcap_ros2_understand_the_definition(name):
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(definition(name), name))
    assert store.hash_rihs01(name) == type_hash(name)
    dynamic = pytest.importorskip('mcap_ros2._dynamic')
    assert name in dynamic.generate_dynamic(name, definition(name))


def test_a_bag_has_the_qos_that_is_offered():
    [qos] = yaml.safe_load(describe('camera/image_raw')['qos'])
    assert qos['depth'] == PUBLISHER_QOS['images'].depth < QOS['images'].depth


def test_qos_is_what_rosbag2_writes():
    [qos] = yaml.safe_load(qos_text(QOS['latched']))
    assert (qos['history'], qos['reliability'], qos['durability']) == (
        'keep_last',
        'reliable',
        'transient_local',
    )
    metadata = pytest.importorskip('rosbags.rosbag2.metadata')
    [parsed] = metadata.parse_qos(qos_text(QOS['latched']))
    assert (parsed.durability.name, parsed.depth) == ('TRANSIENT_LOCAL', 10)


def test_describe_and_unknown_types():
    assert describe('blocks')['type'] == 'eol_msgs/msg/Blocks'
    with pytest.raises(ConfigError, match='install the package no_such_msgs'):
        definition('no_such_msgs/msg/Thing')


@pytest.mark.parametrize('kind', [Slip, FeltSlip, GrainTrigger, BlockTap])
def test_flat_messages_are_read_as_rclpy_does(kind):
    flat, rng = Flat.of(type_name(kind), definition(type_name(kind))), np.random.default_rng(1)
    for frame, read in {'table': True, 'eol/table': False, 'there': True}.items():
        message = kind()
        for name, type_ in kind.get_fields_and_field_types().items():
            if type_ in ('double', 'float'):
                setattr(message, name, float(np.float32(rng.normal())))
            elif type_.startswith(('int', 'uint')):
                setattr(message, name, int(rng.integers(0, 200)))
            elif type_ == 'boolean':
                setattr(message, name, True)
        message.header.stamp = to_msg(10**18 + int(rng.integers(0, 10**12)))
        message.header.frame_id = frame
        raw = serialize_message(message)
        found = flat.read(raw)
        assert (found is not None) == read  # of another length: rclpy reads it
        if read:
            for name in kind.get_fields_and_field_types():
                ours, theirs = getattr(found, name), getattr(message, name)
                if name == 'header':
                    assert ours.frame_id == frame
                    ours, theirs = ours.stamp, theirs.stamp
                assert to_ns(ours) == to_ns(theirs) if hasattr(ours, 'sec') else ours == theirs
            assert flat.read(raw[:-9]) is None
    for other in (Cascade, Empty):
        assert Flat.of(type_name(other), definition(type_name(other))) is None
