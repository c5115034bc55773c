# SPDX-License-Identifier: Apache-2.0
"""Definitions and hashes of installed types, against what rosbags works out by itself."""

import pytest
import yaml

from eol_ros.errors import ConfigError
from eol_ros.ros.definitions import definition, describe, qos_text, type_hash
from eol_ros.ros.topics import PUBLISHER_QOS, QOS
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
