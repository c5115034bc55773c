# SPDX-License-Identifier: Apache-2.0
"""Names of topics, frames and nodes in a namespace."""

import pytest

from eol_ros.streams.graph import (
    TOPICS,
    frame_prefix,
    full_name,
    namespace_of,
    relative_name,
    status_name,
    topic_of,
)

SPACES = ('eol', 'north', 'museum/north', '')


@pytest.mark.parametrize('namespace', SPACES)
def test_a_name_goes_to_the_graph_and_back(namespace):
    for name, row in TOPICS.items():
        full = full_name(name, namespace)
        assert full.startswith('/') and '//' not in full
        assert relative_name(full, namespace) == name
        assert topic_of(full, namespace) is row
    assert topic_of('/else/slips', namespace) is None
    assert full_name('/else/where', namespace) == '/else/where'
    assert relative_name('/else/where', 'eol') == '/else/where'


def test_diagnostics_are_those_of_the_whole_domain():
    assert full_name('diagnostics', 'north') == full_name('/diagnostics') == '/diagnostics'
    assert status_name('tracker', 'museum/north') == 'museum/north: tracker'


@pytest.mark.parametrize('namespace', SPACES)
def test_the_namespace_of_a_recording_is_where_most_of_the_table_are(namespace):
    types = {full_name(name, namespace): row.type_name for name, row in TOPICS.items()}
    types |= {'/other/camera/image_raw': 'sensor_msgs/msg/Image', '/other/slips': 'x/msg/Slip'}
    assert namespace_of(types) == namespace


def test_a_recording_of_others_is_in_no_namespace_of_ours():
    assert namespace_of({'/eol/point': 'geometry_msgs/msg/Point', '/a/blocks': 'x/msg/Y'}) == 'eol'
    assert namespace_of({'/myblocks': 'eol_msgs/msg/Blocks'}) == 'eol'


def test_frames_carry_another_namespace_than_the_usual_one():
    assert [frame_prefix(space) for space in SPACES[:3]] == ['', 'north/', 'museum/north/']
