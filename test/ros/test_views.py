# SPDX-License-Identifier: Apache-2.0
"""What ships for RViz, Foxglove and diagnostic_aggregator names what exists in the graph."""

import json
import re
from pathlib import Path

import yaml
from eol_msgs.msg import Block

from eol_ros.ros.health import PERIOD_S
from eol_ros.ros.topics import PUBLISHER_QOS, topic_class
from eol_ros.streams.graph import (
    NAMESPACE,
    NODES,
    TOPICS,
    frame_prefix,
    relative_name,
    status_name,
)
from eol_ros.streams.requests import KINDS

VIEWS = Path(__file__).parents[2] / 'config' / 'view'
DISPLAYS = {  # of rviz_default_plugins
    'MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'PoseArray': 'geometry_msgs/msg/PoseArray',
    'Image': 'sensor_msgs/msg/Image',
    'TF': None,
}


def test_rviz_displays_have_topics_of_their_type_and_a_qos_that_matches():
    data = yaml.safe_load((VIEWS / 'eol.rviz').read_text())['Visualization Manager']
    kinds = []
    for display in data['Displays']:
        kinds.append(display['Class'].removeprefix('rviz_default_plugins/'))
        wanted = DISPLAYS[kinds[-1]]
        if wanted is None:
            continue
        row, topic = TOPICS[relative_name(display['Topic']['Value'])], display['Topic']
        assert row.type_name == wanted
        offered = PUBLISHER_QOS[row.qos].reliability.name.replace('_', ' ').title()
        assert topic['Reliability Policy'] in (offered, 'Best Effort')
        assert topic['Durability Policy'] == 'Volatile'
    assert sorted(kinds) == sorted(DISPLAYS)
    assert data['Global Options']['Fixed Frame'] == frame_prefix('eol') + 'table'


def panels(layout):
    if isinstance(layout, str):
        return [layout]
    return panels(layout['first']) + panels(layout['second'])


def test_foxglove_panels_name_topics_fields_and_services():
    data = json.loads((VIEWS / 'foxglove.json').read_text())
    assert sorted(panels(data['layout'])) == sorted(data['configById'])
    for panel, config in data['configById'].items():
        kind, text = panel.partition('!')[0], json.dumps(config)
        paths = re.findall(r'"(/[\w/]+)((?:\.\w+(?:\[\d+\])?)*)"', text)
        assert paths or kind == 'TF', panel
        for name, fields in paths:
            if kind == 'CallService':
                request = KINDS[relative_name(name)]
                assert request.off and json.loads(config['requestPayload']) == {'data': True}
                continue
            message = topic_class(relative_name(name))()
            if kind == 'Image':
                assert TOPICS[relative_name(name)].type_name.startswith('sensor_msgs/')
            for field in re.findall(r'\.(\w+)', fields):
                assert hasattr(message, field), f'{panel}: {name}{fields}'
                message = getattr(message, field)
                message = Block() if field == 'blocks' else message


def test_the_diagnostic_aggregator_takes_the_states_of_all_nodes():
    data = yaml.safe_load((VIEWS / 'diagnostics.yaml').read_text())['/**']['ros__parameters']
    (prefix,) = data['nodes']['startswith']
    assert [prefix] == data['nodes']['remove_prefix']
    for node in NODES:
        assert status_name(node, NAMESPACE) == prefix + node
    assert data['nodes']['timeout'] > 2 * PERIOD_S
